"""Coefficients of friction that depend on speed: closed forms, an independent integration, sticking, and what is refused."""

import math
import pickle

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vibgym
from vibgym import Part, Simulator, Surface
from vibgym.bounds.time_bound import TimeBound
from vibgym.physics.core.records import LAW_SPEED
from vibgym.physics.planar.wrench import varying_wrench
from vibgym.scene.friction_laws import FRICTION_LAWS, Stribeck, law_table
from vibgym.scene.parts import part_from, shipped_part

G, OMEGA = 9.81, 2 * math.pi * 25.0
ONE = Surface(rows=1, columns=1, element_size=8.0)  # everything happens on one element
STRIBECK = {"kind": "stribeck", "rise": 0.5, "speed": 0.3, "shape": 2.0, "viscous": 0.1}
FALLING = {"kind": "stribeck", "rise": 1.0, "speed": 0.4}


def test_stress_follows_the_law():
    table, law = law_table(STRIBECK), Stribeck(Stribeck.Settings(rise=0.5, speed=0.3, viscous=0.1))
    for speed in (0.0005, 0.013, 0.31, 1.7):
        rows = np.zeros((5, 8))
        rows[0, 0] = 1.0
        fx, fy, _ = varying_wrench(*rows, 8, G, 1.0, 0.0, 0.6 * speed, 0.8 * speed, 0.0, table)
        assert math.hypot(fx, fy) / G == pytest.approx(law(np.array(speed)), rel=1e-4)
        assert fy / fx == pytest.approx(0.8 / 0.6)


def test_factors_are_constant_beyond_the_table():
    table, rows = law_table(STRIBECK), np.zeros((5, 8))
    rows[0, 0] = 1.0
    fast = [varying_wrench(*rows, 8, G, 1.0, 0.0, speed, 0.0, 0.0, table)[0] for speed in (LAW_SPEED * 1023, 5.0, 1e3)]
    assert fast == pytest.approx([G * table[-1]] * 3)


@pytest.mark.parametrize("law", [None, STRIBECK, FALLING, {"kind": "stribeck", "rise": 5.0, "speed": 0.4}])
def test_slow_parts_are_braked_by_the_mean_of_both_slopes(law):
    """Friction changes a small velocity v by ``-(g / 2) (mu(U) / U + mu'(U)) v``, U the speed of the table: half of it for the
    direction of the slip, half for its size. Where the coefficient falls fast, the velocity grows."""
    speed, mu, v, periods, step = ONE.table_speed, 0.02, 1e-3, 25, 1e-5
    part = Part.disc(0.02, friction=mu, friction_law=law)
    simulator = Simulator(ONE, part, worlds=2, substeps=16)
    simulator.reset(np.tile([4.0, 4.0, 0.0], (2, 1, 1)), np.array([[[0.0, 0.0, 0.0]], [[v, 0.0, 0.0]]]))
    made = FRICTION_LAWS.make("law", law or "stribeck")
    slope = (made(np.array(speed + step)) - made(np.array(speed - step))) / (2.0 * step)
    rate = 0.5 * mu * G * (made(np.array(speed)) / speed + slope)
    assert (rate < 0.0) == (law is not None and law["rise"] == 5.0)
    apart = []
    for _ in range(2):
        simulator.advance(0.0, 0.0, periods)
        apart.append(np.linalg.norm(np.subtract(*simulator.state.mean_velocity[:, 0, :2])))
    assert apart[1] / apart[0] == pytest.approx(math.exp(-rate * periods / 25.0), rel=3e-3)


@pytest.mark.parametrize("law", [STRIBECK, FALLING])
def test_motion_is_that_of_an_independent_integration(law):
    made, mu, amplitude, phase = FRICTION_LAWS.make("law", law), 0.3, 3e-4, 0.7
    part, periods = Part.disc(0.003, friction=mu, friction_law=law), 12

    def rates(t, y):
        ux, uy = -ONE.table_speed * math.sin(OMEGA * t) - y[2], ONE.table_speed * math.cos(OMEGA * t) - y[3]
        size = math.hypot(ux, uy)
        normal = G - amplitude * OMEGA**2 * math.cos(OMEGA * t + phase)
        pull = mu * float(made(np.array(size))) * normal / size
        return [y[2], y[3], pull * ux, pull * uy]

    found = solve_ivp(rates, (0.0, periods / 25.0), [4.0, 4.0, 0.0, 0.0], rtol=1e-11, atol=1e-13)
    simulator = Simulator(ONE, part, substeps=16)
    simulator.reset([[[4.0, 4.0, 0.0]]])
    simulator.advance(amplitude, phase, periods)
    moved = found.y[:2, -1] - 4.0
    assert np.linalg.norm(moved) > 5e-3
    np.testing.assert_allclose(
        simulator.state.pose[0, 0, :2] - 4.0, moved, atol=1e-5 * float(np.linalg.norm(moved)) + 1e-8
    )


