"""Policies without a sensor: zero, random, and fields planned once."""

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import POSE_TASKS, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo


@pytest.mark.parametrize("task", POSE_TASKS)
def test_it_observes_once_per_episode(task):
    """Later observations do not change its actions."""
    policy = make_policy("open_loop", info_of(task))
    seen, other = observations(task, worlds=2, steps=6), observations(task, worlds=2, steps=6, seed=5)
    _, state = policy.predict(seen[0])
    _, blind = policy.predict(seen[0])
    for step in range(1, 6):
        action, state = policy.predict(seen[step], state)
        same, blind = policy.predict(other[step], blind)
        assert (action == same).all()
    assert (action != policy.predict(other[0])[0]).any()


def strengths(heading_error, periods, steps):
    """Return the largest amplitude in each step of a turn (rad) in place at 10 rad/s."""
    policy = make_policy({"kind": "open_loop", "turn_rate": 10.0}, info_of("Rotate", periods_per_step=periods))
    env = single("Rotate", action="phasor", periods_per_step=periods)
    seen, _ = env.reset(seed=0, options={"pose": [0.416, 0.104, 0.0], "goal": [0.416, 0.104, heading_error]})
    state, amplitude = None, []
    for _ in range(steps):
        action, state = policy.predict(seen, state)
        amplitude.append(np.hypot(action[::2], action[1::2]).max())
    return np.array(amplitude)


@pytest.mark.parametrize("heading_error, periods", [(1.0, 1), (2.0, 4), (-1.9, 3), (0.3, 4)])
def test_durations_of_fields_do_not_depend_on_the_step(heading_error, periods):
    """The last step is scaled: strengths times step time add up to the turn over its rate."""
    acting = strengths(heading_error, periods, 12)
    assert acting.sum() * 0.04 * periods == pytest.approx(abs(heading_error) / 10.0, rel=1e-4)


def observations(task, worlds=6, steps=8, seed=0):
    """Return the states of a batch, (steps, worlds, n)."""
    env = batch(task, worlds, action="patch")
    env.action_space.seed(seed)
    return np.array([env.reset(seed=seed)[0], *[env.step(env.action_space.sample())[0] for _ in range(steps - 1)]])


def test_random_policy():
    policy, again, other = (make_policy("random", info_of(), seed=seed) for seed in (1, 1, 2))
    seen = observations("Align", steps=1)[0]
    first, second = policy.predict(seen)[0], policy.predict(seen)[0]
    assert first.shape == (6, 512) and first.dtype == np.float32
    assert np.abs(first).max() <= 1 and first.mean() == pytest.approx(0, abs=0.05) and first.std() > 0.5
    assert (first == again.predict(seen)[0]).all()
    assert (first != second).any() and (first != other.predict(seen)[0]).any()
    assert (make_policy({"kind": "random", "seed": 2}, info_of(), seed=1).predict(seen)[0] != first).any()


@pytest.mark.parametrize("task", ["Transport", "Sort"])
def test_parts_rest_under_the_zero_policy(task):
    env = single(task, action="field")
    seen, _ = env.reset(seed=0)
    start = env.unwrapped.truth.pose
    policy = make_policy("zero", TaskInfo.of(env))
    for _ in range(20):
        seen, *_ = env.step(policy.predict(seen)[0])
    assert np.abs(env.unwrapped.truth.pose - start).max() < 1e-4
