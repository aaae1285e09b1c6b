"""``model="tilting"``: equality with the planar model, uneven ground, contacts, tipping margins, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.plugins.tilting.rigid import ALUMINIUM, DISC, LARGE, PARTS, STEEL, in_the_middle, leans
from tests.simulation.helpers import random_fields, same
from vibgym import Part, Simulator, Surface

THREE = [STEEL, DISC, ALUMINIUM]


def tilting(parts: object = STEEL, surface: Surface = LARGE, **settings: object) -> Simulator:
    """A simulator with its parts in the middle of the table."""
    simulator = Simulator(surface, parts, model="tilting", **settings)
    in_the_middle(simulator)
    return simulator


# -- Flat --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parts", [STEEL, DISC, THREE], ids=["block", "disc", "three"])
def test_flat_on_level_ground_is_the_planar_model_to_the_bit(parts):
    flat, planar = tilting(parts, worlds=3), Simulator(LARGE, parts, worlds=3)
    in_the_middle(planar)
    rough = np.random.default_rng(12).uniform(0.6, 1.4, (3, 40, 40))
    for sim in (flat, planar):
        sim.set_conditions(slice(None), patches=rough)
    for phase in (0.3, 2.0, -1.0):
        for sim in (flat, planar):
            sim.advance(3e-4, phase, 3)
    state = flat.get_state()
    assert not state["mode"].any()
    for name, values in planar.get_state().items():
        assert np.array_equal(state[name], values), name


def test_landed_parts_equal_the_planar_model():
    simulator = tilting(worlds=8)
    simulator.tip(slice(None), leans(np.full(8, 0.03)))
    simulator.advance(2e-4, 1.0, 4)
    assert not simulator.get_state()["mode"].any() and not simulator.lean.any()
    planar = Simulator(LARGE, STEEL, worlds=8)
    planar.reset(simulator.pose, simulator.velocity)
    for sim in (simulator, planar):
        sim.advance(2e-4, 1.0, 5)
    assert np.array_equal(simulator.pose, planar.pose)


# -- Ground ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_a_part_rocks_where_plates_differ(part):
    """It rests on the highest plates, tilted within the limits of their heights and its width."""
    amplitude, phase = random_fields(LARGE, 16, 2)
    simulator = tilting(part, worlds=16)
    simulator.advance(0.25 * amplitude, phase, 10)
    state = simulator.get_state()
    assert (state["mode"] == 1).all()
    assert (simulator.tilt > 1e-6).any() and (simulator.tilt < 0.05).all()
    assert (np.abs(state["height"] - part.centre_height) < 5e-4).all()


def test_narrow_ramps_converge():
    """Results depend less on narrower ramps; at a tenth of the amplitude means agree."""
    amplitude, phase = random_fields(LARGE, 32, 4)
    ends = []
    for ramp in (0.0, 0.5, 6.0):
        simulator = tilting(worlds=32, ramp_mm=ramp)
        start = simulator.pose
        simulator.advance(0.1 * amplitude, phase, 5)
        ends.append(simulator.pose - start)
    near, far = (np.hypot(*(ends[0] - end)[:, 0, :2].T).mean() for end in ends[1:])
    assert near < far and near < 5e-4


# -- Contacts ----------------------------------------------------------------------------------------------------------


def test_a_tilted_part_keeps_its_footprint_in_contacts():
    """A block pushed into a tilted one moves it, without overlap."""
    parts = [STEEL, STEEL]
    simulator = Simulator(LARGE, parts, model="tilting")
    simulator.reset([[[0.50, 0.52, 0.0], [0.551, 0.52, 0.0]]], [[[0.3, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    simulator.tip(0, [[[0.0, 0.0], [0.02, 0.03]]], which=[[False, True]])
    simulator.advance(0.0, 0.0)
    assert simulator.pose[0, 1, 0] > 0.552 and simulator.statistics["contact"] == 1
    assert simulator.deepest_overlap < 3e-4
    simulator.advance(0.0, 0.0, 10)
    assert not simulator.tilt.any() and simulator.deepest_overlap < 3e-4


def test_a_toppled_part_has_no_contacts():
    tall = Part.rectangle(0.02, 0.02, friction=0.6, height=0.06, name="tall")
    simulator = tilting(tall, worlds=6)
    simulator.tip(slice(None), leans(np.full(6, 0.3)), rocking=40.0 * leans(np.full(6, 0.3)))
    simulator.advance(0.0, 0.0, 5)
    assert simulator.toppled.all() and simulator.fallen.all()
    here = simulator.pose
    simulator.advance(3e-4, 1.0, 5)
    assert np.array_equal(simulator.pose, here)
    simulator.reset(0.52)
    assert not simulator.toppled.any() and not simulator.fallen.any()


# -- How near a planar part is to tipping ------------------------------------------------------------------------------


def test_tipping_ratio_and_inertia():
    assert STEEL.tipping_ratio == pytest.approx(0.64 * 0.002 / 0.02)
    assert ALUMINIUM.tipping_ratio == pytest.approx(0.58 * 0.01 / 0.0175)
    high = Part.disc(0.02, friction=0.5, height=0.04, centre_height=0.03)
    assert high.tipping_ratio == pytest.approx(0.5 * 0.03 / 0.02, rel=2e-3)
    assert Part.rectangle(0.05, 0.04, friction=0.6).centre_height == 0.005
    square = (0.04**2 + 0.004**2) / 12, (0.05**2 + 0.004**2) / 12
    assert np.allclose(STEEL.inertia, [*square, 0.0], rtol=1e-12, atol=1e-18)
    assert np.allclose(high.inertia, [0.02**2 / 4 + 0.04**2 / 12] * 2 + [0.0], rtol=1e-9, atol=1e-15)
    turned = Part.polygon(STEEL.outline @ [[0.6, 0.8], [-0.8, 0.6]], friction=0.6, height=0.004)
    xx, yy, xy = turned.inertia  # the tensor of the same plate in other axes
    assert xx + yy == pytest.approx(sum(square)) and xx * yy - xy * xy == pytest.approx(square[0] * square[1])


def test_tipping_margin_on_level_ground():
    """Friction alone moves the centre of pressure: by ``mu h_C`` against the slip, all around once a period."""
    for part in (STEEL, ALUMINIUM):
        for model in ("planar", "tilting"):
            simulator = Simulator(LARGE, part, model=model)
            in_the_middle(simulator)
            assert simulator.tipping_margin[0, 0] == pytest.approx(1.0 - part.tipping_ratio, rel=0.01)
            simulator.advance(LARGE.max_amplitude, 0.3, 2)
            assert simulator.tipping_margin[0, 0] == pytest.approx(1.0 - part.tipping_ratio, rel=0.01)


def test_tipping_margin_at_a_border_and_of_tilted_and_fallen_parts():
    simulator = Simulator(LARGE, ALUMINIUM, worlds=3, model="tilting")
    simulator.reset([[[0.52, 0.52, 0.0]], [[0.005, 0.52, 0.0]], [[0.52, 0.52, 0.0]]])
    simulator.tip(2, 0.05)
    level, edge, tilted = simulator.tipping_margin[:, 0]
    assert edge == pytest.approx(1.0 - 0.58 * 0.01 / 0.005, rel=0.02) and edge < level and tilted == 0.0
    simulator.advance(LARGE.max_amplitude, 0.5 * math.pi, 60)
    assert simulator.fallen.any() and np.isneginf(simulator.tipping_margin[simulator.fallen]).all()


# -- Input -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arguments, message", [
    ({"worlds": 0, "lean": [[[0.0, 1.2]]]}, "lean"),
    ({"worlds": 5, "lean": 0.1}, "worlds"),
    ({"worlds": 0, "lean": np.zeros(7)}, "lean"),
    ({"worlds": 0, "lean": 0.0, "rocking": math.inf}, "rocking"),
])  # fmt: skip
def test_bad_tilts_change_nothing(arguments, message):
    simulator = tilting(ALUMINIUM, worlds=2)
    before = simulator.get_state()
    with pytest.raises(ValueError, match=message):
        simulator.tip(**arguments)
    assert same(before, simulator.get_state())


def test_only_this_model_tips():
    with pytest.raises(AttributeError, match="planar.*tip"):
        Simulator(LARGE, STEEL).tip(0, 0.1)


@pytest.mark.parametrize(("name", "value"), [("mode", 3), ("mode", -1), ("lean", 1.55)])
def test_damaged_states_are_refused(name, value):
    simulator = tilting()
    state = simulator.get_state()
    state[name] = np.full_like(state[name], value)
    with pytest.raises(ValueError, match=rf"state\['{name}'\]"):
        simulator.set_state(state)
    state.pop(name)
    with pytest.raises(ValueError, match="state"):
        simulator.set_state(state)
