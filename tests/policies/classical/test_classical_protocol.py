"""The one call that all policies have, for one part and for several."""

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import episodes, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo


def observations(task, worlds=6, steps=8, seed=0):
    """States that a batch comes through, (steps, worlds, n)."""
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
