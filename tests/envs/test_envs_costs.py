"""Costs beside the reward: closed forms, weights, custom costs; and contacts in observations."""

import gymnasium as gym
import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.ops import nearest_points

from tests.envs.helpers import batch
from vibgym.adapters.safety import SafetyEnv
from vibgym.envs.costs import COSTS, Cost
from vibgym.envs.features import RowLayout

ALL = {"impulse": 2.0, "fallen": 10.0, "clearance": {"weight": 0.1, "below_mm": 8}, "effort": 0.5}
DISC = {"shape": "disc", "radius_mm": 20, "friction": 0.58, "mass": 0.1, "name": "disc", "restitution": 0.5}


def two_discs(gap=0.05, **settings):
    env = gym.make("vibgym/Sort-v0", **{"parts": [DISC, DISC], "costs": ALL, "action": "element", **settings})
    pose = [[0.3, 0.1, 0.0], [0.34 + gap, 0.1, 0.0]]
    _, info = env.reset(seed=0, options={"pose": pose})
    return env, info


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
    weights = {**ALL, "clearance": 0.1}
    total = sum(weight * info["costs"][name] for name, weight in weights.items())
    assert info["cost"] == pytest.approx(total, rel=1e-12)
    assert info["parts"]["cost"].sum() == pytest.approx(total, rel=1e-12)


def test_longer_steps_add_up_and_do_not_change_the_motion():
    settings = {"start": "crowded", "action": "element"}
    short = gym.make("vibgym/Sort-v0", costs=ALL, **settings)
    plain, long = (gym.make("vibgym/Sort-v0", costs=costs, periods_per_step=3, **settings) for costs in (None, ALL))
    for env in (short, plain, long):
        env.reset(seed=3)
    for seed in range(4):
        action = np.random.default_rng(seed).uniform(-1, 1, short.action_space.shape).astype(np.float32)
        three, seen, same = [short.step(action)[-1]["costs"] for _ in range(3)], long.step(action), plain.step(action)
        np.testing.assert_array_equal(seen[0], same[0])
        assert "cost" not in same[-1] and "costs" not in same[-1] and "cost" not in same[-1]["parts"]
        once = seen[-1]["costs"]
        for name in ("impulse", "effort"):
            assert once[name] == pytest.approx(sum(costs[name] for costs in three), rel=1e-12)
        assert once["impulse"] > 0.0 and once["clearance"] == 3 * three[-1]["clearance"]


def test_a_custom_cost(monkeypatch):
    class Crowd(Cost):
        by_part = False

        class Settings(Cost.Settings):
            least: float = 3.0

        def measure(self, now):
            return np.where(now.present.sum(axis=1) >= self.settings.least, 1.0, np.inf)

    monkeypatch.setitem(COSTS._items, "crowd", Crowd)
    env = gym.make("vibgym/Sort-v0", costs={"crowd": {"weight": 2.0, "least": 4}}, action="velocity")
    env.reset(seed=0)
    info = env.step(np.zeros(18))[-1]
    assert info["costs"] == {"crowd": 1.0} and info["cost"] == 2.0
    assert info["parts"]["cost"].tolist() == pytest.approx([1 / 3] * 6)
    env = gym.make("vibgym/Sort-v0", costs={"crowd": {"weight": 1.0, "least": 7}}, action="velocity")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="cost 'crowd'"):  # not finite
        env.step(np.zeros(18))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_safety_interface_returns_the_cost_of_the_step(mode):
    """Also of finished worlds, and with drawn shapes."""
    settings = {"action": "velocity", "costs": {"effort": 1.0}, "max_episode_steps": 2, "autoreset_mode": mode}
    env = SafetyEnv(gym.make_vec("vibgym/AlignShapes-v0", num_envs=2, **settings))
    env.reset(seed=0)
    for _ in range(2):
        *_, info = seen = env.step(np.ones((2, 3), np.float32))
        cost = seen[2]
        assert cost.shape == (2,) and (cost > 0.0).all()
        assert (cost == info.get("final_info", info)["cost"]).all()
    with pytest.raises(ValueError, match="costs"):
        SafetyEnv("vibgym/Sort-v0")
    with pytest.raises(ValueError, match="require the id"):
        SafetyEnv(env.env, action="velocity")


def test_observations_contain_contacts():
    env = batch(
        "Push", 16, action="wrench", observation="parts_and_state", sensor={"kind": "ideal", "report": ["contacts"]}
    ).unwrapped
    observation, _ = env.reset(seed=0)
    parts, touched = env.parts, 0
    rows, blocks = RowLayout.of(env.task), env.core.observation.layout
    action = np.zeros((16, 3, 3), dtype=np.float32)
    for _ in range(60):
        way = env.truth.pose[:, 2:, :2] - env.truth.pose[:, :2, :2]
        action[:, :2, :2] = way / np.abs(way).max(axis=-1, keepdims=True)
        observation, *_ = env.step(action)
        normal = rows.numbers(observation["parts"], "contact_normal")
        impulse = rows.quantity(observation["parts"], "contact_impulse")
        assert (normal == blocks.numbers(observation["state"], "contact_normal")).all()
        mass = [[part.mass] for part in parts]
        assert impulse * mass == pytest.approx(env.core.simulator.contact_impulse, abs=2e-6)
        touched += (np.abs(impulse[:, 2]).max(axis=-1) > 0.02 * env.surface.table_speed).sum()
    assert touched > 100
    for world in range(16):
        pose = env.truth.pose[world]
        shapes = [
            affinity.translate(affinity.rotate(shapely.Polygon(part.outline), turn, (0, 0), use_radians=True), x, y)
            for part, (x, y, turn) in zip(parts, pose, strict=True)
        ]
        nearest = min((0, 1), key=lambda k: shapes[2].distance(shapes[k]))
        mine, theirs = nearest_points(shapes[2], shapes[nearest])
        way = np.array([theirs.x - mine.x, theirs.y - mine.y])
        if np.hypot(*way) > 0.002:  # shapely has no normal for touching outlines
            # A disc's outline is a polygon for shapely.
            assert normal[world, 2] == pytest.approx(way / np.hypot(*way), abs=0.06)
