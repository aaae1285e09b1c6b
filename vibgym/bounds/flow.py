"""The most parts a minute that can pass a table from an inlet to the gates of their kinds, whatever the elements do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds.tables import FREE_END, Hold, fewest_periods, way_reach
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface


@dataclass(eq=False)
class FlowBound:
    """Most good parts in the counted time of an episode, and a minute: what slots and gates have time for.

    Each of the parts is a slot: one that leaves makes room for the next, which begins at rest at the inlet. So between two that
    leave from a slot there are a step and the least time for the way from inlet to gate. Through a gate good parts come no
    sooner than a headway after one another. Of moments that are ``d`` apart at least, ``1 + (n - 1) // d`` find room in ``n``
    periods. Nothing else counts: parts are not in each other's way, and the inlet never waits.

    Args:
        surface: the table.
        parts: one of every slot.
        kind: (parts,) whole numbers, which gate a part's own is.
        way: (parts,) m, from where it may arrive to its gate, at least.
        headway: periods between good parts through the same gate.
        periods: that count.
        periods_per_step: oscillation periods of a step; parts arrive and leave when one ends.
        amplitude: m, largest vertical amplitude that an element may reach; None: the surface's.

    Raises:
        ValueError: a bad argument.
    """

    surface: Surface
    parts: Sequence[Part]
    kind: Any
    way: Any
    headway: int
    periods: int
    periods_per_step: int = 1
    amplitude: float | None = None

    def __post_init__(self) -> None:
        number, stride = len(self.parts), checks.count("periods_per_step", self.periods_per_step)
        kind = checks.array("kind", self.kind, (number,), dtype=np.int64)
        way = checks.array("way", self.way, (number,), least=0.0)
        gate = _steps(checks.count("headway", self.headway, least=0), stride)
        moments = checks.count("periods", self.periods, least=0) // stride
        full = self.surface.full_scale / self.surface.angular_frequency**2
        amplitude = full if self.amplitude is None else checks.number("amplitude", self.amplitude, least=0.0, most=full)
        passes = np.zeros(number, dtype=np.int64)
        for k, part in enumerate(self.parts):
            reach = way_reach(self.surface, part.friction, amplitude, FREE_END, Hold(1, 1))
            transit = _steps(int(fewest_periods(reach, way[k : k + 1])[0]), stride)
            passes[k] = _fitting(moments, transit + 1)
        self.transit = self.surface.period * stride * transit
        """s, least from arrival to leaving, of the last part."""
        self.most = int(sum(min(passes[kind == one].sum(), _fitting(moments, gate)) for one in np.unique(kind)))
        """Parts in the time that counts."""

    @property
    def per_minute(self) -> float:
        """Parts a minute of the time that counts; nan without any."""
        return 60.0 * self.most / (self.surface.period * self.periods) if self.periods else math.nan


def _steps(periods: int, stride: int) -> int:
    """Whole steps, one at least."""
    return max(-(-periods // stride), 1)


def _fitting(moments: int, apart: int) -> int:
    """How many of so many moments can be chosen that are so far apart."""
    return 1 + (moments - 1) // apart if moments > 0 else 0
