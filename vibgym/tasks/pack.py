"""Pack: bring the parts to the poses of a pattern, close together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import bound
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import Start
from vibgym.tasks.patterns import Pattern
from vibgym.tasks.pose import PATIENT_TERMS, PoseTask
from vibgym.tasks.scoring import Scoring, Stage
from vibgym.tasks.sort import ArrangedTask


class Pack(ArrangedTask):
    """Every part in its place of a pattern, within 1 mm and 3 degrees, all of them at once for ten periods; none has fallen.

    By default the pattern is a lattice with gaps of 2 mm at a drawn place. Headings count modulo a part's symmetry. With fewer
    parts than goals the last goals of each kind stay open.
    """

    class Settings(ArrangedTask.Settings, Pattern.Settings):
        """Settings of Pack, among them those of its pattern."""

        free: bool = True
        """Whether parts of a kind are interchangeable, as in Swap. If not, each part has the goal of its number among its
        kind's."""

    settings: Settings

    DEFAULT_PARTS = ("aluminium_block",) * 12
    TERMS = PATIENT_TERMS
    FEATURES = ("present", "kind", *PoseTask.FEATURES, "gap", "neighbour")
    has_goal = True
    position_tolerance = 0.001
    heading_tolerance = math.radians(3.0)
    modulo_symmetry = True

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        self.exchanges = self.settings.free
        self.pattern = Pattern(surface, self.parts, self.settings)
        self.draws, self.goal_gap = self.starts.draws + self.pattern.draws, self.pattern.gap

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        pose, there = self.starts.draw(uniform[:, : self.starts.draws], present)
        goals = self.pattern.draw(uniform[:, self.starts.draws :])
        if not self.settings.free:
            return Start(pose, there, self.pattern.own(goals, there))
        start = Start(pose, there, self.pattern.first(goals, there))
        return start._replace(goal=self.goal_from(start, pose))

    def scoring(self, state: State, periods: int) -> PatternScoring:
        return PatternScoring(self.rules(periods), self.part_kinds, state, self.kind if self.exchanges else None)


class PatternScoring(Scoring):
    """Measures how far the parts are from their pattern: m, root of the mean square distance to the goals."""

    MEASURED = ("pattern_error",)

    def measure(self) -> list[Stage]:
        return [bound(update_pattern_error, self.relations.error, self.episode.present, self.measured["pattern_error"])]


@jit
def update_pattern_error(error, present, pattern_error, worlds):
    """Compute the root of the mean square distance to the goals, m, of the present parts of ``worlds`` (n,).

    Args:
        error: (worlds, parts, 3) m, m, rad.  present: (worlds, parts) bool.
        pattern_error: (worlds,), overwritten.
    """
    for k in range(worlds.shape[0]):
        world, squares, count = worlds[k], 0.0, 0
        for i in range(error.shape[1]):
            if present[world, i]:
                squares += error[world, i, 0] ** 2 + error[world, i, 1] ** 2
                count += 1
        pattern_error[world] = math.sqrt(squares / max(count, 1))
