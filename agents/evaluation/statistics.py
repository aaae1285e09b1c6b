"""Confidence intervals and paired differences of episodes.

Intervals of means and interquartile means of one policy use ``scipy.stats.bootstrap`` (bias-corrected and accelerated). Where
all values are equal, resampling cannot estimate the spread: success rates then have the exact (Clopper-Pearson) interval.

Several training runs of one policy form a table (runs, episodes). All runs share starts and goals, so its cells are not
independent: runs and episodes are resampled separately (Owen, "The pigeonhole bootstrap", Annals of Applied Statistics 1,
2007).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from vibgym.policies.measures import MeasuredOutcomes

RNG_SEED = 20021
"""Seed of all resampling, so that results are reproducible."""

CUT = 0.25
"""Fraction that an interquartile mean drops at either end."""

BATCH_CELLS = 2_000_000
"""Cells resampled at a time: 16 MB."""


@dataclass(frozen=True)
class Interval:
    """Confidence interval and its method, such as "BCa bootstrap" or "Clopper-Pearson"."""

    low: float
    high: float
    method: str


class Quartiles(NamedTuple):
    """Quartiles of a sample; nan if it is empty."""

    lower: float
    median: float
    upper: float


@dataclass(frozen=True)
class Estimate:
    """Difference of two policies, first minus second.

    Attributes:
        value: nan without a pair.
        interval: None where all pairs differ by the same amount.
    """

    value: float
    interval: Interval | None

    @property
    def clear(self) -> bool:
        """Whether the interval excludes zero."""
        return self.interval is not None and (self.interval.low > 0.0 or self.interval.high < 0.0)

    def negative(self) -> Estimate:
        """Return the estimate with the policies exchanged."""
        flipped = self.interval and Interval(-self.interval.high, -self.interval.low, self.interval.method)
        return Estimate(-self.value, flipped)


def bootstrap(values: np.ndarray, level: float, resamples: int, statistic: Callable[..., Any] = np.mean) -> Interval:
    """Return the bootstrap interval of a statistic of ``values`` (n,), which must not all be equal.

    BCa is undefined for some very uneven samples; the percentile interval is used then.
    """
    for method in ("BCa", "percentile"):
        with np.errstate(invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)
            result = stats.bootstrap(
                (values,),
                statistic,
                confidence_level=level,
                n_resamples=resamples,
                batch=1000,
                method=method,
                rng=np.random.default_rng(RNG_SEED),
            )
        low, high = (float(end) for end in result.confidence_interval)
        if np.isfinite([low, high]).all():
            return Interval(low, high, f"{method} bootstrap")
    raise ArithmeticError(f"the bootstrap of {len(values)} values has no finite interval")


def pigeonhole(statistic: Callable[..., np.ndarray], tables: Sequence[np.ndarray], draws: int) -> np.ndarray:
    """Return a statistic of resampled tables (draws,): training runs and episodes are drawn separately, with replacement.

    Args:
        statistic: of arrays (batch, runs x episodes), one for each table, along the last axis.
        tables: (runs, episodes) each, resampled with the same draws.
        draws: number of resamples.
    """
    runs, episodes = tables[0].shape
    rows = np.random.default_rng([RNG_SEED, 1]).integers(runs, size=(draws, runs))[:, :, None]
    columns = np.random.default_rng([RNG_SEED, 0]).integers(episodes, size=(draws, episodes))[:, None, :]
    batch = max(1, BATCH_CELLS // (runs * episodes))
    batches = []
    for start in range(0, draws, batch):
        some = slice(start, start + batch)
        cells = [table[rows[some], columns[some]].reshape(-1, runs * episodes) for table in tables]
        batches.append(statistic(*cells))
    return np.concatenate(batches)


def percentiles(draws: np.ndarray, level: float, runs: int) -> Interval:
    """Return the percentile interval of resampled statistics (draws,); nan is ignored."""
    low, high = np.nanquantile(draws, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    over = "runs and episodes" if runs > 1 else "episodes"
    return Interval(float(low), float(high), f"percentile bootstrap over {over}")


def interval_of(
    table: np.ndarray, level: float, resamples: int, statistic: Callable[..., Any] = np.mean
) -> Interval | None:
    """Return the interval of a statistic of ``table`` (runs, episodes); None where all its cells are equal."""
    runs = len(table)
    if np.ptp(table) < 1e-9:
        return None
    if runs == 1:
        return bootstrap(table[0], level, resamples, statistic)
    return percentiles(pigeonhole(lambda cells: statistic(cells, axis=-1), [table], resamples), level, runs)


def exact(successes: int, episodes: int, level: float) -> Interval:
    """Return the Clopper-Pearson interval of a proportion."""
    interval = stats.binomtest(successes, episodes).proportion_ci(level, method="exact")
    return Interval(float(interval.low), float(interval.high), "Clopper-Pearson")


def success_interval(success: np.ndarray, level: float, resamples: int) -> Interval:
    """Return the interval of a success rate from ``success``, bool, (episodes,) or (runs, episodes).

    If all runs succeed or fail in all episodes, it is the exact interval of one run: runs share their episodes.
    """
    table = np.atleast_2d(success)
    if table.all() or not table.any():
        return exact(int(table[0].sum()), table.shape[1], level)
    interval = interval_of(table.astype(np.float64), level, resamples)
    assert interval is not None
    return interval


def median_interval(sample: np.ndarray, level: float) -> Interval:
    """Return the exact interval of a median from order statistics of ``sample`` (n,).

    Conover, "Practical nonparametric statistics", 1999, section 3.2. For small samples it is the whole range.
    """
    ordered, tail = np.sort(sample), 0.5 - 0.5 * level
    below = max(int(stats.binom.ppf(tail, len(sample), 0.5)) - 1, 0)
    return Interval(float(ordered[below]), float(ordered[len(sample) - 1 - below]), "order statistics")


def quartiles(values: np.ndarray) -> Quartiles:
    """Return the quartiles of the finite ``values``."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return Quartiles(np.nan, np.nan, np.nan)
    return Quartiles(*(float(quartile) for quartile in np.percentile(finite, [25.0, 50.0, 75.0])))


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the interquartile mean: without the lowest and highest quarter, each rounded down to whole values.

    Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS 2021.
    """
    return stats.trim_mean(values, CUT, axis=axis)


def success_difference(first: np.ndarray, second: np.ndarray, level: float, resamples: int) -> Estimate:
    """Return the paired difference of success rates of ``first`` (runs, episodes) and ``second`` (1, episodes), bool.

    If all pairs are equal, the interval is exact: the rate of seeds with different outcomes is below its upper bound.
    """
    gap = first.astype(np.float64) - second
    value = float(gap.mean())
    if np.ptp(gap) > 0.0:
        return Estimate(value, interval_of(gap, level, resamples))
    episodes, sign = gap.shape[1], float(gap[0, 0])
    if sign == 0.0:
        bound = exact(0, episodes, level).high
        return Estimate(value, Interval(-bound, bound, "Clopper-Pearson"))
    bound = exact(episodes, episodes, level).low
    return Estimate(value, Interval(min(sign * bound, sign), max(sign * bound, sign), "Clopper-Pearson"))


def mean_difference(gap: np.ndarray, level: float, resamples: int) -> Estimate:
    """Return the mean of paired differences ``gap`` (runs, episodes); nan marks pairs that are left out."""
    values = gap[np.isfinite(gap)]
    value = float(values.mean()) if len(values) else float("nan")
    # Times are multiples of the step time, so equal ones differ by rounding only.
    if len(values) < 2 or np.ptp(values) < 1e-9:
        return Estimate(value, None)
    if len(gap) == 1:
        return Estimate(value, bootstrap(values, level, resamples))
    return Estimate(value, percentiles(pigeonhole(_finite_mean, [gap], resamples), level, len(gap)))


def _finite_mean(cells: np.ndarray) -> np.ndarray:
    counted = np.isfinite(cells)
    count = counted.sum(axis=-1)
    total = np.where(counted, cells, 0.0).sum(axis=-1)
    return np.divide(total, count, out=np.full(len(cells), np.nan), where=count > 0)


def iqm_difference(first: np.ndarray, second: np.ndarray, level: float, resamples: int) -> Estimate:
    """Return the difference of interquartile means of ``first`` (runs, episodes) and ``second`` (1, episodes)."""
    runs = len(first)
    second = np.repeat(second, runs, axis=0)  # of the same size, so that both drop quarters of the same size
    value = float(iqm(first.ravel()) - iqm(second.ravel()))
    draws = pigeonhole(lambda one, other: iqm(one) - iqm(other), [first, second], resamples)
    return Estimate(value, None if np.ptp(draws) < 1e-9 else percentiles(draws, level, runs))


def episode_scores(measured: MeasuredOutcomes) -> np.ndarray:
    """Return scores in [0, 1] (episodes,); nan where no bound is known.

    Least possible time over time to goal, 0 without success (success weighted by path length, Anderson et al., "On evaluation
    of embodied navigation agents", 2018, with times for lengths). Where parts come and go: good parts over their bound.
    """
    if np.isfinite(measured.rate_bound).all():
        return measured.rate_over_bound
    times = np.where(measured.success, measured.time_to_goal, 1.0)
    return np.where(measured.success, measured.bound / times, 0.0 * measured.bound)


def suite_score(tasks: Sequence[np.ndarray]) -> float:
    """Return the interquartile mean of the tasks' mean scores, each from (episodes,)."""
    return float(iqm(np.array([scores.mean() for scores in tasks])))


def suite_interval(tasks: Sequence[np.ndarray], level: float, resamples: int) -> Interval | None:
    """Return the interval of :func:`suite_score`: episodes are resampled within each task.

    None where it cannot be estimated: in no task do two episodes differ.
    """
    varied = [k for k, scores in enumerate(tasks) if len(scores) > 1 and np.ptp(scores) >= 1e-12]
    if not varied:
        return None

    def score(*samples: np.ndarray, axis: int = -1) -> np.ndarray:
        means = [np.full(samples[0].shape[:-1], scores.mean()) for scores in tasks]
        for k, sample in zip(varied, samples, strict=True):
            means[k] = sample.mean(axis=axis)
        return iqm(np.stack(means), axis=0)

    interval = stats.bootstrap(
        [tasks[k] for k in varied],
        score,
        confidence_level=level,
        n_resamples=resamples,
        batch=1000,
        method="percentile",
        rng=np.random.default_rng(RNG_SEED),
    ).confidence_interval
    return Interval(float(interval.low), float(interval.high), "stratified percentile bootstrap over episodes")
