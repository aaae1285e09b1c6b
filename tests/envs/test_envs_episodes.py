"""Registered environments, ends of episodes, and steps of several periods. Scores of given states: see ``tests/tasks``."""

import math

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import TASKS, batch, goal, put, single, sorted_pose, still
from vibgym.envs import VibgymEnv, VibgymVectorEnv
from vibgym.registration import ENVIRONMENTS, register_environments


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_registered(name):
    """``docs/environments`` states limits; parts of different kinds are mixed, not one kind after the other."""
    spec, (limit, _) = gym.registry[f"vibgym/{name}-v0"], ENVIRONMENTS[name]
    register_environments()
    assert gym.registry[f"vibgym/{name}-v0"] is spec
    env, many = single(name, action="field"), batch(name, 2, action="field")
    assert isinstance(env.unwrapped, VibgymEnv) and isinstance(many, VibgymVectorEnv)
    assert env.spec.max_episode_steps == many.max_episode_steps == limit
    task, parts = env.unwrapped.task, len(env.unwrapped.parts)
    assert env.action_space.shape == (parts * 6,) and env.observation_space.shape[0] % parts == 0
    if name.startswith("Sort"):
        assert parts == {"SortTwelve": 12}.get(name, 6) and env.observation_space.shape == (20 * parts,)
        kinds = len(task.kinds)
        assert kinds == {"SortThreeKinds": 3}.get(name, 2) and task.kind[:kinds].tolist() == list(range(kinds))


@pytest.mark.parametrize("task", TASKS)
def test_success_after_ten_steps_within_tolerance(task):
    """Leaving the goal restarts the hold."""
    env = single(task, action="phasor")
    env.reset(seed=1)
    aim = goal(env)
    put(env, aim)
    for _ in range(9):
        assert not env.step(still(env))[2]
    put(env, aim + [0.006, 0, 0])
    _, _, terminated, _, info = env.step(still(env))
    assert not terminated and info["reward_terms"]["inside"] == 0.0
    put(env, aim)
    for step in range(1, 11):
        _, reward, terminated, truncated, info = env.step(still(env))
        assert (terminated, info["is_success"]) == (step == 10, step == 10), step
        assert not truncated and not info["fallen"]
    assert info["reward_terms"]["success"] == 5.0 and reward == pytest.approx(5.08, abs=1e-3)


@pytest.mark.parametrize("task", ["Align", "Sort"])
def test_a_fall_ends_the_episode_without_success(task):
    """At its goal, in the tenth step; only the part that has fallen is penalised."""
    env = single(task, action="phasor")
    env.reset(seed=1)
    pose = goal(env)[None] if task == "Align" else sorted_pose()
    put(env, pose)
    for _ in range(9):
        env.step(still(env))
    pose[-1, :2], outwards = [0.0005, 0.1], env.unwrapped.core.idle.copy()
    outwards[..., -1, :] = [-0.5, 0.0, 0.0]
    put(env, pose, outwards)
    if task == "Align":
        env.unwrapped.core.episode.goal[0, 0] = [0.0, 0.1, pose[0, 2]]
    seen, reward, terminated, truncated, info = env.step(still(env))
    assert terminated and not truncated and info["fallen"] and not info["is_success"] and reward < -4.0
    assert info["reward_terms"]["fallen"] == -5.0 and info["reward_terms"]["success"] == 0.0
    others, of_parts = [False] * (len(pose) - 1), info["parts"]
    assert of_parts["fallen"].tolist() == [*others, True] and env.observation_space.contains(seen)
    assert of_parts["reward_terms"]["fallen"].tolist() == [0.0] * len(others) + [-5.0]
    assert of_parts["done"].tolist() == [True] * len(others) + [False]


