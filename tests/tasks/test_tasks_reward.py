"""Custom rewards: shipped rewards in NumPy, terms by hand, weights, and bad input."""

import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.envs import VibgymEnv, VibgymVectorEnv
from vibgym.tasks import TASKS, Align, Sort, Task

SCENES = {
    "Transport": {}, "Align": {}, "Rotate": {}, "Follow": {"parts": ["aluminium_block", "steel_block"]},
    "Sort": {"randomize": {"parts": [2, 6]}}, "Singulate": {"randomize": {"parts": [2, 6]}},
}  # fmt: skip


class Quiet(Align):
    """Align with a cost of energy."""

    TERMS = {**Align.TERMS, "energy": 0.5}

    def reward(self, step):
        energy = np.square(step.phasors).sum(axis=(1, 2, 3)) / step.phasors[0, ..., 0].size
        return {**super().reward(step), "energy": -energy[:, None] * step.present}


class Gentle(Sort):
    """Sort with progress and speed only."""

    TERMS = {"progress": 2.0, "speed": 1.0, "fallen": -3.0}

    def reward(self, step):
        now = step.now
        progress = step.before.position_error - now.position_error
        return {
            "progress": progress, "speed": -np.hypot(*np.moveaxis(now.mean_velocity, -1, 0)[:2]),
            "fallen": 1.0 * now.fallen,
        }  # fmt: skip


@pytest.fixture
def names(monkeypatch):
    """A registry for the duration of a test."""
    monkeypatch.setattr(TASKS, "_items", dict(TASKS._items))
    for cls in (Quiet, Gentle):
        TASKS.register(cls.__name__, cls)
    return TASKS


def actions(env, steps):
    values = np.random.default_rng(0).uniform(-1, 1, (steps, *env.action_space.shape))
    return np.sign(values) * abs(values) ** 0.3


@pytest.mark.parametrize("name, periods", [*((name, 1) for name in SCENES), ("Rotate", 3), ("Sort", 3)])
def test_shipped_rewards_are_the_same_bits_in_numpy(names, name, periods):
    """Compare the kernels with :meth:`Task.reward` called by a custom task."""
    own = type("Same", (names[name],), {"reward": lambda self, step: Task.reward(self, step)})
    names.register("Same", own)
    settings = {**SCENES[name], "num_envs": 8, "action": "field", "max_episode_steps": 20, "periods_per_step": periods}
    kernels, numpy = VibgymVectorEnv(name, **settings), VibgymVectorEnv("Same", **settings)
    assert_same(kernels.reset(seed=3), numpy.reset(seed=3))
    for action in actions(kernels, 50):
        assert_same(numpy.step(action), kernels.step(action))


def test_energy_counts_as_computed_by_hand(names):
    settings = {"action": "phasor", "max_episode_steps": 30, "num_envs": 4}
    plain, quiet = VibgymVectorEnv("Align", **settings), VibgymVectorEnv("Quiet", **settings)
    loud = VibgymVectorEnv("Quiet", task_settings={"weights": {"energy": 2.0, "time": 0.1}}, **settings)
    for env in (plain, quiet, loud):
        env.reset(seed=0)
    for k, action in enumerate(actions(plain, 40)):
        without, with_it, louder = plain.step(action), quiet.step(action), loud.step(action)
        phasors = action.reshape(4, -1, 2)
        phasors = phasors / np.maximum(np.linalg.norm(phasors, axis=-1, keepdims=True), 1.0)
        energy = np.square(phasors).sum(axis=(1, 2)) / phasors.shape[1]
        if k == 29:  # the step after the limit is a reset without reward
            assert without[3].all()
        if k == 30:
            assert not (with_it[1].any() or louder[1].any())
            continue
        assert with_it[4]["reward_terms"]["energy"] == pytest.approx(-0.5 * energy, rel=1e-6)
        assert with_it[1] == pytest.approx(without[1] - 0.5 * energy, abs=1e-6)
        assert louder[1] == pytest.approx(without[1] - 2.0 * energy - 0.08, abs=1e-6)
        assert (with_it[4]["parts"]["reward"][:, 0] == with_it[1]).all()


