"""Settings that the simulator chooses: ``model="auto"`` within a tolerance, steps of the planar model, threads."""

import math

import numpy as np
import pytest

from tests.simulation.helpers import SURFACE, random_fields, simulated
from vibgym import Part, Surface
from vibgym.scene.parts import shipped_part
from vibgym.simulation import choice, threads
from vibgym.simulation.schemes import PlanarSettings, planar_scheme

BLOCK = shipped_part("aluminium_block")


def test_auto_equals_the_chosen_model():
    scene = SURFACE, BLOCK, [0.3, 0.1, 0.2], None, 3e-4, 1.0, 5
    auto = simulated(*scene, model="auto", tolerance=5e-5)
    chosen = simulated(*scene, model=auto.choice.model, **auto.choice.knobs)
    assert (auto.pose == chosen.pose).all()


@pytest.mark.parametrize("kind", ["one element", "many elements", "stick-slip"])
@pytest.mark.parametrize("periods_per_call", [1, 25])
def test_the_cheapest_sufficient_candidate_is_chosen(kind, periods_per_call):
    """Brute force over the evidence, for every class and a sweep of tolerances."""
    surface = Surface(rows=1, columns=1, element_size=1.0) if kind == "one element" else SURFACE
    part = Part.rectangle(0.05, 0.035, friction=8.0) if kind == "stick-slip" else BLOCK
    entry = choice.class_of(choice.traits(surface, part))
    assert entry["kind"] == kind
    previous = math.inf
    for tolerance in np.geomspace(1e-6, 1e-1, 26):
        able = [
            row for row in entry["rows"]
            if row["error"] is not None and choice.MARGIN * row["error"] * surface.horizontal_amplitude <= tolerance
            and row["knobs"].get("stride", 1) <= periods_per_call
        ]  # fmt: skip
        if not able:
            with pytest.raises(ValueError, match=r"tolerance"):
                choice.choose(surface, part, tolerance, periods_per_call)
            continue
        picked = choice.choose(surface, part, tolerance, periods_per_call)
        cost = min(choice.cost_of(row, periods_per_call) for row in able)
        assert picked.cost == cost and picked.error <= tolerance and cost <= previous
        previous = cost
    assert previous < math.inf


def test_a_scene_takes_a_class_that_is_at_least_as_hard():
    for friction in (0.05, 0.3, 0.58, 1.2, 3.0):
        for length in (0.008, 0.02, 0.05, 0.2):
            scene = choice.traits(SURFACE, Part.rectangle(length, 0.7 * length, friction=friction))
            entry = choice.class_of(scene)
            assert entry["kind"] == scene.kind and entry["eps"] >= scene.eps and entry["scale"] <= scene.scale
    double = Surface(element_size=0.052, horizontal_amplitude=5.4e-3, frequency=25.0 / math.sqrt(2))
    alike = choice.traits(double, Part.rectangle(0.10, 0.07, friction=0.58))
    same = choice.traits(SURFACE, Part.rectangle(0.05, 0.035, friction=0.58))
    assert alike.eps == pytest.approx(same.eps) and alike.scale == pytest.approx(
        same.scale
    )  # twice as large, in every way


def test_the_evidence_is_complete():
    stored = choice.evidence()
    assert stored["periods"] == choice.PERIODS
    for entry in stored["classes"]:
        models = {row["model"] for row in entry["rows"]}
        assert models == ({"planar"} if entry["kind"] == "stick-slip" else {"planar", "averaged"})
        for row in entry["rows"]:
            assert row["us_per_period"] >= 0.0 and row["us_per_call"] >= 0.0
            assert row["error"] is None or 0.0 <= row["error"] <= (row["error_95"] or math.inf)


UNSEEN = {
    "L-shape on the prototype": (
        SURFACE,
        Part.polygon(1e-3 * np.array([[0, 0], [60, 0], [60, 30], [30, 30], [30, 60], [0, 60]]), friction=0.4),
    ),
    "triangle on small elements": (
        Surface(rows=24, columns=24, element_size=0.015),
        Part.polygon([[0, 0], [0.05, 0.01], [0.02, 0.06]], friction=0.7),
    ),
    "slow wide table": (
        Surface(rows=12, columns=12, element_size=0.05, horizontal_amplitude=6e-3, frequency=12.0),
        Part.disc(0.04, friction=0.25),
    ),
    "stick and slip": (Surface(horizontal_amplitude=6e-4, max_amplitude=3e-4), Part.rectangle(0.06, 0.03, friction=0.9)),
}  # fmt: skip


@pytest.mark.parametrize("name", UNSEEN)
@pytest.mark.parametrize("tolerance", [2e-3, 2e-4])
def test_promised_errors_hold_on_other_scenes(name, tolerance):
    surface, part = UNSEEN[name]
    worlds, periods = 32, choice.PERIODS
    amplitude, phase = random_fields(surface, worlds, 11)
    far = np.random.default_rng(11).uniform([0.4, 0.4, -3.0], [0.6, 0.6, 3.0], (worlds, 1, 3))
    pose = far * [surface.width, surface.depth, 1.0]

    scene = surface, part, pose, None, amplitude, phase, periods
    sim = simulated(*scene, model="auto", tolerance=tolerance, periods_per_call=periods)
    truth = simulated(*scene, steps=96, substeps=2, pieces=4)
    difference = np.abs(sim.pose - truth.pose)[:, 0]
    deviation = np.hypot(difference[:, 0], difference[:, 1]) + part.radius * difference[:, 2]
    assert np.median(deviation) <= sim.choice.error <= tolerance


# -- steps of the planar model, and threads ------------------------------------------------------------------------------


def scheme(part, **settings):
    chosen = planar_scheme(SURFACE, part, PlanarSettings(**settings))
    return chosen.steps, chosen.substeps


def test_small_parts_are_cut_more_often():
    # The radius of gyration of a disc is r / sqrt(2); the table's speed makes 2 pi a_h = 17 mm in a period.
    limit = 2.0 * math.pi * SURFACE.horizontal_amplitude * math.sqrt(2.0)
    assert scheme(Part.disc(0.999 * limit, friction=0.5)) == (9, 2)
    assert scheme(Part.disc(1.001 * limit, friction=0.5)) == (5, 4)


@pytest.mark.parametrize("steps", [4, 5, 17, 18, 40])
def test_at_least_eighteen_runge_kutta_steps(steps):
    got, substeps = scheme(shipped_part("steel_block"), steps=steps)
    assert got == steps and steps * substeps >= 18 and steps * (substeps - 1) < 18


def test_threads_are_limited_by_the_environment_variable(monkeypatch):
    monkeypatch.delenv(threads.VARIABLE, raising=False)
    available = threads.available_threads()
    assert available >= 1
    for number, expected in (("1", 1), ("2", min(available, 2)), ("100000", available), ("", available)):
        monkeypatch.setenv(threads.VARIABLE, number)
        assert threads.available_threads() == expected
    for number in ("0", "two", "1.5"):
        monkeypatch.setenv(threads.VARIABLE, number)
        with pytest.raises(ValueError, match="VIBGYM_THREADS"):
            threads.available_threads()
