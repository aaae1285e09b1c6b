"""Errors of a run, fronts of cost and error, and costs at equal error.

Strong error, of the trajectory: distance of a point of the part's circle at the end of the run, ``|dx| + R |dtheta|``.

Weak error, of the mean velocity over all worlds, each in the frame of its own true drift ``d`` (as complex numbers), so that
systematic errors along and across it add up and others cancel: ``|sum conj(d) (d' - d)| / sum |d|^2``. With one drift for all
worlds it is the relative error of the mean velocity vector.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Spread(NamedTuple):
    """Median, 95th percentile and maximum over worlds; infinite where worlds have failed."""

    median: float
    p95: float
    worst: float


def strong_errors(pose: np.ndarray, truth: np.ndarray, lever: float) -> np.ndarray:
    """Return (worlds,) ``|dx| + lever |dtheta|``, m; infinite where a pose is not finite.

    Args:
        pose, truth: (worlds, 3), m and rad.
        lever: radius of the part; 0 for a disc, whose heading is not observable.
    """
    off = np.abs(pose - truth)
    errors = np.hypot(off[:, 0], off[:, 1]) + (lever * off[:, 2] if lever else 0.0)
    return np.where(np.isfinite(errors), errors, math.inf)


def spread(errors: np.ndarray) -> Spread:
    """Return median, 95th percentile and maximum, each an error that occurred (no mean of a number and infinity)."""
    if not len(errors):
        return Spread(math.nan, math.nan, math.nan)
    at = np.quantile(errors, [0.5, 0.95], method="higher")
    return Spread(float(at[0]), float(at[1]), float(errors.max()))


def weak_error(drift: np.ndarray, truth: np.ndarray) -> float:
    """Return the relative error of mean velocities (worlds, 2) m/s; infinite if one is not finite."""
    if not np.isfinite(drift).all():
        return math.inf
    right = truth[:, 0] + 1j * truth[:, 1]
    wrong = (drift[:, 0] + 1j * drift[:, 1]) - right
    scale = float(np.sum(np.abs(right) ** 2))
    if scale == 0.0:
        return 0.0 if not wrong.any() else math.inf
    return float(abs(np.sum(np.conj(right) * wrong))) / scale


def pareto(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Return the indices of the points on the Pareto front, cheapest first.

    A point is dominated by one with cost and error at most as large, and one of them smaller. Of equal points the first is
    kept. Points that are not finite are excluded.
    """
    usable = [k for k in range(len(costs)) if math.isfinite(costs[k]) and math.isfinite(errors[k])]
    front: list[int] = []
    for k in sorted(usable, key=lambda k: (costs[k], errors[k], k)):
        if not front or errors[k] < errors[front[-1]]:
            front.append(k)
    return front


def cheapest(costs: Sequence[float], errors: Sequence[float], tolerance: float) -> int | None:
    """Return the index of the cheapest point within ``tolerance``; None if there is none."""
    within = [k for k in range(len(costs)) if math.isfinite(costs[k]) and errors[k] <= tolerance]
    return min(within, key=lambda k: (costs[k], errors[k])) if within else None


def cost_at(costs: Sequence[float], errors: Sequence[float], error: float) -> float | None:
    """Return the cost at which a method reaches ``error``, interpolated on its front in the logarithm of both.

    None if no point is within the error. Costs are not extrapolated: above the error of its cheapest point, the method has the
    cost of that point. A point without error is not interpolated.
    """
    front = pareto(costs, errors)
    if not front or errors[front[-1]] > error:
        return None
    for before, k in zip(front, front[1:], strict=False):
        if errors[k] <= error < errors[before]:
            if errors[k] <= 0.0:
                return costs[k]
            share = math.log(errors[before] / error) / math.log(errors[before] / errors[k])
            return costs[before] * (costs[k] / costs[before]) ** share
    return costs[front[0]]
