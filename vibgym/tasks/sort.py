"""Sort: bring every kind of part into its own zone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.arranged import ArrangedTask
from vibgym.tasks.base import HOLD_PERIODS
from vibgym.tasks.zones import check_room, zones_from


class Sort(ArrangedTask):
    """Every present part's centre inside its kind's zone and slower than 20 mm/s; none has fallen.

    The speed is that of the mean over the last period: a part that slides in place circles at 37 mm/s.

    Args:
        zones: a mapping from kind to [x_low, y_low, x_high, y_high], m; None for end zones.
        start, randomize, slots, hold: see :class:`ArrangedTask`.
    """

    speed_limit = 0.020

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        *,
        start: str | Mapping[str, Any] = "scattered",
        zones: Mapping[str, Sequence[float]] | None = None,
        randomize: Any = None,
        slots: int | None = None,
        hold: int = HOLD_PERIODS,
    ) -> None:
        super().__init__(surface, parts, start=start, randomize=randomize, slots=slots, hold=hold)
        self.zones = zones_from(zones, surface, self.kinds)
        check_room(self.zones, self.parts, self.kinds, self.kind, self.starts.most)
