"""Intervals, paired differences and scores against known values and closed forms; false alarms by simulation."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from agents.evaluation.statistics import (
    bootstrap,
    episode_scores,
    interval_of,
    iqm,
    iqm_difference,
    mean_difference,
    median_interval,
    pigeonhole,
    quartiles,
    success_difference,
    success_interval,
    suite_interval,
    suite_score,
)  # fmt: skip
from agents.evaluation.verify import chance_of

LEVEL, RESAMPLES, DRAWS = 0.95, 9999, 2000


def outcomes(successes, episodes):
    return np.arange(episodes) < successes


def means(cells):
    return cells.mean(axis=-1)


def test_bootstrap_of_a_mean_agrees_with_the_t_interval():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    interval = bootstrap(values, LEVEL, RESAMPLES)
    low, high = stats.t.interval(LEVEL, 399, values.mean(), stats.sem(values))
    assert interval.method == "BCa bootstrap" and interval == bootstrap(values, LEVEL, RESAMPLES)
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=0.03)


@pytest.mark.parametrize("successes", [50, 250, 400])
def test_success_rate_agrees_with_wilson(successes):
    interval = success_interval(outcomes(successes, 500), LEVEL, RESAMPLES)
    wilson = stats.binomtest(successes, 500).proportion_ci(LEVEL, method="wilson")
    assert (interval.low, interval.high) == pytest.approx((wilson.low, wilson.high), abs=0.004)


def test_unanimous_success_has_no_interval_of_zero_width():
    # Clopper-Pearson of n / n: the lower end solves p^n = 0.025.
    interval = success_interval(outcomes(500, 500), LEVEL, RESAMPLES)
    assert (interval.method, interval.high) == ("Clopper-Pearson", 1.0)
    assert interval.low == pytest.approx(0.025 ** (1 / 500))
    interval = success_interval(outcomes(0, 500), LEVEL, RESAMPLES)
    assert (interval.low, interval.high) == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 500)))
    # Training runs on the same episodes do not narrow the exact interval.
    several = success_interval(np.ones((3, 100), dtype=bool), LEVEL, DRAWS)
    assert (several.method, several.low) == ("Clopper-Pearson", pytest.approx(0.025 ** (1 / 100)))


def test_paired_success_differences():
    first, second = outcomes(80, 100)[None], outcomes(60, 100)[None]
    difference = success_difference(first, second, LEVEL, RESAMPLES)
    # 20 of 100 seeds differ, all the same way, so this is the interval of 20 / 100; unpaired it were 0.2 +- 0.124.
    wilson = stats.binomtest(20, 100).proportion_ci(LEVEL, method="wilson")
    assert (difference.interval.low, difference.interval.high) == pytest.approx((wilson.low, wilson.high), abs=0.01)
    assert difference.clear
    same = success_difference(first, first, LEVEL, RESAMPLES).interval
    assert same.low == -same.high == pytest.approx(0.025 ** (1 / 100) - 1.0)
    always = success_difference(outcomes(0, 100)[None], outcomes(100, 100)[None], LEVEL, RESAMPLES).interval
    assert (always.low, always.high) == (-1.0, pytest.approx(-(0.025 ** (1 / 100))))


def test_quartiles_and_the_mean_of_the_middle_half():
    middle = quartiles(np.array([1.0, np.nan, 2.0, 3.0, 4.0, 5.0]))
    assert tuple(middle) == (2.0, 3.0, 4.0) and np.isnan(quartiles(np.array([np.nan])).median)
    assert iqm(np.array([9.0, 1.0, 2.0, 100.0, 3.0, 4.0, -50.0, 5.0])) == pytest.approx((2 + 3 + 4 + 5) / 4)
    values = np.random.default_rng(0).normal(size=1003)
    assert iqm(values) == pytest.approx(np.sort(values)[250:-250].mean())


def test_one_run_is_the_usual_bootstrap():
    values = np.random.default_rng(2).normal(3.0, 2.0, (1, 300))
    assert pigeonhole(means, [values], 9999).std() == pytest.approx(values.std() / math.sqrt(300), rel=0.03)
    theirs = stats.bootstrap((values[0],), iqm, n_resamples=4000, method="percentile", rng=np.random.default_rng(3))
    assert pigeonhole(iqm, [values], 4000).std() == pytest.approx(theirs.standard_error, rel=0.06)


def test_runs_that_share_episodes_are_not_independent():
    # Variance of the pigeonhole bootstrap of rows that are copies: that of one row, not a third of it.
    row = np.random.default_rng(4).normal(size=(1, 200))
    one = pigeonhole(means, [row], 9999).std()
    assert pigeonhole(means, [np.repeat(row, 3, axis=0)], 9999).std() == pytest.approx(one, rel=0.03)
    # Runs that differ as a whole: their spread counts too.
    apart = row + np.array([[0.0], [1.0], [2.0]])
    expected = math.sqrt(one**2 + np.var([0.0, 1.0, 2.0]) / 3)
    assert pigeonhole(means, [apart], 9999).std() == pytest.approx(expected, rel=0.03)


def test_a_paired_difference_is_narrower_than_either_interval():
    rng = np.random.default_rng(7)
    hard = rng.uniform(1.0, 3.0, (1, 200))
    other = hard + 0.05 + rng.normal(0.0, 0.02, (1, 200))
    time, middle = mean_difference(other - hard, LEVEL, DRAWS), iqm_difference(other, hard, LEVEL, DRAWS)
    assert time.value == pytest.approx(0.05, abs=0.005) and time.clear and middle.clear
    alone = interval_of(hard, LEVEL, DRAWS, iqm)
    assert middle.interval.high - middle.interval.low < 0.2 * (alone.high - alone.low)
    assert (middle.negative().value, middle.negative().interval.low) == (-middle.value, -middle.interval.high)


def test_several_runs_against_one():
    rng = np.random.default_rng(8)
    hard = rng.uniform(1.0, 3.0, (1, 150))
    runs = hard + np.array([[0.0], [0.1], [0.2]]) + rng.normal(0.0, 0.01, (3, 150))
    runs[2, :30] = np.nan
    success = success_difference(np.isfinite(runs), np.isfinite(hard), LEVEL, DRAWS)
    assert success.value == pytest.approx(-30 / 450)
    # Two thirds of the runs never fail: with a chance of 8 in 27 no run that does is drawn.
    assert success.interval.high == 0.0 and success.interval.low < -0.1
    time = mean_difference(runs - hard, LEVEL, DRAWS)
    assert time.value == pytest.approx((0.0 * 150 + 0.1 * 150 + 0.2 * 120) / 420, abs=0.003)
    same = np.repeat(hard, 3, axis=0)
    assert mean_difference(same - hard, LEVEL, DRAWS).interval is None
    assert iqm_difference(same, hard, LEVEL, DRAWS).interval is None


def test_nothing_scores_0_and_the_bound_1():
    nan = np.full(3, np.nan)
    at = {"success": np.array([False, True, True]), "time_to_goal": np.array([np.nan, 2.0, 4.0]), "rate_bound": nan}
    assert episode_scores(SimpleNamespace(**at, bound=np.full(3, 2.0))).tolist() == [0.0, 1.0, 0.5]
    assert np.isnan(episode_scores(SimpleNamespace(**at, bound=nan))).all()
    feeding = SimpleNamespace(rate_bound=np.array([300.0, 300.0]), rate_over_bound=np.array([0.0, 1.0]))
    assert episode_scores(feeding).tolist() == [0.0, 1.0]


def test_the_score_of_all_is_the_interquartile_mean_of_the_tasks():
    tasks = [np.full(5, share) for share in (0.0, 0.1, 0.4, 0.5, 0.7, 0.8, 0.9, 1.0)]
    assert suite_score(tasks) == pytest.approx((0.4 + 0.5 + 0.7 + 0.8) / 4)
    assert suite_score(tasks[::-1]) == suite_score(tasks) and suite_interval(tasks, 0.95, 200) is None
    assert suite_score([np.zeros(3)] * 8) == 0.0 and suite_score([np.ones(3)] * 8) == 1.0


def test_its_interval_is_that_of_the_episodes_of_each_task():
    random = np.random.default_rng(0)
    one = random.random(200)
    interval = suite_interval([one], 0.95, 4000)
    half = 1.96 * one.std() / np.sqrt(200)
    assert (interval.low, interval.high) == pytest.approx((one.mean() - half, one.mean() + half), abs=0.1 * half)
    # Of four tasks the middle two count: their mean varies less by sqrt(2).
    four = suite_interval([np.zeros(200), one, one[::-1].copy(), np.ones(200)], 0.95, 4000)
    assert four.high - four.low == pytest.approx((interval.high - interval.low) / np.sqrt(2.0), rel=0.1)


ALPHA, TRIALS = 0.05, 2000
ALARMS = stats.binom.ppf(0.9999, TRIALS, ALPHA) / TRIALS
"""More false alarms than this show that there are too many."""

SAMPLES = {
    "rare": lambda rng, count: rng.binomial(1, 0.03, count),
    "often": lambda rng, count: rng.binomial(1, 0.6, count),
    "times": lambda rng, count: rng.lognormal(size=count),
    "whole steps": lambda rng, count: np.round(rng.lognormal(size=count) / 0.3) * 0.3,
    "counts": lambda rng, count: rng.negative_binomial(1, 0.3, count),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_false_alarms(name):
    rng, rate = np.random.default_rng(1), name in ("rare", "often")
    pairs = [(SAMPLES[name](rng, 100), SAMPLES[name](rng, 20)) for _ in range(TRIALS)]
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
    intervals = [median_interval(rng.lognormal(size=60), 0.95) for _ in range(TRIALS)]
    missed = np.mean([not interval.low <= 1.0 <= interval.high for interval in intervals])
    assert 0.01 < missed <= ALARMS