@pytest.mark.parametrize("task, observation", [
    *((task, "goal") for task in TASKS), ("Align", "state"), ("Rotate", "image"), ("Sort", "state"), ("Singulate", "image"),
])  # fmt: skip
def test_a_diverged_world_ends_with_finite_values(task, observation):
    env = single(task, action="phasor", observation=observation)
    env.reset(seed=1)
    pose = goal(env) if task in TASKS else sorted_pose()
    put(env, pose)
    for _ in range(9):
        env.step(still(env))
    velocity = env.unwrapped.core.idle.copy()
    velocity[-1, 0] = math.nan
    put(env, pose, velocity)
    seen, reward, terminated, truncated, info = env.step(still(env))
    assert terminated and not truncated and info["diverged"] and not info["is_success"] and not info["fallen"]
    assert env.observation_space.contains(seen)  # finite except for goals
    assert all(np.isfinite(value).all() for value in (seen.values() if observation == "goal" else [seen]))
    errors = [info[name] for name in ("position_error", "heading_error", "clearance") if name in info]
    assert np.isfinite([reward, *errors, *info["reward_terms"].values()]).all()
    assert not env.reset()[1]["diverged"]
    *_, info = env.step(still(env))
    assert not info["diverged"] and np.isfinite(env.unwrapped.core.simulator.velocity).all()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_diverged_world_does_not_affect_others(mode):
    env, other = (batch("Align", 3, action="field", autoreset_mode=mode) for _ in range(2))
    env.reset(seed=1), other.reset(seed=1)
    put(env, [0.4, 0.1, 0.0], [0.0, 0.0, math.inf], world=1)
    action = np.random.default_rng(0).uniform(-1, 1, (3, 1, 6)).astype(np.float32)
    got, expected = env.step(action), other.step(action)
    info = got[4]["final_info"] if mode == "SameStep" else got[4]
    assert got[2].tolist() == [False, True, False] and info["diverged"].tolist() == [False, True, False]
    for k in (0, 1):
        assert np.isfinite(got[k]).all()
        assert (got[k][[0, 2]] == expected[k][[0, 2]]).all()
    if mode == "Disabled":
        env.reset(options={"reset_mask": got[2]})
    for _ in range(3):
        seen, reward, terminated, _, info = env.step(action)
        assert np.isfinite(seen).all() and not info["diverged"].any()
        assert (seen[[0, 2]] == other.step(action)[0][[0, 2]]).all()


def test_walls_keep_parts_on_the_table():
    push = np.zeros((6, 6), dtype=np.float32)
    push[:, 1] = 1.0
    for walls, falls in (([], True), (["top"], False)):
        env = single("Sort", action="field", walls=walls)
        env.reset(seed=4)
        assert any(env.step(push)[2] for _ in range(60)) == falls


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


def test_a_step_of_several_periods_equals_steps_of_one():
    slow, fast = single("Rotate", action="element", periods_per_step=3), single("Rotate", action="element")
    slow.reset(seed=1), fast.reset(seed=1)
    slow.action_space.seed(1)
    for step in range(1, 4):
        action = slow.action_space.sample()
        seen = [env.step(action)[0] for env in (slow, fast, fast, fast)]
        assert (seen[0] == seen[-1]).all()
        assert slow.unwrapped.core.simulator.time == pytest.approx(step * 3 * 0.04)


@pytest.mark.parametrize("settings, steps", [
    *(({"periods_per_step": periods}, max(math.ceil(10 / periods), 2)) for periods in (2, 3, 9, 10, 25)),
    ({"task_settings": {"hold": 25}}, 25),
])  # fmt: skip
def test_the_hold_lasts_as_long_with_longer_steps(settings, steps):
    """Ten periods, and never a single instant in passing."""
    env = single("Transport", action="velocity", **settings)
    env.reset(seed=1)
    put(env, goal(env))
    assert [env.step(still(env))[2] for _ in range(steps)] == [False] * (steps - 1) + [True]


def test_passing_the_goal_is_no_success():
    env = single("Transport", action="velocity", periods_per_step=10)
    env.reset(options={"pose": [0.2, 0.104, 0.0], "goal": [0.2818, 0.104]})
    steps = [env.step(np.array([1.0, 0.0, 0.0])) for _ in range(3)]
    assert steps[1][4]["position_error"] < 0.005 < steps[2][4]["position_error"]
    assert not any(step[2] or step[4]["is_success"] for step in steps)
