"""Both environment checkers, every task, action and observation, with warnings as errors."""

import itertools
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from stable_baselines3.common.env_checker import check_env as check_sb3_env

from tests.envs.helpers import ACTIONS, OBSERVATIONS, TASKS, batch, single

EVERY = list(itertools.product(TASKS, ACTIONS, OBSERVATIONS))


@pytest.fixture(autouse=True)
def no_screen_no_warning(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("task, action, observation", EVERY)
def test_gymnasium_checker(task, action, observation):
    # Renders, in a window too, once a task; the picture does not depend on action and observation.
    rendered = (action, observation) == ("field", "state")
    check_env(single(task, action=action, observation=observation).unwrapped, skip_render_check=not rendered)


@pytest.mark.parametrize("task, action, observation", EVERY)
def test_stable_baselines_checker(task, action, observation):
    env = single(task, action=action, observation=observation, render_mode="rgb_array").unwrapped
    check_sb3_env(env, warn=True, skip_render_check=(action, observation) != ("field", "state"))


@pytest.mark.parametrize("task, action, observation", EVERY)
def test_batch_keeps_to_its_spaces(task, action, observation):
    """Gymnasium has no checker for native batches; its passive checks, by hand."""
    env = batch(task, 3, action=action, observation=observation, max_episode_steps=4)
    assert env.metadata["autoreset_mode"] is gym.vector.AutoresetMode.NEXT_STEP
    one = single(task, action=action, observation=observation)
    assert env.single_action_space == one.action_space and env.single_observation_space == one.observation_space
    assert env.action_space == gym.vector.utils.batch_space(one.action_space, 3)
    assert env.observation_space == gym.vector.utils.batch_space(one.observation_space, 3)
    seen, info = env.reset(seed=1)
    assert env.observation_space.contains(seen) and isinstance(info, dict)
    env.action_space.seed(1)
    for _ in range(6):
        seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(seen)
        assert reward.dtype == np.float64 and terminated.dtype == truncated.dtype == bool
        assert reward.shape == terminated.shape == truncated.shape == (3,)
    env.close()


def test_only_goal_environments_have_a_goal_reward():
    assert not hasattr(single("Rotate").unwrapped, "compute_reward")
    assert not hasattr(single("Rotate", observation="image").unwrapped, "compute_reward")
    assert callable(single("Rotate", observation="goal").unwrapped.compute_reward)


@pytest.mark.parametrize("task", TASKS)
def test_two_environments_of_one_kind_match(task):
    one, other = (single(task, action="patch").unwrapped for _ in range(2))
    check_environments_match(one, other, num_steps=10, skip_render=True)