def test_a_reward_with_custom_terms_only(names):
    env = VibgymVectorEnv("Gentle", num_envs=4, action="field", randomize={"parts": [2, 5]})
    env.reset(seed=1)
    assert not env.core.terms.any() and env.core.terms.shape == (4, 3)
    before = np.hypot(*np.moveaxis(env.truth.error, -1, 0)[:2])
    for action in actions(env, 10):
        _, reward, *_, info = env.step(action)
        truth, reported = env.truth, info["parts"]["reward_terms"]
        away = np.hypot(*np.moveaxis(truth.error, -1, 0)[:2])
        assert reported["progress"] == pytest.approx(np.where(truth.present, 2.0 * (before - away), 0.0), abs=1e-12)
        assert not reported["speed"][~truth.present].any() and (reported["speed"][truth.present] < 0.0).all()
        assert reward == pytest.approx(info["parts"]["reward"].sum(axis=1) / truth.present.sum(axis=1), abs=1e-12)
        before = away
    pose = truth.pose[:, :].copy()
    pose[1, np.flatnonzero(truth.present[1])[0], :2] = 0.4, -0.01
    env.core.simulator.place(np.arange(4), pose, env.core.idle, 0.0, ~truth.present)
    *_, info = env.step(np.zeros(env.action_space.shape))
    assert info["reward_terms"]["fallen"].tolist() == [0.0, -3.0, 0.0, 0.0]  # the worst part's, not the mean
    assert info["parts"]["reward_terms"]["fallen"].sum() == -3.0


def test_a_goal_observation_keeps_its_reward(names):
    quiet, plain = (VibgymEnv(name, action="field", observation="goal") for name in ("Quiet", "Align"))
    assert_same(quiet.reset(seed=0), plain.reset(seed=0))
    assert_same(quiet.step(np.ones(6)), plain.step(np.ones(6)))


@pytest.mark.parametrize("terms, reward, message", [
    ({"a": 1.0}, lambda step: {"b": step.gap}, "no attribute 'gap'"),
    ({"a": 1.0}, lambda step: {"b": step.now.gap}, "terms of the reward of Mine"),
    ({"a": 1.0}, lambda step: {"a": step.now.gap[:, 0]}, "reward of Mine, term 'a'"),
    ({"a": 1.0}, lambda step: {"a": np.array([["one"]])}, "reward of Mine, term 'a'"),
    ({"a": 1.0}, lambda step: step.now.gap, "reward of Mine"),
    ({"a": 1.0}, lambda step: {"a": np.multiply(step.now.pose, 0.0, out=step.now.pose)}, "read-only"),
    ({"a": ("gap", 1.0)}, None, r"Mine.TERMS\['a'\]\[0\]"),
    ({"a": 1.0}, None, r"Mine.TERMS\['a'\]"),
    ({"a": float("inf")}, lambda step: {}, r"Mine.TERMS\['a'\]"),
])  # fmt: skip
def test_bad_rewards_are_refused_at_construction(names, terms, reward, message):
    own = {} if reward is None else {"reward": lambda self, step: reward(step)}
    names.register("Mine", type("Mine", (Align,), {"TERMS": terms, **own}))
    with pytest.raises((ValueError, AttributeError), match=message):
        VibgymEnv("Mine")


@pytest.mark.parametrize("later, message", [
    (lambda step: {"a": np.full((1, 1), np.nan)}, "reward of Mine, term 'a', part 0 of world 0"),
    (lambda step: {"a": np.full((1, 1), 1e308)}, "reward of Mine, term 'a', part 0 of world 0"),
    (lambda step: {"a": np.zeros(1)}, "reward of Mine, term 'a'"),
    (lambda step: {"a": step.now.gap, "b": step.now.gap}, "reward of Mine"),
])  # fmt: skip
def test_bad_rewards_are_refused_by_the_step(names, later, message):
    def reward(self, step):
        return later(step) if step.phasors.any() else {"a": step.now.gap}

    names.register("Mine", type("Mine", (Align,), {"TERMS": {"a": 10.0, "b": 1.0}, "reward": reward}))
    env = VibgymEnv("Mine", action="field")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(np.ones(6))


def test_weights_of_terms(names):
    """Of a term without a default, and of a shipped task."""
    names.register("Mine", type("Mine", (Align,), {"reward": lambda self, step: {"near": -step.now.position_error}}))
    mine, usual, other = (VibgymEnv(name, action="field", task_settings={"weights": weights}) for name, weights in (
        ("Mine", {"near": 10.0}), ("Align", {}), ("Align", {"distance": -3.0}),
    ))  # fmt: skip
    for env in (mine, usual, other):
        env.reset(seed=4)
    for action in actions(usual, 5):
        _, reward, *_, info = mine.step(action)
        assert reward == pytest.approx(-10.0 * info["position_error"]) and list(info["reward_terms"]) == ["near"]
        expected, terms = usual.step(action)[4]["reward_terms"], other.step(action)[4]["reward_terms"]
        assert terms == {**expected, "distance": pytest.approx(-3.0 * expected["distance"], rel=1e-12)}
    with pytest.raises(ValueError, match=r"'time' of task_settings\.weights"):
        VibgymEnv("Mine", task_settings={"weights": {"near": 10.0, "time": 0.1}})
