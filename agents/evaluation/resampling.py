"""Bootstrap of samples, and of tables (runs, episodes): training runs and episodes are both drawn anew.

All runs meet the same starts and goals, so that a hard start is hard in all rows of the table. Drawing its cells one by one
would take them for independent, and give intervals that are too narrow. So runs and episodes are drawn apart from each other,
and a cell counts as often as its row times as often as its column (Owen, "The pigeonhole bootstrap", Annals of Applied
Statistics 1, 2007, 386-411; it errs on the wide side). With one run it is the usual bootstrap over episodes. Paired policies
get the same draws of episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import stats

RNG_SEED = 20021
"""Of the resampling, so that a report can be repeated to the digit."""


CUT = 0.25
"""Share of the values that an interquartile mean leaves out at either end."""

BATCH_CELLS = 2_000_000
"""Cells that are weighted at a time: 16 MB."""

Statistic = Callable[[np.ndarray], np.ndarray]
"""From weights (draws, cells) of the cells of a table, row after row, to (draws,) or (draws, k) values."""


@dataclass(frozen=True)
class Interval:
    """A confidence interval and how it was found: "BCa bootstrap", "percentile bootstrap" or "Clopper-Pearson"."""

    low: float
    high: float
    method: str

    def negative(self) -> Interval:
        """The interval of the negative quantity."""
        return Interval(-self.high, -self.low, self.method)


def bootstrap(values: np.ndarray, level: float, resamples: int, statistic: Callable[..., Any] = np.mean) -> Interval:
    """Interval of the mean of ``values`` (n,), or another ``statistic`` of them; they must not all be equal.

    The corrected method has no answer for some very uneven samples; the plain percentiles are then used, and named.
    """
    for method in ("BCa", "percentile"):
        result = stats.bootstrap(
            (values,),
            statistic,
            confidence_level=level,
            n_resamples=resamples,
            batch=1000,
            method=method,
            rng=np.random.default_rng(RNG_SEED),
        )
        low, high = (float(each) for each in result.confidence_interval)
        if np.isfinite([low, high]).all():
            return Interval(low, high, f"{method} bootstrap")
    raise ArithmeticError(f"the bootstrap of {len(values)} values has no finite interval")


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Interquartile mean: of what is left without the lowest and the highest quarter, each rounded down to whole values.

    Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS 2021.
    """
    return stats.trim_mean(values, CUT, axis=axis)


@lru_cache(maxsize=8)
def _counts(size: int, draws: int, stream: int) -> np.ndarray:
    """How often each of ``size`` items is drawn in each of ``draws`` draws of as many, (draws, size)."""
    rng = np.random.default_rng([RNG_SEED, stream])
    drawn = rng.integers(size, size=(draws, size)) + size * np.arange(draws)[:, None]
    counts = np.bincount(drawn.ravel(), minlength=draws * size).reshape(draws, size)
    counts.setflags(write=False)
    return counts


def weights(runs: int, episodes: int, draws: int) -> Iterator[np.ndarray]:
    """Batches of weights (some draws, runs x episodes), all together ``draws`` of them."""
    of_episodes = _counts(episodes, draws, 0)
    of_runs = _counts(runs, draws, 1)
    batch = max(1, BATCH_CELLS // (runs * episodes))
    for start in range(0, draws, batch):
        some = slice(start, start + batch)
        product = of_runs[some, :, None] * of_episodes[some, None, :]
        yield product.reshape(len(product), runs * episodes).astype(np.float64)


def drawn(statistic: Statistic, runs: int, episodes: int, draws: int) -> np.ndarray:
    """The statistic of every draw, (draws, ...)."""
    return np.concatenate([statistic(each) for each in weights(runs, episodes, draws)])


def mean_of(table: np.ndarray) -> Statistic:
    """Weighted mean of a table (runs, episodes), or of each of several (runs, episodes, k)."""
    cells = table.reshape(table.shape[0] * table.shape[1], *table.shape[2:]).astype(np.float64)
    return lambda weight: weight @ cells / table.shape[0] / table.shape[1]


def mean_where(table: np.ndarray, counted: np.ndarray) -> Statistic:
    """Weighted mean of the cells of a table that are ``counted``; nan of draws that have none of them."""
    cells, counts = np.where(counted, table, 0.0).ravel(), counted.ravel().astype(np.float64)

    def statistic(weight: np.ndarray) -> np.ndarray:
        total = weight @ counts
        return np.divide(weight @ cells, total, out=np.full(len(weight), np.nan), where=total > 0.0)

    return statistic


def iqm_of(table: np.ndarray) -> Statistic:
    """Interquartile mean of a table (runs, episodes) whose cells count several times: :func:`iqm` of all of them."""
    order = np.argsort(table.ravel(), kind="stable")
    cells, total = table.ravel()[order], table.size
    cut = int(CUT * total)

    def statistic(weight: np.ndarray) -> np.ndarray:
        upper = np.cumsum(weight[:, order], axis=1)
        lower = np.concatenate([np.zeros((len(weight), 1)), upper[:, :-1]], axis=1)
        inside = np.clip(upper, cut, total - cut) - np.clip(lower, cut, total - cut)
        return inside @ cells / (total - 2 * cut)

    return statistic


def percentiles(values: np.ndarray, level: float, runs: int) -> Interval:
    """Interval from the statistic of every draw (draws,); draws without a value do not count."""
    low, high = np.nanquantile(values, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    over = "runs and episodes" if runs > 1 else "episodes"
    return Interval(float(low), float(high), f"percentile bootstrap over {over}")


def interval_of(
    table: np.ndarray,
    level: float,
    resamples: int,
    statistic: Callable[..., Any] = np.mean,
    weighted: Callable[[np.ndarray], Statistic] = mean_of,
) -> Interval | None:
    """Interval of a statistic of a table (runs, episodes); None where all its cells are equal.

    Args:
        table: of numbers.
        level: of the interval.
        resamples: draws of the bootstrap.
        statistic: of the values of one run.
        weighted: the same of a table whose cells count several times.
    """
    runs, episodes = table.shape
    if np.ptp(table) < 1e-9:
        return None
    if runs == 1:
        return bootstrap(table[0], level, resamples, statistic)
    return percentiles(drawn(weighted(table), runs, episodes, resamples), level, runs)
