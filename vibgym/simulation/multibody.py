"""The planar model with several parts in a world, or walls, see :mod:`vibgym.physics.contacts.multibody`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.broad_phase import CONTACT, FREE, NEAR
from vibgym.physics.contacts.coupling import CONTACT_SCENE, ContactScene, Coupling, new_contacts
from vibgym.physics.contacts.multibody import (
    BROAD_PHASE,
    CALLS,
    COUNTS,
    BroadPhase,
    broad_phase,
    new_broad_phase,
    resolve,
)
from vibgym.physics.contacts.solver import new_solver
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.planar.workspace import FixedScene, new_workspace
from vibgym.scene.bodies import bodies_of
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.simulation.alone import Alone
from vibgym.simulation.contact_parts import check_masses, check_parts, impact_properties_of, slop_of
from vibgym.simulation.model import NO_PATHS, Conditions, Model, Setup
from vibgym.simulation.schemes import PlanarSchemes, check_contact_steps
from vibgym.simulation.threads import Pool

STATISTICS = {"free": FREE, "near": NEAR, "contact": CONTACT, "contact_steps": CALLS}


class Multibody(Model):
    """Advances worlds with several parts or walls.

    Args:
        buffers: pool of working arrays; None: of :class:`ContactBuffers`.

    Attributes:
        counts: (worlds, 4) periods and solver calls since the reset, see :data:`STATISTICS`.
    """

    def __init__(self, setup: Setup, schemes: PlanarSchemes, buffers: Pool[Any] | None = None) -> None:
        super().__init__(setup)
        self.cost = 7.0 * len(setup.parts)
        self._bend = min(schemes.bend)
        self._buffers = buffers or Pool(partial(ContactBuffers, setup, schemes))
        self.counts = np.zeros((setup.worlds, COUNTS), dtype=np.int64)
        self._smallest_gap = np.zeros(setup.worlds)  # of a block, at the index of its first world

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        def work(buffers: ContactBuffers) -> None:
            prospect = buffers.prospect(stop - start)
            together, seen, at = buffers.together.address, prospect.address, state.address
            buffers.contacts.deepest[1] = self._smallest_gap[start]
            driven = drive.address
            try:
                for _ in range(periods):
                    near = broad_phase(start, stop, together, at, seen)
                    self.slide(start, stop, buffers, prospect.record, driven, at, near)
                    if near:
                        resolve(start, stop, together, driven, at, seen, self.counts)
                    else:
                        self.counts[start:stop, FREE] += 1
                    self.end_period(start, stop, buffers, at)
            finally:
                self._smallest_gap[start] = buffers.contacts.deepest[1]

        self._buffers.lend(work)

    def slide(
        self, start: int, stop: int, buffers: ContactBuffers, prospect: BroadPhase, drive: int, state: int, near: bool
    ) -> None:
        """Advance the parts of a block's worlds that touch nothing by a period.

        Args:
            drive, state: addresses of pinned records.
            near: whether parts may come into contact; then their paths are recorded.
        """
        paths = prospect.paths if near else NO_PATHS
        for alone, rows in buffers.alone.split(prospect.rows, prospect.count):
            slide_rows(rows, alone.address, drive, state, 1, paths, start * buffers.parts)

    def end_period(self, start: int, stop: int, buffers: ContactBuffers, state: int) -> None:
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


class ContactBuffers:
    """Constants and working arrays of one thread.

    Attributes:
        parts: number of parts of a world.
        together: constants for all parts of a world, with contacts.
        contacts: working arrays of contacts.
        alone: the same for eight parts without contacts.
    """

    def __init__(self, setup: Setup, schemes: PlanarSchemes) -> None:
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        self.parts, hulls = len(setup.parts), hulls_of(setup.parts)
        check_parts(setup.parts)
        most = max(schemes.alone, key=lambda scheme: scheme.substeps)  # for the size of the working arrays
        friction = FixedScene(table, bodies, most, new_workspace(table, bodies, most, self.parts))
        self.contacts = new_contacts(self.parts, hulls)
        together = ContactScene(
            friction, hulls, new_solver(self.parts, len(hulls.rounding)), impact_properties_of(setup.parts),
            self.contacts, coupling_of(setup.parts.every, schemes), schemes.walls,
        )  # fmt: skip
        self.together = Pinned(CONTACT_SCENE, together)
        self.alone = Alone(table, bodies, schemes.alone)
        self._steps = np.array([scheme.steps for scheme in schemes.alone])
        self._prospects: dict[int, Pinned[BroadPhase]] = {}

    def prospect(self, worlds: int) -> Pinned[BroadPhase]:
        """Return working arrays of the broad phase for a block of ``worlds``."""
        if worlds not in self._prospects:
            self._prospects[worlds] = Pinned(BROAD_PHASE, new_broad_phase(worlds, self.parts, self._steps))
        return self._prospects[worlds]


def coupling_of(kinds: Sequence[Part], schemes: PlanarSchemes) -> Coupling:
    """Return the resolution of the coupling between friction and contacts, for kernels."""
    return Coupling(
        steps=np.array([scheme.steps for scheme in schemes.alone]),
        substeps=np.array([scheme.substeps for scheme in schemes.alone]),
        bend=np.array(schemes.bend),
        overlap=np.array(schemes.overlap),
        slop=np.array([slop_of(kind) for kind in kinds]),
        fewest=schemes.fewest,
    )
