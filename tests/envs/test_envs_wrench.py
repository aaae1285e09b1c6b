"""The wrench action: resulting accelerations, and reasons for parts without allocation."""

import math

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from vibgym.envs import ACTIONS, Wrench
from vibgym.envs.motions import BESIDE, GONE, LEFT_OUT, REASONS, SERVED
from vibgym.scene.parts import shipped_part

PART = shipped_part("aluminium_block")


def scale(env):
    return env.unwrapped.core.action.scale


def test_parts_get_the_commanded_acceleration():
    """By the planar model, from rest to 0.13 m/s, before parts come upon other elements."""
    env = batch("Align", 64, action="wrench")
    seen, _ = env.reset(seed=1)
    generator = np.random.default_rng(1)
    wanted = generator.uniform(-0.35, 0.35, (64, 1, 3))
    velocity = []
    for _ in range(3):
        env.step(wanted.astype(np.float32).reshape(64, 3))
        velocity.append(env.unwrapped.truth.mean_velocity[:, 0])
    made = (velocity[2] - velocity[0]) / (2 * 0.04) / scale(env)[0]
    assert np.abs(made - wanted[:, 0]).max(axis=1) == pytest.approx(0.0, abs=0.04)
    assert np.median(np.abs(made - wanted[:, 0])) < 0.01
    assert np.hypot(*velocity[2][:, :2].T).max() > 0.12


def test_zeros_keep_the_velocity():
    env = single("Transport", action="wrench")
    env.reset(seed=2, options={"pose": [0.2, 0.1, 0.0], "goal": [0.7, 0.1, 0.0]})
    for _ in range(4):
        env.step(np.array([0.5, 0.0, 0.0], dtype=np.float32))
    speeds = []
    for _ in range(10):
        env.step(np.zeros(3, dtype=np.float32))
        speeds.append(env.unwrapped.truth.mean_velocity[0, 0, 0])
    assert speeds[0] > 0.1 and speeds[-1] == pytest.approx(speeds[0], rel=0.03)


def test_several_parts_get_their_accelerations():
    env = batch("Sort", 16, action="wrench")
    env.reset(seed=3)
    wanted = np.random.default_rng(3).uniform(-0.2, 0.2, (16, 6, 3))
    velocity = []
    for _ in range(3):
        _, _, _, _, info = env.step(wanted.astype(np.float32))
        velocity.append(env.unwrapped.truth.mean_velocity)
    made = (velocity[2] - velocity[1]) / 0.04 / scale(env)
    assert np.median(np.abs(made - wanted)) < 0.03
    assert (info["commanded"]["unserved"] == SERVED).all()


def test_commands_pass_a_dead_zone():
    """Also small ones, by elements in opposite directions."""
    env = single("Align", action="wrench", actuators={"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0})
    env.reset(seed=4)
    least = env.unwrapped.data_sheet.dead_zone / env.unwrapped.surface.max_amplitude
    env.step(np.array([0.02, 0.0, 0.0], dtype=np.float32))
    env.step(np.zeros(3, dtype=np.float32))
    length = np.hypot(*env.unwrapped.phasors().reshape(-1, 2).T)
    assert (length > 0.0).sum() >= 2 and length[length > 0.0].min() >= least * (1.0 - 1e-6)


def test_reasons_for_resting_elements_are_reported():
    env = single("Align", action="wrench", surface={"rows": 4, "columns": 4})
    _, info = env.reset(seed=5)
    assert info["commanded"]["unserved"].tolist() == [SERVED]
    done = False
    while not done:
        _, _, done, _, info = env.step(np.array([1.0, 0.0, 0.0], dtype=np.float32))
    assert info["fallen"] and info["commanded"]["unserved"].tolist() in ([SERVED], [BESIDE], [GONE])
    many = batch("Sort", 2, action="wrench", slots=7, randomize={"parts": [2, 3]})
    many.reset(seed=6)
    _, _, _, _, info = many.step(np.ones((2, 6, 3), dtype=np.float32))
    there = many.unwrapped.truth.present
    assert (info["commanded"]["unserved"] == np.where(there, SERVED, GONE)).all() and not there.all()
    assert len(REASONS) == LEFT_OUT + 1


def test_parts_that_can_stick_are_refused():
    with pytest.raises(ValueError, match="parts"):
        single("Align", action="wrench", parts=[{"shape": "disc", "radius": 0.02, "friction": 4.0, "name": "grippy"}])


def test_scales_agree_with_the_documentation():
    env = single("Align", action="wrench")
    push = 0.5 * PART.friction * 9.81
    assert scale(env)[0, 0] == pytest.approx([push, push, push / math.sqrt(PART.gyration)])
    assert env.unwrapped.action_shape == (1, 3)


class Spared(Wrench):
    """Exclude the second part."""

    def left_out(self, measurement):
        return np.broadcast_to([False, True], measurement.gone.shape)


def test_a_subclass_excludes_parts(monkeypatch):
    monkeypatch.setitem(ACTIONS._items, "spared", Spared)
    pose, moved = [[0.2, 0.1, 0.0], [0.6, 0.1, 0.0]], {}
    for action in ("wrench", "spared"):
        env = single("Singulate", action=action, parts=["aluminium_block"] * 2)
        env.reset(seed=1, options={"pose": pose})
        for _ in range(5):
            *_, info = env.step(np.full((2, 3), 0.3, dtype=np.float32))
        moved[action] = env.unwrapped.truth.pose[0] - pose
        assert info["commanded"]["unserved"].tolist() == [SERVED, LEFT_OUT if action == "spared" else SERVED]
    assert (moved["spared"][0] == moved["wrench"][0]).all() and abs(moved["wrench"][1, 0]) > 5e-3
    assert abs(moved["spared"][1, 0]) < 5e-4 and "left out" in REASONS[LEFT_OUT]
