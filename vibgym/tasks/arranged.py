"""Tasks whose parts start scattered or in a heap, and are done all at once: the common core of Sort and Singulate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import HOLD_PERIODS, Start, Task
from vibgym.tasks.starts import Starts


class ArrangedTask(Task):
    """Parts without goals of their own, each done under conditions that all of them have to meet at once for 10 periods.

    Args:
        surface: the table.
        parts: the parts; those with the same name are of one kind, and there are at most three kinds.
        start: ``"scattered"`` (random poses at least 2 mm apart), ``"crowded"`` (one heap, in touch) or ``"pattern"``; or a
            mapping with ``kind`` and settings, see :data:`vibgym.tasks.starts.STARTS`.
        randomize: ``{"parts": [low, high]}``: so many of the parts, chosen at random, are there in an episode.
        slots: blocks of the state observation, at least the number of parts, which is the default.
        apart: m, distance to the nearest other part above which a part is done; None: it does not count.
        hold: see :class:`vibgym.tasks.Task`.

    Raises:
        ValueError: a bad setting, or too little room on the surface.
    """

    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 3
    TERMS = {
        "distance": ("distance", 1.0),
        "inside": ("inside", 1.0),
        "clearance": ("clearance", 1.0),
        "time": ("time", 0.003),  # costs less over an episode than a fall, so that falling does not pay
        "success": ("success", 5.0),
        "fallen": ("fallen", 5.0),
    }
    FACTS = ("is_success", "position_error", "clearance", "touching", "parts_done", "fallen", "diverged")
    FEATURES = (
        "present", "kind", "element", "heading", "position", "way", "way_coarse", "velocity", "spin", "gap", "neighbour"
    )  # fmt: skip

    RANDOMIZED = ("parts",)

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        *,
        start: str | Mapping[str, Any] = "scattered",
        randomize: Any = None,
        slots: int | None = None,
        apart: float | None = None,
        hold: int = HOLD_PERIODS,
    ) -> None:
        super().__init__(surface, parts, hold=hold)
        if apart is not None:
            self.apart = apart
        self.slots = len(self.parts)
        if slots is not None:
            self.slots = checks.count("slots", slots, least=len(self.parts), most=10_000)
        self.starts = Starts(surface, self.parts, start, randomize, self.apart)
        self.draws = self.starts.draws

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        pose, there = self.starts.draw(uniform, present)
        return Start(pose, there, np.zeros_like(pose))