def test_a_law_of_ones_changes_nothing():
    FRICTION_LAWS.register("ones", lambda: np.ones_like)
    table = Surface()
    plain, lawful = (
        Simulator(table, Part.rectangle(0.05, 0.035, friction=0.5, friction_law=law), worlds=3, pieces=2)
        for law in (None, {"kind": "ones"})
    )
    poses = np.array([[[0.2, 0.1, 0.3]], [[0.4, 0.08, 1.0]], [[0.6, 0.12, -2.0]]])
    rng = np.random.default_rng(0)
    amplitude, phase = rng.uniform(0, 3e-4, (3, 8, 32)), rng.uniform(-3, 3, (3, 8, 32))
    for simulator in (plain, lawful):
        simulator.reset(poses)
        simulator.advance(amplitude, phase, 20)
    np.testing.assert_allclose(lawful.state.pose, plain.state.pose, rtol=0, atol=1e-11)


def test_a_part_sticks_by_the_coefficient_at_rest():
    limit = ONE.horizontal_amplitude * OMEGA**2 / G  # coefficient from which a part sticks
    for rise, sticks in ((1.02, True), (0.97, False)):
        part = Part.disc(0.02, friction=0.5 * limit, friction_law={"kind": "stribeck", "rise": rise, "speed": 0.05})
        assert part.static_friction == pytest.approx(0.5 * limit * (1.0 + rise))
        simulator = Simulator(ONE, part)
        simulator.reset([[[4.0, 4.0, 0.0]]], [[[0.0, ONE.table_speed, 0.0]]])  # the table's velocity at the start
        simulator.advance(0.0, 0.0, 3)
        assert bool(simulator.state.sticking[0, 0]) == sticks


def test_batches_and_contacts_have_the_same_bits():
    scene = [Part.rectangle(0.05, 0.035, friction=0.5, friction_law=STRIBECK), shipped_part("steel_block")]
    rng = np.random.default_rng(1)
    poses = np.stack([[[0.2, 0.1, x], [0.5, 0.1, -x]] for x in rng.uniform(-1, 1, 5)])
    amplitude, phase = rng.uniform(0, 3e-4, (5, 8, 32)), rng.uniform(-3, 3, (5, 8, 32))
    batch = Simulator(Surface(), scene, worlds=5)
    batch.reset(poses)
    batch.advance(amplitude, phase, 8)
    for world in range(5):
        one = Simulator(Surface(), scene)
        one.reset(poses[world : world + 1])
        one.advance(amplitude[world : world + 1], phase[world : world + 1], 8)
        np.testing.assert_array_equal(one.state.pose[0], batch.state.pose[world])
    alone = Simulator(Surface(), scene[0])  # nothing touches it
    alone.reset(poses[:1, :1])
    alone.advance(amplitude[:1], phase[:1], 8)
    np.testing.assert_array_equal(alone.state.pose[0, 0], batch.state.pose[0, 0])


def test_environments_take_laws_and_parts_keep_them():
    given = {"shape": "rectangle", "length_mm": 50, "width_mm": 35, "friction": 0.5, "friction_law": STRIBECK}
    part = part_from(given)
    assert pickle.loads(pickle.dumps(part)).same_as(part)
    assert part_from(part.to_dict()).same_as(part) and not part.same_as(part_from({**given, "friction_law": None}))
    env = gym.make("vibgym/Align-v0", action="velocity", parts=[given])
    policy = vibgym.make_policy({"kind": "pose", "action": "velocity"}, env)
    assert policy is not None
    found = vibgym.policies.rollout(
        {"kind": "pose", "action": "velocity"}, "vibgym/Align-v0", seeds=range(10), parts=[given]
    )
    assert found.success.all()


def test_parts_with_holes_follow_laws():
    ring = [[0.02 * math.cos(a), 0.02 * math.sin(a)] for a in np.linspace(0, 2 * math.pi, 24, endpoint=False)]
    hole = [[0.4 * x, 0.4 * y] for x, y in ring]
    plain, lawful = (Part.polygon(ring, holes=[hole], friction=0.4, friction_law=law) for law in (None, STRIBECK))
    np.testing.assert_array_equal(plain.outline, lawful.outline)
    ways = []
    for part in (plain, lawful):
        simulator = Simulator(ONE, part)
        simulator.reset([[[4.0, 4.0, 0.0]]])
        simulator.advance(3e-4, 0.7, 10)
        ways.append(np.linalg.norm(simulator.state.pose[0, 0, :2] - 4.0))
    assert ways[1] > 1.05 * ways[0] > 0.0


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("stribeck", "friction_law"),
        ({"rise": 1.0}, "kind"),
        ({"kind": "unknown"}, "stribeck"),
    ],
)
def test_invalid_laws_are_refused(law, message):
    with pytest.raises(ValueError, match=message):
        Part.disc(0.02, friction=0.5, friction_law=law)


def test_what_assumes_a_constant_coefficient_refuses_a_law():
    part = Part.disc(0.02, friction=0.3, friction_law=STRIBECK)
    with pytest.raises(ValueError, match="constant coefficient"):
        Simulator(Surface(), part, model="averaged")
    with pytest.raises(ValueError, match="constant coefficient"):
        Simulator(Surface(), part, model="tilting")
    with pytest.raises(ValueError, match="constant coefficient"):
        TimeBound(Surface(), part, position_tolerance=1e-3)
    with pytest.raises(ValueError, match="static_friction"):
        Part.disc(0.02, friction=0.3, friction_law=STRIBECK, static_friction=0.4)
