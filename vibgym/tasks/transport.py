"""Transport: bring the part to a position."""

from __future__ import annotations

import math

import numpy as np

from vibgym.tasks.pose import PoseTask


class Transport(PoseTask):
    """The centre within 5 mm of a goal position anywhere on the surface; the heading is free."""

    position_tolerance = 0.005
    draws = 5
    FACTS = ("is_success", "position_error", "fallen", "diverged")

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        heading = 2.0 * math.pi * uniform[:, 2] - math.pi
        start = np.column_stack([self.somewhere(uniform[:, 0:2]), heading])
        goal = np.column_stack([self.somewhere(uniform[:, 3:5]), heading])
        return start, goal
