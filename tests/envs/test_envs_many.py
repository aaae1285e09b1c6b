"""Environments with several parts: registration, ends of episodes, and info."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import WALLS, batch, put, single, sorted_pose, still
from vibgym.envs import VibgymEnv, VibgymVectorEnv
from vibgym.physics.contacts.hulls import all_gaps
from vibgym.registration import register_environments

NAMES = {"Sort": 750, "SortTwelve": 1500, "SortThreeKinds": 750, "SortCrowded": 750, "Singulate": 500}


@pytest.mark.parametrize("name, limit", NAMES.items())
def test_registered(name, limit):
    spec = gym.registry[f"vibgym/{name}-v0"]
    register_environments()
    assert gym.registry[f"vibgym/{name}-v0"] is spec
    env = single(name, action="field")
    assert env.spec.max_episode_steps == limit and isinstance(env.unwrapped, VibgymEnv)
    many = batch(name, 2, action="field")
    assert isinstance(many, VibgymVectorEnv) and many.max_episode_steps == limit
    parts = {"SortTwelve": 12}.get(name, 6)
    assert env.action_space.shape == (parts * 6,) and env.observation_space.shape == (20 * parts,)
    assert single(name, action="patch").unwrapped.action_shape == (parts, 4, 4, 2)
    kinds = {"SortThreeKinds": ("steel_block", "aluminium_block", "disc")}.get(name, ("steel_block", "aluminium_block"))
    task = env.unwrapped.core.task
    assert task.kinds == kinds and (np.bincount(task.kind) == parts // len(kinds)).all()
    assert task.kind[:2].tolist() == [0, 1]  # mixed, not one kind after the other


def test_sorted_parts_are_a_success_after_ten_steps():
    env = single("Sort", action="phasor")
    env.reset(seed=1)
    put(env, sorted_pose())
    for step in range(1, 11):
        _, reward, terminated, truncated, info = env.step(still(env))
        assert (terminated, info["is_success"]) == (step == 10, step == 10), step
        assert info["parts_done"] == 6 and info["position_error"] == 0.0 and not truncated
    assert info["reward_terms"]["success"] == 5.0
    assert reward == pytest.approx(4.997 + info["reward_terms"]["inside"], abs=1e-12)


def test_absent_parts_do_not_count():
    """Success depends on present parts only; absent ones do not count as fallen."""
    env = single("Sort", action="phasor", randomize={"parts": [2, 2]})
    env.reset(seed=1)
    core = env.unwrapped.core
    present = core.episode.present[0].copy()
    assert present.sum() == 2
    pose = np.where(present[:, None], sorted_pose(), core.simulator.pose[0])
    core.simulator.place(np.array([0]), pose[None], np.where(present[:, None], core.idle, 0.0), 0.0, ~present)
    for _ in range(10):
        *_, terminated, _, info = env.step(still(env))
    assert terminated and info["is_success"] and info["parts_done"] == 2 and not info["fallen"]


def test_info_agrees_with_the_state():
    env = batch("SortCrowded", 8, action="field", walls=WALLS)
    env.reset(seed=0)
    env.action_space.seed(0)
    core = env.unwrapped.core
    for _ in range(10):
        *_, info = env.step(env.action_space.sample())
        gaps = np.empty((8, 6, 6))
        all_gaps(core.simulator.hulls, core.simulator.pose, gaps)
        assert info["clearance"] == pytest.approx(gaps.min(axis=(1, 2)), abs=1e-12)
        assert (info["touching"] == (gaps < 1e-4).sum(axis=(1, 2)) // 2).all()
        assert info["touching"].dtype == info["parts_done"].dtype == np.int64
    assert not info["fallen"].any()


def test_walls_keep_parts_on_the_table():
    push = np.zeros((6, 6), dtype=np.float32)
    push[:, 1] = 1.0
    for walls, falls in (([], True), (["top"], False)):
        env = single("Sort", action="field", walls=walls)
        env.reset(seed=4)
        assert env.unwrapped.core.simulator.walls == tuple(walls)
        ends = any(env.step(push)[2] for _ in range(60))
        assert ends == falls


@pytest.mark.parametrize("action", ["patch", "field"])
def test_absent_parts_have_no_commands(action):
    env = single("Sort", action=action, randomize={"parts": [1, 1]})
    env.reset(seed=2)
    core = env.unwrapped.core
    (part,) = np.flatnonzero(core.episode.present[0])
    generator = np.random.default_rng(0)
    commands = generator.uniform(-1, 1, env.unwrapped.action_shape).astype(np.float32)
    before = core.simulator.get_state()
    env.step(commands)
    moved, phasors = core.simulator.pose[0, part], core.phasors(0)
    assert (np.hypot(*np.moveaxis(phasors, -1, 0)) > 0).sum() == (16 if action == "patch" else 256)
    others = generator.uniform(-1, 1, env.unwrapped.action_shape).astype(np.float32)
    others[part] = commands[part]
    core.simulator.set_state(before)
    env.step(others)
    assert (core.simulator.pose[0, part] == moved).all() and (core.phasors(0) == phasors).all()
    alone = single("Sort", action=action, parts=["steel_block" if part % 2 == 0 else "aluminium_block"])
    alone.reset(seed=0)
    put(alone, before["pose"][0, [part]])
    alone.step(commands[[part]])
    assert alone.unwrapped.core.phasors(0) == pytest.approx(phasors, abs=1e-12)
    # Without others the simulator divides the period differently, so results are only approximately equal.
    assert alone.unwrapped.core.simulator.pose[0, 0] == pytest.approx(moved, abs=2e-5)
