"""The pose sensor: gaps, rates, velocities, ages. Errors: see test_effects.py."""

import math

import gymnasium as gym
import numpy as np
import pytest


def batch(worlds, sensor, task="Align", **settings):
    settings = {"action": "patch", "autoreset_mode": "Disabled", **settings}
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, sensor=sensor, **settings).unwrapped


def at_rest(env, steps):
    """Return errors (steps + 1, worlds, parts, 3) of measured poses, ages, and poses, with elements at rest."""
    env.reset(seed=2)
    still, errors, ages, poses = np.zeros(env.action_space.shape, dtype=np.float32), [], [], []
    for k in range(steps + 1):
        if k > 0:
            env.core.pipeline.run(still)
        known = env.core.sensing.measurement
        errors.append(known.pose - env.truth.pose)
        ages.append(known.age.copy())
        poses.append(known.pose.copy())
    return np.array(errors), np.array(ages), np.array(poses)


def test_without_noise_velocities_are_the_mean_velocities():
    env = batch(3, {"kind": "pose", "noise": 0.0})
    env.reset(seed=4)
    random = np.random.default_rng(0)
    for _ in range(5):
        env.step(random.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        known = env.core.sensing.measurement
        assert (known.pose == env.truth.pose).all()
        assert known.mean_velocity == pytest.approx(env.truth.mean_velocity, abs=1e-12)


def test_dropouts_keep_the_last_reading_and_count_its_age():
    env = batch(40, {"kind": "pose", "noise": [1e-4, 0.0], "dropout": 0.3}, "Sort")
    _, ages, poses = at_rest(env, 50)
    assert (ages[0] == 0).all()  # the first sample misses nothing
    missed = ages[1:] > 0
    assert abs(missed.mean() - 0.3) < 4 * math.sqrt(0.21 / missed.size)
    assert (ages[1:] == np.where(missed, ages[:-1] + 1, 0)).all()
    assert ((poses[1:] == poses[:-1]).all(axis=-1) == missed).all()
    info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))[-1]
    assert (info["measured"]["age"] == env.core.sensing.measurement.age).all()


def test_velocity_after_a_gap_is_the_mean_over_it():
    env = batch(30, {"kind": "pose", "noise": 0.0, "dropout": 0.5})
    env.reset(seed=4)
    random, path, seen = np.random.default_rng(0), [env.truth.pose], np.zeros(30, dtype=int)
    for k in range(1, 12):
        env.core.pipeline.run(random.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        path.append(env.truth.pose)
        known = env.core.sensing.measurement
        for world in np.flatnonzero(known.age[:, 0] == 0):
            mean = (path[k][world] - path[seen[world]][world]) / ((k - seen[world]) * 0.04)
            assert known.mean_velocity[world] == pytest.approx(mean, abs=1e-12)
            seen[world] = k


def test_a_slower_rate():
    env = batch(2, {"kind": "pose", "rate": 25.0 / 3.0}, autoreset_mode="Disabled")
    _, ages, _ = at_rest(env, 7)
    assert ages[:, 0, 0].tolist() == [0, 1, 2, 0, 1, 2, 0, 1]
    slow = batch(2, {"kind": "pose", "rate": 6.25}, periods_per_step=2)
    assert at_rest(slow, 4)[1][:, 0, 0].tolist() == [0, 2, 0, 2, 0]


@pytest.mark.parametrize("estimator", ["none", "kalman", "model"])
@pytest.mark.parametrize("periods, delay", [(1, 0), (1, 3), (2, 3), (3, 3)])
def test_age_counts_from_the_start_until_the_first_sample_is_due(periods, delay, estimator):
    """The repeated reading of the start has the age of the episode and a constant sigma."""
    sensor = {"kind": "pose", "delay": delay, "estimator": estimator}
    env = batch(2, sensor, "Sort", periods_per_step=periods)
    _, info = env.reset(seed=0)
    assert (info["measured"]["age"] == 0).all()
    sigma, still = info["measured"]["sigma"], np.zeros(env.action_space.shape, dtype=np.float32)
    for step in range(1, 6):
        measured = env.step(still)[4]["measured"]
        assert (measured["age"] == min(step * periods, delay)).all()
        if step * periods <= delay and estimator != "none":
            assert (measured["sigma"] >= sigma).all()


@pytest.mark.parametrize("settings, message", [
    ({"sensor": {"kind": "pose", "rate": 20.0}}, r"sensor\.rate"),
    ({"sensor": {"kind": "pose", "delay": 250}}, r"sensor\.delay"),
    ({"sensor": {"kind": "pose", "report": ["age", "age"]}}, r"sensor\.report"),
    ({"actuators": "prototype", "randomize": {"latency": [0, 400]}}, r"randomize\['latency'\]"),
    ({"actuators": {"kind": "prototype", "latency": 300}}, r"actuators\.latency"),
])  # fmt: skip
def test_settings_that_do_not_fit_the_episode_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        gym.make("vibgym/Align-v0", **settings)
