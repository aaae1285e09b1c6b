"""A picture shows the step that was taken, even if the caller reuses the action's array."""

import gymnasium as gym
import numpy as np
import pytest


@pytest.mark.parametrize("action", ["element", "phasor", "patch", "field"])
def test_the_action_array_may_be_reused(action):
    single = gym.make("vibgym/Align-v0", action=action, render_mode="rgb_array")
    batch = gym.make_vec("vibgym/Align-v0", num_envs=2, action=action, render_mode="rgb_array")
    single.reset(seed=0)
    batch.reset(seed=0)
    for env, render in ((single, single.render), (batch, lambda: batch.render()[0])):
        values = np.full(env.action_space.shape, 0.5, dtype=np.float32)
        env.step(values)
        before = render()
        values[:] = -0.5
        assert (render() == before).all()
        env.step(values)
        assert (render() != before).any()
