"""Interquartile means, resampling and power against closed forms and independent computations."""

import functools
import math

import numpy as np
import pytest
from agents.evaluation.comparison.paired import difference
from agents.evaluation.comparison.power import detectable_mean, detectable_normal, detectable_success, power_of_success
from agents.evaluation.comparison.profiles import profile
from agents.evaluation.comparison.sample import Sample
from agents.evaluation.statistics import drawn, interval_of, iqm, iqm_of, mean_of, mean_where, weights
from scipy import stats

from agents.evaluation.statistics import success_interval
from vibgym.policies.rollout import OWN_FACTS

LEVEL, POWER, DRAWS = 0.95, 0.8, 2000


def sample(time, limit=10.0, bound=1.0, first_seed=0):
    """Of times (runs, episodes), nan where an episode fails."""
    runs, episodes = time.shape
    no = np.zeros((runs, episodes), dtype=bool)
    none = np.full((runs, episodes), np.nan)
    return Sample(
        "Align",
        tuple(range(first_seed, first_seed + episodes)),
        1.0,
        steps=time,
        success=np.isfinite(time),
        **dict.fromkeys(("fallen", "diverged"), no),
        **dict.fromkeys(("returns", "position_error", "heading_error", "path_error", "collisions", "rate_bound"), none),
        facts=np.full((runs, episodes, len(OWN_FACTS)), np.nan),
        bound=np.full((runs, episodes), bound),
        limit=limit,
    )


def test_iqm_is_the_mean_of_the_middle_half():
    assert iqm(np.array([9.0, 1.0, 2.0, 100.0, 3.0, 4.0, -50.0, 5.0])) == pytest.approx((2 + 3 + 4 + 5) / 4)
    values = np.random.default_rng(0).normal(size=1003)
    ordered = np.sort(values)
    assert iqm(values) == pytest.approx(ordered[250:-250].mean())


@pytest.mark.parametrize("shape", [(1, 40), (3, 17), (4, 5)])
def test_a_weighted_iqm_is_that_of_the_cells_written_out(shape):
    table = np.random.default_rng(1).exponential(size=shape).round(1)  # with ties
    for weight in weights(*shape, 50):
        counts = weight.astype(int)
        assert (counts.sum(axis=1) == table.size).all()
        found = iqm_of(table)(weight)
        expected = [stats.trim_mean(np.repeat(table.ravel(), each), 0.25) for each in counts]
        np.testing.assert_allclose(found, expected)


def test_weights_draw_whole_rows_and_columns():
    weight = next(iter(weights(3, 7, 100))).reshape(-1, 3, 7)
    rows, columns = weight.sum(axis=2) / 7, weight.sum(axis=1) / 3
    np.testing.assert_allclose(weight, rows[:, :, None] * columns[:, None, :])
    assert (rows.sum(axis=1) == 3).all() and (columns.sum(axis=1) == 7).all()


def test_one_run_is_the_usual_bootstrap():
    values = np.random.default_rng(2).normal(3.0, 2.0, (1, 300))
    draws = drawn(mean_of(values), 1, 300, 9999)
    assert draws.std() == pytest.approx(values.std() / math.sqrt(300), rel=0.03)
    ours = drawn(iqm_of(values), 1, 300, 4000).std()
    theirs = stats.bootstrap((values[0],), iqm, n_resamples=4000, method="percentile", rng=np.random.default_rng(3))
    assert ours == pytest.approx(theirs.standard_error, rel=0.06)


def test_runs_that_share_hard_episodes_are_no_more_of_them():
    # Variance of the pigeonhole bootstrap of rows that are copies: that of one row, not a third of it.
    row = np.random.default_rng(4).normal(size=(1, 200))
    one = drawn(mean_of(row), 1, 200, 9999).std()
    three = drawn(mean_of(np.repeat(row, 3, axis=0)), 3, 200, 9999).std()
    assert three == pytest.approx(one, rel=0.03)
    # Runs that differ as a whole: their spread counts too.
    apart = row + np.array([[0.0], [1.0], [2.0]])
    expected = math.sqrt(one**2 + np.var([0.0, 1.0, 2.0]) / 3)
    assert drawn(mean_of(apart), 3, 200, 9999).std() == pytest.approx(expected, rel=0.03)


