"""Align: bring the part to a pose."""

from __future__ import annotations

import math

import numpy as np

from vibgym.scene.parts import Part
from vibgym.tasks.base import looks_same_after
from vibgym.tasks.pose import PoseTask


class Align(PoseTask):
    """The centre within 2 mm and the heading within 3 degrees of a goal pose anywhere on the surface.

    Headings that look the same are the same: they count modulo the part's symmetry (180 degrees for a rectangle).
    """

    position_tolerance = 0.002
    heading_tolerance = math.radians(3.0)
    draws = 6

    def heading_period(self, part: Part) -> float:
        return looks_same_after(part)

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        headings = 2.0 * math.pi * uniform[:, 4:6] - math.pi
        start = np.column_stack([self.somewhere(uniform[:, 0:2]), headings[:, 0]])
        goal = np.column_stack([self.somewhere(uniform[:, 2:4]), headings[:, 1]])
        return start, goal
