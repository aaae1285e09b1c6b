"""Conditions of worlds: friction of parts and elements, mass, an inclined table; closed forms, references, equivalent parts."""

import dataclasses
import math

import numpy as np
import pytest

from studies.accuracy.reference import integrate
from tests.simulation.helpers import SURFACE, random_fields, random_scene, same_motion, simulated
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

G = 9.81
STILL = Surface(horizontal_amplitude=0.0)
PERIOD = STILL.period
ONE = Surface(rows=1, columns=1, element_size=8.0)
BLOCK = Part.rectangle(0.050, 0.035, friction=0.4, static_friction=0.5)


# -- a still, inclined table ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [-2.0, 0.0, 0.3, 2.0])
def test_a_sliding_part_is_slowed_by_friction_less_the_incline(slope):
    """In a line: v = v_0 - (mu g - b) t, until it stops after v_0^2 / (2 (mu g - b)) and sticks."""
    braking, start = 0.4 * G - slope, 0.5
    simulator = simulated(STILL, BLOCK, [0.3, 0.1, 0.0], [start, 0.0, 0.0], conditions={"incline": [slope, 0.0]})
    assert simulator.velocity[0, 0] == pytest.approx([start - braking * PERIOD, 0.0, 0.0], abs=1e-12)
    way = start * PERIOD - 0.5 * braking * PERIOD**2
    assert simulator.pose[0, 0] == pytest.approx([0.3 + way, 0.1, 0.0], abs=1e-12)
    simulator.advance(0.0, 0.0, 10)
    assert simulator.sticking.all() and (simulator.velocity == 0.0).all()
    # The last steps are implicit.
    assert simulator.pose[0, 0] == pytest.approx([0.3 + start**2 / (2.0 * braking), 0.1, 0.0], abs=2e-7)
    stopped = simulator.pose
    simulator.advance(0.0, 0.0, 10)
    assert (simulator.pose == stopped).all()


@pytest.mark.parametrize("direction", [0.0, 0.7, 2.5, -1.2])
def test_static_friction_holds_up_to_its_coefficient(direction):
    along = np.array([math.cos(direction), math.sin(direction)])
    for share, held in ((0.9, True), (0.9999, True), (1.0001, False), (1.1, False)):
        conditions = {"incline": share * 0.5 * G * along}
        simulator = simulated(STILL, BLOCK, [0.3, 0.1, 0.0], periods=2, conditions=conditions)
        assert simulator.sticking.all() == held
        # After breakaway only sliding friction acts.
        way = 0.0 if held else 0.5 * (share * 0.5 - 0.4) * G * (2.0 * PERIOD) ** 2
        assert simulator.pose[0, 0] == pytest.approx([0.3 + way * along[0], 0.1 + way * along[1], 0.0], abs=2e-6)


def test_energy_on_an_inclined_table_never_grows():
    """Kinetic energy less the work of the incline, with contacts and walls."""
    parts = [BLOCK, Part.disc(0.02, friction=0.1, restitution=0.9), Part.disc(0.015, friction=0.0, restitution=1.0)] * 2
    worlds, random = 12, np.random.default_rng(3)
    simulator = Simulator(STILL, parts, walls=["left", "right", "bottom", "top"], worlds=worlds)
    x = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    pose = np.stack([x, np.full(6, 0.1), np.zeros(6)], axis=1)
    simulator.reset(pose, random.normal(0.0, 1.0, (worlds, 6, 3)) * [0.5, 0.5, 5.0])
    incline, factor = random.normal(0.0, 1.5, (worlds, 2)), random.uniform(0.3, 3.0, (worlds, 6))
    simulator.set_conditions(slice(None), friction=random.uniform(0.3, 3.0, (worlds, 6)), mass=factor, incline=incline)
    mass, inertia = np.array([p.mass for p in parts]) * factor, np.array([p.gyration for p in parts])
    energies = []
    for _ in range(25):
        place, v = simulator.pose, simulator.velocity
        moving = 0.5 * mass * (v[..., 0] ** 2 + v[..., 1] ** 2 + inertia * v[..., 2] ** 2)
        energies.append((moving - mass * (place[..., :2] * incline[:, None]).sum(-1)).sum(1))
        simulator.advance(0.0, 0.0, 1)
    energy = np.array(energies)
    # The overlap correction may lift a part by the depth of the overlap.
    lift = simulator.deepest_overlap * (mass * np.hypot(*incline.T)[:, None]).sum(1)
    assert (np.diff(energy, axis=0) <= lift + 1e-12).all() and simulator.statistics["contact"] > 50
    assert simulator.deepest_overlap < 3e-4 and not simulator.fallen.any() and not simulator.diverged.any()


