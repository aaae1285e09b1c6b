"""Planning by sampling: the model agrees with the world, plans are reproducible in batches and processes, and good."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import FRESH, info_of
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.simulated import Model
from vibgym.policies.task_info import TaskInfo

SMALL = {"kind": "mpc", "samples": 6, "horizon": 4, "iterations": 1}


@pytest.mark.parametrize("task, action", [
    ("Align", "wrench"), ("Align", "velocity"), ("Sort", "target"), ("Sort", "field"), ("Rotate", "patch"),
])  # fmt: skip
def test_the_model_agrees_with_the_world(task, action):
    env = batch(task, 3, action=action)
    seen, _ = env.reset(seed=FRESH)
    info, random = TaskInfo.of(env), np.random.default_rng(0)
    model = Model(info, 3, action)
    drift = np.tile(model.rest, (3, 1, 1, 1))
    for _ in range(6):
        model.begin(Measured.of(seen, info), drift)
        push = random.uniform(-0.5, 0.5, env.action_space.shape).astype(np.float32)
        earned, (seen, *_, reported) = model.step(push), env.step(push)
        drift, truth = model.drift(), env.truth
        off = model.core.simulator.state.pose - truth.pose
        off[..., 2] = np.sin(2.0 * off[..., 2])  # blocks look the same after half a turn
        np.testing.assert_allclose(off, 0.0, atol=1e-6)  # float32 observations
        np.testing.assert_allclose(earned, reported["parts"]["reward"], atol=1e-4)
        np.testing.assert_allclose(model.core.observations, seen, atol=1e-3)


def test_parts_that_arrive_and_leave_are_copied_to_the_model():
    env = batch("Feed", 2, action="field")
    seen, _ = env.reset(seed=FRESH)
    info = TaskInfo.of(env)
    model = Model(info, 2, "field")
    for _ in range(4):
        model.begin(Measured.of(seen, info), np.tile(model.rest, (2, 1, 1, 1)))
        assert (model.core.episode.present == env.truth.present).all()
        model.step(np.zeros(env.action_space.shape))
        seen, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))


def test_a_plan_depends_on_seed_and_observation_alone():
    env = batch("Align", 3, action="field")
    seen, _ = env.reset(seed=FRESH)
    info = TaskInfo.of(env)
    policy, again, other = (make_policy({**SMALL, "seed": seed}, info) for seed in (1, 1, 2))
    state = None
    for _ in range(3):
        action, after = policy.predict(seen, state)
        np.testing.assert_array_equal(action, again.predict(seen, state)[0])
        for world in range(3):
            own = None if state is None else (type(state[0])(*(each[world : world + 1] for each in state[0])), None)
            np.testing.assert_array_equal(policy.predict(seen[world], own)[0], action[world])
        assert (action != other.predict(seen, state)[0]).any()
        snapshot = env.get_state()
        seen, *_ = env.step(action)
        env.set_state(snapshot)  # the history of the world is not in the policy's model
        np.testing.assert_array_equal(env.step(action)[0], seen)
        state = after


def test_plans_reach_goals_and_improve_a_base_policy():
    seeds = range(FRESH, FRESH + 4)
    alone = rollout({"kind": "mpc", "samples": 24}, "Align", seeds=seeds)
    assert alone.success.all()
    same = rollout({"kind": "mpc", "samples": 24, "action": "field", "base": "zero"}, "Align", seeds=seeds)
    np.testing.assert_array_equal(same.returns, alone.returns)  # variations of zero actions
    for action in ("velocity", "target"):
        assert rollout({"kind": "mpc", "samples": 24, "action": action}, "Align", seeds=seeds).success.all()
    base = rollout("pose", "Align", seeds=seeds)
    led = rollout({"kind": "mpc", "base": "pose"}, "Align", seeds=seeds)
    assert led.success.all() and led.returns.mean() > base.returns.mean() - 0.1


@pytest.mark.parametrize("settings, task, named", [
    ({"action": "element"}, "Align", "action"), ({"base": "magic"}, "Align", "policy.kind"), ({}, "Follow", "policy 'mpc'"),
    ({"base": "open_loop"}, "Align", "base.action"), ({"base": "planner", "action": "field"}, "Align", "field"),
])  # fmt: skip
def test_bad_settings_and_moving_goals_are_refused(settings, task, named):
    with pytest.raises(ValueError, match=named):
        make_policy({**SMALL, **settings}, info_of(task))
