"""``randomize={"disturbance": ...}`` in every environment, with tilts and with impulses."""

from __future__ import annotations

import math

import numpy as np
import pytest

import vibgym  # noqa: F401 - registers the environments
from vibgym.envs import VibgymVectorEnv

OFTEN = {"disturbance": {"rate": 5.0, "tilt_deg": [1, 3]}}


def batch(model: str = "planar", worlds: int = 16, task: str = "Align", **settings: object) -> VibgymVectorEnv:
    """Return environments with frequent disturbances."""
    env = VibgymVectorEnv(task, num_envs=worlds, model=model, **{"randomize": OFTEN, **settings})
    env.reset(seed=4)
    return env


def play(env: VibgymVectorEnv, steps: int) -> list[np.ndarray]:
    """Return ``disturbed`` of every step under zero actions."""
    action = np.zeros((env.num_envs, *env.single_action_space.shape), np.float32)
    return [env.step(action)[4]["parts"]["disturbed"].copy() for _ in range(steps)]


@pytest.mark.parametrize("model", ["planar", "tilting"])
def test_info_reports_disturbances(model):
    env = batch(model, worlds=64, action="wrench")
    disturbed = np.array(play(env, 50))
    assert ((disturbed == 0.0) | ((disturbed >= math.radians(1)) & (disturbed <= math.radians(3)))).all()
    seconds = 50 * 0.04 * 64
    assert (disturbed > 0.0).sum() == pytest.approx(5.0 * seconds, rel=0.15)  # some twice in a step, or after their end


def test_disturbed_parts_tilt_and_land_in_the_tilting_model():
    env = batch("tilting", action="wrench", randomize={"disturbance": {"rate": 1.0, "tilt_deg": 5}})
    simulator = env.core.simulator
    for disturbed in play(env, 25):
        if disturbed.any():
            assert simulator.time_tilted[disturbed > 0.0].min() > 0.0
    assert "toppled" in env.step(np.zeros((16, 3), np.float32))[4]["parts"]


def test_disturbed_parts_get_a_kick_in_planar_models():
    """Kicks are normal with the fitted deviations per root of a degree; other parts do not move."""
    from vibgym.physics.planar.impulse import SPEED, SPIN

    env = VibgymVectorEnv(
        "Align", num_envs=4000, action="wrench", randomize={"disturbance": {"rate": 50.0, "tilt_deg": 2}}
    )
    env.reset(seed=0)
    core = env.core
    before = core.simulator.velocity
    core.disturbances.disturb(core.episode.present)
    impulse, disturbed = core.simulator.velocity - before, core.disturbances.disturbed > 0.0
    assert 0.8 < disturbed.mean() < 0.92 and not impulse[~disturbed].any()  # 1 - exp(-2)
    deviation = impulse[disturbed].std(axis=0) / math.sqrt(2.0)
    assert deviation == pytest.approx([SPEED, SPEED, SPIN], rel=0.06)


def test_without_it_nothing_is_drawn():
    """Starts do not change, and ``info`` does not contain it."""
    plain = VibgymVectorEnv("Align", num_envs=2)
    seen, info = plain.reset(seed=3)
    other, _ = VibgymVectorEnv("Align", num_envs=2, model="tilting").reset(seed=3)
    assert np.array_equal(seen, other) and "disturbed" not in info["parts"]


def test_a_toppled_part_ends_the_episode_as_a_fallen_one():
    tall = {"shape": "rectangle", "length": 0.02, "width": 0.02, "friction": 0.6, "height": 0.05}
    env = VibgymVectorEnv("Align", num_envs=8, model="tilting", parts=[tall], action="field")
    env.reset(seed=0)
    for _ in range(200):
        info = env.step(np.ones((8, 6), np.float32))[4]
        toppled = info["parts"]["toppled"]
        if toppled.any():
            break
    assert toppled.any() and info["fallen"][toppled[:, 0]].all()
