"""Elements with different friction: closed forms, the independent reference, and equality with a common factor."""

import math

import numpy as np
import pytest

from studies.accuracy.reference import integrate
from tests.simulation.helpers import random_fields
from vibgym import Part, Simulator, Surface

G = 9.81
BLOCK = Part.rectangle(0.050, 0.030, friction=0.4, static_friction=0.5)
TWO = Surface(rows=1, columns=2, element_size=1.0, horizontal_amplitude=0.0)
"""Return a still table of two elements with a border at x = 1 m."""


def still(surface, part, pose, velocity, patches, **knobs):
    simulator = Simulator(surface, part, **knobs)
    simulator.reset(pose, velocity)
    simulator.set_conditions(0, patches=patches)
    return simulator


@pytest.mark.parametrize("knobs", [{}, {"steps": 30}, {"pieces": 3}])
@pytest.mark.parametrize("before, after", [(1.0, 0.5), (0.6, 1.4)])
def test_a_part_that_crosses_a_border_loses_the_work_of_friction(before, after, knobs):
    """The coefficient changes linearly over the part's length L: v^2 / 2 decreases by mu g (f_1 + f_2) L / 2."""
    start, length = 1.0, 0.050
    simulator = still(TWO, BLOCK, [0.97, 0.5, 0.0], [start, 0.0, 0.0], [[before, after]], **knobs)
    simulator.advance(0.0, 0.0, 2)
    way = simulator.pose[0, 0, 0] - 0.97 - 0.005 - length  # on the second element alone, after 5 mm on the first
    energy = 0.5 * start**2 - 0.4 * G * (0.005 * before + 0.5 * (before + after) * length + way * after)
    assert way > 0.0 and simulator.velocity[0, 0] == pytest.approx([math.sqrt(2.0 * energy), 0.0, 0.0], abs=2e-4)


@pytest.mark.parametrize("factor, held", [(0.999, True), (1.001, False)])
def test_static_friction_is_that_of_the_elements(factor, held):
    """With equal areas on both sides of the centre of mass, the limit is the mean."""
    slope = factor * 0.5 * G * 0.85
    simulator = still(TWO, BLOCK, [1.0, 0.5, 0.0], None, [[1.0, 0.7]])
    simulator.set_conditions(0, incline=[slope, 0.0])
    simulator.advance(0.0, 0.0, 1)
    assert simulator.sticking.all() == held


@pytest.mark.parametrize("share, frequency, slope, switches", [(1.0, 25.0, 0.9, 0), (0.4, 6.0, 1.2, 7)])
def test_against_the_independent_reference(share, frequency, slope, switches):
    """Sliding, and sticking and slipping on an incline, on random elements of random friction."""
    surface = Surface(rows=4, columns=8, frequency=frequency)
    amplitude, phase = random_fields(surface, 1, 5)
    amplitude *= share
    patches, incline = np.random.default_rng(4).uniform(0.6, 1.4, (4, 8)), [0.0, slope]
    start, velocity = [0.1, 0.05, 0.4], [0.0, surface.table_speed, 0.0]
    known = integrate(
        surface, BLOCK, start, velocity, amplitude[0], phase[0], 3,
        patches=patches, incline=incline, tolerance=1e-5, estimate=False,
    )  # fmt: skip
    assert len(known.switches) == switches
    ends = []
    for each, inclined in ((patches, incline), (1.0, incline), (patches, 0.0)):
        simulator = still(surface, BLOCK, start, velocity, each, steps=64, substeps=2, pieces=6)
        simulator.set_conditions(0, incline=inclined)
        simulator.advance(amplitude, phase, 3)
        ends.append(np.abs(simulator.pose[0, 0] - known.pose[-1]).max())
    assert ends[0] < 2e-5 and min(ends[1:]) > 20.0 * ends[0]


@pytest.mark.parametrize("knobs", [{}, {"pieces": 3}])
def test_equal_patches_equal_a_factor_on_friction(knobs):
    surface = Surface()
    amplitude, phase = random_fields(surface, 20, 6)
    start = np.random.default_rng(5).uniform([0.1, 0.05, -3.0], [0.7, 0.15, 3.0], (20, 1, 3))
    ends = []
    for name in ("friction", "patches"):
        simulator = Simulator(surface, BLOCK, worlds=20, **knobs)
        simulator.reset(start)
        simulator.set_conditions(slice(None), **{name: 0.8})
        simulator.advance(amplitude, phase, 10)
        ends.append(simulator.pose)
    assert np.abs(ends[0] - ends[1]).max() < 1e-11


