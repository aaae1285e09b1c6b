"""Errors, fronts, costs at equal error, and a measurement of made-up candidates."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.accuracy import comparisons, errors, ladder, page
from studies.accuracy.candidates import Candidate, Outcome, model_candidate, prepare_model
from studies.accuracy.model_checks import auto_rows, fitted_order
from studies.accuracy.scenes import scenes_from
from studies.accuracy.settings import TruthSettings
from vibgym import Surface
from vibgym.simulation import choice

NUMBERS = st.one_of(st.floats(1e-6, 1e6), st.sampled_from([1.0, 2.0, math.inf, math.nan]))
POINTS = st.lists(st.tuples(NUMBERS, NUMBERS), max_size=12)
FINEST = TruthSettings(steps=32, substeps=2, pieces=2)


# -- fronts and costs --------------------------------------------------------------------------------------------------


@given(POINTS)
def test_pareto_by_brute_force(points):
    costs, values = [c for c, _ in points], [e for _, e in points]
    front = errors.pareto(costs, values)
    finite = [p for p in points if all(map(math.isfinite, p))]
    unbeaten = {p for p in finite if not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in finite)}
    assert [points[k] for k in front] == sorted(unbeaten)


@given(POINTS, st.floats(1e-6, 1e6))
def test_cheapest_by_brute_force(points, tolerance):
    cheapest = errors.cheapest([c for c, _ in points], [e for _, e in points], tolerance)
    within = [c for c, e in points if math.isfinite(c) and e <= tolerance]
    assert (cheapest is None) == (not within)
    if cheapest is not None:
        assert points[cheapest][0] == min(within) and points[cheapest][1] <= tolerance


@given(POINTS, st.floats(1e-6, 1e6))
def test_cost_at_an_error_lies_between_points_that_reach_it_and_do_not(points, error):
    costs, values = [c for c, _ in points], [e for _, e in points]
    cost, sure = errors.cost_at(costs, values, error), errors.cheapest(costs, values, error)
    assert (cost is None) == (sure is None)
    if cost is not None and sure is not None:
        assert cost <= costs[sure] * (1 + 1e-12)
        worse = [costs[k] for k in errors.pareto(costs, values) if values[k] > error]
        assert cost >= max(worse, default=costs[sure]) * (1 - 1e-12)


def test_cost_on_a_power_law_is_exact():
    """A method of fourth order costs error**(-1/4), between its settings too; none is extrapolated."""
    costs = [1.0, 2.0, 4.0, 8.0]
    values = [1e-2 * cost**-4 for cost in costs]
    for error in (1e-2, 3e-3, 1e-5, values[-1]):
        assert errors.cost_at(costs, values, error) == pytest.approx((error / 1e-2) ** -0.25)
    assert errors.cost_at(costs, values, 1.0) == 1.0
    assert errors.cost_at(costs, values, 0.99 * values[-1]) is None
    assert errors.cost_at([1.0, 5.0], [1e-2, 0.0], 1e-3) == 5.0  # no logarithm of zero


# -- errors ------------------------------------------------------------------------------------------------------------


def test_strong_error_is_what_the_farthest_point_moves():
    """|dx| + R |dtheta| bounds every point of the circle, and for small turns some point gets there."""
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(20, 3))
    pose = truth + 1e-4 * rng.normal(size=(20, 3))
    around = np.linspace(0.0, 2.0 * math.pi, 721)

    def circle(at):
        angle = at[:, 2:] + around
        return np.stack([at[:, :1] + 0.03 * np.cos(angle), at[:, 1:2] + 0.03 * np.sin(angle)])

    farthest = np.hypot(*(circle(pose) - circle(truth))).max(axis=1)
    error = errors.strong_errors(pose, truth, 0.03)
    assert (farthest <= error * (1 + 1e-9)).all() and farthest == pytest.approx(error, rel=1e-3)


def test_strong_error_of_failures_and_discs():
    pose, truth = np.array([[3e-3, 4e-3, 2.0], [math.nan, 0.0, 0.0]]), np.zeros((2, 3))
    assert errors.strong_errors(pose, truth, 0.0).tolist() == [5e-3, math.inf]
    assert errors.spread(np.array([1.0, 2.0, math.inf])) == (2.0, math.inf, math.inf)


def test_weak_error():
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(4000, 2))
    for angle, factor in ((0.1, 1.0), (0.0, 0.97), (-0.2, 1.1)):
        c, s = factor * math.cos(angle), factor * math.sin(angle)
        turned = truth @ np.array([[c, s], [-s, c]])
        assert errors.weak_error(turned, truth) == pytest.approx(abs(factor * np.exp(1j * angle) - 1.0))  # systematic
    assert errors.weak_error(truth + 0.1 * rng.normal(size=truth.shape), truth) < 5e-3  # not systematic: cancels
    one = np.array([[0.3, 0.05]])
    assert errors.weak_error(one + [[0.003, 0.004]], one) == pytest.approx(0.005 / np.hypot(0.3, 0.05))
    assert errors.weak_error(np.full((1, 2), math.nan), one) == math.inf
    assert errors.weak_error(np.zeros((1, 2)), np.zeros((1, 2))) == 0.0


def test_order_of_a_power_law():
    assert fitted_order((8, 16, 32), tuple(3.0 * n**-3.5 for n in (8, 16, 32))) == pytest.approx(3.5)
    assert math.isnan(fitted_order((8, 16), (1e-3, 0.0)))


# -- measuring ---------------------------------------------------------------------------------------------------------


def made_up(method, change, worlds=4, **more):
    """A candidate that takes the planar outcome of a few worlds and changes it."""

    def prepare(scene):
        truth = prepare_model(scene, "planar", FINEST.knobs)()

        def run():
            pose, fallen = truth.pose[:worlds].copy(), truth.fallen[:worlds].copy()
            trouble = change(pose, fallen) or ()
            none = np.zeros(worlds, dtype=bool)
            return Outcome(truth.settled[:worlds], pose, fallen, none, trouble, 1e-3 * worlds)

        return run

    return Candidate(method, {}, prepare, compiled=False, **more)


def refuse(scene):
    raise ValueError("scene")


def test_worlds_that_a_model_does_not_vouch_for_are_counted():
    """At the table's speed slip passes through zero, which the averaged model is not certified for and says so."""
    table = Surface().table_speed
    [scene] = scenes_from(
        [{"name": "fast", "worlds": 8, "periods": 1, "start": {"velocity": [table, 0.0]}, "drive": {"kind": "random"}}],
        [1e-3], [0.5],
    )  # fmt: skip
    result = ladder.measure(scene, [model_candidate("averaged", {}), model_candidate("planar", {})], FINEST, rounds=1)
    assert result.table["doubtful_worlds"].tolist() == [8, 0]
    assert any("doubtful" in kind for _, _, _, kind in page.troubles(result))


