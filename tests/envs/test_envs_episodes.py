"""Ends of episodes, and rewards."""

import math

import numpy as np
import pytest

from tests.envs.helpers import SMALL, TASKS, batch, goal, put, single, sorted_pose, still

ONE = {
    "distance": (-1, 1), "approach": (-1, 1), "turn": (-1, 1), "alignment": (-1, 1), "inside": (0, 0.1),
    "time": (-0.02, 0), "success": (0, 5), "fallen": (-5, 0),
}  # fmt: skip
SEVERAL = {
    "distance": (-1, 1), "inside": (-1, 1), "clearance": (-1, 1), "time": (-0.003, 0), "success": (0, 5), "fallen": (-5, 0),
}  # fmt: skip


@pytest.mark.parametrize("task", TASKS)
def test_success_after_ten_steps_within_tolerance(task):
    env = single(task, action="phasor")
    env.reset(seed=1)
    put(env, goal(env))
    for step in range(1, 11):
        _, reward, terminated, truncated, info = env.step(still(env))
        assert (terminated, info["is_success"]) == (step == 10, step == 10), step
        assert not truncated and not info["fallen"]
    assert info["reward_terms"]["success"] == 5.0 and reward == pytest.approx(5.08, abs=1e-3)


@pytest.mark.parametrize("task", TASKS)
def test_leaving_the_goal_restarts_the_hold(task):
    env = single(task, action="phasor")
    env.reset(seed=1)
    aim = goal(env)
    put(env, aim)
    for _ in range(9):
        env.step(still(env))
    put(env, aim + [0.006, 0, 0])
    _, _, terminated, _, info = env.step(still(env))
    assert not terminated and info["reward_terms"]["inside"] == 0.0
    put(env, aim)
    ends = [env.step(still(env))[2] for _ in range(10)]
    assert ends == [False] * 9 + [True]


def over_the_edge(env, world=0):
    """Place one world's part at the left edge, moving outwards."""
    put(env, [0.0005, 0.1, 0.0], [-0.5, 0, 0], world)


@pytest.mark.parametrize("task", TASKS)
def test_a_fall_ends_the_episode_without_success(task):
    env = single(task, action="phasor")
    env.reset(seed=1)
    put(env, goal(env))
    for _ in range(9):
        env.step(still(env))
    # It falls within tolerance of the goal, in the tenth step.
    env.unwrapped.core.episode.goal[0, 0] = [0.0, 0.1, 0.0]
    over_the_edge(env)
    seen, reward, terminated, truncated, info = env.step(still(env))
    assert terminated and not truncated and info["fallen"] and not info["is_success"]
    assert info["reward_terms"]["fallen"] == -5.0 and info["reward_terms"]["success"] == 0.0
    assert reward < -4.0
    assert env.observation_space.contains(seen)


OBSERVED = [*((task, each) for task in TASKS for each in ("state", "goal", "image")),
            *((task, each) for task in ("Sort", "Singulate") for each in ("state", "image"))]  # fmt: skip


@pytest.mark.parametrize("task, observation", OBSERVED)
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


@pytest.mark.parametrize("task, bounds, settings", [
    *((task, ONE, {"surface": SMALL}) for task in TASKS),
    ("SortThreeKinds", SEVERAL, {"randomize": {"parts": [1, 6]}}), ("Singulate", SEVERAL, {"randomize": {"parts": [1, 6]}}),
])  # fmt: skip
def test_terms_of_the_reward_keep_their_bounds(task, bounds, settings):
    env = batch(task, 12, action="field", max_episode_steps=25, **settings)
    env.reset(seed=2)
    env.action_space.seed(1)
    generator, seen = np.random.default_rng(1), {name: set() for name in bounds}
    for step in range(60):
        if bounds is ONE and step % 10 == 5:  # jumps, so that progress reaches its bounds
            put(env, generator.uniform([0, 0, -20], [0.104, 0.078, 20]), world=step % 12)
        terms = env.step(env.action_space.sample())[4]["reward_terms"]
        assert [name for name in terms if not name.startswith("_")] == list(bounds)
        for name, (low, high) in bounds.items():
            assert (terms[name] >= low).all() and (terms[name] <= high).all(), name
            seen[name] |= set(terms[name].tolist())
    assert {0.0, -5.0} <= seen["fallen"]
    assert len(seen["clearance" if task == "Singulate" else "distance"]) > 100
    assert task != "Rotate" or {-1.0, 1.0} <= seen["turn"]


@pytest.mark.parametrize("periods", [2, 5])
def test_periods_per_step(periods):
    slow, fast = single("Rotate", action="element", periods_per_step=periods), single("Rotate", action="element")
    slow.reset(seed=1), fast.reset(seed=1)
    slow.action_space.seed(1)
    for step in range(3):
        action = slow.action_space.sample()
        seen, *_ = slow.step(action)
        for _ in range(periods):
            expected, *_ = fast.step(action)
        assert (seen == expected).all()
        assert slow.unwrapped.core.simulator.time == pytest.approx((step + 1) * periods * 0.04)
    assert slow.unwrapped.metadata["render_fps"] == round(25 / periods)


@pytest.mark.parametrize("periods", [2, 3, 9, 10, 25])
def test_the_hold_lasts_as_long_with_longer_steps(periods):
    """Ten periods, and never a single instant in passing."""
    env = single("Transport", action="velocity", periods_per_step=periods)
    env.reset(seed=1)
    put(env, goal(env))
    ends = [env.step(still(env))[2] for _ in range(max(math.ceil(10 / periods), 2))]
    assert ends == [False] * (len(ends) - 1) + [True]
    env = single("Transport", action="velocity", periods_per_step=10)
    env.reset(options={"pose": [0.2, 0.104, 0.0], "goal": [0.2818, 0.104]})
    steps = [env.step(np.array([1.0, 0.0, 0.0])) for _ in range(3)]
    assert steps[1][4]["position_error"] < 0.005 < steps[2][4]["position_error"]
    assert not any(step[2] or step[4]["is_success"] for step in steps)
