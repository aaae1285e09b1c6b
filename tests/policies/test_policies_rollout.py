"""Rollouts: independence of the number of worlds, bad arguments, costs, smoothness and corrective movements."""

import gymnasium as gym
import numpy as np
import pytest

from tests.policies.helpers import FRESH, single
from vibgym.policies import rollout
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes, environment_id, run, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import gaps_between

SEEDS = range(FRESH, FRESH + 6)
SMALL = {"surface": {"rows": 3, "columns": 4}, "action": "field"}


class Counting:
    """Policy that pushes in a direction that rotates with every step, counted in its state."""

    action, observation = "field", "state"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = np.zeros(len(observation)) if state is None else state.copy()
        count[episode_start] = 0.0
        action = np.zeros((len(observation), 6, 6), dtype=np.float32)  # of six parts
        action[..., 0], action[..., 1] = np.cos(0.1 * count)[:, None], np.sin(0.1 * count)[:, None]
        return action, count + 1.0


class Bare:
    """A model with ``predict`` only."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 6), dtype=np.float32), state


def test_a_name_is_enough():
    reported: list[int] = []
    result = rollout("local_field", "vibgym/Align-v0", seeds=SEEDS, progress=reported.append)
    assert result.success.all() and sum(reported) == len(SEEDS) and result.seeds == tuple(SEEDS)
    short = rollout("local_field", "Align", seeds=SEEDS)
    assert (short.steps == result.steps).all() and (short.returns == result.returns).all()


def test_a_model_with_a_given_action():
    result = rollout(Bare(), "Align", seeds=SEEDS, max_episode_steps=3, **SMALL)
    assert (result.steps <= 3).all() and not result.success.any()


@pytest.mark.parametrize("worlds", [1, 2, 6])
def test_episodes_do_not_depend_on_the_number_of_worlds(worlds):
    whole = rollout(Counting(), "Sort", seeds=SEEDS, max_episode_steps=25)
    again = run(Counting(), worlds_of("Sort", worlds, action="field", max_episode_steps=25), SEEDS, "Sort")
    for name in ("steps", "success", "fallen", "returns", "position_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))


@pytest.mark.parametrize("policy, task, settings, named", [
    ("zero", "Juggle", {"seeds": [1]}, "task"), ("zero", "CartPole-v1", {"seeds": [1]}, "task"),
    ("zero", "Align", {"seeds": []}, "seeds"), ("zero", "Align", {"seeds": [1.5]}, "seeds"),
    ("zero", "Align", {"seeds": [1], "num_envs": 3}, "num_envs"), ("hover", "Align", {"seeds": [1]}, "policy.kind"),
    (Counting(), "Align", {"seeds": [1], "action": "patch"}, "action"),
])  # fmt: skip
def test_bad_arguments_are_refused(policy, task, settings, named):
    with pytest.raises(ValueError, match=named):
        rollout(policy, task, **settings)


def test_episodes_must_end(monkeypatch):
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("Endless-v0", kwargs={"task": "Align"}, **entry)
    monkeypatch.setitem(gym.registry, "Endless-v0", spec)
    assert environment_id("Endless-v0") == "Endless-v0"
    with pytest.raises(ValueError, match="task"):
        rollout("zero", "Endless-v0", seeds=[1])
    assert rollout("zero", "Endless-v0", seeds=[1], max_episode_steps=4).steps.tolist() == [4]


def test_an_object_is_used_as_it_is():
    policy = make_policy("local_field", TaskInfo.of(single("Align", action="field")))
    assert (rollout(policy, "Align", seeds=SEEDS).steps == rollout("local_field", "Align", seeds=SEEDS).steps).all()


# -- measures ----------------------------------------------------------------------------------------------------------


class Scripted:
    """Policy with velocities along x from a table, and then the last one."""

    action, observation = "velocity", "state"

    def __init__(self, values):
        self.values = values

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        step = 0 if state is None else state
        action = np.zeros((len(observation), 3), dtype=np.float32)
        action[:, 0] = self.values[min(step, len(self.values) - 1)]
        return action, step + 1


def touching(env):
    """Return whether pairs of parts are closer than 0.1 mm, (worlds, parts, parts) bool."""
    truth, kinds = env.unwrapped.truth, env.unwrapped.core.kinds
    there = truth.present & ~truth.fallen
    near = gaps_between(kinds, truth.pose) < 1e-4
    return np.triu(near & there[:, :, None] & there[:, None], 1)


def test_costs_changes_and_collisions_are_the_sums_of_the_steps():
    settings = {"costs": {"impulse": 1.0, "clearance": 0.1}, "action": "phasor", "max_episode_steps": 60}
    outcomes = rollout("planner", "SortCrowded", seeds=[3, 4], keep=Measures, **settings)
    env = worlds_of("SortCrowded", 2, **settings)
    (total, changes, collisions), last = np.zeros((3, 2)), None
    steps = Episodes(make_policy("planner", env), env, [3, 4])
    before = touching(env)
    for step in steps:
        now = touching(env)
        collisions, before = collisions + (now & ~before).sum(axis=(1, 2)), now
        total += step.playing * step.info["cost"]
        changes += 0.0 if last is None else step.playing * np.abs(step.action.astype(float) - last).mean(axis=1)
        last = step.action
    np.testing.assert_allclose(outcomes.cost, total)
    np.testing.assert_allclose(outcomes.action_change, changes / (outcomes.steps - 1))
    np.testing.assert_array_equal(outcomes.collisions, collisions)
    assert collisions.sum() > 0 and outcomes.cost.min() > 0.0
    assert np.isnan(outcomes.overshoots).all() and np.isnan(outcomes.corrections).all()
    assert np.isnan(rollout("pose", "Align", seeds=[1], keep=Measures).cost).all()


def test_a_law_without_detours_has_no_corrections():
    outcomes = rollout({"kind": "pose", "action": "velocity"}, "Transport", seeds=range(20), keep=Measures)
    assert outcomes.success.all() and (outcomes.overshoots == 0).all() and np.median(outcomes.corrections) == 0
    assert np.isnan(outcomes.collisions).all()


@pytest.mark.parametrize(("values", "overshoots", "corrections"), [
    ([0.5] * 30 + [0.0] * 30, 1, 0),  # over the goal and away
    ([0.5] * 30 + [-0.5] * 25 + [0.0] * 10, 2, 1),  # and back over it
    ([-0.5] * 8 + [0.5] * 8 + [-0.5] * 8 + [0.5] * 8 + [0.0] * 9, 0, 2),  # to and fro before the goal
])  # fmt: skip
def test_corrective_movements_are_counted(values, overshoots, corrections):
    env = worlds_of("Transport", 1, action="velocity", max_episode_steps=len(values))
    start = {"pose": [[0.3, 0.104, 0.0]], "goal": [[0.34, 0.104, 0.0]]}
    outcomes = run(Scripted(values), env, [0], "Transport", keep=Measures, options=start)
    assert outcomes.overshoots[0] == overshoots and outcomes.corrections[0] == corrections
    changes = np.abs(np.diff(np.float32(values).astype(float))).sum() / (len(values) - 1) / 3
    assert outcomes.action_change[0] == pytest.approx(changes)
