"""The one call that all policies have, for one part and for several."""

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import ARRANGED_TASKS, POSE_TASKS, episodes, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

ALL = [(task, name) for task in POSE_TASKS for name in ("zero", "random", "open_loop", "local_field", "planner")] + [
    (task, name) for task in ARRANGED_TASKS for name in ("zero", "random", "local_field", "planner")
]
REPEATABLE = [(task, name) for task, name in ALL if name != "random"]


def settings(task):
    return {} if task in POSE_TASKS else {"slots": 7, "randomize": {"parts": [2, 6]}}


def observations(task, worlds=6, steps=8, seed=0):
    """States that a batch comes through, (steps, worlds, n)."""
    env = batch(task, worlds, action="patch")
    env.action_space.seed(seed)
    return np.array([env.reset(seed=seed)[0], *[env.step(env.action_space.sample())[0] for _ in range(steps - 1)]])


@pytest.mark.parametrize("task, name", ALL)
def test_actions_fit_the_environment(task, name):
    policy = make_policy(name, info_of(task, **settings(task)))
    env = single(task, action=policy.action, observation=policy.observation, **settings(task))
    many = batch(task, 3, action=policy.action, observation=policy.observation, **settings(task))
    for each in (env, many):
        seen, _ = each.reset(seed=0)
        state, start = None, np.ones(3 if each is many else 1, dtype=bool)
        for _ in range(3):
            action, state = policy.predict(seen, state, start)
            assert action.dtype == np.float32 and each.action_space.contains(action)
            seen, *_ = each.step(action)
            start = np.zeros_like(start)


@pytest.mark.parametrize("task, name", REPEATABLE)
def test_a_batch_is_its_rows(task, name):
    policy = make_policy(name, info_of(task))
    together, alone = None, [None] * 6
    for step, rows in enumerate(observations(task)):
        start = np.array([step == 0] * 6)
        start[2] |= step == 3  # one world begins anew
        actions, together = policy.predict(rows, together, start)
        for world, row in enumerate(rows):
            action, alone[world] = policy.predict(row, alone[world], start[world : world + 1])
            assert action == pytest.approx(actions[world], abs=1e-6)
            again, _ = policy.predict(row[None], alone[world], np.zeros(1, dtype=bool))
            assert again.shape == (1, *action.shape)


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
def test_zero_policy_lets_the_parts_rest(task):
    env = single(task, action="field")
    seen, _ = env.reset(seed=0)
    start = env.unwrapped.truth.pose
    policy = make_policy("zero", TaskInfo.of(env))
    for _ in range(20):
        seen, *_ = env.step(policy.predict(seen)[0])
    assert np.abs(env.unwrapped.truth.pose - start).max() < 1e-4


def test_doing_nothing_does_not_succeed():
    assert episodes(make_policy("zero", info_of()), "Align").success <= 5


def test_local_field_remembers_what_parts_were_given():
    policy = make_policy("local_field", info_of("Rotate"))
    seen = observations("Rotate", steps=2)
    first, state = policy.predict(seen[0])
    assert state.acceleration.shape == (6, 1, 3) and state.law == () and state.acceleration.any()
    quick = state._replace(acceleration=state.acceleration + 5.0)
    later = policy.predict(seen[1], state)[0]
    assert (later != policy.predict(seen[1], quick)[0]).any()
    assert (policy.predict(seen[1], quick, np.ones(6, dtype=bool))[0] == policy.predict(seen[1])[0]).all()
