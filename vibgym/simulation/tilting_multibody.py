"""``model="tilting"`` with several parts in a world, or walls: the planar model's contacts, and parts above the plane between
them.

A tilted part takes part in contacts with the footprint that it has when it lies flat. In a period in which it touches another
part or a wall, the planar model says how it moves in the plane, as if it lay flat, and its height and tilt go on as if it were
alone.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from vibgym.physics.collision.multibody import Prospect
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.tilting.records import TiltScheme
from vibgym.physics.tilting.rows import keep_toppled, rock_driven, rock_rows
from vibgym.simulation.conditions import Conditions
from vibgym.simulation.multibody import ContactBuffers, Multibody
from vibgym.simulation.protocol import NO_PATHS, Setup
from vibgym.simulation.schemes import PlanarSchemes
from vibgym.simulation.threads import Pool
from vibgym.simulation.tilting import AbovePlane, rigid_buffers


class TiltingMultibody(AbovePlane, Multibody):
    """The model where parts may touch one another, or walls."""

    def __init__(self, setup: Setup, schemes: PlanarSchemes, scheme: TiltScheme) -> None:
        AbovePlane.__init__(self, setup, scheme)
        Multibody.__init__(self, setup, schemes)
        self._rigid = Pool(partial(rigid_buffers, setup, scheme))

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Those that contacts do not cover are refused."""
        Multibody.check_conditions(self, conditions, where)

    def slide(
        self, start: int, stop: int, buffers: ContactBuffers, prospect: Prospect, drive: int, state: int, near: bool
    ) -> None:
        """See :meth:`vibgym.simulation.multibody.Multibody.slide`."""
        paths, base, tilt = prospect.paths if near else NO_PATHS, start * buffers.parts, self.pinned.address
        rigid = self._rigid.take()
        rock_driven(start, stop, prospect.driven, prospect.found, rigid.address, drive, state, tilt, NO_PATHS)
        for kind, alone in enumerate(buffers.alone):
            rows = prospect.rows[kind, : prospect.count[kind]]
            flat = np.empty_like(rows)
            n = rock_rows(rows, flat, rigid.address, drive, state, tilt, paths, base, prospect.steps[kind])
            if n > 0:
                slide_rows(flat[:n], alone.address, drive, state, 1, paths, base)
        self._rigid.give(rigid)

    def end_period(self, start: int, stop: int, buffers: ContactBuffers, state: int) -> None:
        """See :meth:`vibgym.simulation.multibody.Multibody.end_period`."""
        keep_toppled(start, stop, state, self.pinned.address)
