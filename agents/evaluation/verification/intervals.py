"""In which interval a figure of fresh episodes should lie, if what is published is true.

The null hypothesis is that published and fresh episodes are of one kind. Then the fresh ones are a random sample of all of them
taken together, whatever their distribution, and it can be counted what such a sample's figure is. Nothing is assumed, nothing
resampled, so that false alarms are as rare as they should be, also at one in a hundred thousand. Of a rate and a median the
intervals follow from the published episodes alone (prediction intervals), of other means from both together.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import stats


def rate_between(times: int, published: int, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the rate in ``fresh`` episodes of what occurred ``times`` in ``published`` ones.

    Those rates which Fisher's exact test does not reject ("The design of experiments", 1935), on either side.

    Args:
        alpha: the rate lies outside with this probability at most, and with half of it on either side.
    """
    again = np.arange(fresh + 1)
    chances = published + fresh, times + again, fresh
    likely = np.minimum(stats.hypergeom.cdf(again, *chances), stats.hypergeom.sf(again - 1, *chances)) > 0.5 * alpha
    kept = again[likely]
    return float(kept[0] / fresh), float(kept[-1] / fresh)


def median_between(published: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the median of ``fresh`` values, from the ``published`` ones (n,).

    How many published values lie below the j-th of the fresh ones has a negative hypergeometric distribution (Fligner, Wolfe,
    "Some applications of sample analogues to the probability integral transformation", The American Statistician 30, 1976).
    With ties less is outside, and so it is with an even number: the lower one of the two in the middle would have to be below,
    or the upper one above.

    Args:
        alpha: see :func:`rate_between`.

    Returns:
        Two published values; minus or plus infinity where there are too few of them.
    """
    low, high = _ranks(len(published), fresh, alpha)
    ordered = np.concatenate([[-np.inf], np.sort(published), [np.inf]])
    return float(ordered[low]), float(ordered[high])


@lru_cache(maxsize=1024)
def _ranks(published: int, fresh: int, alpha: float) -> tuple[int, int]:
    """Ranks of the published values between which the median lies: 0 and ``published`` + 1 where none is low or high enough."""
    lower, upper, ranks = (fresh + 1) // 2, fresh // 2 + 1, np.arange(published)
    below = stats.betabinom.cdf(ranks, published, lower, fresh - lower + 1) <= 0.5 * alpha
    above = stats.betabinom.sf(ranks, published, upper, fresh - upper + 1) <= 0.5 * alpha
    return int(below.sum()), published + 1 - int(above.sum())


def mean_between(pool: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the mean of ``fresh`` values drawn without replacement from ``pool`` (n,), published and fresh ones together.

    A permutation test, exact by the distribution of the sum.

    Args:
        pool: whole numbers.
        fresh: from 1 to n.
        alpha: see :func:`rate_between`.
    """
    whole = np.rint(pool).astype(np.int64)
    least = int(whole.min())
    chances = _sums(whole - least, fresh)
    upto, beyond = np.cumsum(chances), np.cumsum(chances[::-1])[::-1]  # P(sum <= s), P(sum >= s)
    kept = np.flatnonzero(np.minimum(upto, beyond) > 0.5 * alpha)
    return least + float(kept[0]) / fresh, least + float(kept[-1]) / fresh


def _sums(pool: np.ndarray, drawn: int) -> np.ndarray:
    """Probability of every sum of ``drawn`` values of ``pool`` (n,), whole numbers from 0 up."""
    most = int(np.sort(pool)[-drawn:].sum())
    values, counts = np.unique(pool, return_counts=True)
    left = len(pool)
    chances = np.zeros((drawn + 1, most + 1))  # of so many values drawn with such a sum
    chances[0, 0] = 1.0
    for value, count in zip(values.tolist(), counts.tolist(), strict=True):
        after, taken = np.zeros_like(chances), np.arange(min(count, drawn) + 1)
        shares = stats.hypergeom.pmf(taken[:, None], left, count, drawn - np.arange(drawn + 1))
        for more in taken[: 1 + most // value if value else None].tolist():
            moved = shares[more, : drawn + 1 - more, None] * chances[: drawn + 1 - more, : most + 1 - more * value]
            after[more:, more * value :] += moved
        chances, left = after, left - count
    return chances[drawn]
