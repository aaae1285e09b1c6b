"""Controllers: set velocities and headings, long steps, targets, independent worlds, and pulses near the target."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import HARDWARE, SURFACE, TILTING, info_of, measurement
from vibgym.policies.classical.gains import GainLearner
from vibgym.policies.classical.law import BAND, LOOSE_BAND, NEAR, REACH_TURN, Settling
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.steering import LocalFieldPolicy, Steering
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation.plant import TOP_SLIP


def steering(name="Sort", periods=1, **arguments):
    return Steering(info_of(name, periods_per_step=periods), Steering.Settings(**arguments))


def wanted(policy, measured, displacement):
    """Return the controller's accelerations (worlds, parts, 3) for displacements to the goal."""
    displacement = np.broadcast_to(displacement, (*measured.present.shape, 2))
    return policy.law.wanted(measured, displacement, policy._heading_error(measured), ())[0]


def test_parts_can_stop_from_the_set_speed():
    law = steering(approach=1e3).law
    distance = np.linspace(0.001, 0.02, 6)
    speed = law.stopping_rate(distance, law.plant.push)
    assert speed**2 / (2.0 * law.plant.push) == pytest.approx(law.braking * distance)  # v^2 = 2 a d
    near = steering(approach=2.0).law.stopping_rate(np.full(6, 0.001), law.plant.push)
    assert near == pytest.approx(0.002)


def test_set_velocities_are_within_the_top_speed():
    policy = steering()
    change = wanted(policy, measurement(policy.info), [3.0, -4.0]) * policy.law.response[:, None]
    assert np.hypot(change[..., 0], change[..., 1]) == pytest.approx(TOP_SLIP * SURFACE.table_speed)
    assert change[..., 1] == pytest.approx(-4.0 / 3.0 * change[..., 0])


@pytest.mark.parametrize("task, turned", [("Sort", True), ("Transport", False), ("Align", True)])
def test_headings_are_controlled_and_several_parts_are_aligned(task, turned):
    policy = steering(task)
    skew = measurement(policy.info, heading=0.3, heading_error=-0.3 if task == "Align" else 0.0)
    torque = wanted(policy, skew, [0.0, 0.0])[..., 2]
    assert (torque < 0.0).all() if turned else (torque == 0.0).all()


def test_touching_parts_do_not_turn():
    policy = steering()
    for gap, turns in ((0.1, True), (0.0, False)):
        skew = measurement(policy.info, heading=0.3, gap=gap)
        action, _ = policy.steer(skew, np.zeros((1, 6, 2)), policy.initial(1))
        assert (np.abs(action) > 1e-9).any() == turns


@pytest.mark.parametrize("periods", [1, 2, 4, 8])
def test_the_velocity_does_not_overshoot_in_a_step(periods):
    """By first-order averages, a part from rest is not faster than the set velocity after a step."""
    policy = steering("Transport", periods)
    target = 0.05
    push = wanted(policy, measurement(policy.info), [policy.law.lead * target, 0.0])[0, 0, 0]
    drag = policy.law.plant.drag
    reached = push / drag * -np.expm1(-drag * 0.04 * periods)
    assert 0.5 * target < reached <= target * (1.0 + 1e-9)
    assert policy.ahead == pytest.approx(0.02 * (periods - 1))


def test_one_period_a_step_leaves_the_measurement_as_it_is():
    env = batch("Align", 4, action="field", periods_per_step=4)
    env.reset(seed=1)
    env.action_space.seed(1)
    seen, *_ = env.step(env.action_space.sample())
    measured = Measured.of(seen, TaskInfo.of(env))
    one, four = steering("Align"), steering("Align", 4)
    same, ahead = one.expected(measured, one.initial(4)), four.expected(measured, four.initial(4))
    assert (same.centre == measured.centre).all() and (same.heading_error == measured.heading_error).all()
    assert ahead.centre == pytest.approx(measured.centre + 0.06 * measured.velocity)
    assert ahead.centre + ahead.displacement == pytest.approx(measured.centre + measured.displacement)
    assert ahead.heading + ahead.heading_error == pytest.approx(measured.heading + measured.heading_error)


