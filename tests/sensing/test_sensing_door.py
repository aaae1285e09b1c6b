"""Base class of sensors: delay in periods, and use of measurement and truth."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.sensing import SENSORS, Sensor
from vibgym.settings import Length
from vibgym.tasks import PoseTask


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
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action="patch", sensor=sensor, **settings).unwrapped


def driven(env, seed=3, steps=12):
    """Return observations under random patches, which are centred on the measurement."""
    random = np.random.default_rng(1)
    seen = [env.reset(seed=seed)[0]]
    truth = [env.truth.pose]
    for _ in range(steps):
        seen.append(env.step(random.uniform(-1, 1, env.action_space.shape).astype(np.float32))[0])
        truth.append(env.truth.pose)
    return seen, truth


@pytest.mark.parametrize("periods, delay", [(1, 1), (1, 3), (4, 1), (4, 4), (4, 6), (3, 7)])
def test_a_delayed_sensor_returns_the_past_state(periods, delay):
    """Compare with environments of one period per step with the same commands."""
    settings = {"sensor": {"kind": "shifted", "most": 0.0}, "model": "planar"}
    slow = gym.make_vec("vibgym/Align-v0", num_envs=3, action="element", periods_per_step=periods,
                        **{**settings, "sensor": {**settings["sensor"], "delay": delay}}).unwrapped  # fmt: skip
    fine = gym.make_vec("vibgym/Align-v0", num_envs=3, action="element").unwrapped
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
    assert (
        shifted.compute_reward(seen[0]["achieved_goal"], goal, None)[shift[:, 0] > PoseTask.position_tolerance] <= 0
    ).all()
    far, near = batch(1, sensor={"kind": "shifted", "most": 2.5}), batch(1)
    for env in (far, near):
        env.reset(seed=11, options={"pose": [0.3, 0.1, 0.0]})
        env.step(np.ones(env.action_space.shape, dtype=np.float32))
    columns = [np.flatnonzero(np.hypot(*env.phasors(0)[4].T)) for env in (far, near)]
    assert columns[0].min() > columns[1].max()  # the patch is centred on the measured part


def test_names_that_exist_are_refused():
    with pytest.raises(ValueError, match="sensor name"):
        SENSORS.register("ideal", Shifted)
    with pytest.raises(ValueError, match="sensor name"):
        SENSORS.register("two words", Shifted)
    with pytest.raises(ValueError, match="sensor"):
        SENSORS.register("three", 3)
    assert "three" not in SENSORS
