"""Lanes: parts keep out of one another's way, and leave as the gates ask for."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from vibgym.policies.classical.lanes import FeedingPolicy
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo


@pytest.fixture(scope="module")
def info():
    return TaskInfo.of(batch("Feed", 1, parts=["steel_block", "aluminium_block"] * 2))


def seen(centre, present=None, velocity=0.0):
    """A measurement of straight parts at rest, (parts, 2) m."""
    centre = np.array(centre, dtype=float)[None]
    alone = np.zeros(centre.shape[:2])
    there = np.ones_like(alone, dtype=bool) if present is None else np.array([present])
    moving = np.zeros_like(centre)
    moving[..., 0] = velocity
    return Measured(
        present=there, centre=centre, heading=alone, way=0.0 * centre, turn=alone, velocity=moving, spin=alone,
        gap=alone + 1.0, single=False,
    )  # fmt: skip


def test_parts_alone_go_along_their_lanes_at_full_speed(info):
    policy = FeedingPolicy(info)
    velocity = policy.velocity(seen([[0.2, 0.052], [0.3, 0.156], [0.6, 0.156], [0.1, 0.104]]))[0]
    assert velocity[[0, 1]] == pytest.approx(np.array([[policy.top, 0.0]] * 2))
    assert velocity[2, 1] < 0.0 < velocity[2, 0] and velocity[3, 1] > 0.0  # to their own half
    assert np.hypot(*velocity.T) == pytest.approx(policy.top)


def test_who_is_behind_keeps_its_distance_and_who_is_not_there_counts_for_nothing(info):
    policy, absent = FeedingPolicy(info), [-0.8, -0.2]
    there = [True, False, True, False]
    near, far = (
        policy.velocity(seen([[0.7, 0.052], absent, [0.7 - apart, 0.052], absent], there))[0, [0, 2], 0]
        for apart in (0.080, 0.140)
    )
    assert near[0] == far[0] == policy.top and near[1] == 0.0 and 0.0 < far[1] <= policy.top


def test_nobody_changes_its_lane_into_another_part(info):
    policy = FeedingPolicy(info)
    beside = policy.velocity(seen([[0.2, 0.110], [0.21, 0.068], [0.6, 0.052], [0.7, 0.156]]))[0]
    assert beside[0, 1] > -0.02  # its lane is below, where another one is just ahead of it


@pytest.mark.parametrize("task, settings, least", [
    ("Feed", {}, 240.0), ("FeedHeaps", {}, 230.0),
    ("FeedHeaps", {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}, 225.0),
])  # fmt: skip
def test_good_parts_a_minute(task, settings, least):
    env = batch(task, 4, action="wrench", **settings)
    policy = make_policy({"kind": "lanes", "action": "wrench"}, env)
    state, info = None, {}
    observation, _ = env.reset(seed=20)
    for _ in range(1500):
        action, state = policy.predict(observation, state, None)
        observation, _, _, _, info = env.step(action)
    faulty = sum(info[f"{name}_per_minute"] for name in ("tilted", "close", "wrong", "lost"))
    assert info["good_per_minute"].mean() > least and faulty.mean() < 0.02 * least
    env.close()


@pytest.mark.parametrize("task", ["Sort", "Follow"])
def test_tasks_without_gates_or_goals_that_stay_are_refused(task):
    with pytest.raises(ValueError, match="policy 'lanes'"):
        make_policy("lanes", batch(task, 1))


def test_bad_settings_are_refused(info):
    with pytest.raises(ValueError, match="near"):
        FeedingPolicy(info, near=-1.0)