# -- a moving, inclined table --------------------------------------------------------------------------------------------


def test_drift_down_a_slope():
    """Averaged friction near rest is -(mu g / 2 V) v: the part drifts with 2 b V / (mu g), to the first order in eps."""
    for friction, share in ((0.1, 0.002), (0.05, 0.0006)):  # eps = 0.015 and 0.007: of second order
        part = Part.rectangle(0.05, 0.035, friction=friction)
        slope = 0.02 * friction * G
        simulator = simulated(ONE, part, [4.0, 4.0, 0.0], periods=1500, conditions={"incline": [slope, 0.0]})
        drift = complex(*simulator.mean_velocity[0, 0, :2])
        assert abs(drift) == pytest.approx(2.0 * slope * ONE.table_speed / (friction * G), rel=share)


def test_order_of_convergence_under_incline():
    """Runge-Kutta steps stay of fourth order: the incline is part of every stage."""

    def end(substeps):
        scene, conditions = ([4.0, 4.0, 0.0], [0.1, 0.05, 2.0], ONE.max_amplitude, 1.0, 2), {"incline": [1.5, -2.0]}
        return simulated(ONE, BLOCK, *scene, conditions=conditions, steps=4, substeps=substeps).pose[0, 0]

    exact = end(512)
    errors = [np.abs(end(substeps) - exact).max() for substeps in (8, 16, 32)]
    for coarse, fine in zip(errors, errors[1:]):
        assert 12.0 < coarse / fine < 20.0


# -- factors against equivalent parts ----------------------------------------------------------------------------------


def copies(parts, friction, mass):
    """Return parts with these factors."""
    return [
        dataclasses.replace(
            part, friction=f * part.friction, static_friction=f * part.static_friction, mass=m * part.mass
        )
        for part, f, m in zip(parts, friction, mass, strict=True)
    ]


STICKY = Surface(frequency=8.0)


@pytest.mark.parametrize("surface, model, factor", [
    *((SURFACE, model, factor) for model in ("planar", "averaged") for factor in (0.3, 1.3, 2.1)), (STICKY, "planar", 0.7),
])  # fmt: skip
def test_a_factor_on_friction_equals_another_part(surface, model, factor):
    """Sliding, and sticking and slipping."""
    worlds = 9
    amplitude, phase = random_fields(surface, worlds, 2)
    velocity = np.random.default_rng(4).normal(0.0, 1.0, (worlds, 1, 3)) * [0.1, 0.1, 3.0]
    scene = [[[0.3, 0.1, 0.5]]] * worlds, velocity, amplitude, phase, 5
    one = simulated(surface, BLOCK, *scene, model=model, conditions={"friction": factor})
    same_motion(one, simulated(surface, copies([BLOCK], [factor], [1.0]), *scene, model=model))


@pytest.mark.parametrize("friction, mass", [
    ([1.0] * 4, [5.0, 0.2, 1.0, 40.0]), ([2.5, 0.4, 1.0, 3.0], [1.0] * 4), ([3.0, 0.1, 2.0, 0.7], [0.03, 7.0, 0.5, 11.0]),
])  # fmt: skip
def test_factors_of_touching_parts_equal_other_parts(friction, mass):
    """In impacts, the solver's iterations, and the steps of the coupling."""
    parts = [BLOCK, Part.disc(0.02, friction=0.5, restitution=0.8), shipped_part("steel_block"), BLOCK]
    pose = [[0.20, 0.10, 0.3], [0.26, 0.10, 0.0], [0.32, 0.10, 1.0], [0.04, 0.05, 0.0]]
    velocity = [[0.3, 0.0, 2.0], [-0.2, 0.0, 0.0], [-0.3, 0.05, -4.0], [-0.5, 0.0, 0.0]]
    scene = [pose] * 3, velocity, *random_fields(SURFACE, 3, 6), 8
    one = simulated(SURFACE, parts, *scene, walls=["left"], conditions={"friction": friction, "mass": mass})
    other = simulated(SURFACE, copies(parts, friction, mass), *scene, walls=["left"])
    same_motion(one, other)
    assert one.statistics == other.statistics and one.statistics["contact_steps"] > 20


