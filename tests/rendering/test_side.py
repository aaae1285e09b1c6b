"""The view from the side of environments with ``model="tilting"``."""

from __future__ import annotations

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from vibgym.rendering.side import HEIGHT, MAGNIFIED


def environment(model: str) -> gym.Env:
    """Return an environment with a picture."""
    env = gym.make("vibgym/Align-v0", model=model, action="wrench", render_mode="rgb_array")
    env.reset(seed=1)
    return env


def test_only_tilting_has_a_view_from_the_side():
    flat, above = environment("planar").render(), environment("tilting").render()
    assert above.shape == (flat.shape[0] + HEIGHT, *flat.shape[1:])
    assert np.array_equal(above[: flat.shape[0]], flat)


def test_a_tilted_part_is_drawn_with_its_height():
    """The drawn height is that of its bottom, magnified."""
    env = environment("tilting")
    before = env.render()[-HEIGHT:]
    simulator = env.unwrapped.core.simulator
    state = simulator.get_state()
    state["mode"][:], state["lean"][0, 0] = 1, [0.05, 0.03]
    state["height"][:] = simulator.parts[0].centre_height + 5e-4
    simulator.set_state(state)
    after = env.render()[-HEIGHT:]
    rows = np.flatnonzero((before != after).any(axis=(1, 2)))
    (bottom,) = simulator.bottoms(0)
    extent = MAGNIFIED * np.ptp(bottom[:, 2]) * env.unwrapped._viewer._painters[0]._table[3]
    assert abs(np.ptp(rows) - extent) < 12 and np.ptp(rows) > 30


def test_bottoms_are_where_the_parts_are():
    env = environment("tilting")
    simulator = env.unwrapped.core.simulator
    (flat,) = simulator.bottoms(0)
    assert not flat[:, 2].any()
    assert np.allclose(flat[:, :2].mean(axis=0), simulator.pose[0, 0, :2], atol=1e-12)
