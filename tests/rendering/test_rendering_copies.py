"""Copies and pickles of environments with a picture continue and draw like the original."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

import vibgym  # noqa: F401 - registers the environments

pytest.importorskip("pygame")

COPIES = [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
@pytest.mark.parametrize("task", ["Align", "Sort"])
def test_single(task, copied):
    env = gym.make(f"vibgym/{task}-v0", action="field", render_mode="rgb_array")
    env.reset(seed=3)
    push = np.full(env.action_space.shape, 0.5, dtype=np.float32)
    for _ in range(3):
        env.step(push)
    again = copied(env)
    np.testing.assert_array_equal(again.render(), env.render())
    for sign in (1.0, -1.0, -1.0):
        mine, its = env.step(sign * push), again.step(sign * push)
        np.testing.assert_array_equal(mine[0], its[0])
        np.testing.assert_equal(mine[1:], its[1:])  # info is compared as well
    np.testing.assert_array_equal(again.render(), env.render())
    before = env.render()
    again.step(push)
    np.testing.assert_array_equal(env.render(), before)
    assert (again.render() != before).any()


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
def test_a_window_on_the_screen_stays_with_the_original(monkeypatch, copied):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make("vibgym/Align-v0", action="field", render_mode="human")
    env.reset(seed=3)
    again = copied(env)
    assert env.unwrapped._viewer.window.is_open and not again.unwrapped._viewer.window.is_open
    env.close()
    again.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert again.unwrapped._viewer.window.is_open
    again.close()
