"""``model="tilting"`` with several parts in a world, or walls: the planar model's contacts, and parts above the plane between
them.

A tilted part takes part in contacts with the footprint that it has when it lies flat. In a period in which it touches another
part or a wall, the planar model says how it moves in the plane, as if it lay flat, and its height and tilt go on as if it were
alone.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from vibgym.physics.contacts.multibody import Prospect
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.tilting.records import TiltScheme
from vibgym.physics.tilting.rows import keep_toppled, rock_rows
from vibgym.simulation.conditions import Conditions
from vibgym.simulation.multibody import ContactBuffers, Multibody
from vibgym.simulation.protocol import NO_PATHS, Setup
from vibgym.simulation.schemes import PlanarSchemes
from vibgym.simulation.threads import Pool
from vibgym.simulation.tilting import AbovePlane, rigid_buffers, sorted_rows


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
        rigid, told = self._rigid.take(), (drive, state)
        touching = prospect.driven[: stop - start] & (prospect.found[: stop - start] > 0)[:, None]
        _, others = sorted_rows(base + np.flatnonzero(touching), rigid.address, told, tilt, 1)
        rock_rows(others, False, rigid.address, *told, tilt, NO_PATHS, 0, 0)
        for kind, alone in enumerate(buffers.alone):
            rows = prospect.rows[kind, : prospect.count[kind]]
            flat, others = sorted_rows(rows, rigid.address, told, tilt, 1)
            rock_rows(others, True, rigid.address, *told, tilt, paths, base, int(prospect.steps[kind]))
            slide_rows(flat, alone.address, *told, 1, paths, base)
        self._rigid.give(rigid)

    def end_period(self, start: int, stop: int, buffers: ContactBuffers, state: int) -> None:
        """See :meth:`vibgym.simulation.multibody.Multibody.end_period`."""
        keep_toppled(start, stop, state, self.pinned.address)