def test_patches_per_world_and_in_snapshots():
    """Patches are allocated on first use; snapshots from before and after are compatible."""
    surface = Surface()
    amplitude, phase = random_fields(surface, 3, 8)
    patches = np.random.default_rng(9).uniform(0.5, 1.5, (3, 8, 32))
    several, plain = (Simulator(surface, [BLOCK, BLOCK], worlds=3) for _ in range(2))
    before = several.get_state()
    several.set_conditions(1, patches=patches[1])
    assert (several.patches[1] == patches[1]).all() and (several.patches[[0, 2]] == 1.0).all()
    state = several.get_state()
    several.advance(amplitude, phase, 5)
    plain.advance(amplitude, phase, 5)
    assert (several.pose[[0, 2]] == plain.pose[[0, 2]]).all() and (several.pose[1] != plain.pose[1]).any()
    after = several.pose
    plain.set_state(state)
    plain.advance(amplitude, phase, 5)
    assert (plain.pose == after).all()
    several.set_state(before)
    assert (several.patches == 1.0).all()
    several.set_conditions(2, patches=patches[2])
    several.reset([[0.2, 0.1, 0.0], [0.5, 0.1, 0.0]])
    assert (several.patches == 1.0).all()


def test_tipping_margin_with_patches():
    """A part on one element equals a part with that factor; its pressure does not change."""
    tall = Part.rectangle(0.050, 0.030, friction=0.3, height=0.025)
    margins = []
    for given in ({"friction": 1.5}, {"patches": [[1.5] * 32] * 8}):
        simulator = Simulator(Surface(), tall)
        simulator.reset([0.4, 0.1, 0.3])
        simulator.set_conditions(0, **given)
        margins.append(simulator.tipping_margin[0, 0])
    assert margins[0] == pytest.approx(margins[1], abs=1e-12) and 0.0 < margins[0] < 1.0


@pytest.mark.parametrize(
    "part", [Part.rectangle(0.050, 0.035, friction=0.58, height=0.020), Part.disc(0.02, friction=0.5)]
)
def test_tilted_parts_have_the_friction_of_each_plate(part):
    """Equal patches equal a factor on friction; a flat part equals the planar model bit for bit."""
    surface = Surface()
    amplitude, phase = random_fields(surface, 6, 10)
    amplitude *= 0.3
    # Rounding grows on steps: from these starts, a shift by 1e-15 m changes the end by at most 2e-8; from others by 4e-5.
    start = np.random.default_rng(16).uniform([0.1, 0.06, -3.0], [0.7, 0.14, 3.0], (6, 1, 3))
    rough = np.random.default_rng(12).uniform(0.6, 1.4, (6, 8, 32))
    ends = {}
    for name, given in (("even", {"friction": 0.7}), ("alike", {"patches": 0.7}), ("rough", {"patches": rough})):
        simulator = Simulator(surface, part, worlds=6, model="tilting")
        simulator.reset(start)
        simulator.set_conditions(slice(None), **given)
        simulator.tip(slice(None), [0.03, 0.02])
        simulator.advance(0.2 * surface.max_amplitude, 0.3, 3)  # it lands
        simulator.advance(amplitude, phase, 2)  # and rests on steps
        ends[name] = simulator.pose
    assert np.abs(ends["even"] - ends["alike"]).max() < 1e-6
    assert np.abs(ends["rough"] - ends["even"]).max() > 1e-5
    flat, middle = [], start * [1.0, 0.2, 1.0] + [0.0, 0.08, 0.0]
    for model in ("tilting", "planar"):
        simulator = Simulator(surface, part, worlds=6, model=model)
        simulator.reset(middle)
        simulator.set_conditions(slice(None), patches=rough)
        for _ in range(8):
            simulator.advance(0.3 * surface.max_amplitude, 0.4)
        flat.append(simulator.pose)
    assert (flat[0] == flat[1]).all()
