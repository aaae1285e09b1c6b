"""The planar model with several parts in a world, or walls."""

from __future__ import annotations

from functools import partial

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.broad_phase import CALLS, CONTACT, COUNTS, FREE, NEAR
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.physics.planar.friction import slide_rows
from vibgym.simulation.contacts import CONTACTS, ContactModel
from vibgym.simulation.contacts.base import check_contact_steps, check_masses
from vibgym.simulation.model import NO_PATHS, Conditions, Model, Setup
from vibgym.simulation.schemes import PlanarSettings
from vibgym.simulation.threads import Pool

STATISTICS = {"free": FREE, "near": NEAR, "contact": CONTACT, "contact_steps": CALLS}


class Multibody(Model):
    """Advances worlds with several parts or walls by a contact model.

    Attributes:
        counts: (worlds, 4) periods and contact steps since the reset, see :data:`STATISTICS`.
    """

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup)
        self.cost = 7.0 * len(setup.parts)
        self._contacts = Pool(partial(CONTACTS.choose("model.contacts", settings.contacts), setup, settings))
        self.most_overlap, self._bend = self._contacts.lend(lambda contacts: (contacts.most_overlap, contacts.bend))
        self.counts = np.zeros((setup.worlds, COUNTS), dtype=np.int64)
        self._smallest_gap = np.zeros(setup.worlds)

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        def work(contacts: ContactModel) -> None:
            contacts.load(stop - start)
            for _ in range(periods):
                near = contacts.find(start, stop, state.address)
                self.slide(start, contacts, drive.address, state.address, near)
                if near:
                    contacts.resolve(start, stop, drive, state, self.counts, self._smallest_gap)
                else:
                    self.counts[start:stop, FREE] += 1
                self.end_period(start, stop, state.address)

        self._contacts.lend(work)

    def slide(self, start: int, contacts: ContactModel, drive: int, state: int, near: bool) -> None:
        """Advance the parts of a block's worlds that touch nothing by a period.

        Args:
            start: first world of the block.
            drive, state: addresses of pinned records.
            near: whether other parts may touch; then paths are recorded.
        """
        block, base = contacts.block.record, start * len(self.setup.parts)
        for alone, rows in contacts.alone.split(block.rows, block.count):
            slide_rows(rows, alone.address, drive, state, 1, contacts.paths if near else NO_PATHS, base)

    def end_period(self, start: int, stop: int, state: int) -> None:
        """Finish a period of a block's worlds, after contacts have been resolved."""

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        self.check_contacts(conditions, where)
        super().check_conditions(conditions, where)

    def check_contacts(self, conditions: Conditions, where: str) -> None:
        """Raise ValueError for masses that are too different, and friction that requires too many contact steps."""
        if not len(conditions.incline):
            return
        parts, surface = self.setup.parts, self.setup.surface
        check_masses(where.format("mass"), parts, conditions.mass)
        roughest = parts.largest(lambda part: part.most_friction)
        friction = (conditions.strongest * [part.most_friction for part in roughest]).max(axis=1)
        hardest = np.argmax(friction * surface.gravity + 0.5 * conditions.slope)
        own, incline = float(friction[hardest]), float(conditions.slope[hardest])
        check_contact_steps(where.format(conditions.stronger), surface, own, incline, self._bend)

    def reset(self) -> None:
        self.counts[:] = 0
        self._smallest_gap[:] = 0.0

    def deepest_overlap(self) -> float:
        return -float(self._smallest_gap.min())

    def statistics(self, periods: int) -> dict[str, int]:
        return {name: int(self.counts[:, column].sum()) for name, column in STATISTICS.items()}
