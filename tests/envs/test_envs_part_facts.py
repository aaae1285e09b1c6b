"""``info`` of each part, other observations of the same instant, and the hold."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, put, single, sorted_pose, still

SETTINGS = {"action": "field", "randomize": {"parts": [2, 5]}}


def test_info_of_every_part():
    env = batch("Sort", 8, **SETTINGS)
    env.reset(seed=2)
    env.action_space.seed(2)
    for _ in range(5):
        *_, info = env.step(env.action_space.sample())
        reported, truth = info["parts"], env.truth
        assert (reported["present"] == truth.present).all() and (reported["done"] == truth.done).all()
        assert (reported["fallen"] == (truth.fallen & truth.present)).all() and not reported["fallen"].any()
        assert reported["reward_terms"].keys() == info["reward_terms"].keys()
        assert reported["reward"].shape == (8, 6) and reported["reward"].dtype == np.float64
        for name, values in reported["reward_terms"].items():
            if name.startswith("_"):
                assert values.all()
                continue
            assert not values[~truth.present].any()


def test_only_the_fallen_part_is_penalised():
    env = single("Sort", action="phasor")
    env.reset(seed=0)
    pose = sorted_pose()
    pose[2, :2] = 0.4, -0.01  # its centre is off the surface
    put(env, pose)
    *_, reward, terminated, _, info = env.step(still(env))
    assert terminated and info["fallen"]
    reported = info["parts"]
    assert reported["fallen"].tolist() == [part == 2 for part in range(6)]
    assert reported["reward_terms"]["fallen"].tolist() == [-5.0 if part == 2 else 0.0 for part in range(6)]
    assert info["reward_terms"]["fallen"] == -5.0
    assert reported["done"].tolist() == [part != 2 for part in range(6)]


# -- another observation of the same instant -----------------------------------------------------------------------------


@pytest.mark.parametrize("many", [False, True])
def test_observed_equals_an_environment_with_that_observation(many):
    settings = {"action": "field", "sensor": "pose"}

    def make(observation):
        return (
            batch("Align", 3, observation=observation, **settings)
            if many
            else single("Align", observation=observation, **settings)
        )

    env, others = make("parts"), {kind: make(kind) for kind in ("state", "parts", "image", "goal")}
    seen = {kind: other.reset(seed=5)[0] for kind, other in others.items()}
    env.reset(seed=5)
    env.action_space.seed(5)
    for _ in range(3):
        for kind, expected in seen.items():
            assert_same(env.unwrapped.observed(kind), expected)
        action = env.action_space.sample()
        env.step(action)
        seen = {kind: other.step(action)[0] for kind, other in others.items()}


def test_observed_has_no_side_effects():
    env, quiet = (batch("Sort", 2, observation="parts", sensor="pose", **SETTINGS) for _ in range(2))
    env.reset(seed=1)
    quiet.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(4):
        env.unwrapped.observed("state")
        action = env.action_space.sample()
        assert_same(env.step(action), quiet.step(action))
    assert_same(env.unwrapped.get_state(), quiet.unwrapped.get_state())


def test_unsupported_observations():
    env = single("Sort", observation="parts").unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.observed("state")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="kind"):
        env.observed("flat")
    with pytest.raises(ValueError, match="observation"):
        env.observed("goal")
    for bad in (None, 3, ["state"]):
        with pytest.raises(ValueError, match="kind"):
            env.observed(bad)
    seeing = single("Align", sensor="camera").unwrapped
    seeing.reset(seed=0)
    with pytest.raises(ValueError, match="kind"):
        seeing.observed("camera")


# -- hold ----------------------------------------------------------------------------------------------------------------


def test_a_longer_hold_at_the_goal():
    steps = {}
    for hold in (10, 25):
        env = single("Transport", action="phasor", task_settings={"hold": hold})
        _, info = env.reset(seed=0, options={"pose": [0.4, 0.1, 0.0], "goal": [0.4, 0.1, 0.0]})
        steps[hold], terminated = 0, False
        while not terminated:
            *_, terminated, _, info = env.step(still(env))
            steps[hold] += 1
        assert info["is_success"]
    assert steps == {10: 10, 25: 25}


@pytest.mark.parametrize("make", [single, lambda task, **settings: batch(task, 2, **settings)])
def test_a_hold_longer_than_an_episode_is_refused(make):
    with pytest.raises(ValueError, match=r"task_settings.*hold"):
        make("Align", task_settings={"hold": 251})
    make("Align", task_settings={"hold": 250})
    with pytest.raises(ValueError, match="paths"):
        make("Follow", task_settings={"hold": 480})
    with pytest.raises(ValueError, match="'held' of task_settings"):
        make("Sort", task_settings={"held": 10})
