"""Conditions of worlds: factors on friction and mass, and an inclined table, against closed forms and equivalent parts."""

import dataclasses
import math

import numpy as np
import pytest

from tests.simulation.helpers import random_fields, same_motion
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

G = 9.81
STILL = Surface(horizontal_amplitude=0.0)
PERIOD = STILL.period
ONE = Surface(rows=1, columns=1, element_size=8.0)
SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.4, static_friction=0.5)


def inclined(surface, part, incline, velocity=None, pose=(0.3, 0.1, 0.0), **keywords):
    simulator = Simulator(surface, part, **keywords)
    simulator.reset(pose, velocity)
    simulator.set_conditions(slice(None), incline=incline)
    return simulator


# -- a still, inclined table ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [-2.0, -0.3, 0.3, 2.0])
def test_a_sliding_part_is_slowed_by_friction_less_the_incline(slope):
    """In a line: v = v_0 - (mu g - b) t, until it stops after v_0^2 / (2 (mu g - b)) and sticks."""
    braking, start = 0.4 * G - slope, 0.5
    simulator = inclined(STILL, BLOCK, [slope, 0.0], [start, 0.0, 0.0])
    simulator.advance(0.0, 0.0, 1)
    assert simulator.velocity[0, 0] == pytest.approx([start - braking * PERIOD, 0.0, 0.0], abs=1e-12)
    way = start * PERIOD - 0.5 * braking * PERIOD**2
    assert simulator.pose[0, 0] == pytest.approx([0.3 + way, 0.1, 0.0], abs=1e-12)
    simulator.advance(0.0, 0.0, 10)
    assert simulator.sticking.all() and (simulator.velocity == 0.0).all()
    # The last steps are implicit.
    assert simulator.pose[0, 0] == pytest.approx([0.3 + start**2 / (2.0 * braking), 0.1, 0.0], abs=2e-7)


@pytest.mark.parametrize("direction", [0.0, 0.7, 2.5, -1.2])
def test_static_friction_holds_up_to_its_coefficient(direction):
    along = np.array([math.cos(direction), math.sin(direction)])
    for share, held in ((0.9, True), (0.9999, True), (1.0001, False), (1.1, False)):
        simulator = inclined(STILL, BLOCK, share * 0.5 * G * along)
        simulator.advance(0.0, 0.0, 2)
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
        simulator = inclined(ONE, part, [slope, 0.0], pose=(4.0, 4.0, 0.0))
        simulator.advance(0.0, 0.0, 1500)
        drift = complex(*simulator.mean_velocity[0, 0, :2])
        assert abs(drift) == pytest.approx(2.0 * slope * ONE.table_speed / (friction * G), rel=share)


def test_order_of_convergence_under_incline():
    """Runge-Kutta steps stay of fourth order: the incline is part of every stage."""

    def end(substeps):
        simulator = inclined(ONE, BLOCK, [1.5, -2.0], [0.1, 0.05, 2.0], pose=(4, 4, 0), steps=4, substeps=substeps)
        simulator.advance(ONE.max_amplitude, 1.0, 2)
        return simulator.pose[0, 0]

    exact = end(512)
    errors = [np.abs(end(substeps) - exact).max() for substeps in (8, 16, 32)]
    for coarse, fine in zip(errors, errors[1:]):
        assert 12.0 < coarse / fine < 20.0


# -- factors against equivalent parts ----------------------------------------------------------------------------------


def copies(parts, worlds, friction, mass):
    """Return parts with the first world's factors."""
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
    made = copies([BLOCK], worlds, [factor], [1.0])
    one, other = (Simulator(surface, part, worlds=worlds, model=model) for part in (BLOCK, made))
    for each in (one, other):
        each.reset([0.3, 0.1, 0.5], velocity)
    one.set_conditions(slice(None), friction=factor)
    for each in (one, other):
        each.advance(amplitude, phase, 5)
    same_motion(one, other)


