"""Pulses near the target: position of rest, parts without pulses, and results on the prototype hardware."""

import dataclasses
import math

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import info_of
from vibgym.policies.classical.law import BAND, LOOSE_BAND, NEAR, REACH_TURN, Settling
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.steering import Steering
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo


def steering(name="Align", periods=1, **arguments):
    return Steering(info_of(name, actuators="prototype", periods_per_step=periods), Steering.Settings(**arguments))


def seen(policy, displacement, heading_error=0.0, velocity=(0.0, 0.0), spin=0.0):
    """Return the measurement of one part at a displacement and velocity, at the start of a step."""
    rows = np.zeros((1, policy.info.layout.size))
    measured = dataclasses.replace(
        Measured.of(rows, policy.info),
        present=np.ones((1, 1), dtype=bool), gap=np.full((1, 1), math.inf),
        displacement=np.reshape(displacement, (1, 1, 2)).astype(float), heading_error=np.full((1, 1), heading_error),
        velocity=np.reshape(velocity, (1, 1, 2)).astype(float), spin=np.full((1, 1), spin),
    )  # fmt: skip
    moved, turned = policy.ahead * measured.velocity, policy.ahead * measured.spin
    return dataclasses.replace(
        measured, displacement=measured.displacement - moved, heading_error=measured.heading_error - turned
    )


def wanted(policy, measured):
    """Return the wanted acceleration (3,), NaN for resting elements."""
    return policy.law.wanted(measured, measured.displacement, measured.heading_error, ())[0][0, 0]


def rests(policy, measured):
    return bool(np.isnan(wanted(policy, measured)).all())


@pytest.mark.parametrize("periods", [1, 4])
@pytest.mark.parametrize("velocity, spin", [((0.0, 0.0), 0.0), ((0.004, 0.006), -0.1)])
def test_a_pulse_brings_a_part_to_rest_at_its_goal(periods, velocity, spin):
    """By the solution of v' = a - c v the part coasts to the goal after the pulse, for any step length."""
    policy = steering(periods=periods)
    drag, length = policy.law.plant.drag[0], 0.04 * periods
    displacement, heading_error = np.array([0.0012, -0.0008]), 0.03
    pulse = wanted(policy, seen(policy, displacement, heading_error, velocity, spin))
    assert not np.isnan(pulse).any()
    pulse = pulse + drag * (np.array([*velocity, spin]) + 0.5 * 0.04 * pulse)  # elements also compensate mean friction
    for start, rate, goal in ((np.array(velocity), pulse[:2], displacement), (spin, pulse[2], heading_error)):
        fade = math.exp(-drag * length)
        after = start * fade + rate / drag * (1.0 - fade)
        moved = start / drag * (1.0 - fade) + rate / drag * (length - (1.0 - fade) / drag)
        assert moved + after / drag == pytest.approx(goal, rel=1e-9)


def test_parts_that_coast_close_enough_get_no_pulse():
    policy, band = steering(), BAND * 0.002
    assert rests(policy, seen(policy, [0.9 * band, 0.0])) and not rests(policy, seen(policy, [1.1 * band, 0.0]))
    heading_error = BAND * math.radians(3.0)
    assert rests(policy, seen(policy, [0.0, 0.0], -0.9 * heading_error))
    assert wanted(policy, seen(policy, [0.0, 0.0], -1.1 * heading_error))[2] < 0.0
    # At the speed that friction dissipates on the way; not decelerated otherwise.
    assert rests(policy, seen(policy, [0.010, 0.0], 0.0, [0.010 * policy.law.plant.drag[0], 0.0]))
    assert wanted(policy, seen(policy, [-0.001, 0.0], 0.0, [0.02, 0.0]))[0] < 0.0  # it would overshoot


def test_no_effect_far_from_the_goal():
    aware, plain = steering(), Steering(info_of("Align"))
    for displacement, heading_error, velocity in (
        ([0.2, 0.05], 1.0, [0.0, 0.0]),
        ([0.02, 0.0], 0.0, [0.3, 0.1]),
        ([0.0, 0.0], 0.5, [0.0, 0.0]),
    ):
        measured = seen(aware, displacement, heading_error, velocity)
        assert (wanted(aware, measured) == wanted(plain, measured)).all()
    assert (wanted(aware, seen(aware, [0.9 * NEAR, 0.0])) != wanted(plain, seen(aware, [0.9 * NEAR, 0.0]))).any()


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


def test_fast_spinning_parts_get_no_pulses():
    """Even if they would coast to their goals: acceleration and deceleration are faster."""
    policy = steering(law="pose")
    heading_error = 1.0
    coasting = heading_error * policy.info.plant.drag[0]
    assert not rests(policy, seen(policy, [0.0, 0.0], heading_error, (0.0, 0.0), coasting))
    slow = 0.5 * REACH_TURN
    assert rests(policy, seen(policy, [0.0, 0.0], slow, (0.0, 0.0), slow * policy.info.plant.drag[0]))


def test_only_used_with_hard_dead_zones():
    assert Steering(info_of("Align")).law.settling is None
    for change in ({"dead_zone": 0.0}, {"dead_zone_form": "soft"}):
        policy = Steering(info_of("Align", actuators={"kind": "prototype", **change}))
        assert policy.law.settling is None and policy.slack == 0.0
    assert isinstance(steering().law.settling, Settling)


def test_tasks_without_poses_have_a_separate_band():
    settle = steering("Sort").law.settling
    assert settle.band == LOOSE_BAND and 0.0 < settle.slack < 0.005


# -- what it achieves --------------------------------------------------------------------------------------------------
