"""Tests of verification: false alarms by simulation, and what is found."""

import numpy as np
import pytest
from scipy import stats

from agents.evaluation.statistics import median_interval
from agents.evaluation.verify import chance_of

ALPHA, TRIALS = 0.05, 2000
ALARMS = stats.binom.ppf(0.9999, TRIALS, ALPHA) / TRIALS
"""More false alarms than this show that there are too many."""

DRAWS = {
    "rare": lambda rng, count: rng.binomial(1, 0.03, count),
    "often": lambda rng, count: rng.binomial(1, 0.6, count),
    "times": lambda rng, count: rng.lognormal(size=count),
    "whole steps": lambda rng, count: np.round(rng.lognormal(size=count) / 0.3) * 0.3,
    "counts": lambda rng, count: rng.negative_binomial(1, 0.3, count),
}


@pytest.mark.parametrize("name", DRAWS)
def test_false_alarms(name):
    rng, rate = np.random.default_rng(1), name in ("rare", "often")
    pairs = [(DRAWS[name](rng, 100), DRAWS[name](rng, 20)) for _ in range(TRIALS)]
    assert np.mean([chance_of(before, now, rate) <= ALPHA for before, now in pairs]) <= ALARMS


def test_what_is_found():
    alpha, rng = 0.01 / 500, np.random.default_rng(4)
    every, published = np.ones(500), rng.lognormal(sigma=0.3, size=500)
    assert chance_of(every, np.arange(20) < 14, True) < alpha < chance_of(every, np.arange(20) < 18, True)
    other = rng.lognormal(sigma=0.3, size=20)
    assert chance_of(published, 1.6 * other, False) < alpha < chance_of(published, 1.02 * other, False)
    assert chance_of(every, np.ones(5), False) == 1.0


def test_confidence_of_a_median():
    rng = np.random.default_rng(5)
    found = [median_interval(rng.lognormal(size=60), 0.95) for _ in range(TRIALS)]
    missed = np.mean([not each.low <= 1.0 <= each.high for each in found])
    assert 0.01 < missed <= ALARMS