@pytest.mark.parametrize("friction, mass", [
    ([1.0] * 4, [5.0, 0.2, 1.0, 40.0]), ([2.5, 0.4, 1.0, 3.0], [1.0] * 4), ([3.0, 0.1, 2.0, 0.7], [0.03, 7.0, 0.5, 11.0]),
])  # fmt: skip
def test_factors_of_touching_parts_equal_other_parts(friction, mass):
    """In impacts, the solver's iterations, and the steps of the coupling."""
    parts = [BLOCK, Part.disc(0.02, friction=0.5, restitution=0.8), shipped_part("steel_block"), BLOCK]
    made, worlds = copies(parts, 1, friction, mass), 3
    pose = [[0.20, 0.10, 0.3], [0.26, 0.10, 0.0], [0.32, 0.10, 1.0], [0.04, 0.05, 0.0]]
    velocity = [[0.3, 0.0, 2.0], [-0.2, 0.0, 0.0], [-0.3, 0.05, -4.0], [-0.5, 0.0, 0.0]]
    amplitude, phase = random_fields(SURFACE, worlds, 6)
    one, other = (Simulator(SURFACE, each, walls=["left"], worlds=worlds) for each in (parts, made))
    for each in (one, other):
        each.reset(pose, velocity)
    one.set_conditions(slice(None), friction=friction, mass=mass)
    for each in (one, other):
        each.advance(amplitude, phase, 8)
    same_motion(one, other)
    assert one.statistics == other.statistics and one.statistics["contact_steps"] > 20


def test_conditions_of_worlds_are_independent():
    """One at a time, in threads, or in a batch; default conditions equal no conditions."""
    parts, worlds, random = [BLOCK, Part.disc(0.02, friction=0.5)], 40, np.random.default_rng(8)
    pose, velocity = [[0.2, 0.1, 0.0], [0.25, 0.1, 0.0]], random.normal(0.0, 0.3, (worlds, 2, 3))
    friction, mass = random.uniform(0.3, 3.0, (2, worlds, 2))
    incline = random.normal(0.0, 0.5, (worlds, 2))
    usual = np.arange(worlds) % 4 == 0
    friction[usual], mass[usual], incline[usual] = 1.0, 1.0, 0.0
    amplitude, phase = random_fields(SURFACE, worlds, 9)

    def run(chosen, threads=1, conditions=True):
        simulator = Simulator(SURFACE, parts, worlds=len(chosen), threads=threads)
        simulator.reset(pose, velocity[chosen])
        if conditions:
            simulator.set_conditions(
                np.arange(len(chosen)), friction=friction[chosen], mass=mass[chosen], incline=incline[chosen]
            )
        simulator.advance(amplitude[chosen], phase[chosen], 4)
        return simulator.pose

    everything = np.arange(worlds)
    together = run(everything)
    assert (run(everything, threads=2) == together).all()
    assert (run(everything[::-1]) == together[::-1]).all()
    assert all((run([world]) == together[world]).all() for world in (0, 1, 2, 17, 39))
    assert (run(everything[usual], conditions=False) == together[usual]).all()
    assert not (run(everything, conditions=False)[~usual] == together[~usual]).all(axis=(1, 2)).any()


def test_an_incline_carries_parts_into_a_wall():
    """Without friction and from rest, contact follows from the incline alone. The part rebounds with e times its speed."""
    part = Part.disc(0.02, friction=0.0, restitution=0.5, contact_friction=0.0)
    slope, gap, start = 3.0, 0.001, 0.021
    simulator = Simulator(STILL, part, walls=["left"])
    simulator.reset([start, 0.1, 0.0])
    simulator.set_conditions(0, incline=[-slope, 0.0])
    simulator.advance(0.0, 0.0, 1)
    impact_time = math.sqrt(2.0 * gap / slope)
    left = PERIOD - impact_time
    speed = 0.5 * slope * impact_time
    assert 0.0 < left < 2.0 * speed / slope  # moving back, or down again, at the end
    assert simulator.pose[0, 0, 0] == pytest.approx(0.02 + speed * left - 0.5 * slope * left**2, abs=3e-5)
    assert simulator.velocity[0, 0, 0] == pytest.approx(speed - slope * left, abs=3e-3)
    assert simulator.deepest_overlap < 1e-4


# -- the interface -----------------------------------------------------------------------------------------------------


