"""The tilting model with several parts in a world, or walls: contacts of the planar model, rigid bodies between them.

For contacts a tilted part has its flat footprint. In a period in which it touches another part or a wall, the planar model
computes its motion in the plane as that of a flat part; height and tilt are integrated without the contacts.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from vibgym.physics.planar.friction import slide_rows
from vibgym.plugins.tilting.model import AbovePlane, rigid_buffers, sorted_rows
from vibgym.plugins.tilting.period import keep_toppled, rock_rows
from vibgym.plugins.tilting.records import TiltScheme
from vibgym.simulation.contacts import ContactModel
from vibgym.simulation.model import NO_PATHS, Conditions, Setup
from vibgym.simulation.multibody import Multibody
from vibgym.simulation.schemes import PlanarSettings
from vibgym.simulation.threads import Pool


class TiltingMultibody(AbovePlane, Multibody):
    """The model where parts may touch one another, or walls."""

    def __init__(self, setup: Setup, scheme: TiltScheme) -> None:
        Multibody.__init__(self, setup, PlanarSettings())
        AbovePlane.__init__(self, setup, scheme)
        self._rigid = Pool(partial(rigid_buffers, setup, scheme))

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        self.check_contacts(conditions, where)

    def slide(self, start: int, contacts: ContactModel, drive: int, state: int, near: bool) -> None:
        paths, base, tilt = contacts.paths if near else NO_PATHS, start * len(self.setup.parts), self.pinned.address
        block, rigid, inputs = contacts.block.record, self._rigid.take(), (drive, state)
        _, others = sorted_rows(base + np.flatnonzero(block.driven), rigid.address, inputs, tilt, 1)
        rock_rows(others, False, rigid.address, *inputs, tilt, NO_PATHS, 0, 0)
        for alone, rows in contacts.alone.split(block.rows, block.count):
            flat, others = sorted_rows(rows, rigid.address, inputs, tilt, 1)
            rock_rows(others, True, rigid.address, *inputs, tilt, paths, base, alone.record.scheme.steps)
            slide_rows(flat, alone.address, *inputs, 1, paths, base)
        self._rigid.give(rigid)

    def end_period(self, start: int, stop: int, state: int) -> None:
        keep_toppled(start, stop, state, self.pinned.address)