def test_spins_beyond_the_range_of_observations_are_estimated():
    """Observations end at 10 rad/s; a block on ideal elements reaches 14. Compare with the truth during a long turn."""
    env = batch("Rotate", 40, action="phasor")
    policy = make_policy({"kind": "local_field", "law": "pose"}, TaskInfo.of(env))
    rows, _ = env.reset(seed=5)
    memory, fastest = None, 0.0
    for step in range(12):
        if step:
            spin = env.unwrapped.truth.velocity[..., 2]
            assert np.abs(policy.expected(Measured.of(rows, policy.info), memory).spin - spin).max() < 0.6
            fastest = max(fastest, np.abs(spin).max())
        action, memory = policy.predict(rows, memory)
        rows, *_ = env.step(action)
    assert fastest > 12.0


@pytest.mark.parametrize("name", ["Transport", "Sort", "Singulate"])
def test_targets_are_goals_positions_in_zones_or_away_from_others(name):
    env = batch(name, 5, action="field")
    seen, _ = env.reset(seed=2)
    policy = LocalFieldPolicy(TaskInfo.of(env))
    truth, target = env.unwrapped.truth, policy.targets(Measured.of(seen, policy.info))
    if name == "Transport":
        assert target == pytest.approx(truth.goal[..., :2], abs=1e-6)
    elif name == "Sort":
        zone = policy.info.zones[list(policy.info.kind)]
        assert (target >= zone[:, :2] + 0.03 - 1e-9).all() and (target <= zone[:, 2:] - 0.03 + 1e-9).all()
    else:
        now, then = (np.linalg.norm(at - at.mean(axis=1, keepdims=True), axis=-1).mean()
                     for at in (truth.pose[..., :2], target))  # fmt: skip
        assert then > 1.2 * now


@pytest.mark.parametrize("task, policy, settings", [
    ("Follow", "pose", HARDWARE), ("Sort", "planner", HARDWARE), ("Align", "lqr", TILTING),
    ("Align", "pose", {**HARDWARE, "actuators": {"kind": "prototype", "dead": 0.2}}),
])  # fmt: skip
def test_worlds_are_independent_and_stored_memories_continue_bit_for_bit(task, policy, settings):
    """With estimates of gains and disturbances; near a dead zone a rounding error may change the choice of elements."""
    env = batch(task, 4, action="phasor", **settings)
    policy = make_policy(policy, TaskInfo.of(env))
    rows, _ = env.reset(seed=3)
    together, alone = None, [None] * 4
    for step in range(60):
        actions, together = policy.predict(rows, together)
        for world, row in enumerate(rows):
            action, alone[world] = policy.predict(row, alone[world])
            assert action.tobytes() == actions[world].tobytes()
        together = pickle.loads(pickle.dumps(together)) if step == 25 else together
        rows, *_ = env.step(actions)


# -- pulses near the target, on elements with a hard dead zone ---------------------------------------------------------


def on_prototype(name="Align", periods=1, **arguments):
    return Steering(info_of(name, actuators="prototype", periods_per_step=periods), Steering.Settings(**arguments))


def before(policy, displacement, heading_error=0.0, velocity=(0.0, 0.0), spin=0.0):
    """Return the measurement of one part that has this displacement to its goal and this velocity in mid-step."""
    displacement = np.array(displacement) - policy.ahead * np.array(velocity)
    heading_error = heading_error - policy.ahead * spin
    return measurement(
        policy.info, displacement=displacement, heading_error=heading_error, velocity=velocity, spin=spin
    )


def pulse(policy, measured):
    """Return the wanted acceleration (3,), NaN for resting elements."""
    return wanted(policy, measured, measured.displacement)[0, 0]


def rests(policy, measured):
    return bool(np.isnan(pulse(policy, measured)).all())