def test_mean_where_counts_what_is_counted():
    table, counted = np.array([[1.0, 2.0, 30.0]]), np.array([[True, True, False]])
    statistic = mean_where(table, counted)
    np.testing.assert_allclose(statistic(np.array([[1.0, 1.0, 1.0], [0.0, 3.0, 0.0]])), [1.5, 2.0])
    assert np.isnan(statistic(np.array([[0.0, 0.0, 3.0]]))).all()


def test_success_of_runs_that_all_succeed_has_the_exact_interval_of_one():
    found = success_interval(np.ones((3, 100), dtype=bool), LEVEL, DRAWS)
    assert (found.method, found.high) == ("Clopper-Pearson", 1.0)
    assert found.low == pytest.approx(0.025 ** (1 / 100))
    some = np.arange(300).reshape(3, 100) % 5 > 0
    assert success_interval(some, LEVEL, DRAWS).method == "percentile bootstrap over runs and episodes"
    assert interval_of(np.full((2, 9), 1.2), LEVEL, DRAWS, iqm, iqm_of) is None


def test_power_of_the_sign_test_without_episodes_against_it_has_a_closed_form():
    # At 5 % six discordant pairs of six are the fewest that count: P(Binomial(n, d) >= 6) = power.
    for pairs in (30, 200):
        found = detectable_success(0.0, pairs, LEVEL, POWER)
        # Larger counts with none against them all count too.
        assert stats.binom.sf(5, pairs, found) == pytest.approx(POWER, abs=1e-5)
    assert math.isnan(detectable_success(0.0, 5, LEVEL, POWER))
    assert math.isnan(detectable_success(0.5, 100, LEVEL, POWER))


def test_power_of_the_sign_test_agrees_with_simulation_and_with_connor():
    rng, pairs, other, gap = np.random.default_rng(5), 120, 0.05, 0.10
    counts = rng.multinomial(pairs, [other + gap, other, 1.0 - 2.0 * other - gap], size=4000)
    pvalue = functools.cache(lambda one, both: stats.binomtest(one, both).pvalue)
    wins = [a > b and pvalue(a, a + b) <= 0.05 for a, b, _ in counts.tolist()]
    assert power_of_success(gap, other, pairs, LEVEL) == pytest.approx(np.mean(wins), abs=0.025)
    # Connor (1987): n = (z_a sqrt(share) + z_b sqrt(share - d^2))^2 / d^2, for large samples.
    found = detectable_success(0.05, 4000, LEVEL, POWER)
    share, z_a, z_b = 0.1 + found, stats.norm.ppf(0.975), stats.norm.ppf(POWER)
    needed = (z_a * math.sqrt(share) + z_b * math.sqrt(share - found**2)) ** 2 / found**2
    assert needed == pytest.approx(4000, rel=0.04)


def test_smallest_mean_difference_is_found_with_the_power_asked():
    pairs, deviation, rng = 12, 0.3, np.random.default_rng(6)
    smallest = detectable_mean(deviation, pairs, LEVEL, POWER)
    drawn_pairs = rng.normal(smallest, deviation, (20_000, pairs))
    found = (stats.ttest_1samp(drawn_pairs, 0.0, axis=1).pvalue <= 0.05) & (drawn_pairs.mean(axis=1) > 0.0)
    assert found.mean() == pytest.approx(POWER, abs=0.01)
    # Many pairs: (z_a + z_b) sd / sqrt(n).
    large = detectable_mean(deviation, 5000, LEVEL, POWER)
    assert large == pytest.approx(detectable_normal(deviation / math.sqrt(5000), LEVEL, POWER), rel=1e-3)
    assert large == pytest.approx((1.959964 + 0.841621) * deviation / math.sqrt(5000), rel=1e-3)
    assert math.isnan(detectable_mean(0.0, 10, LEVEL, POWER)) and math.isnan(detectable_mean(1.0, 1, LEVEL, POWER))


