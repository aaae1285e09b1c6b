"""The reward of every registered environment is that of the table in ``docs/extending.md``, section Reward."""

import gymnasium as gym
import numpy as np
import pytest

from vibgym.registration import ENVIRONMENTS
from vibgym.tasks import TASKS, PoseTask, Task

WORLDS, STEPS, FALL = 4, 12, 6
"""Worlds, steps, and the step in which the first part of the first world falls."""


def custom(cls):
    """A task with a further term, computed by an override."""

    def reward(self, step):
        return {**Task.reward(self, step), "speed": -np.linalg.norm(step.now.mean_velocity[..., :2], axis=-1)}

    return type(f"Custom{cls.__name__}", (cls,), {"TERMS": {**cls.TERMS, "speed": 0.5}, "reward": reward})


def check(reward, info, counted, worst):
    """Compare rewards and terms of worlds with the means of those of their parts, ``counted`` (worlds,) of them."""
    of_parts, total, total_of_parts = info["parts"], np.zeros(WORLDS), 0.0
    terms = {name: values for name, values in of_parts["reward_terms"].items() if not name.startswith("_")}
    assert terms.keys() == {name for name in info["reward_terms"] if not name.startswith("_")}
    for name, values in terms.items():
        expected = values.min(axis=1) if name in worst else values.sum(axis=1) / counted
        assert info["reward_terms"][name] == pytest.approx(expected, abs=1e-12), name
        total, total_of_parts = total + expected, total_of_parts + values
    assert of_parts["reward"] == pytest.approx(total_of_parts, abs=1e-12)
    assert reward == pytest.approx(total, abs=1e-12)
    return terms


GIVEN = {"shipped": {}, "custom": {"task": "Custom"}, "goal": {"observation": "goal"}}
CASES = [
    (name, source)
    for name, (_, settings) in ENVIRONMENTS.items()
    for source in GIVEN
    if source != "goal" or issubclass(TASKS[settings["task"]], PoseTask)
]


@pytest.mark.parametrize("name, source", CASES)
def test_a_reward_is_the_mean_over_parts(monkeypatch, name, source):
    settings = ENVIRONMENTS[name][1]
    cls, continuous_feed = TASKS[settings["task"]], settings["task"] == "Feed"
    monkeypatch.setattr(TASKS, "_items", {**TASKS._items, "Custom": custom(cls)})
    env = gym.make_vec(f"vibgym/{name}-v0", num_envs=WORLDS, action="phasor", **GIVEN[source]).unwrapped
    parts = len(settings.get("parts") or cls.DEFAULT_PARTS)
    present = np.arange(parts) >= np.arange(WORLDS)[:, None]  # one more is absent in each world
    if "split" in settings:
        present[:] = present[1]  # worlds of different shapes
    if cls.MAX_PARTS == 1 or settings["task"] in ("Follow", "Push"):
        present[:] = True
    _, info = env.reset(
        seed=0, options=None if present.all() else {"parts": present[1] if "split" in settings else present}
    )
    assert not info["parts"]["reward"].any()
    pushed = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, *env.action_space.shape)).astype(np.float32)
    core, seen, falls = getattr(env, "core", None), [], []
    for k, action in enumerate(pushed):
        if k == FALL and core is not None:
            core.simulator.state.pose[0, np.flatnonzero(core.episode.present[0])[0], :2] = 0.4, -0.01
        _, reward, *_, info = env.step(action)
        terms = check(reward, info, present.sum(axis=1), () if continuous_feed else ("fallen",))
        if k > FALL and core is not None and not continuous_feed:
            present[0] = True  # a new episode
        assert not any(values[~info["parts"]["present"]].any() for values in terms.values()) or continuous_feed
        seen.append(reward)
        falls.append(terms.get("fallen", terms.get("goal")).min() <= -5.0)
    assert np.any(seen) and (core is None or falls[FALL])