@pytest.mark.parametrize("periods", [1, 4])
@pytest.mark.parametrize("velocity, spin", [((0.0, 0.0), 0.0), ((0.004, 0.006), -0.1)])
def test_a_pulse_brings_a_part_to_rest_at_its_goal(periods, velocity, spin):
    """By the solution of v' = a - c v the part coasts to the goal after the pulse, for any step length."""
    policy = on_prototype(periods=periods)
    drag, length = policy.law.plant.drag[0], 0.04 * periods
    displacement, heading_error = np.array([0.0012, -0.0008]), 0.03
    push = pulse(policy, before(policy, displacement, heading_error, velocity, spin))
    assert not np.isnan(push).any()
    push = push + drag * (np.array([*velocity, spin]) + 0.5 * 0.04 * push)  # elements also compensate mean friction
    for start, rate, goal in ((np.array(velocity), push[:2], displacement), (spin, push[2], heading_error)):
        fade = math.exp(-drag * length)
        after = start * fade + rate / drag * (1.0 - fade)
        moved = start / drag * (1.0 - fade) + rate / drag * (length - (1.0 - fade) / drag)
        assert moved + after / drag == pytest.approx(goal, rel=1e-9)


def test_parts_that_coast_close_enough_get_no_pulse():
    policy, band, heading_error = on_prototype(), BAND * 0.002, BAND * math.radians(3.0)
    assert rests(policy, before(policy, [0.9 * band, 0.0])) and not rests(policy, before(policy, [1.1 * band, 0.0]))
    assert rests(policy, before(policy, [0.0, 0.0], -0.9 * heading_error))
    assert pulse(policy, before(policy, [0.0, 0.0], -1.1 * heading_error))[2] < 0.0
    # At the speed that friction dissipates on the way; not decelerated otherwise.
    assert rests(policy, before(policy, [0.010, 0.0], 0.0, [0.010 * policy.law.plant.drag[0], 0.0]))
    assert pulse(policy, before(policy, [-0.001, 0.0], 0.0, [0.02, 0.0]))[0] < 0.0  # it would overshoot


def test_no_effect_far_from_the_goal():
    aware, plain = on_prototype(), steering("Align")
    far = ([0.2, 0.05], 1.0, [0.0, 0.0]), ([0.02, 0.0], 0.0, [0.3, 0.1]), ([0.0, 0.0], 0.5, [0.0, 0.0])
    for displacement, heading_error, velocity in far:
        measured = before(aware, displacement, heading_error, velocity)
        assert (pulse(aware, measured) == pulse(plain, measured)).all()
    near = before(aware, [0.9 * NEAR, 0.0])
    assert (pulse(aware, near) != pulse(plain, near)).any()


def test_fast_spinning_parts_get_no_pulses():
    """Even if they would coast to their goals: acceleration and deceleration are faster."""
    policy = on_prototype(law="pose")
    drag, slow = policy.info.plant.drag[0], 0.5 * REACH_TURN
    assert not rests(policy, before(policy, [0.0, 0.0], 1.0, (0.0, 0.0), drag))
    assert rests(policy, before(policy, [0.0, 0.0], slow, (0.0, 0.0), slow * drag))


def test_parts_do_not_rest_if_their_goals_move():
    info = info_of("Follow", actuators="prototype")
    settling = Settling(info, 0.25e-3, math.radians(0.3))
    rest, push = Measured.of(np.zeros(info.layout.size), info), np.ones((1, 1, 3))
    none = np.zeros((1, 1, 2)), np.zeros((1, 1))
    assert np.isnan(settling(rest, *none, push)).all()
    for name in ("goal_velocity", "goal_acceleration"):
        moving = dataclasses.replace(rest, **{name: np.array([[[0.0, 1e-3, 0.0]]])})
        assert (settling(moving, *none, push) == push).all()


@pytest.mark.parametrize("task, actuators, settings, settles, learns", [
    ("Align", "prototype", {}, True, True), ("Align", "prototype", {"learn": False}, True, False),
    ("Sort", "prototype", {}, True, False),  # its task has no goal poses
    ("Align", {"kind": "prototype", "dead_zone": 0.0}, {}, False, False), ("Align", "ideal", {}, False, False),
    ("Align", {"kind": "prototype", "dead_zone_form": "soft"}, {}, False, False),
])  # fmt: skip
def test_hard_dead_zones_require_pulses_and_gains(task, actuators, settings, settles, learns):
    policy = Steering(info_of(task, actuators=actuators), Steering.Settings(**settings))
    assert isinstance(policy.law.settling, Settling) == settles == (policy.slack > 0.0)
    assert isinstance(policy.learner, GainLearner) == learns
    if task == "Sort":
        assert policy.law.settling.band == LOOSE_BAND and policy.law.settling.slack < 0.005
