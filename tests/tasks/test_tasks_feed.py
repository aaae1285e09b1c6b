"""Parts that arrive and leave: good parts, counts, and cleared memory of slots."""

import math

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from vibgym import Surface
from vibgym.policies.registry import make_policy
from vibgym.scene.hulls import gaps_between
from vibgym.scene.parts import shipped_part
from vibgym.tasks import Feed
from vibgym.tasks.episode import EVENTS

STEEL, ALUMINIUM = 0, 1
RIGHT = 0.785
NAMES = ["steel_block", "aluminium_block"] * 2


def play(env, steps, seed=3, law="pose"):
    """Move all parts straight to their gates; yield the result of each step."""
    policy = make_policy({"kind": "local_field", "law": law, "action": "wrench"}, env)
    seen, _ = env.reset(seed=seed)
    state, start = None, np.ones(env.num_envs, dtype=bool)
    for _ in range(steps):
        action, state = policy.predict(seen, state, start)
        start = np.zeros_like(start)
        result = env.step(action)
        seen = result[0]
        yield result


@pytest.fixture
def one():
    """Return an environment of one world for parts placed by the test."""
    env = single("Feed", parts=NAMES, action="wrench", task_settings={"warm_up": 0.0}).unwrapped
    env.reset(seed=0)
    return env


def put(env, poses):
    """Place exactly these slots on the table, at these poses, at rest."""
    core = env.core
    state, episode = core.simulator.state, core.episode
    episode.present[0], state.fallen[0], state.velocity[0] = False, True, 0.0
    state.pose[0, :, :2] = -1.0
    for slot, pose in poses.items():
        episode.present[0, slot], state.fallen[0, slot], state.pose[0, slot] = True, False, pose
        state.velocity[0, slot] = core.idle[0, slot]
    core.scoring._flow.pool[0] = episode.present[0]  # no further arrivals


LOW, HIGH = 0.052, 0.156  # m, the middles of the two gates


@pytest.mark.parametrize("poses, expected", [
    ({0: (RIGHT, LOW, 0.0)}, {0: "good"}),
    ({0: (RIGHT, LOW, math.pi)}, {0: "good"}),
    ({0: (RIGHT, LOW, math.radians(4.9))}, {0: "good"}),
    ({0: (RIGHT, LOW, math.radians(5.5))}, {0: "tilted"}),
    ({0: (RIGHT, HIGH, 0.0)}, {0: "wrong"}),
    ({1: (RIGHT, HIGH, 0.0)}, {1: "good"}),
    ({0: (RIGHT, LOW, 0.0), 2: (RIGHT - 0.080, LOW, 0.0)}, {0: "close", 2: "stays"}),
    ({0: (RIGHT, LOW, 0.0), 2: (RIGHT - 0.089, LOW, 0.0)}, {0: "good", 2: "stays"}),
    ({0: (RIGHT, LOW, 0.0), 1: (RIGHT, HIGH, 0.0)}, {0: "good", 1: "good"}),
    ({0: (0.780, LOW, 0.0)}, {0: "stays"}),
    ({0: (RIGHT, -0.01, 0.0)}, {0: "lost"}),
])  # fmt: skip
def test_outcomes_of_a_part(one, poses, expected):
    put(one, poses)
    _, _, terminated, truncated, info = one.step(np.zeros(12, dtype=np.float32))
    event = {slot: EVENTS[info["parts"]["event"][slot]] for slot in expected}
    assert event == expected and not terminated and not truncated
    for name in EVENTS[1:]:
        assert info[name] == list(expected.values()).count(name)
        assert info[f"{name}_per_minute"] == pytest.approx(info[name] * 60.0 / 0.04)
    for slot, name in expected.items():
        assert info["parts"]["present"][slot] == (name == "stays")
        terms = {term: values[slot] for term, values in info["parts"]["reward_terms"].items()}
        assert terms["good"] == (5.0 if name == "good" else 0.0)
        assert terms["faulty"] == (-5.0 if name in ("tilted", "close", "wrong") else 0.0)
        assert terms["fallen"] == (-5.0 if name == "lost" else 0.0)


def test_a_part_that_follows_too_soon_is_close(one):
    for wait, expected in ((5, "close"), (6, "good")):  # periods between the two steps
        one.reset(seed=0)
        put(one, {0: (RIGHT, LOW, 0.0)})
        one.step(np.zeros(12, dtype=np.float32))
        for _ in range(wait):
            one.step(np.zeros(12, dtype=np.float32))
        put(one, {2: (RIGHT, LOW, 0.0)})
        info = one.step(np.zeros(12, dtype=np.float32))[4]
        assert EVENTS[info["parts"]["event"][2]] == expected
    assert one.task.headway == 7  # (50 mm + 36.8 mm) at 305 mm/s take 0.285 s


