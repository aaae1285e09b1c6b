"""Where goals that move will be, and parts seen from there."""

import dataclasses
import math

import numpy as np
import pytest

from tests.envs.helpers import single
from tests.policies.helpers import info_of
from vibgym.policies.classical.law import Settling
from vibgym.policies.classical.measured import Measured, Preview, from_goals
from vibgym.policies.classical.steering import Steering
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.episode import PREVIEW

T = 0.04
DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6}
STEADY = np.array([[0.1, -0.05, 0.3], [0.0, 0.0, 0.0]]), np.array([[0.4, 0.2, -1.0], [0.0, -0.3, 2.0]])


def motion(start, rate, time):
    """Place and velocity of goals under constant acceleration."""
    return time * start + 0.5 * time**2 * rate, start + time * rate


def seen(info, start, rate, way=0.0):
    """What is measured of two parts whose goals have these velocities and accelerations."""
    rest = Measured.of(np.zeros((1, info.layout.size)), info)
    ahead = np.stack([motion(start, rate, T * k)[0] for k in range(1, PREVIEW + 1)], axis=-2)
    shape = (1, len(start), 2)
    return dataclasses.replace(
        rest, present=np.ones(shape[:2], dtype=bool), way=np.full(shape, way), goal_velocity=start[None],
        goal_ahead=ahead[None],
    )  # fmt: skip


def two(lead=0, periods=1, parts=("steel_block", "aluminium_block")):
    return dataclasses.replace(info_of("Follow", parts=list(parts), periods_per_step=periods), lead=lead)


@pytest.mark.parametrize("lead", range(7))
@pytest.mark.parametrize("periods", [1, 2, 5])
def test_steady_acceleration_is_carried_on_from_any_instant(lead, periods):
    """Also beyond what is told, and for steps of several periods."""
    info = two(lead, periods)
    start, rate = STEADY
    then = Preview(info)(seen(info, start, rate, way=0.01))
    place, speed = motion(start, rate, T * lead)
    assert then.way[0] == pytest.approx(0.01 + place[:, :2], abs=1e-12)
    assert then.turn[0] == pytest.approx(place[:, 2], abs=1e-12)
    assert then.goal_velocity[0] == pytest.approx(speed, abs=1e-12)
    assert then.goal_acceleration[0] == pytest.approx(rate, abs=1e-9)


@pytest.mark.parametrize("lead", [0, 1, 2])
def test_on_a_circle_a_part_with_the_goals_velocity_and_acceleration_is_with_it_after_a_step(lead):
    radius, speed = 0.06, 0.15
    info = two(lead)
    angle = speed / radius * T * np.arange(PREVIEW + 2)
    place = radius * np.stack([np.cos(angle) - 1.0, np.sin(angle), 0.0 * angle], axis=-1)
    start = np.array([[0.0, speed, 0.0]] * 2)
    measured = dataclasses.replace(seen(info, start, 0.0 * start), goal_ahead=np.tile(place[1:-1], (1, 2, 1, 1)))
    then = Preview(info)(measured)
    reached = then.way[0, 0] + T * then.goal_velocity[0, 0, :2] + 0.5 * T**2 * then.goal_acceleration[0, 0, :2]
    assert reached == pytest.approx(place[lead + 1, :2], abs=1e-12)
    assert np.hypot(*then.goal_velocity[0, 0, :2]) == pytest.approx(speed, rel=2e-3)


def test_the_heading_of_a_disc_is_not_turned():
    info = two(1, parts=(DISC, "steel_block"))
    then = Preview(info)(seen(info, *STEADY))
    assert then.goal_velocity[0, 0, 2] == then.goal_acceleration[0, 0, 2] == then.turn[0, 0] == 0.0
    assert then.goal_acceleration[0, 1, 2] == pytest.approx(2.0)


def test_a_part_that_goes_with_its_goal_stands_still_seen_from_there():
    info = two()
    start, rate = STEADY
    measured = dataclasses.replace(
        seen(info, start, rate), way=np.full((1, 2, 2), 0.002), turn=np.full((1, 2), 0.1),
        velocity=start[None, :, :2], spin=start[None, :, 2],
    )  # fmt: skip
    rest = from_goals(measured)
    assert (rest.velocity == 0.0).all() and (rest.spin == 0.0).all()
    assert (rest.centre == -0.002).all() and (rest.heading == -0.1).all()


def test_the_middle_of_a_long_step_is_where_part_and_goal_have_moved_to():
    info = two(0, periods=4)
    policy = Steering(info)
    measured = dataclasses.replace(seen(info, *STEADY, way=0.01), velocity=np.full((1, 2, 2), 0.02))
    then = policy.expected(measured, policy.initial(1))
    assert then.centre == pytest.approx(measured.centre + 0.06 * 0.02)
    assert then.way[0] == pytest.approx(0.01 + 0.06 * (STEADY[0][:, :2] - 0.02))
    assert then.turn[0] == pytest.approx(0.06 * STEADY[0][:, 2])


def test_parts_do_not_come_to_rest_where_their_goals_move():
    info = info_of("Follow", actuators="prototype")
    settling = Settling(info, np.array([7.0]), 0.25e-3, math.radians(0.3))
    rest, wanted = Measured.of(np.zeros(info.layout.size), info), np.ones((1, 1, 3))
    none = np.zeros((1, 1, 2)), np.zeros((1, 1))
    assert np.isnan(settling(rest, *none, wanted)).all()
    for name in ("goal_velocity", "goal_acceleration"):
        moving = dataclasses.replace(rest, **{name: np.array([[[0.0, 1e-3, 0.0]]])})
        assert (settling(moving, *none, wanted) == wanted).all()


@pytest.mark.parametrize("sensor, latency, lead", [
    ("ideal", 2, 0), ("pose", 2, 0), ({"kind": "pose", "delay": 1}, 2, 0),
    ({"kind": "pose", "delay": 1, "estimator": "model"}, 2, 2), ({"kind": "pose", "estimator": "kalman"}, 1, 1),
    ({"kind": "pose", "estimator": "model"}, 0, 0),
])  # fmt: skip
def test_measurements_tell_of_so_many_periods_ahead(sensor, latency, lead):
    actuators = {"kind": "prototype", "latency": latency}
    assert TaskInfo.of(single("Follow", sensor=sensor, actuators=actuators)).lead == lead
