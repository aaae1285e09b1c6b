"""Intervals against known values."""

import numpy as np
import pytest
from agents.evaluation.records import Trial
from agents.evaluation.statistics import bootstrap
from scipy import stats

from agents.evaluation.statistics import compare, difference_interval, quartiles, success_interval

LEVEL, RESAMPLES = 0.95, 9999


def outcomes(successes, episodes):
    return np.arange(episodes) < successes


def test_bootstrap_of_a_mean_agrees_with_the_t_interval():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    interval = bootstrap(values, LEVEL, RESAMPLES)
    low, high = stats.t.interval(LEVEL, 399, values.mean(), stats.sem(values))
    assert interval.method == "BCa bootstrap"
    assert interval.low == pytest.approx(low, abs=0.03)
    assert interval.high == pytest.approx(high, abs=0.03)


def test_bootstrap_can_be_repeated():
    values = np.random.default_rng(2).exponential(1.0, 50)
    assert bootstrap(values, LEVEL, 500) == bootstrap(values, LEVEL, 500)


@pytest.mark.parametrize("successes", [50, 250, 400])
def test_success_rate_agrees_with_wilson(successes):
    interval = success_interval(outcomes(successes, 500), LEVEL, RESAMPLES)
    wilson = stats.binomtest(successes, 500).proportion_ci(LEVEL, method="wilson")
    assert interval.low == pytest.approx(wilson.low, abs=0.004)
    assert interval.high == pytest.approx(wilson.high, abs=0.004)


def test_unanimous_success_has_no_interval_of_zero_width():
    # Clopper-Pearson of n / n: the lower end solves p^n = 0.025.
    interval = success_interval(outcomes(500, 500), LEVEL, RESAMPLES)
    assert (interval.method, interval.high) == ("Clopper-Pearson", 1.0)
    assert interval.low == pytest.approx(0.025 ** (1 / 500))
    interval = success_interval(outcomes(0, 500), LEVEL, RESAMPLES)
    assert interval.low == 0.0
    assert interval.high == pytest.approx(1.0 - 0.025 ** (1 / 500))


def test_paired_differences():
    first, second = outcomes(80, 100), outcomes(60, 100)
    interval = difference_interval(first, second, LEVEL, RESAMPLES)
    # 20 of 100 seeds differ, all the same way, so this is the interval of 20 / 100; unpaired it were 0.2 +- 0.124.
    wilson = stats.binomtest(20, 100).proportion_ci(LEVEL, method="wilson")
    assert interval.low == pytest.approx(wilson.low, abs=0.01)
    assert interval.high == pytest.approx(wilson.high, abs=0.01)
    same = difference_interval(first, first, LEVEL, RESAMPLES)
    assert same.low == -same.high == pytest.approx(0.025 ** (1 / 100) - 1.0)
    always = difference_interval(outcomes(0, 100), outcomes(100, 100), LEVEL, RESAMPLES)
    assert (always.low, always.high) == (-1.0, pytest.approx(-(0.025 ** (1 / 100))))


def test_quartiles_skip_what_does_not_apply():
    found = quartiles(np.array([1.0, np.nan, 2.0, 3.0, 4.0, 5.0]))
    assert (found.lower, found.median, found.upper) == (2.0, 3.0, 4.0)
    assert np.isnan(quartiles(np.array([np.nan])).median)


def test_comparison_is_paired_and_turns_round(found):
    pusher, still = (
        found.rollouts[Trial("Transport", "ideal", "pusher")],
        found.rollouts[Trial("Transport", "ideal", "still <&>")],
    )
    forth = compare("ideal", ("pusher", "still"), pusher, still, LEVEL, 500)
    assert forth.success_difference == pytest.approx(pusher.success.mean())
    assert forth.both == 0 and np.isnan(forth.time_difference) and forth.time_interval is None
    back = forth.turned()
    assert (back.first, back.second) == ("still", "pusher")
    assert back.success_interval.low == -forth.success_interval.high
    same = compare("ideal", ("pusher", "pusher"), pusher, pusher, LEVEL, 500)
    assert same.time_difference == 0.0 and same.time_interval is None
    with pytest.raises(ValueError, match="same task and the same seeds"):
        compare("ideal", ("a", "b"), pusher, found.rollouts[Trial("Align", "ideal", "pusher")], LEVEL, 500)
