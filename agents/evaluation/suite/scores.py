"""Scores: 0 for a policy that does nothing, 1 at the bound, task by task, and one figure for all of them.

- Tasks that succeed: an episode scores its least possible time over the time that it took, and 0 without success. (Success
  weighted by length, as in Anderson et al., "On evaluation of embodied navigation agents", 2018, with times for lengths.)
- Tasks whose parts come and go: an episode scores its good parts a minute over the most that are possible.

A task's score is the mean of its episodes, a suite's is the interquartile mean of its tasks': one task that nobody can do, or
that everybody can, says little (Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice",
NeurIPS 2021).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.evaluation.resampling import RNG_SEED, Interval, iqm
from vibgym.policies.measures import Measured


def episode_scores(found: Measured) -> np.ndarray:
    """(episodes,) in [0, 1]; nan where no bound is known."""
    if np.isfinite(found.rate_bound).all():
        return found.rate_over_bound
    return np.where(found.success, found.bound / np.where(found.success, found.time_to_goal, 1.0), 0.0 * found.bound)


def suite_score(tasks: Sequence[np.ndarray]) -> float:
    """Of the episodes' scores of all tasks, each (episodes,)."""
    return float(iqm(np.array([scores.mean() for scores in tasks])))


def suite_interval(tasks: Sequence[np.ndarray], level: float, resamples: int) -> Interval | None:
    """Of :func:`suite_score`: episodes are drawn anew within each task (stratified bootstrap); None where none differ."""
    if all(np.ptp(scores) < 1e-12 for scores in tasks):
        return None
    rng = np.random.default_rng(RNG_SEED)
    means = np.stack(
        [scores[rng.integers(len(scores), size=(resamples, len(scores)))].mean(axis=1) for scores in tasks]
    )
    low, high = np.quantile(iqm(means, axis=0), [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return Interval(float(low), float(high), "stratified percentile bootstrap over episodes")
