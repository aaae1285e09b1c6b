"""Costs beside the reward: closed forms, weights, parity, snapshots, custom costs."""

import gymnasium as gym
import numpy as np
import pytest

from vibgym.adapters.safety import SafetyEnv
from vibgym.envs.costs import COSTS, Cost

ALL = {"impulse": 2.0, "fallen": 10.0, "clearance": {"weight": 0.1, "below_mm": 8}, "effort": 0.5}
DISC = {"shape": "disc", "radius_mm": 20, "friction": 0.58, "mass": 0.1, "name": "disc", "restitution": 0.5}


def two_discs(gap=0.05, **settings):
    env = gym.make("vibgym/Sort-v0", **{"parts": [DISC, DISC], "costs": ALL, "action": "element", **settings})
    pose = [[0.3, 0.1, 0.0], [0.34 + gap, 0.1, 0.0]]
    _, info = env.reset(seed=0, options={"pose": pose})
    return env, info


def test_nothing_is_reported_unless_asked_for():
    env = gym.make("vibgym/Sort-v0")
    env.reset(seed=0)
    info = env.step(env.action_space.sample())[-1]
    assert "cost" not in info and "costs" not in info and "cost" not in info["parts"]


def test_effort_is_the_mean_square_amplitude():
    env, info = two_discs()
    assert info["cost"] == 0.0 and set(info["costs"].values()) == {0.0}
    action = np.zeros(env.unwrapped.action_shape)  # half of the amplitude, at any phase
    assert env.step(action)[-1]["costs"]["effort"] == pytest.approx(0.25, rel=1e-6)
    action[..., 0] = -1.0  # at rest
    action[0, 0, 0] = 1.0  # but one element
    assert env.step(action)[-1]["costs"]["effort"] == pytest.approx(1 / 256, rel=1e-6)


@pytest.mark.parametrize(("gap", "parts"), [(0.0079, 2), (0.0081, 0)])
def test_clearance_counts_parts_below_the_limit(gap, parts):
    env, _ = two_discs(gap, action="velocity")
    info = env.step(np.zeros(6))[-1]
    assert info["costs"]["clearance"] == parts
    assert info["parts"]["cost"].tolist() == pytest.approx([info["cost"] / 2] * 2)


def test_impulses_are_those_of_the_momentum_exchanged():
    """A disc at rest is hit: each gets the same impulse, which changes the relative velocity by (1 + e) of its approach."""
    still = {"horizontal_amplitude": 0.0}
    env, _ = two_discs(0.001, surface=still, parts=[{**DISC, "friction": 0.0}] * 2)
    state = env.unwrapped.get_state()
    state["simulator"]["velocity"][0, 0] = [0.1, 0.0, 0.0]
    env.unwrapped.set_state(state)
    info = env.step(-np.ones(env.unwrapped.action_shape))[-1]
    one = 0.5 * 0.1 * (1 + 0.5) * 0.1  # reduced mass, restitution, speed
    assert info["costs"]["impulse"] == pytest.approx(2 * one, rel=1e-6)
    assert info["parts"]["cost"].tolist() == pytest.approx([2.0 * one + 0.1] * 2)  # and clearance
    assert env.step(-np.ones(env.unwrapped.action_shape))[-1]["costs"]["impulse"] == 0.0


def test_fallen_parts_cost_at_the_step_of_the_fall():
    env, _ = two_discs(action="velocity")
    env.reset(options={"pose": [[0.001, 0.1, 0.0], [0.4, 0.1, 0.0]]})
    action, ended = np.tile([-1.0, 0.0, 0.0], 2), False
    while not ended:
        _, _, ended, _, info = env.step(action)
    assert info["fallen"] and info["costs"]["fallen"] == 1.0
    total = sum(
        (each["weight"] if isinstance(each, dict) else each) * info["costs"][name] for name, each in ALL.items()
    )
    assert info["cost"] == pytest.approx(total, rel=1e-12)
    assert info["parts"]["cost"].sum() == pytest.approx(total, rel=1e-12)


