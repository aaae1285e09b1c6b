"""Decoded observations, goals that move, and the memory of controllers."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import ARRANGED_TASKS, DISC, POSE_TASKS, info_of, measurement
from vibgym.policies.classical.measured import Measured, Preview, from_goals, recall, wrap
from vibgym.policies.classical.steering import Steering
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.episode import PREVIEW

OTHER_PARTS = (["steel_block"], [{"shape": "disc", "radius": 0.03, "friction": 0.4}])
SCENES = [
    *((task, {"parts": parts}) for task in POSE_TASKS for parts in OTHER_PARTS),
    *((task, {"slots": 7, "randomize": {"parts": [3, 6]}}) for task in ARRANGED_TASKS),
    ("Align", {"periods_per_step": 3}),
]


@pytest.mark.parametrize("task, settings", SCENES)
def test_decoded_observations_are_the_true_state(task, settings):
    """With the ideal sensor."""
    env = batch(task, 8, action="patch", **settings)
    env.reset(seed=3)
    env.action_space.seed(3)
    info = TaskInfo.of(env)
    symmetry = np.array([part.symmetry for part in info.parts])
    for _ in range(5):
        rows, *_ = env.step(env.action_space.sample())
        measured, truth = Measured.of(rows, info), env.unwrapped.truth
        there, pose = truth.present, truth.pose
        assert (measured.present == there).all() and there.all() == (len(info.parts) == 1)
        assert measured.centre[there] == pytest.approx(pose[there][:, :2], abs=1e-6)
        assert measured.displacement[there] == pytest.approx(truth.error[there][:, :2], abs=1e-6)
        assert measured.velocity[there] == pytest.approx(truth.mean_velocity[there][:, :2], abs=1e-6)
        assert measured.spin[there] == pytest.approx(np.clip(truth.mean_velocity[there][:, 2], -10, 10), abs=1e-5)
        turned = wrap(measured.heading - pose[..., 2], symmetry)
        assert turned[there & (symmetry > 0)] == pytest.approx(0.0, abs=1e-6)
        assert (measured.heading[:, symmetry == 0] == 0.0).all()
        heading_error = np.clip(truth.error[..., 2], -2 * math.pi, 2 * math.pi)
        assert measured.heading_error[there] == pytest.approx(heading_error[there], abs=1e-5)
        near = there & (truth.gap < 0.1)
        if len(info.parts) > 1:
            assert measured.gap[near] == pytest.approx(truth.gap[near], abs=1e-4)
        else:
            assert (measured.gap == math.inf).all()
        assert not measured.single
        one = Measured.of(rows[2], info)
        assert one.single and (one.centre == measured.centre[2:3]).all() and (one.gap == measured.gap[2:3]).all()


@pytest.mark.parametrize("task, names, size, shapes", [
    ("Align", ["zero", "random", "open_loop", "local_field"], 18, [(17,), (3, 19), (), (0,), (2, 2, 18)]),
    ("Sort", ["zero", "random", "local_field", "planner"], 120, [(18,), (3, 119), (), (0,)]),
])  # fmt: skip
def test_observations_of_another_shape_are_refused(task, names, size, shapes):
    for name in names:
        for seen in [*map(np.zeros, shapes), *(["seen"] if task == "Align" else [])]:
            with pytest.raises(ValueError, match="observation"):
                make_policy(name, info_of(task)).predict(seen)


def test_wrap():
    assert wrap(np.array([3.0, 3.0, -7.0]), np.array([2, 1, 1])) == pytest.approx([3 - math.pi, 3.0, 2 * math.pi - 7])


class Two(NamedTuple):
    """A memory of two arrays."""

    place: np.ndarray
    count: np.ndarray


def test_memories_are_reset_with_episodes():
    initial, state = Two(np.zeros((2, 3)), np.full(2, 7)), Two(np.ones((2, 3)), np.array([1, 2]))
    first, new = recall(None, None, initial, 2)
    assert isinstance(first, Two) and new.tolist() == [True, True]
    assert all((a == b).all() and a is not b for a, b in zip(first, initial, strict=True))
    kept, new = recall(state, np.array([False, True]), initial, 2)
    assert isinstance(kept, Two) and new.tolist() == [False, True]
    assert kept.place.tolist() == [[1, 1, 1], [0, 0, 0]] and kept.count.tolist() == [1, 7]
    kept.place[:], kept.count[:] = 5.0, 5  # a separate copy
    assert (state.place == 1).all() and state.count.tolist() == [1, 2]


def test_memory_of_new_parts_is_cleared():
    initial, state = Two(np.zeros((1, 2, 3)), np.full((1, 2), 7)), Two(np.ones((2, 2, 3)), np.array([[1, 2], [3, 4]]))
    arrived = np.array([[False, True], [False, False]])
    kept, _ = recall(state, np.array([False, True]), initial, 2, arrived)
    assert kept.place[..., 0].tolist() == [[1, 0], [0, 0]] and kept.count.tolist() == [[1, 7], [7, 7]]
    assert (state.place == 1).all()


@pytest.mark.parametrize("kind", ["lanes", "planner", "local_field"])
def test_controllers_clear_slots_with_new_parts(kind):
    """Independent of the previous part in the slot."""
    env = batch("Feed", 2, parts=["steel_block", "aluminium_block"] * 2, action="wrench")
    info, memory, cleared = TaskInfo.of(env), None, 0
    policy = make_policy({"kind": kind, "law": "pid"}, env)
    seen, _ = env.reset(seed=0)
    for step in range(120):
        new, arrived = np.full(2, step == 0), Measured.of(seen, info).arrived
        action, after = policy.predict(seen, memory, new)
        if step and arrived.any():
            assert (policy.predict(seen, spoilt(memory, arrived), new)[0] == action).all()
            assert (policy.predict(seen, spoilt(memory, ~arrived), new)[0] != action).any()
            cleared += 1
        seen, memory = env.step(action)[0], after
    assert cleared


def spoilt(memory, parts):
    """Return an observation with changed rows of some parts, (batch, parts) bool."""
    if isinstance(memory, np.ndarray):
        return np.where(parts.reshape(parts.shape + (1,) * (memory.ndim - 2)), memory + 1, memory).astype(memory.dtype)
    return type(memory)(*(spoilt(entry, parts) for entry in memory)) if memory else memory


@pytest.mark.parametrize(
    "state", [np.zeros(2), Two(np.zeros((3, 3)), np.zeros(3)), (np.zeros((2, 3)), np.zeros(2)), ()]
)
def test_memories_of_others_are_refused(state):
    with pytest.raises(ValueError, match="state"):
        recall(state, None, Two(np.zeros((2, 3)), np.zeros(2)), 2)


T = 0.04
STEADY = np.array([[0.1, -0.05, 0.3], [0.0, 0.0, 0.0]]), np.array([[0.4, 0.2, -1.0], [0.0, -0.3, 2.0]])


def motion(start, rate, time):
    """Return position and velocity of goals under constant acceleration."""
    return time * start + 0.5 * time**2 * rate, start + time * rate


def seen(info, start, rate, displacement=0.0):
    """Return the measurement of two parts whose goals have these velocities and accelerations."""
    ahead = np.stack([motion(start, rate, T * k)[0] for k in range(1, PREVIEW + 1)], axis=-2)
    return measurement(info, displacement=displacement, goal_velocity=start, goal_ahead=ahead)


def two(lead=0, periods=1, parts=("steel_block", "aluminium_block")):
    return dataclasses.replace(info_of("Follow", parts=list(parts), periods_per_step=periods), lead=lead)


@pytest.mark.parametrize("lead", range(7))
@pytest.mark.parametrize("periods", [1, 2, 5])
def test_constant_acceleration_is_extrapolated_from_any_instant(lead, periods):
    """Also beyond the preview, and for steps of several periods."""
    info = two(lead, periods)
    start, rate = STEADY
    then = Preview(info)(seen(info, start, rate, displacement=0.01))
    place, speed = motion(start, rate, T * lead)
    assert then.displacement[0] == pytest.approx(0.01 + place[:, :2], abs=1e-12)
    assert then.heading_error[0] == pytest.approx(place[:, 2], abs=1e-12)
    assert then.goal_velocity[0] == pytest.approx(speed, abs=1e-12)
    assert then.goal_acceleration[0] == pytest.approx(rate, abs=1e-9)


@pytest.mark.parametrize("lead", [0, 1, 2])
def test_a_part_with_its_goals_motion_on_a_circle_stays_with_it(lead):
    radius, speed = 0.06, 0.15
    info = two(lead)
    angle = speed / radius * T * np.arange(PREVIEW + 2)
    place = radius * np.stack([np.cos(angle) - 1.0, np.sin(angle), 0.0 * angle], axis=-1)
    start = np.array([[0.0, speed, 0.0]] * 2)
    measured = dataclasses.replace(seen(info, start, 0.0 * start), goal_ahead=np.tile(place[1:-1], (1, 2, 1, 1)))
    then = Preview(info)(measured)
    reached = then.displacement[0, 0] + T * then.goal_velocity[0, 0, :2] + 0.5 * T**2 * then.goal_acceleration[0, 0, :2]
    assert reached == pytest.approx(place[lead + 1, :2], abs=1e-12)
    assert np.hypot(*then.goal_velocity[0, 0, :2]) == pytest.approx(speed, rel=2e-3)


def test_the_heading_of_a_disc_is_not_turned():
    info = two(1, parts=(DISC, "steel_block"))
    then = Preview(info)(seen(info, *STEADY))
    assert then.goal_velocity[0, 0, 2] == then.goal_acceleration[0, 0, 2] == then.heading_error[0, 0] == 0.0
    assert then.goal_acceleration[0, 1, 2] == pytest.approx(2.0)


def test_a_part_that_moves_with_its_goal_has_zero_relative_velocity():
    info = two()
    start, rate = STEADY
    measured = dataclasses.replace(
        seen(info, start, rate), displacement=np.full((1, 2, 2), 0.002), heading_error=np.full((1, 2), 0.1),
        velocity=start[None, :, :2], spin=start[None, :, 2],
    )  # fmt: skip
    rest = from_goals(measured)
    assert (rest.velocity == 0.0).all() and (rest.spin == 0.0).all()
    assert (rest.centre == -0.002).all() and (rest.heading == -0.1).all()


def test_predictions_for_the_middle_of_a_long_step():
    info = two(0, periods=4)
    policy = Steering(info)
    measured = dataclasses.replace(seen(info, *STEADY, displacement=0.01), velocity=np.full((1, 2, 2), 0.02))
    then = policy.expected(measured, policy.initial(1))
    assert then.centre == pytest.approx(measured.centre + 0.06 * 0.02)
    assert then.displacement[0] == pytest.approx(0.01 + 0.06 * (STEADY[0][:, :2] - 0.02))
    assert then.heading_error[0] == pytest.approx(0.06 * STEADY[0][:, 2])


@pytest.mark.parametrize("sensor, latency, lead", [
    ("ideal", 2, 0), ("pose", 2, 0), ({"kind": "pose", "delay": 1}, 2, 0),
    ({"kind": "pose", "delay": 1, "estimator": "model"}, 2, 2), ({"kind": "pose", "estimator": "kalman"}, 1, 1),
    ({"kind": "pose", "estimator": "model"}, 0, 0),
])  # fmt: skip
def test_preview_of_measurements(sensor, latency, lead):
    actuators = {"kind": "prototype", "latency": latency}
    assert TaskInfo.of(single("Follow", sensor=sensor, actuators=actuators)).lead == lead