def compared(first, second):
    return difference(("Align", "ideal"), ("a", "b"), (sample(first), sample(second)), LEVEL, POWER, DRAWS)


def test_a_paired_difference_is_narrower_than_either_interval():
    rng = np.random.default_rng(7)
    hard = rng.uniform(1.0, 3.0, (1, 200))
    found = compared(hard + 0.05 + rng.normal(0.0, 0.02, (1, 200)), hard)
    assert found.time.value == pytest.approx(0.05, abs=0.005) and found.time.clear
    assert found.time.detectable == pytest.approx(2.80 * 0.02 / math.sqrt(200), rel=0.15)
    alone = interval_of(hard, LEVEL, DRAWS, iqm, iqm_of)
    assert found.iqm.interval is not None and alone is not None
    assert found.iqm.clear and found.iqm.interval.high - found.iqm.interval.low < 0.2 * (alone.high - alone.low)
    assert found.success.value == 0.0 and not found.success.clear
    assert math.isnan(found.collisions.value) and found.both == 200


def test_several_runs_against_one():
    rng = np.random.default_rng(8)
    hard = rng.uniform(1.0, 3.0, (1, 150))
    runs = hard + np.array([[0.0], [0.1], [0.2]]) + rng.normal(0.0, 0.01, (3, 150))
    runs[2, :30] = np.nan
    found = compared(runs, hard)
    assert found.runs == 3 and found.both == 420
    assert found.success.value == pytest.approx(-30 / 450)
    assert found.time.value == pytest.approx((0.0 * 150 + 0.1 * 150 + 0.2 * 120) / 420, abs=0.003)
    # Two thirds of the runs never fail: with a chance of 8 in 27 no run that does is drawn.
    interval = found.success.interval
    assert interval is not None and interval.high == 0.0 and interval.low < -0.1
    same = compared(np.repeat(hard, 3, axis=0), hard)
    assert same.success.interval is not None and same.success.interval.method == "Clopper-Pearson"
    assert same.time.interval is None and same.iqm.interval is None


def test_a_failure_counts_as_the_longest_episode():
    times = np.array([[1.0, 1.0, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan]])
    assert sample(times).limited_time.tolist() == [[1.0, 1.0] + 6 * [10.0]]
    assert compared(times, np.ones((1, 8))).iqm.value == pytest.approx(9.0)


def test_a_comparison_needs_the_same_episodes():
    one, other = sample(np.ones((1, 4))), sample(np.ones((1, 4)), first_seed=9)
    with pytest.raises(ValueError, match="same seeds"):
        difference(("Align", "ideal"), ("a", "b"), (one, other), LEVEL, POWER, DRAWS)
    with pytest.raises(ValueError, match="one run of the second"):
        difference(("Align", "ideal"), ("a", "b"), (one, sample(np.ones((2, 4)))), LEVEL, POWER, DRAWS)


def test_profiles_rise_to_the_success_rate_within_their_bands():
    rng = np.random.default_rng(9)
    times = rng.exponential(1.0, (2, 60)) + 1.0
    times[:, :6] = np.nan
    samples = {"a": sample(times), "b": sample(np.full((1, 60), 1.5))}
    found = profile(("Align", "ideal"), samples, LEVEL, DRAWS)
    assert found.unit == "bound" and found.limits[0] == 1.0 and (np.diff(found.limits) > 0.0).all()
    for name, (share, low, high) in found.curves.items():
        assert (np.diff(share) >= 0.0).all() and (low <= share).all() and (share <= high).all(), name
        wanted = np.where(samples[name].success, samples[name].time_to_goal, np.inf)
        for limit, each in zip(found.limits[::17], share[::17], strict=True):
            assert each == pytest.approx((wanted <= limit).mean())
    share, low, high = found.curves["a"]
    assert share[-1] == 0.9 and found.curves["b"][0, -1] == 1.0
    # Where all are solved the band is the exact one.
    assert found.curves["b"][1, -1] == pytest.approx(0.025 ** (1 / 60))
    unknown = {"a": sample(times, bound=np.nan), "b": samples["b"]}
    assert profile(("Sort", "ideal"), unknown, LEVEL, 200).unit == "s"