@pytest.mark.parametrize("heap", [1, 6])
def test_arrivals_have_room_and_come_through_the_inlet(heap):
    settings = {"heap": heap, "warm_up": 0.0}
    env = batch("Feed", 3, action="wrench", parts=["steel_block", "aluminium_block"] * 6, task_settings=settings)
    came = np.zeros(3, dtype=int)
    before = None
    for _, _, _, _, info in play(env, 400):
        arrived, left = info["parts"]["arrived"], info["parts"]["event"] > 0
        truth = env.unwrapped.truth
        assert not (arrived & left).any() and not truth.present[left].any() and truth.present[arrived].all()
        if before is not None:
            assert not before[arrived].any()  # a slot is empty for a step at least
        before = truth.present.copy()
        for world in np.flatnonzero(arrived.any(axis=1)):
            new, there = arrived[world], truth.present[world]
            gaps = gaps_between(env.unwrapped.parts, truth.pose[world : world + 1])[0]
            np.fill_diagonal(gaps, np.inf)
            x = truth.pose[world, new, 0]
            if heap == 1:
                assert (x >= 0.020).all() and (x <= 0.055).all() and gaps[new][:, there].min() >= 0.002 - 1e-12
            else:
                assert new.sum() == 6 and x.max() < 0.2
                assert (gaps[new][:, new].min(axis=1) < 1e-6).all()  # in touch
                assert gaps[new][:, there & ~new].min(initial=1.0) > 0.0
        came += arrived.sum(axis=1)
        assert np.isfinite(info["reward_terms"]["progress"]).all()
    assert (came > 20).all()
    tally = {name: info[name] for name in EVENTS[1:]}
    on_table = env.unwrapped.truth.present.sum(axis=1)
    # All arrived parts, including those of the reset, are on the table or have been counted.
    assert (sum(tally.values()) + on_table - came <= 12).all() and (sum(tally.values()) > 10).all()
    env.close()


@pytest.mark.parametrize("sensor", [
    "ideal", "pose", {"kind": "pose", "delay": 3}, {"kind": "pose", "delay": 2, "estimator": "kalman"},
    {"kind": "pose", "estimator": "model"}, {"kind": "pose", "dropout": 0.5}, {"kind": "ideal", "rate": 5.0},
])  # fmt: skip
def test_new_parts_are_measured_at_their_poses_at_rest(sensor):
    """Sensors, estimators and actions keep nothing of the previous part in the slot."""
    env = batch("Feed", 2, action="wrench", sensor=sensor, parts=["steel_block", "aluminium_block"]).unwrapped
    arrivals = 0
    for _, _, _, _, info in play(env, 250):
        arrived, event = info["parts"]["arrived"], info["parts"]["event"]
        known, truth = env.core.sensing.measurement, env.truth
        assert np.abs(known.pose - truth.pose)[arrived][:, :2].max(initial=0.0) < 1e-3
        assert not known.gone[arrived].any() and known.gone[event > 0].all()
        assert np.abs(known.mean_velocity[arrived]).max(initial=0.0) == 0.0
        assert (known.age[arrived] == 0).all()
        assert (env.core.action.live()["given"][arrived | (event > 0)] == 0.0).all()
        state, present = env.observed("state").reshape(2, 2, -1), truth.present
        assert (state[..., -1] == arrived).all() and not state[~present].any()
        assert (env.observed("parts")["mask"] == present).all()
        arrivals += arrived.sum()
    assert arrivals > 4


def test_a_reset_sets_the_parts_that_may_arrive():
    env = single("Feed", parts=NAMES, action="wrench")
    env.reset(seed=1, options={"parts": [1, 2]})
    seen = np.zeros(4, dtype=bool)
    for _ in range(100):
        seen |= env.step(np.zeros(12, dtype=np.float32))[4]["parts"]["present"]
    assert seen.tolist() == [False, True, True, False]


def test_gates_are_strips_of_equal_width():
    parts = [shipped_part(name) for name in NAMES]
    task = Feed(Surface(), parts)
    assert task.zones == pytest.approx(np.array([[0.782, 0.0, 0.832, 0.104], [0.782, 0.104, 0.832, 0.208]]))
