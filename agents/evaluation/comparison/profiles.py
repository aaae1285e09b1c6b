"""Performance profiles: the share of the episodes that are solved within a multiple of their bounds, or within a time.

Score distributions as Agarwal et al. draw them ("Deep reinforcement learning at the edge of the statistical precipice",
NeurIPS 2021), after Dolan and Moré (Mathematical Programming 91, 2002): of two curves the upper one is of the better policy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.comparison.sample import Sample
from agents.evaluation.resampling import drawn, mean_of
from agents.evaluation.statistics import exact
from agents.evaluation.tables import WORTH_SHOWING

POINTS = 200
"""Of a curve."""


@dataclass(frozen=True)
class Profile:
    """The curves of all policies on one task and hardware.

    Attributes:
        unit: of ``limits``: "bound", multiples of each episode's least time, or "s".
        limits: (points,) ascending.
        curves: policy -> (3, points): share solved within the limit, and the lower and upper ends of its pointwise interval.
    """

    task: str
    hardware: str
    unit: str
    limits: np.ndarray
    curves: dict[str, np.ndarray]

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        curves = {
            name: dict(zip(("share", "low", "high"), np.round(curve, 6).tolist(), strict=True))
            for name, curve in self.curves.items()
        }
        head = {"task": self.task, "hardware": self.hardware, "unit": self.unit}
        return {**head, "limits": np.round(self.limits, 6).tolist(), "curves": curves}


def profile(place: tuple[str, str], samples: Mapping[str, Sample], confidence: float, resamples: int) -> Profile:
    """The profiles of policies on the same episodes.

    Multiples of the bound count where the bound of every episode is known to all, seconds else.

    Args:
        place: task and hardware.
        samples: of the policies, by name.
        confidence: level of the bands.
        resamples: draws of the bootstrap.
    """
    bounded = all(sample.bounded for sample in samples.values())
    needed = {
        name: np.where(sample.success, sample.time_over_bound if bounded else sample.time_to_goal, np.inf)
        for name, sample in samples.items()
    }
    limits = _limits(list(needed.values()), 1.0 if bounded else 0.0)
    curves = {name: _curve(table, limits, confidence, resamples) for name, table in needed.items()}
    return Profile(*place, "bound" if bounded else "s", limits, curves)


def _limits(tables: list[np.ndarray], start: float) -> np.ndarray:
    """From ``start`` to a little beyond the last success of all policies that ever succeed to speak of."""
    last = [float(table[np.isfinite(table)].max()) for table in tables if np.isfinite(table).mean() >= WORTH_SHOWING]
    return np.linspace(start, max(start + 1.1 * (max(last, default=start) - start), start + 1e-3), POINTS)


def _curve(needed: np.ndarray, limits: np.ndarray, confidence: float, resamples: int) -> np.ndarray:
    """Share, low, high (3, points) of a table (runs, episodes)."""
    runs, episodes = needed.shape
    # Times are whole steps: a limit takes what is equal to it, but for rounding.
    solved = needed[..., None] <= limits + 1e-9
    draws = drawn(mean_of(solved), runs, episodes, resamples)
    tails = [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
    low, high = np.quantile(draws, tails, axis=0)
    # Where all or none are solved resampling says nothing: the band is the exact one, as that of a success rate is.
    all_solved, none_solved = solved.all(axis=(0, 1)), ~solved.any(axis=(0, 1))
    low[all_solved] = exact(episodes, episodes, confidence).low
    high[none_solved] = exact(0, episodes, confidence).high
    return np.stack([solved.mean(axis=(0, 1)), low, high])