def test_conditions_are_read_back_kept_and_cleared():
    parts = [BLOCK, BLOCK]
    simulator = Simulator(SURFACE, parts, worlds=3)
    simulator.reset([[0.2, 0.1, 0.0], [0.4, 0.1, 0.0]])
    assert (simulator.friction == 1.0).all() and (simulator.mass == 1.0).all() and (simulator.incline == 0.0).all()
    simulator.set_conditions([True, False, True], friction=[0.5, 2.0], incline=[[0.1, 0.2], [0.3, 0.0]])
    simulator.set_conditions(1, mass=3.0)
    assert simulator.friction.tolist() == [[0.5, 2.0], [1.0, 1.0], [0.5, 2.0]]
    assert simulator.mass.tolist() == [[1.0, 1.0], [3.0, 3.0], [1.0, 1.0]]
    assert simulator.incline.tolist() == [[0.1, 0.2], [0.0, 0.0], [0.3, 0.0]]
    simulator.advance(0.0, 0.0, 1)
    state = simulator.get_state()
    simulator.advance(0.0, 0.0, 3)
    other = Simulator(SURFACE, parts, worlds=3)
    other.set_state(state)
    other.advance(0.0, 0.0, 3)
    same_motion(simulator, other)
    assert (other.friction == simulator.friction).all() and (other.incline == simulator.incline).all()
    simulator.reset([[0.2, 0.1, 0.0], [0.4, 0.1, 0.0]])
    assert (simulator.friction == 1.0).all() and (simulator.mass == 1.0).all() and (simulator.incline == 0.0).all()


LIGHT = Part.disc(0.02, friction=0.5, mass=0.001, name="light")
HEAVY = Part.disc(0.02, friction=0.5, mass=1.0, name="heavy")

BAD = [
    ({"friction": 0.0}, "friction"),
    ({"friction": 101.0}, "friction"),
    ({"mass": [1.0, -1.0]}, "mass"),
    ({"mass": [1.0, 2.0, 3.0]}, "mass"),
    ({"mass": [0.3, 1.0]}, "mass"),
    ({"friction": math.nan}, "friction"),
    ({"incline": 8.0}, "incline"),
    ({"incline": [[0.0, 1.0, 2.0]]}, "incline"),
    ({"incline": "steep"}, "incline"),
    ({"worlds": [2]}, "worlds"),
    ({"worlds": [True]}, "worlds"),
    ({"worlds": [-1]}, "worlds"),
    ({"worlds": "all"}, "worlds"),
    ({"worlds": [0.5]}, "worlds"),
    ({"worlds": [[0], [0, 1]]}, "worlds"),
]


@pytest.mark.parametrize("given, message", BAD, ids=str)
def test_bad_conditions_are_one_error_and_change_nothing(given, message):
    simulator = Simulator(SURFACE, [LIGHT, HEAVY], worlds=2)
    before = simulator.get_state()
    with pytest.raises(ValueError, match=message) as error:
        simulator.set_conditions(**{"worlds": slice(None), "friction": 0.5, "mass": 1.0, **given})
    assert "\n" not in str(error.value)
    after = simulator.get_state()
    assert all(np.array_equal(after[name], values) for name, values in before.items())


def test_the_averaged_model_refuses_what_may_stick():
    part = Part.rectangle(0.05, 0.035, friction=0.6)
    simulator = Simulator(SURFACE, part, worlds=2, model="averaged")
    simulator.set_conditions([0, 1], friction=[[1.0], [5.6]])  # a_h w^2 = 66.6 m/s^2, mu (g + a_v w^2) = 65.9
    for given, name in (({"friction": 5.7}, "friction"), ({"friction": 5.6, "incline": [0.6, 0.6]}, "friction")):
        with pytest.raises(ValueError, match=rf"{name}"):
            simulator.set_conditions(1, **given)
    with pytest.raises(ValueError, match="patches"):
        simulator.set_conditions(0, patches=5.7)
    assert simulator.friction.tolist() == [[1.0], [5.6]] and (simulator.patches == 1.0).all()


def test_friction_beyond_the_contact_steps_is_refused():
    slow = Surface(frequency=0.03, horizontal_amplitude=1e-4)
    simulator = Simulator(slow, [BLOCK, BLOCK])
    with pytest.raises(ValueError, match="friction"):
        simulator.set_conditions(0, friction=100.0)