@pytest.fixture(scope="module")
def result():
    [scene] = scenes_from(
        [{"name": "made up", "worlds": 8, "periods": 4, "drive": {"kind": "random"}}], [1e-3, 1e-6], [0.5]
    )

    def shift(pose, fallen):
        pose[:, 0] += 1e-4

    def fall(pose, fallen):
        fallen[1] = True

    def lose(pose, fallen):
        pose[2:] = math.nan
        return ("gave up", "gave up")

    candidates = [
        model_candidate("planar", {"steps": 8}),
        model_candidate("averaged", {"order": 2}),
        made_up("shifted", shift, peer=True),
        made_up("falling", fall, peer=True),
        made_up("losing", lose, peer=True),
        Candidate("refusing", {}, refuse, peer=True),
    ]
    return ladder.measure(scene, candidates, FINEST, rounds=3)


def row(result, method):
    return result.table[result.table["method"] == method].iloc[0]


def strong(row):
    return row[["strong_median_m", "strong_p95_m", "strong_max_m"]].tolist()


def test_rows(result):
    shifted = row(result, "shifted")
    assert strong(shifted) == pytest.approx([1e-4] * 3, rel=1e-6)
    assert shifted["worlds"] == 4 and shifted["cost_us"] == pytest.approx(1e3 / 4) and shifted["failed_worlds"] == 0
    assert math.isnan(shifted["strong_step_median_m"])
    planar = row(result, "planar")
    assert planar["timings"] == 3 and planar["worlds"] == 8 and 0 < planar["weak"] < 0.05
    assert strong(planar)[:2] == [planar["strong_step_median_m"], planar["strong_step_p95_m"]]