def test_an_incline_carries_parts_into_a_wall():
    """Without friction and from rest, contact follows from the incline alone. The part rebounds with e times its speed."""
    part = Part.disc(0.02, friction=0.0, restitution=0.5, contact_friction=0.0)
    slope, gap, start = 3.0, 0.001, 0.021
    simulator = simulated(STILL, part, [start, 0.1, 0.0], walls=["left"], conditions={"incline": [-slope, 0.0]})
    impact_time = math.sqrt(2.0 * gap / slope)
    left = PERIOD - impact_time
    speed = 0.5 * slope * impact_time
    assert 0.0 < left < 2.0 * speed / slope  # moving back, or down again, at the end
    assert simulator.pose[0, 0, 0] == pytest.approx(0.02 + speed * left - 0.5 * slope * left**2, abs=3e-5)
    assert simulator.velocity[0, 0, 0] == pytest.approx(speed - slope * left, abs=3e-3)
    assert simulator.deepest_overlap < 1e-4


# -- the interface -----------------------------------------------------------------------------------------------------


def test_conditions_are_read_back():
    simulator = Simulator(SURFACE, [BLOCK, BLOCK], worlds=3)
    simulator.reset([[0.2, 0.1, 0.0], [0.4, 0.1, 0.0]])
    assert (simulator.friction == 1.0).all() and (simulator.mass == 1.0).all() and (simulator.incline == 0.0).all()
    simulator.set_conditions([True, False, True], friction=[0.5, 2.0], incline=[[0.1, 0.2], [0.3, 0.0]])
    simulator.set_conditions(1, mass=3.0)
    assert simulator.friction.tolist() == [[0.5, 2.0], [1.0, 1.0], [0.5, 2.0]]
    assert simulator.mass.tolist() == [[1.0, 1.0], [3.0, 3.0], [1.0, 1.0]]
    assert simulator.incline.tolist() == [[0.1, 0.2], [0.0, 0.0], [0.3, 0.0]]


# -- elements with different friction ------------------------------------------------------------------------------------

SLIM = Part.rectangle(0.050, 0.030, friction=0.4, static_friction=0.5)
TWO = Surface(rows=1, columns=2, element_size=1.0, horizontal_amplitude=0.0)
"""A still table of two elements with a border at x = 1 m."""


@pytest.mark.parametrize("knobs", [{}, {"steps": 30}, {"pieces": 3}])
@pytest.mark.parametrize("before, after", [(1.0, 0.5), (0.6, 1.4)])
def test_a_part_that_crosses_a_border_loses_the_work_of_friction(before, after, knobs):
    """The coefficient changes linearly over the part's length L: v^2 / 2 decreases by mu g (f_1 + f_2) L / 2."""
    start, length = 1.0, 0.050
    conditions = {"patches": [[before, after]]}
    simulator = simulated(TWO, SLIM, [0.97, 0.5, 0.0], [start, 0.0, 0.0], periods=2, conditions=conditions, **knobs)
    way = simulator.pose[0, 0, 0] - 0.97 - 0.005 - length  # on the second element alone, after 5 mm on the first
    energy = 0.5 * start**2 - 0.4 * G * (0.005 * before + 0.5 * (before + after) * length + way * after)
    assert way > 0.0 and simulator.velocity[0, 0] == pytest.approx([math.sqrt(2.0 * energy), 0.0, 0.0], abs=2e-4)


@pytest.mark.parametrize("factor, held", [(0.999, True), (1.001, False)])
def test_static_friction_is_that_of_the_elements(factor, held):
    """With equal areas on both sides of the centre of mass, the limit is the mean."""
    conditions = {"patches": [[1.0, 0.7]], "incline": [factor * 0.5 * G * 0.85, 0.0]}
    assert simulated(TWO, SLIM, [1.0, 0.5, 0.0], conditions=conditions).sticking.all() == held


