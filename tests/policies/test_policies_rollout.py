"""Rollouts: independence of the number of worlds, and one line for bad input."""

import gymnasium as gym
import numpy as np
import pytest

from tests.policies.helpers import FRESH, single
from vibgym.policies import rollout
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Ends, Episodes, environment_id, worlds_of
from vibgym.policies.task_info import TaskInfo

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
    found = rollout("local_field", "vibgym/Align-v0", seeds=SEEDS, progress=reported.append)
    assert found.success.all() and sum(reported) == len(SEEDS) and found.seeds == tuple(SEEDS)
    short = rollout("local_field", "Align", seeds=SEEDS)
    assert (short.steps == found.steps).all() and (short.returns == found.returns).all()


def test_a_model_with_a_given_action():
    found = rollout(Bare(), "Align", seeds=SEEDS, max_episode_steps=3, **SMALL)
    assert (found.steps <= 3).all() and not found.success.any()


@pytest.mark.parametrize("worlds", [1, 2, 6])
def test_episodes_do_not_depend_on_the_number_of_worlds(worlds):
    whole = rollout(Counting(), "Sort", seeds=SEEDS, max_episode_steps=25)
    env = worlds_of("Sort", worlds, action="field", max_episode_steps=25)
    kept, begun = [], []

    def began(fresh, observation, info):
        begun.append(int(fresh.sum()))
        if not kept:
            kept.append(Ends(env.unwrapped, info, list(SEEDS)))

    episodes = Episodes(Counting(), env, SEEDS, began)
    for step in episodes:
        kept[0].add(step)
    found = kept[0].result("Sort", episodes.timing)
    for name in ("steps", "success", "fallen", "returns", "position_error"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    assert sum(begun) == len(SEEDS)


BAD = {
    "no such environment": (("zero", "Juggle"), {"seeds": [1]}, "task"),
    "another kind": (("zero", "CartPole-v1"), {"seeds": [1]}, "task"),
    "no seeds": (("zero", "Align"), {"seeds": []}, "seeds"),
    "no number": (("zero", "Align"), {"seeds": [1.5]}, "seeds"),
    "worlds": (("zero", "Align"), {"seeds": [1], "num_envs": 3}, "num_envs"),
    "another action": ((Counting(), "Align"), {"seeds": [1], "action": "patch"}, "action"),
    "no policy": (("hover", "Align"), {"seeds": [1]}, "policy.kind"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    arguments, more, message = BAD[case]
    with pytest.raises(ValueError, match=message):
        rollout(*arguments, **more)


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
