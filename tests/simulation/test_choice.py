"""``model="auto"``: the cheapest candidate within the tolerance, and one clear error where there is none."""

import json
import math

import numpy as np
import pytest

from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part
from vibgym.simulation import choice

BLOCK = shipped_part("aluminium_block")
PROTOTYPE = Surface()


def auto(surface=PROTOTYPE, part=BLOCK, **knobs):
    return Simulator(surface, part, model="auto", **knobs)


def test_auto_equals_the_chosen_model():
    sim = auto(tolerance=5e-5)
    same = Simulator(PROTOTYPE, BLOCK, model=sim.choice.model, **sim.choice.knobs)
    for each in (sim, same):
        each.reset([0.3, 0.1, 0.2])
        each.advance(3e-4, 1.0, 5)
    assert (sim.pose == same.pose).all()


@pytest.mark.parametrize("kind", ["one element", "many elements", "stick-slip"])
@pytest.mark.parametrize("periods_per_call", [1, 25])
def test_the_cheapest_sufficient_candidate_is_chosen(kind, periods_per_call):
    """Brute force over the evidence, for every class and a sweep of tolerances."""
    surface = Surface(rows=1, columns=1, element_size=1.0) if kind == "one element" else PROTOTYPE
    part = Part.rectangle(0.05, 0.035, friction=8.0) if kind == "stick-slip" else BLOCK
    found = choice.class_of(choice.traits(surface, part))
    assert found["kind"] == kind
    previous = math.inf
    for tolerance in np.geomspace(1e-6, 1e-1, 26):
        able = [
            row for row in found["rows"]
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
            scene = choice.traits(PROTOTYPE, Part.rectangle(length, 0.7 * length, friction=friction))
            found = choice.class_of(scene)
            assert found["kind"] == scene.kind and found["eps"] >= scene.eps and found["scale"] <= scene.scale
    double = Surface(element_size=0.052, horizontal_amplitude=5.4e-3, frequency=25.0 / math.sqrt(2))
    alike = choice.traits(double, Part.rectangle(0.10, 0.07, friction=0.58))
    same = choice.traits(PROTOTYPE, Part.rectangle(0.05, 0.035, friction=0.58))
    assert alike.eps == pytest.approx(same.eps) and alike.scale == pytest.approx(
        same.scale
    )  # twice as large, in every way


def test_scenes_without_evidence_are_refused():
    speck = Part.disc(1e-5, friction=0.5)
    with pytest.raises(ValueError, match="model"):
        auto(part=speck)
    with pytest.raises(ValueError, match="tolerance"):
        auto(tolerance=1e-12)
    with pytest.raises(ValueError, match="tolerance"):
        Simulator(PROTOTYPE, BLOCK, tolerance=1e-3)


def test_the_evidence_is_complete():
    stored = choice.evidence()
    assert json.loads(json.dumps(stored)) == stored and stored["periods"] == choice.PERIODS
    for each in stored["classes"]:
        models = {row["model"] for row in each["rows"]}
        assert models == ({"planar"} if each["kind"] == "stick-slip" else {"planar", "averaged"})
        for row in each["rows"]:
            assert row["us_per_period"] >= 0.0 and row["us_per_call"] >= 0.0
            assert row["error"] is None or 0.0 <= row["error"] <= (row["error_95"] or math.inf)


def held_scene(surface, worlds, seed):
    rng = np.random.default_rng(seed)
    shape = (worlds, surface.rows, surface.columns)
    pose = np.column_stack([
        rng.uniform(0.4, 0.6, worlds) * surface.width, rng.uniform(0.4, 0.6, worlds) * surface.depth,
        rng.uniform(-3, 3, worlds),
    ])[:, None]  # fmt: skip
    return pose, rng.uniform(0.0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


UNSEEN = {
    "L-shape on the prototype": (
        PROTOTYPE,
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
    pose, amplitude, phase = held_scene(surface, worlds, 11)

    def run(**settings):
        sim = Simulator(surface, part, worlds=worlds, **settings)
        sim.reset(pose)
        sim.advance(amplitude, phase, periods)
        return sim

    sim, truth = run(model="auto", tolerance=tolerance, periods_per_call=periods), run(steps=96, substeps=2, pieces=4)
    difference = np.abs(sim.pose - truth.pose)[:, 0]
    deviation = np.hypot(difference[:, 0], difference[:, 1]) + part.radius * difference[:, 2]
    assert np.median(deviation) <= sim.choice.error <= tolerance
