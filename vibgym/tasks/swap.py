"""Swap: two kinds of parts exchange the ends of the table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import Length
from vibgym.tasks.base import Start, Task
from vibgym.tasks.pose import PATIENT_TERMS, PoseTask
from vibgym.tasks.starts import DrawnParts, Scattered, pose_of_absent

APART = 0.005
"""m, least distance between goals, and between starts."""

END_COLUMNS = 13
"""Elements along x of an end: room for fifteen of the shipped blocks at any heading."""


class Swap(Task):
    """Every part within 5 mm and 5 degrees of a pose at the other end, all of them at once for ten periods; none has fallen.

    Parts of the first kind start scattered over the left end, those of the second over the right end. Their goals, drawn in
    the same way, are at the other end, so all have to pass one another on the way. Headings count modulo a part's symmetry.

    Raises:
        ValueError: another number of kinds, or ends that overlap or are too small.
    """

    class Settings(Task.Settings):
        """Settings of Swap."""

        free: bool = True
        """Whether parts of a kind are interchangeable. If so, goals are assigned at the start with the least sum of cubed
        distances, and two parts exchange theirs after a step where that shortens their distances."""

        apart: Length = Field(default=APART, ge=0.0)
        """Least distance between goals, and between starts."""

        columns: int = Field(default=END_COLUMNS, ge=1)
        """Elements along x of each end; at most half of the surface's."""

        randomize: DrawnParts = DrawnParts()
        """Number of parts in an episode."""

    settings: Settings

    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 8
    TERMS = PATIENT_TERMS
    FEATURES = ("present", "kind", *PoseTask.FEATURES, "gap", "neighbour")
    RANDOMIZED = ("parts",)
    has_goal = True
    position_tolerance = 0.005
    heading_tolerance = math.radians(5.0)
    modulo_symmetry = True

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        if len(self.kinds) != 2:
            kinds = f"{len(self.kinds)} kinds: {', '.join(self.kinds)}"
            raise checks.refuse("parts", kinds, "parts of two kinds (names)")
        own, most = self.settings, surface.columns // 2
        if own.columns > most:
            raise checks.refuse(
                "task_settings.columns", own.columns, f"a whole number <= {most}, half of the surface's"
            )
        self.exchanges = own.free
        self._whole = Scattered(surface, self.parts, own.randomize.parts)
        end = replace(surface, columns=own.columns)
        self._own = [self.kind == k for k in range(2)]
        kinds = ([part for part, its in zip(self.parts, mine, strict=True) if its] for mine in self._own)
        self._ends = [Scattered(end, group, apart=own.apart, clear=own.apart) for group in kinds]
        self._far = surface.width - end.width
        self.draws = 1 + len(self.parts) + 2 * sum(end.draws for end in self._ends)

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        parts = len(self.parts)
        if present is None:
            present = self._whole.draw_present(uniform)
        pose, goal = (np.zeros((len(uniform), parts, 3)) for _ in range(2))
        at = 1 + parts
        for k, (own, end) in enumerate(zip(self._own, self._ends, strict=True)):
            for places, side in ((pose, k), (goal, 1 - k)):
                drawn, _ = end.draw(uniform[:, at : at + end.draws], present[:, own])
                drawn[..., 0] += side * self._far
                places[:, own] = drawn
                at += end.draws
        pose = np.where(present[..., None], pose, pose_of_absent(self.surface))
        goal = np.where(present[..., None], goal, 0.0)
        start = Start(pose, present, goal)
        return start._replace(goal=self.goal_from(start, pose))
