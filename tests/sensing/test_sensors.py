"""Base class of sensors: delay, rate, age, velocities, and use of measurement and truth. Errors: see ``test_effects.py``."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.sensing import SENSORS, Sensor
from vibgym.settings import Length


class Shifted(Sensor):
    """Sensor with a shift of all parts along x, drawn for each episode."""

    class Settings(Sensor.Settings):
        most: Length = 0.010

    draws = 1

    def __init__(self, *scene, **base):
        super().__init__(*scene, **base)
        self.shift = np.zeros((self.worlds, 1))

    def begin(self, worlds, uniform):
        self.shift[worlds] = self.settings.most * uniform

    def measure(self, state, measurement):
        measurement.pose[...] = state.pose
        measurement.pose[..., 0] += self.shift
        measurement.mean_velocity[...] = state.mean_velocity
        measurement.gone[...] = state.fallen

    def custom_state(self):
        return {"shift": self.shift}


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setattr(SENSORS, "_items", {**SENSORS._items, "shifted": Shifted})


def batch(worlds, task="Align", sensor="ideal", **settings):
    settings = {"action": "patch", "sensor": sensor, **settings}
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, **settings).unwrapped


@pytest.mark.parametrize("periods, delay", [(1, 1), (1, 3), (4, 1), (4, 4), (4, 6), (3, 7)])
def test_a_delayed_sensor_returns_the_past_state(periods, delay):
    """Compare with environments of one period per step with the same commands."""
    sensor = {"kind": "shifted", "most": 0.0, "delay": delay}
    slow, fine = batch(3, sensor=sensor, action="element", periods_per_step=periods), batch(3, action="element")
    slow.reset(seed=5), fine.reset(seed=5)
    random, true = np.random.default_rng(2), [fine.truth.pose]
    for step in range(1, 7):
        action = random.uniform(-1, 1, slow.action_space.shape).astype(np.float32)
        slow.step(action)
        for _ in range(periods):
            fine.step(action)
            true.append(fine.truth.pose)
        assert (slow.truth.pose == true[-1]).all()
        expected = true[max(step * periods - delay, 0)]
        if step * periods <= delay:  # not yet due: the reading of the reset
            expected = true[0]
        assert (slow.core.sensing.measurement.pose == expected).all(), step


def test_observation_and_aim_come_from_the_measurement_and_reward_from_the_truth():
    ideal, shifted = batch(4, observation="goal"), batch(4, sensor={"kind": "shifted"}, observation="goal")
    ideal.reset(seed=3), shifted.reset(seed=3)
    shift = shifted.core.sensing.sensor.shift
    assert (shift > 1e-4).all() and (ideal.truth.pose == shifted.truth.pose).all()  # the start does not change
    seen = shifted.step(np.zeros(shifted.action_space.shape, dtype=np.float32))
    true = ideal.step(np.zeros(ideal.action_space.shape, dtype=np.float32))
    moved = seen[0]["achieved_goal"] - true[0]["achieved_goal"]
    assert moved[:, :1] == pytest.approx(shift, abs=1e-6) and (moved[:, 1:] == 0).all()
    for k in (1, 2, 3):
        assert_same(seen[k], true[k])
    assert_same(seen[4]["position_error"], true[4]["position_error"])
    # Learners compute rewards from observations; the reward of the step uses the truth.
    goal = true[0]["achieved_goal"]
    assert (shifted.compute_reward(goal, goal, None) == 0.0).all()
    far, near = batch(1, sensor={"kind": "shifted", "most": 2.5}), batch(1)
    for env in (far, near):
        env.reset(seed=11, options={"pose": [0.3, 0.1, 0.0]})
        env.step(np.ones(env.action_space.shape, dtype=np.float32))
    columns = [np.flatnonzero(np.hypot(*env.phasors(0)[4].T)) for env in (far, near)]
    assert columns[0].min() > columns[1].max()  # the patch is centred on the measured part


def of_poses(worlds, sensor, task="Align", **settings):
    return batch(worlds, task, {"kind": "pose", **sensor}, autoreset_mode="Disabled", **settings)


def at_rest(env, steps):
    """Return ages and poses (steps + 1, worlds, parts, ...) of measurements with elements at rest."""
    env.reset(seed=2)
    ages, poses = [], []
    for k in range(steps + 1):
        if k > 0:
            env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        ages.append(env.core.sensing.measurement.age.copy())
        poses.append(env.core.sensing.measurement.pose.copy())
    return np.array(ages), np.array(poses)


def test_dropouts_keep_the_last_reading_and_count_its_age():
    ages, poses = at_rest(of_poses(40, {"noise": [1e-4, 0.0], "dropout": 0.3}, "Sort"), 50)
    missed = ages[1:] > 0
    assert (ages[0] == 0).all() and missed.any()  # the first sample misses nothing
    assert (ages[1:] == np.where(missed, ages[:-1] + 1, 0)).all()
    assert ((poses[1:] == poses[:-1]).all(axis=-1) == missed).all()


def test_velocity_after_a_gap_is_the_mean_over_it():
    env = of_poses(30, {"noise": 0.0, "dropout": 0.5})
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


@pytest.mark.parametrize("kind", ["ideal", "pose"])
def test_a_slower_rate(kind):
    assert at_rest(of_poses(2, {"kind": kind, "rate": 25.0 / 3.0}), 7)[0][:, 0, 0].tolist() == [0, 1, 2, 0, 1, 2, 0, 1]
    assert at_rest(of_poses(2, {"rate": 6.25}, periods_per_step=2), 4)[0][:, 0, 0].tolist() == [0, 2, 0, 2, 0]


@pytest.mark.parametrize("estimator, periods, delay", [
    ("none", 1, 0), ("none", 2, 3), ("kalman", 1, 3), ("kalman", 3, 3), ("model", 2, 3), ("model", 3, 3),
])  # fmt: skip
def test_age_counts_from_the_start_until_the_first_sample_is_due(estimator, periods, delay):
    """The repeated reading of the start has the age of the episode and a constant sigma."""
    env = of_poses(2, {"delay": delay, "estimator": estimator}, "Sort", periods_per_step=periods)
    _, info = env.reset(seed=0)
    assert (info["measured"]["age"] == 0).all()
    sigma, still = info["measured"]["sigma"], np.zeros(env.action_space.shape, dtype=np.float32)
    for step in range(1, 6):
        measured = env.step(still)[4]["measured"]
        assert (measured["age"] == min(step * periods, delay)).all()
        if step * periods <= delay and estimator != "none":
            assert (measured["sigma"] >= sigma).all()


def test_names_that_exist_are_refused():
    with pytest.raises(ValueError, match="sensor name"):
        SENSORS.register("ideal", Shifted)
    with pytest.raises(ValueError, match="sensor name"):
        SENSORS.register("two words", Shifted)
    with pytest.raises(ValueError, match="sensor"):
        SENSORS.register("three", 3)
    assert "three" not in SENSORS
