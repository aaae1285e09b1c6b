"""In which interval a re-run's figure should lie, if what is published is true.

The null hypothesis is that published and fresh episodes are of one kind. Then the fresh ones are a random sample of all of
them taken together, whatever their distribution: the intervals hold what such a sample's figure is with a given probability at
least, by counting and without resampling. They are exact permutation tests turned into intervals: of a success rate Fisher's
(Fisher, "The design of experiments", 1935), of a median one by the negative hypergeometric distribution (Fligner and Wolfe,
"Some applications of sample analogues to the probability integral transformation", The American Statistician 30, 1976).
"""

from __future__ import annotations

import numpy as np
from scipy import stats

SLACK = 1e-12
"""Of probabilities: the rounding of their sums."""


def median_between(pool: np.ndarray, drawn: int, alpha: float) -> tuple[float, float]:
    """Interval of the median of ``drawn`` values drawn from ``pool`` (n,) without replacement.

    Args:
        pool: finite.
        drawn: from 1 to n.
        alpha: the median lies outside with this probability at most, and with half of it on either side.

    Returns:
        Two values of the pool. With ties, and of an even number (of two values in the middle the lower one must lie below, or
        the upper one above), less is outside.
    """
    ordered, size = np.sort(pool), len(pool)
    ranks = np.arange(size + 1)
    # Of the values drawn the j-th is among the lowest k of the pool where j or more of those k are drawn.
    low_enough = stats.hypergeom.sf((drawn + 1) // 2 - 1, size, ranks, drawn)
    high_enough = stats.hypergeom.cdf(drawn // 2, size, ranks, drawn)
    below = int(np.flatnonzero(low_enough <= 0.5 * alpha + SLACK)[-1])  # so many values may be left out below
    above = int(np.flatnonzero(high_enough <= 0.5 * alpha + SLACK)[0])  # and all beyond so many
    return float(ordered[below]), float(ordered[above - 1])


def mean_between(pool: np.ndarray, drawn: int, alpha: float) -> tuple[float, float]:
    """Interval of the mean of ``drawn`` values drawn from ``pool`` (n,), whole numbers, without replacement.

    Args:
        pool: finite; rates are means of 0 and 1.
        drawn: from 1 to n.
        alpha: see :func:`median_between`.
    """
    whole = np.rint(pool).astype(np.int64)
    least, most = int(whole.min()), int(whole.max())
    if most == least:
        return float(least), float(least)
    step = most - least if set(np.unique(whole).tolist()) == {least, most} else 1
    if step == 1 and most - least > 1:
        chances = _sums(whole - least, drawn)
    else:  # a rate: Fisher's
        chances = stats.hypergeom.pmf(np.arange(drawn + 1), len(whole), int((whole == most).sum()), drawn)
    upto = np.cumsum(chances)
    below = upto - chances  # P(sum < s)
    low = int(np.flatnonzero(below <= 0.5 * alpha + SLACK)[-1])
    high = int(np.flatnonzero(1.0 - upto <= 0.5 * alpha + SLACK)[0])
    return least + step * low / drawn, least + step * high / drawn


def _sums(pool: np.ndarray, drawn: int) -> np.ndarray:
    """Probability of every sum of ``drawn`` values of ``pool`` (n,), whole numbers from 0 up."""
    most = int(np.sort(pool)[-drawn:].sum())
    values, counts = np.unique(pool, return_counts=True)
    left = len(pool)
    chances = np.zeros((drawn + 1, most + 1))  # of so many values drawn with such a sum
    chances[0, 0] = 1.0
    for value, count in zip(values.tolist(), counts.tolist(), strict=True):
        after, taken = np.zeros_like(chances), np.arange(min(count, drawn, left) + 1)
        shares = stats.hypergeom.pmf(taken[:, None], left, count, drawn - np.arange(drawn + 1))
        for more in taken[: 1 + most // value if value else None].tolist():
            rest = drawn + 1 - more
            moved = shares[more, :rest, None] * chances[:rest, : most + 1 - more * value]
            after[more:, more * value :] += moved
        chances, left = after, left - count
    return chances[drawn]