def test_model_error_and_step_error_bound_the_whole(result):
    averaged = row(result, "averaged, order 2")
    model = next(entry for entry in result.models if entry.method == "averaged, order 2")
    assert averaged["strong_p95_m"] <= model.strong.worst + averaged["strong_step_p95_m"]
    assert model.strong.worst > 1e-5 and averaged["strong_step_p95_m"] > 1e-7


def test_failures_are_named_and_off_the_front(result):
    assert row(result, "falling")["failures"] == {"fell, though it does not": 1}
    assert row(result, "losing")["failures"] == {"gave up": 2} and row(result, "losing")["weak"] == math.inf
    assert row(result, "refusing")["refused"] == "scene"
    failed = result.table["method"].isin(["falling", "losing", "refusing"])
    for front in ("front_strong", "front_weak"):
        assert result.table[front].any() and not result.table[front][failed].any()
    lines = page.troubles(result)
    assert ("made up", "falling", "every setting, 1 of 4 worlds", "failed: fell, though it does not") in lines
    assert ("made up", "losing", "every setting, 2 of 4 worlds", "failed: gave up") in lines
    assert ("made up", "refusing", "every setting", "refused: scene") in lines
    assert page.absent(result) == [("refusing", "scene")]


def test_choices_and_comparisons(result):
    loose, tight, weak = comparisons.choices(result)
    assert loose.row is not None and not loose.row.peer and loose.by_method["shifted"].cost_us == pytest.approx(250.0)
    assert tight.row is None and set(tight.by_method.values()) == {None}
    assert weak.weak and weak.tolerance == 0.5 and weak.row is not None
    [pair] = comparisons.at_its_errors(result, "planar", "shifted")
    assert pair.error == pytest.approx(1e-4) and pair.ratio == pytest.approx(250 / row(result, "planar")["cost_us"])
    missed = comparisons.at_error(result, "planar", "shifted", 1e-5, weak=False)
    assert missed is not None and missed.ratio is None and "shifted gets to 0.1 mm" in missed.note
    assert comparisons.at_error(result, "planar", "losing", 1.0, weak=False) is None
    assert comparisons.why_missing(result, "losing") == "every setting fails in some world"


# -- auto --------------------------------------------------------------------------------------------------------------


def test_promises_kept_and_broken_are_told_apart(monkeypatch):
    """With made-up evidence that praises the first-order model: what it says is held against what the model does."""

    rows = [
        {"model": model, "knobs": knobs, "error": error, "error_95": 9 * error, "us_per_period": cost, "us_per_call": 0.0}
        for model, knobs, error, cost in (
            ("averaged", {"order": 1}, 1e-3, 0.1), ("planar", {"steps": 24, "substeps": 2}, 1e-4, 5.0)
        )
    ]  # fmt: skip
    classes = [{"kind": "many elements", "eps": 0.5, "scale": 0.1, "rows": rows}]
    monkeypatch.setattr(choice, "evidence", lambda: {"classes": classes})
    [scene] = scenes_from([{"name": "any", "worlds": 8, "periods": 30, "drive": {"kind": "random"}}])
    fine = TruthSettings(steps=64, substeps=2, pieces=2)
    broken, kept, refused = auto_rows(scene, [1e-5, 1e-6, 1e-7], fine)
    assert (broken.model, broken.held) == ("averaged", False) and broken.measured is not None and broken.measured > 1e-4
    assert (kept.model, kept.setting) == ("planar", "steps=24, substeps=2") and kept.promised == pytest.approx(
        1.5e-4 * 2.7e-3
    )
    assert kept.held is (kept.measured is not None and kept.measured <= 1e-6) and kept.measured < 1e-3
    assert refused.refused.startswith("tolerance") and refused.held is None