@pytest.mark.parametrize("share, frequency, slope, switches", [(1.0, 25.0, 0.9, 0), (0.4, 6.0, 1.2, 7)])
def test_against_the_independent_reference(share, frequency, slope, switches):
    """Sliding, and sticking and slipping on an incline, on random elements of random friction."""
    surface = Surface(rows=4, columns=8, frequency=frequency)
    amplitude, phase = random_fields(surface, 1, 5)
    amplitude *= share
    patches, incline = np.random.default_rng(4).uniform(0.6, 1.4, (4, 8)), [0.0, slope]
    start, velocity = [0.1, 0.05, 0.4], [0.0, surface.table_speed, 0.0]
    known = integrate(
        surface, SLIM, start, velocity, amplitude[0], phase[0], 3,
        patches=patches, incline=incline, tolerance=1e-5, estimate=False,
    )  # fmt: skip
    assert len(known.switches) == switches
    ends = []
    for factors, inclined in ((patches, incline), (1.0, incline), (patches, 0.0)):
        simulator = simulated(
            surface, SLIM, start, velocity, amplitude, phase, 3, steps=64, substeps=2, pieces=6,
            conditions={"patches": factors, "incline": inclined},
        )  # fmt: skip
        ends.append(np.abs(simulator.pose[0, 0] - known.pose[-1]).max())
    assert ends[0] < 2e-5 and min(ends[1:]) > 20.0 * ends[0]


@pytest.mark.parametrize("knobs", [{}, {"pieces": 3}])
def test_equal_patches_equal_a_factor_on_friction(knobs):
    scene = random_scene(SURFACE, 20, 6)
    one, other = (
        simulated(SURFACE, SLIM, *scene, 10, conditions={name: 0.8}, **knobs).pose for name in ("friction", "patches")
    )
    assert np.abs(one - other).max() < 1e-11


def test_patches_per_world_and_in_snapshots():
    """Patches are allocated on first use; snapshots from before and after are compatible."""
    amplitude, phase = random_fields(SURFACE, 3, 8)
    patches = np.random.default_rng(9).uniform(0.5, 1.5, (3, 8, 32))
    several, plain = (Simulator(SURFACE, [SLIM, SLIM], worlds=3) for _ in range(2))
    before = several.get_state()
    several.set_conditions(1, patches=patches[1])
    assert (several.patches[1] == patches[1]).all() and (several.patches[[0, 2]] == 1.0).all()
    state = several.get_state()
    for simulator in (several, plain):
        simulator.advance(amplitude, phase, 5)
    assert (several.pose[[0, 2]] == plain.pose[[0, 2]]).all() and (several.pose[1] != plain.pose[1]).any()
    plain.set_state(state)
    plain.advance(amplitude, phase, 5)
    assert (plain.pose == several.pose).all()
    several.set_state(before)
    assert (several.patches == 1.0).all()


def test_tipping_margin_with_patches():
    """A part on one element equals a part with that factor; its pressure does not change."""
    tall = Part.rectangle(0.050, 0.030, friction=0.3, height=0.025)
    margins = []
    for conditions in ({"friction": 1.5}, {"patches": [[1.5] * 32] * 8}):
        simulator = simulated(SURFACE, tall, [0.4, 0.1, 0.3], conditions=conditions)
        margins.append(simulator.tipping_margin[0, 0])
    assert margins[0] == pytest.approx(margins[1], abs=1e-12) and 0.0 < margins[0] < 1.0


@pytest.mark.parametrize(
    "part", [Part.rectangle(0.050, 0.035, friction=0.58, height=0.020), Part.disc(0.02, friction=0.5)]
)
def test_tilted_parts_have_the_friction_of_each_plate(part):
    """Equal patches equal a factor on friction."""
    amplitude, phase = random_fields(SURFACE, 6, 10)
    amplitude *= 0.3
    # Rounding grows on steps: from these starts, a shift by 1e-15 m changes the end by at most 2e-8; from others by 4e-5.
    start = np.random.default_rng(16).uniform([0.1, 0.06, -3.0], [0.7, 0.14, 3.0], (6, 1, 3))
    rough = np.random.default_rng(12).uniform(0.6, 1.4, (6, 8, 32))
    ends = {}
    cases = {"even": {"friction": 0.7}, "alike": {"patches": 0.7}, "rough": {"patches": rough}}
    for name, conditions in cases.items():
        simulator = Simulator(SURFACE, part, worlds=6, model="tilting")
        simulator.reset(start)
        simulator.set_conditions(slice(None), **conditions)
        simulator.tip(slice(None), [0.03, 0.02])
        simulator.advance(0.2 * SURFACE.max_amplitude, 0.3, 3)  # it lands
        simulator.advance(amplitude, phase, 2)  # and rests on steps
        ends[name] = simulator.pose
    assert np.abs(ends["even"] - ends["alike"]).max() < 1e-6
    assert np.abs(ends["rough"] - ends["even"]).max() > 1e-5
