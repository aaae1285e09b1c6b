"""How far from the goal poses are, and what that costs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

FINE = (0.002, math.radians(3.0))
"""m, rad: Align's tolerances."""

COARSE = (0.005, math.radians(5.0))


@dataclass(frozen=True, eq=False)
class Errors:
    """Distance from the goal (m) and heading's deviation modulo the part's symmetry (rad), arrays of one shape."""

    distance: np.ndarray
    turn: np.ndarray

    def within(self, tolerance: tuple[float, float]) -> np.ndarray:
        """bool, where both are within a tolerance."""
        return (self.distance <= tolerance[0]) & (self.turn <= tolerance[1])


def errors_of(pose: np.ndarray, goal: np.ndarray, symmetry: int) -> Errors:
    """Errors (...) of poses (..., 3); ``symmetry`` 0, of a disc, makes all headings the same."""
    distance = np.hypot(pose[..., 0] - goal[0], pose[..., 1] - goal[1])
    if symmetry == 0:
        return Errors(distance, np.zeros_like(distance))
    period = 2.0 * math.pi / symmetry
    turn = pose[..., 2] - goal[2]
    return Errors(distance, np.abs(turn - period * np.round(turn / period)))


def cost(errors: Errors) -> np.ndarray:
    """Smooth cost (schedules,) of errors (periods + 1, schedules, trials): the mean over time, and as much for the end.

    A single error, in units of Align's tolerances, costs ``log(1 + e^2)``, so that a part that is far and one that is
    hardly outside are both worth work. The end is the last tenth of the time.
    """
    each = np.log1p((errors.distance / FINE[0]) ** 2 + (errors.turn / FINE[1]) ** 2).mean(axis=-1)
    last = max(len(each) // 10, 1)
    return each.mean(axis=0) + each[-last:].mean(axis=0)
