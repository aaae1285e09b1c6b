"""The smallest difference that a paired sample could have shown: a test finds it with a given power."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import optimize, stats


def power_of_success(difference: float, other: float, pairs: int, confidence: float) -> float:
    """Chance that the exact two-sided McNemar test finds a difference of two success rates.

    The first policy alone succeeds on a share p = ``other`` + ``difference`` of the pairs, the second alone on q = ``other``.
    Of the m ~ Binomial(pairs, p + q) discordant pairs b ~ Binomial(m, p / (p + q)) are the first one's; the test is the sign
    test of b among m. Summed over m without approximation; for many pairs Connor's formula (Biometrics 43, 1987, 207-211)
    gives about the same. A difference that is found with the wrong sign does not count as found.

    Args:
        difference: of the success rates, > 0.
        other: share of the pairs on which the second alone succeeds; 2 other + difference <= 1.
        pairs: number of episodes.
        confidence: 1 minus the level of the test.
    """
    discordant = np.arange(pairs + 1)
    share = min(2.0 * other + difference, 1.0)
    # The smallest count of m that the test calls unlikely: its upper tail has at most half the level.
    least = stats.binom.isf(0.5 - 0.5 * confidence, discordant, 0.5) + 1
    mine = min((other + difference) / share, 1.0)
    found = stats.binom.sf(least - 1, discordant, mine)
    return float(stats.binom.pmf(discordant, pairs, share) @ found)


def detectable_success(other: float, pairs: int, confidence: float, power: float) -> float:
    """The smallest difference of two success rates that :func:`power_of_success` gives a chance ``power``.

    It is nan if there is none: with too few pairs no outcome would have been enough.
    """
    most = 1.0 - 2.0 * other
    if most <= 0.0 or power_of_success(most, other, pairs, confidence) < power:
        return math.nan
    return _root(lambda each: power_of_success(each, other, pairs, confidence) - power, 1e-9, most)


def detectable_mean(deviation: float, pairs: int, confidence: float, power: float) -> float:
    """The smallest mean difference that the paired t test would have found.

    The test statistic of a mean difference d is noncentral t with pairs - 1 degrees of freedom and noncentrality
    d sqrt(pairs) / deviation (Cohen, Statistical Power Analysis for the Behavioral Sciences, 2nd ed. 1988, chapter 2); one
    that is found with the wrong sign does not count as found.

    Args:
        deviation: standard deviation of the differences.
        pairs: number of them.
        confidence: 1 minus the level of the test.
        power: chance to find it.

    Returns:
        In the unit of ``deviation``; nan with fewer than two pairs, or where all differences are equal.
    """
    if pairs < 2 or not deviation > 0.0:
        return math.nan
    freedom = pairs - 1
    edge = float(stats.t.isf(0.5 - 0.5 * confidence, freedom))

    def missing(noncentrality: float) -> float:
        return float(stats.nct.sf(edge, freedom, noncentrality)) - power

    most = 1.0  # far beyond what is needed the distribution cannot be computed
    while missing(most) < 0.0:
        most *= 1.5
    return _root(missing, 0.0, most) * deviation / math.sqrt(pairs)


def detectable_normal(error: float, confidence: float, power: float) -> float:
    """The same of any estimate that is about normal: (z_(1 - a/2) + z_power) times its standard error; nan without one."""
    if not error > 0.0:
        return math.nan
    return float((stats.norm.isf(0.5 - 0.5 * confidence) + stats.norm.ppf(power)) * error)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function is zero."""
    return float(optimize.brentq(function, low, high, xtol=1e-7))  # type: ignore[arg-type]  # full_output would give a pair
