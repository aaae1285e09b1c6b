"""Rotate: turn the part in place."""

from __future__ import annotations

import math

import numpy as np

from vibgym.scene.parts import Part
from vibgym.tasks.base import Start
from vibgym.tasks.pose import PoseTask


class Rotate(PoseTask):
    """Turn by a signed angle up to a full turn, ending within 5 mm of the start and 2 degrees of the unwrapped angle."""

    position_tolerance = 0.005
    heading_tolerance = math.radians(2.0)
    draws = 4

    def heading_period(self, part: Part) -> float:
        return 0.0  # a full turn is not the same as none

    def goal_from(self, start: Start, pose: np.ndarray) -> np.ndarray:
        return start.goal + (pose - start.pose)  # in place, wherever that is

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        heading = 2.0 * math.pi * uniform[:, 2] - math.pi
        start = np.column_stack([self.somewhere(uniform[:, 0:2]), heading])
        turn = 4.0 * math.pi * uniform[:, 3] - 2.0 * math.pi
        return start, start + np.column_stack([np.zeros((len(turn), 2)), turn])
