"""Policies that simulate: plans by sampling, and the choice of the best policy."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import FRESH, HARDWARE, info_of
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.simulated import Model, rows_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.catalogue import SHIPPED

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
        np.testing.assert_allclose(model.core.pipeline.observations, seen, atol=1e-3)


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
    """Not on the history of the world, nor on what was planned before by the same policy, nor on the other worlds."""
    env = batch("Align", 3, action="field")
    seen, _ = env.reset(seed=FRESH)
    policy, again, other = (make_policy({**SMALL, "seed": seed}, env) for seed in (1, 1, 2))
    state = None
    for _ in range(3):
        action, after = policy.predict(seen, state)
        np.testing.assert_array_equal(action, again.predict(seen, state)[0])
        np.testing.assert_array_equal(policy.predict(seen, state)[0], action)
        np.testing.assert_array_equal(policy.predict(seen[:1], rows_of(state, [0]))[0], action[:1])
        assert (action != other.predict(seen, state)[0]).any()
        seen, state = env.step(action)[0], after


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


SEEDS = range(FRESH, FRESH + 6)


class Still:
    """Policy that brakes all parts, and counts its steps since it began to act."""

    action, observation = "velocity", "state"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        age = np.zeros(len(observation), dtype=np.int64) if state is None else state
        age = np.where(False if episode_start is None else episode_start, 0, age)
        return np.zeros((len(observation), 3), dtype=np.float32), age + 1


def choice_of(*policies, **settings):
    return {"kind": "parallel_rollout", "policies": list(policies), **settings}


@pytest.mark.parametrize("task, policy", [
    ("Align", {"kind": "pose", "action": "velocity"}), ("Sort", "planner"), ("Align", "learned"), ("Swap", "learned"),
])  # fmt: skip
def test_one_policy_alone_is_unchanged(task, policy):
    seeds = SEEDS if task == "Align" else SEEDS[:2]
    alone, chosen = (rollout(player, task, seeds=seeds) for player in (policy, choice_of(policy, every=7, horizon=3)))
    assert chosen.success.all()
    np.testing.assert_array_equal(chosen.returns, alone.returns)
    np.testing.assert_array_equal(chosen.steps, alone.steps)


def test_policies_take_the_action_of_the_environment_or_of_the_first():
    env = batch("Align", 1, action="velocity")
    assert make_policy(choice_of("pose", "lqr"), env).action == "velocity"
    info = TaskInfo.of(env)
    assert make_policy(choice_of({"kind": "pose", "action": "target"}, "lqr"), info).action == "target"
    assert make_policy(choice_of("pose", "lqr", action="wrench"), info).action == "wrench"
    agent = str(SHIPPED / "align.json")  # of wrenches; a path among others is that of a file
    assert make_policy(choice_of(agent, "pose"), info).action == "wrench"
    with pytest.raises(ValueError, match="requires action 'wrench', got 'target'"):
        make_policy(choice_of("pose", agent, action="target"), info)


def test_the_better_policy_acts_and_begins_anew():
    env = batch("Align", 3, action="velocity")
    seen, _ = env.reset(seed=FRESH)
    good = {"kind": "pose", "action": "velocity"}
    policy = make_policy(choice_of(Still(), good, every=4, horizon=60), env)
    state, direct, memory = None, make_policy(good, env), None
    for step in range(9):
        action, state = policy.predict(seen, state)
        expected, memory = direct.predict(seen, memory)
        np.testing.assert_array_equal(action, expected)
        assert (state[0].acting == 1).all() and (state[0].age == step + 1).all()
        seen, *_ = env.step(action)
    # Where both do equally well, the one that acts stays: here the first.
    policy = make_policy(choice_of(good, dict(good), every=1, horizon=5), env)
    _, state = policy.predict(seen)
    assert (state[0].acting == 0).all()
    # One that is not asked again begins without a memory.
    policy = make_policy(choice_of(Still(), Still(), every=100, horizon=1), env)
    _, state = policy.predict(seen)
    for _ in range(3):
        _, state = policy.predict(seen, state, np.array([False, True, False]))
    np.testing.assert_array_equal(state[1][0], [4, 1, 4])


def test_a_policy_takes_over_when_the_other_fails_later():
    class Slack(Still):
        """Policy that follows a law for five steps, and then brakes."""

        def __init__(self, law):
            self.law = law

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            zeros, age = super().predict(observation, None if state is None else state[0], episode_start)
            action, memory = self.law.predict(observation, None if state is None else state[1], episode_start)
            return np.where((age > 5)[:, None], zeros, action), (age, memory)

    info = info_of("Align", action="velocity")
    law = make_policy({"kind": "pose", "action": "velocity"}, info)
    assert not rollout(Slack(law), "Align", seeds=SEEDS).success.any()
    result = rollout(choice_of(Slack(law), law, every=3, horizon=100), "Align", seeds=SEEDS)
    assert result.success.all() and (result.steps <= rollout(law, "Align", seeds=SEEDS).steps).all()


@pytest.mark.parametrize("task, policies", [  # of similar speed: beside a much faster one the choice has little to gain
    ("Push", [{"kind": "push", "action": "wrench"}, {"kind": "push", "action": "wrench", "travel": 0.3}]),
    ("PackFull", [{"kind": "two_phases", "action": "velocity"}, {"kind": "two_phases", "action": "velocity", "soft": 1.0}]),
])  # fmt: skip
def test_it_is_faster_than_its_policies(task, policies):
    seeds = SEEDS if task == "Push" else SEEDS[:4]
    alone = [rollout(policy, task, seeds=seeds) for policy in policies]
    chosen = rollout(choice_of(*policies, every=10), task, seeds=seeds)
    assert chosen.success.all()
    assert chosen.steps.mean() < min(run.steps.mean() for run in alone)


def test_worlds_are_on_their_own():
    env = batch("Swap", 3, action="velocity", observation="parts_and_state", **HARDWARE)
    seen, _ = env.reset(seed=FRESH)
    policy = make_policy(choice_of("learned", "lanes", every=2, horizon=6), TaskInfo.of(env))
    assert (policy.action, policy.observation) == ("velocity", "parts_and_state")
    state = None
    for start in (None, np.array([False, True, False]), None):
        action, after = policy.predict(seen, state, start)
        for world in range(3):
            rows = np.array([world])
            here, own = (
                ({name: values[of] for name, values in seen.items()} for of in (rows, world)),
                rows_of(state, rows),
            )
            begins = None if start is None else start[rows]
            for part in here:  # a batch of one world, and a single environment
                np.testing.assert_array_equal(np.ravel(policy.predict(part, own, begins)[0]), action[world])
        seen, *_ = env.step(action)
        state = after


@pytest.mark.parametrize("policies, task, named", [
    ([], "Align", "policy.policies"), ("pose", "Align", "policy.policies"), (["magic"], "Align", "policy.kind"),
    (["open_loop", Still()], "Align", r"policies\[1\].action"), (["pose"], "Follow", "policy 'parallel_rollout'"),
])  # fmt: skip
def test_bad_policies_and_moving_goals_are_refused(policies, task, named):
    with pytest.raises(ValueError, match=named):
        make_policy({"kind": "parallel_rollout", "policies": policies}, info_of(task, action="velocity"))
