"""Intervals, quartiles and paired comparisons.

Intervals of means come from the bootstrap (bias-corrected and accelerated, ``scipy.stats.bootstrap``). Where all values are
equal, as when every episode succeeds, resampling them says nothing and would show an interval of zero width: success
rates then get the exact (Clopper-Pearson) interval of a binomial proportion, other means none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from agents.evaluation.resampling import Interval, bootstrap, drawn, mean_of, percentiles
from vibgym.policies.rollout import Outcomes


class Quartiles(NamedTuple):
    """25, 50 and 75 % of a sample; nan of an empty one."""

    lower: float
    median: float
    upper: float


@dataclass(frozen=True)
class PairedComparison:
    """Two policies on the same seeds of a task and the same hardware; differences are first minus second."""

    task: str
    hardware: str
    first: str
    second: str
    episodes: int
    success_difference: float
    success_interval: Interval
    both: int  # seeds on which both succeed
    time_difference: float  # s, mean over those; nan if there are none
    time_interval: Interval | None  # None if there are fewer than two, or all differences are equal

    def turned(self) -> PairedComparison:
        """The same comparison with the policies in the other order."""
        time = self.time_interval
        return replace(
            self,
            first=self.second,
            second=self.first,
            success_difference=-self.success_difference,
            success_interval=self.success_interval.negative(),
            time_difference=-self.time_difference,
            time_interval=None if time is None else time.negative(),
        )


def exact(successes: int, episodes: int, level: float) -> Interval:
    """Clopper-Pearson interval of a proportion."""
    found = stats.binomtest(successes, episodes).proportion_ci(level, method="exact")
    return Interval(float(found.low), float(found.high), "Clopper-Pearson")


def success_interval(success: np.ndarray, level: float, resamples: int) -> Interval:
    """Interval of a success rate from ``success``, bool, (episodes,) or (runs, episodes).

    Where all runs do alike in all episodes it is the exact one of as many episodes as one run has: runs on the same episodes
    are no more of them.
    """
    table = np.atleast_2d(success)
    runs, episodes = table.shape
    if table.all() or not table.any():
        return exact(int(table[0].sum()), episodes, level)
    if runs == 1:
        return bootstrap(table[0].astype(np.float64), level, resamples)
    return percentiles(drawn(mean_of(table), runs, episodes, resamples), level, runs)


def difference_interval(first: np.ndarray, second: np.ndarray, level: float, resamples: int) -> Interval:
    """Interval of the difference of two success rates from paired outcomes, each (n,) bool.

    Pairs are resampled whole. If all differences are equal the exact interval stands in: without any seed on which the
    outcomes differ, the rate of such seeds in either direction is below its upper bound.
    """
    difference = first.astype(np.float64) - second.astype(np.float64)
    if np.ptp(difference) > 0.0:
        return bootstrap(difference, level, resamples)
    n, sign = len(difference), float(difference[0])
    if sign == 0.0:
        bound = exact(0, n, level).high
        return Interval(-bound, bound, "Clopper-Pearson")
    bound = exact(n, n, level).low
    return Interval(min(sign * bound, sign), max(sign * bound, sign), "Clopper-Pearson")


def median_interval(sample: np.ndarray, level: float) -> Interval:
    """Exact confidence interval of a median from ``sample`` (n,): between two values of the sample (Conover, "Practical
    nonparametric statistics", 1999, section 3.2). One of few values that has too low a level is the whole sample."""
    ordered, tail = np.sort(sample), 0.5 - 0.5 * level
    below = max(int(stats.binom.ppf(tail, len(sample), 0.5)) - 1, 0)
    return Interval(float(ordered[below]), float(ordered[len(sample) - 1 - below]), "order statistics")


def quartiles(values: np.ndarray) -> Quartiles:
    """Quartiles of the finite ``values``."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return Quartiles(np.nan, np.nan, np.nan)
    return Quartiles(*(float(each) for each in np.percentile(finite, [25.0, 50.0, 75.0])))


def compare(
    hardware: str, names: tuple[str, str], first: Outcomes, second: Outcomes, level: float, resamples: int
) -> PairedComparison:
    """Compare two policies seed by seed.

    Raises:
        ValueError: the rollouts are not of the same task and seeds.
    """
    if (first.task, first.seeds) != (second.task, second.seeds):
        raise ValueError(f"{names[0]} and {names[1]}: a paired comparison needs the same task and the same seeds")
    both = first.success & second.success
    times = (first.time_to_goal - second.time_to_goal)[both]
    # Times are whole steps: equal ones differ by rounding at most.
    spread = len(times) > 1 and np.ptp(times) > 1e-9
    return PairedComparison(
        task=first.task,
        hardware=hardware,
        first=names[0],
        second=names[1],
        episodes=len(first.seeds),
        success_difference=float(first.success.mean() - second.success.mean()),
        success_interval=difference_interval(first.success, second.success, level, resamples),
        both=int(both.sum()),
        time_difference=float(times.mean()) if len(times) else float("nan"),
        time_interval=bootstrap(times, level, resamples) if spread else None,
    )
