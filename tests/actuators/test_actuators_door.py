"""Base class of actuators: latency in periods, and resets of single worlds."""

import gymnasium as gym
import numpy as np
import pytest

from vibgym.actuators import ACTUATORS, Actuators


class Weak(Actuators):
    """Actuators that execute a share of the command, drawn for each episode."""

    class Settings(Actuators.Settings):
        least: float = 0.5

    draws = 1

    def __init__(self, *scene, **base):
        super().__init__(*scene, **base)
        self.share = np.ones((self.worlds, 1))

    def begin(self, worlds, uniform):
        self.share[worlds] = self.settings.least + (1.0 - self.settings.least) * uniform

    def realise(self, phasors):
        phasors *= self.share[:, :, None, None]

    def custom_state(self):
        return {"share": self.share}


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setattr(ACTUATORS, "_items", {**ACTUATORS._items, "weak": Weak})


def batch(worlds, actuators="ideal", **settings):
    settings = {"action": "phasor", **settings}
    return gym.make_vec("vibgym/Align-v0", num_envs=worlds, actuators=actuators, **settings).unwrapped


def random_actions(env, steps, seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


def test_exact_actuators_without_latency_equal_ideal_ones():
    """Equal up to rounding, since the motion is stored as amplitude and phase."""
    ideal, faithful = batch(3), batch(3, {"kind": "weak", "least": 1.0})
    ideal.reset(seed=5), faithful.reset(seed=5)
    for action in random_actions(ideal, 8):
        ideal.step(action), faithful.step(action)
        assert faithful.phasors(1) == pytest.approx(ideal.phasors(1), abs=1e-12)
    assert faithful.truth.pose == pytest.approx(ideal.truth.pose, abs=1e-8)


@pytest.mark.parametrize("periods, latency", [(1, 1), (1, 3), (4, 1), (4, 4), (4, 6), (3, 7)])
def test_commands_take_effect_after_the_latency(periods, latency):
    """Compare with environments of one period per step that get the delayed commands, at rest at first."""
    slow = batch(2, {"kind": "weak", "least": 1.0, "latency": latency}, periods_per_step=periods)
    fine = batch(2, {"kind": "weak", "least": 1.0})
    slow.reset(seed=5), fine.reset(seed=5)
    actions = random_actions(slow, 6)
    for step, action in enumerate(actions):
        slow.step(action)
        for period in range(periods):
            acting = (step * periods + period - latency) // periods
            fine.step(actions[acting] if acting >= 0 else np.zeros_like(action))
        assert (slow.truth.pose == fine.truth.pose).all(), step


def test_a_reset_brings_the_elements_of_its_world_to_rest():
    env = batch(2, {"kind": "weak", "latency": 2}, autoreset_mode="Disabled")
    env.reset(seed=5)
    action = np.ones(env.action_space.shape, dtype=np.float32)
    for _ in range(3):
        env.step(action)
    assert all(np.abs(env.phasors(world)).max() > 0.1 for world in (0, 1))
    env.reset(options={"reset_mask": np.array([True, False])})
    env.step(action)
    assert np.abs(env.phasors(0)).max() == 0.0 and np.abs(env.phasors(1)).max() > 0.1


def test_estimators_use_the_mean_of_drawn_actuators(monkeypatch):
    """The nominal value is the mean of the drawn range."""
    monkeypatch.setattr(Weak, "nominal", lambda self: Weak(self.surface, self.worlds, self.periods), raising=False)
    env = batch(2, "weak", sensor={"kind": "ideal", "estimator": "model"})
    env.reset(seed=1)
    assert (env.core.sensing.estimator._predictor._plant.share == 0.75).all()
    env.step(random_actions(env, 1)[0])
