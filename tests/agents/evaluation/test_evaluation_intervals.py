"""Intervals of fresh samples: false alarms by simulation and by counting, and what is found."""

import itertools

import numpy as np
import pytest
from scipy import stats

from agents.evaluation.statistics import median_interval
from agents.evaluation.verify import mean_between, median_between, rate_between

ALPHA, TRIALS = 0.05, 4000
ALARMS = stats.binom.ppf(0.9999, TRIALS, ALPHA) / TRIALS
"""More false alarms than this show that there are too many."""


def outside(value, interval):
    return not interval[0] <= value <= interval[1]


@pytest.mark.parametrize("rate", [0.02, 0.5, 0.97])
def test_false_alarms_of_rates(rate):
    rng = np.random.default_rng(1)
    before, now = rng.binomial(100, rate, TRIALS), rng.binomial(20, rate, TRIALS)
    known = {times: rate_between(times, 100, 20, ALPHA) for times in set(before.tolist())}
    alarms = [outside(n / 20, known[times]) for times, n in zip(before.tolist(), now.tolist(), strict=True)]
    assert np.mean(alarms) <= ALARMS
    assert max(high - low for low, high in known.values()) < 0.65  # an interval that holds everything would not do


@pytest.mark.parametrize("fresh", [19, 20])
@pytest.mark.parametrize("step", [0.0, 0.3])
def test_false_alarms_of_medians(fresh, step):
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(TRIALS):
        values = rng.lognormal(size=100 + fresh)
        values = np.round(values / step) * step if step else values  # times are whole steps: ties
        alarms += outside(float(np.median(values[100:])), median_between(values[:100], fresh, ALPHA))
    assert alarms / TRIALS <= ALARMS
    assert fresh % 2 == 0 or step or alarms / TRIALS > 0.5 * ALPHA  # nor is it wider than it must be


def test_false_alarms_of_means():
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(500):
        values = rng.negative_binomial(1, 0.3, 80)
        alarms += outside(float(values[60:].mean()), mean_between(values, 20, ALPHA))
    assert alarms <= stats.binom.ppf(0.9999, 500, ALPHA)


def test_means_by_counting_all_samples():
    pool, drawn, alpha = np.array([0, 0, 1, 2, 2, 5, 9]), 3, 0.2
    means = np.sort([np.mean(each) for each in itertools.combinations(pool, drawn)])
    low, high = mean_between(pool, drawn, alpha)
    assert (means < low).mean() <= alpha / 2 < (means <= low).mean()
    assert (means > high).mean() <= alpha / 2 < (means >= high).mean()


def test_rates_are_those_that_fishers_test_does_not_reject():
    low, high = rate_between(90, 100, 20, 0.01)
    for again in range(21):
        table = [[again, 20 - again], [90, 10]]
        likely = min(stats.fisher_exact(table, side).pvalue for side in ("less", "greater"))
        assert (likely > 0.005) == (low <= again / 20 <= high)


def test_what_is_found():
    alpha, rng = 0.01 / 500, np.random.default_rng(4)
    assert outside(14 / 20, rate_between(500, 500, 20, alpha))
    assert not outside(18 / 20, rate_between(500, 500, 20, alpha))
    published = rng.lognormal(sigma=0.3, size=500)
    assert outside(1.6 * float(np.median(published)), median_between(published, 20, alpha))
    assert not outside(1.02 * float(np.median(published)), median_between(published, 20, alpha))
    counts = rng.poisson(1.0, 100)
    assert outside(3.0, mean_between(np.concatenate([counts, np.full(20, 3)]), 20, alpha))


def test_bounds_of_few_values():
    assert median_between(np.array([1.0, 2.0]), 5, 0.01) == (-np.inf, np.inf)
    assert rate_between(0, 1, 1, 0.01) == (0.0, 1.0)
    assert mean_between(np.array([3, 3, 3]), 2, 0.01) == (3.0, 3.0)


def test_confidence_of_a_median():
    rng = np.random.default_rng(5)
    found = [median_interval(rng.lognormal(size=60), 0.95) for _ in range(TRIALS)]
    missed = np.mean([outside(1.0, (each.low, each.high)) for each in found])
    assert 0.01 < missed <= ALARMS