def random_steps(env, steps, seed=0):
    draw = np.random.default_rng(seed)
    return [env.step(draw.uniform(-1, 1, env.action_space.shape).astype(np.float32)) for _ in range(steps)]


def test_longer_steps_add_up_and_do_not_change_the_motion():
    settings = {"action": "velocity", "start": "crowded"}
    plain = gym.make("vibgym/Sort-v0", periods_per_step=3, **settings)
    env = gym.make("vibgym/Sort-v0", periods_per_step=3, costs=ALL, **settings)
    np.testing.assert_array_equal(plain.reset(seed=3)[0], env.reset(seed=3)[0])
    for one, other in zip(random_steps(plain, 6), random_steps(env, 6), strict=True):
        np.testing.assert_array_equal(one[0], other[0])
    short = gym.make("vibgym/Sort-v0", costs=ALL, start="crowded", action="element")
    long = gym.make("vibgym/Sort-v0", costs=ALL, start="crowded", action="element", periods_per_step=3)
    short.reset(seed=3)
    long.reset(seed=3)
    for seed in range(4):
        action = np.random.default_rng(seed).uniform(-1, 1, short.action_space.shape).astype(np.float32)
        three, once = [short.step(action)[-1]["costs"] for _ in range(3)], long.step(action)[-1]["costs"]
        for name in ("impulse", "effort"):
            assert once[name] == pytest.approx(sum(each[name] for each in three), rel=1e-12)
        assert once["impulse"] > 0.0 and once["clearance"] == 3 * three[-1]["clearance"]


def test_a_custom_cost(monkeypatch):
    class Crowd(Cost):
        by_part = False

        class Settings(Cost.Settings):
            least: int = 3

        def measure(self, now):
            return (now.present.sum(axis=1) >= self.settings.least).astype(float)

    monkeypatch.setitem(COSTS._items, "crowd", Crowd)
    env = gym.make("vibgym/Sort-v0", costs={"crowd": {"weight": 2.0, "least": 4}}, action="velocity")
    env.reset(seed=0)
    info = env.step(np.zeros(18))[-1]
    assert info["costs"] == {"crowd": 1.0} and info["cost"] == 2.0
    assert info["parts"]["cost"].tolist() == pytest.approx([1 / 3] * 6)


@pytest.mark.parametrize(("costs", "named"), [
    ({}, "costs"),
    (3, "costs"),
    ({"impulses": 1.0}, "did you mean 'impulse'"),
])  # fmt: skip
def test_bad_settings_are_one_error(costs, named):
    with pytest.raises(ValueError, match=named) as error:
        gym.make("vibgym/Sort-v0", costs=costs)
    assert "\n" not in str(error.value)


def test_the_safety_interface_requires_costs():
    with pytest.raises(ValueError, match="costs"):
        SafetyEnv("vibgym/Sort-v0")
    with pytest.raises(ValueError, match="require the id"):
        SafetyEnv(gym.make("vibgym/Sort-v0", costs=ALL), action="velocity")


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_batches_with_drawn_shapes_have_costs(mode):
    settings = {"action": "velocity", "costs": {"effort": 1.0}, "max_episode_steps": 2, "autoreset_mode": mode}
    env = SafetyEnv(gym.make_vec("vibgym/AlignShapes-v0", num_envs=2, **settings))
    env.reset(seed=0)
    for _ in range(2):
        cost = env.step(np.ones((2, 3), np.float32))[2]
        assert cost.shape == (2,) and (cost > 0.0).all()


def test_costs_that_are_not_finite_are_refused(monkeypatch):
    class Endless(Cost):
        def measure(self, now):
            return np.where(now.present, np.inf, 0.0)

    monkeypatch.setitem(COSTS._items, "endless", Endless)
    env = gym.make("vibgym/Sort-v0", costs={"endless": 1.0}, action="velocity")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="cost 'endless'"):
        env.step(np.zeros(18))
