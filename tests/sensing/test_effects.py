"""Effects: the same for every sensor, including user-defined ones. Snapshots and batches: see tests/contracts."""

import math

import gymnasium as gym
import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.physics.core.records import new_state
from vibgym.sensing import EFFECTS, SENSORS, Effect, Sensor
from vibgym.settings import Speed

SURFACE, PARTS = Surface(), (Part.disc(0.02, friction=0.5), Part.rectangle(0.05, 0.035, friction=0.5))
PLACES = np.array([[0.3, 0.1, 0.4], [0.5, 0.1, 0.7]])


class Plain(Sensor):
    """User-defined sensor of true poses, with a sigma of half a millimetre."""

    def measure(self, state, reading):
        reading.pose[...] = state.pose
        reading.gone[...] = state.fallen

    @property
    def sigma(self):
        return np.full((len(self.parts), 3), 3e-4)


class Drift(Effect):
    """Effect: drift of positions along x, with a speed drawn for each episode."""

    draws = 1

    class Settings(Effect.Settings):
        speed: Speed = 0.0

    def __init__(self, sensor, settings=None):
        super().__init__(sensor, settings)
        self.velocity = np.zeros((sensor.worlds, 1))

    def begin(self, worlds, uniform):
        self.velocity[worlds] = self.settings.speed * uniform

    def apply(self, reading):
        reading.pose[..., 0] += self.velocity * self.sensor.samples[:, None] * self.sensor.step

    def custom_state(self):
        return {"velocity": self.velocity}


class Jitter(Effect):
    """User-defined noise."""

    class Settings(Effect.Settings):
        size: float = 0.0

    @property
    def sigma(self):
        return np.full(3, self.settings.size)

    def apply(self, reading):
        reading.pose[...] += self.settings.size * self.normals()


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setattr(SENSORS, "_items", {**SENSORS._items, "plain": Plain})
    monkeypatch.setattr(EFFECTS, "_items", {**EFFECTS._items, "drift": Drift, "jitter": Jitter})


KINDS = {
    "ideal": {"kind": "ideal"},
    "pose": {"kind": "pose", "noise": 0.0},
    "camera": {"kind": "camera"},
    "statistical": {"kind": "camera", "statistical": True},
    "own": {"kind": "plain"},
}
MANY = [kind for kind in KINDS if kind != "camera"]
"""Sensors without images, fast enough for statistics of many samples."""


def read(kind, effects, worlds=200, samples=40, **timing):
    """Return readings of parts at rest: poses and ``seen`` of every sample, and those without effects."""
    shown = []
    for more in (effects, {}):
        own = {"effects": more} if KINDS[kind]["kind"] == "camera" else more  # has a setting of this name
        settings = {**KINDS[kind], **timing, **own}
        sensor = SENSORS.make("sensor", settings, SURFACE, PARTS, worlds, 1)
        state, uniform = new_state(worlds, 2), np.random.default_rng(1).random((worlds, sensor.all_draws))
        state.pose[:] = PLACES
        if KINDS[kind]["kind"] == "camera":  # key of the sensor, the same with effects and without
            uniform[:, :2] = np.random.default_rng(2).random((worlds, 2))
        sensor.reset(np.arange(worlds), state, uniform)
        readings = []
        for k in range(samples + 1):
            if k > 0:
                sensor.sample(state)
            readings.append((sensor.due.pose.copy(), sensor.due.seen.copy(), sensor.due.mean_velocity.copy()))
        shown.append([np.array(values) for values in zip(*readings, strict=True)])
    return shown


@pytest.mark.parametrize("kind", MANY)
def test_noise_is_normal_on_every_sensor(kind):
    (pose, seen, velocity), (plain, _, _) = read(kind, {"noise": [2e-4, 0.01]})
    scaled = (pose - plain) / [2e-4, 2e-4, 0.01]
    n = scaled[..., 0].size
    assert seen.all()
    assert np.abs(scaled.mean(axis=(0, 1, 2))).max() < 4 / math.sqrt(n)
    assert np.abs(scaled.std(axis=(0, 1, 2)) - 1.0).max() < 4 / math.sqrt(2 * n)
    for first, second in ((scaled[1:], scaled[:-1]), (scaled[:, 1:], scaled[:, :-1]), (scaled[:, :, 1:], scaled[:, :, :-1]),
                          (scaled[..., :1], scaled[..., 1:2])):  # fmt: skip
        assert abs((first * second).mean()) < 4 / math.sqrt(first.size)  # of samples, worlds, parts and axes
    assert np.abs((scaled**4).mean(axis=(0, 1, 2)) - 3.0).max() < 4 * math.sqrt(96 / n)
    assert velocity[1:] == pytest.approx(np.diff(pose, axis=0) / SURFACE.period, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("kind", MANY)
def test_bias_stays_on_every_sensor(kind):
    bias = {"position_mm": 1.0, "heading_deg": math.degrees(0.02)}
    (pose, _, _), (plain, _, _) = read(kind, {"bias": bias}, worlds=400, samples=3)
    error = pose - plain
    assert error[1:] == pytest.approx(np.broadcast_to(error[:1], error[1:].shape), abs=1e-12)
    assert error[0, :, 0, :2] == pytest.approx(error[0, :, 1, :2], abs=1e-12)  # one shift of all parts
    assert abs(error[0, :, 0, :2].std() / 1e-3 - 1.0) < 4 / math.sqrt(2 * 800)
    assert abs(error[0, ..., 2].std() / 0.02 - 1.0) < 4 / math.sqrt(2 * 800)
    assert (error[0, :, 0, 2] != error[0, :, 1, 2]).all()  # a turn of each


@pytest.mark.parametrize("kind", MANY)
def test_dropout_misses_a_share_on_every_sensor(kind):
    (pose, seen, _), _ = read(kind, {"dropout": 0.3})
    assert seen[0].all()
    assert abs((~seen[1:]).mean() - 0.3) < 4 * math.sqrt(0.21 / seen[1:].size)
    held = ~seen[1:]
    assert (pose[1:][held] == pose[:-1][held]).all()


def test_delay_and_rate_together():
    (_, seen, _), _ = read("own", {}, worlds=3, samples=6, delay=2, rate=12.5)
    # Samples 0, 2, 4 are due two steps later; before, the reading of the start is repeated.
    assert seen[:, 0, 0].tolist() == [True, False, False, False, True, False, True]


@pytest.mark.parametrize("kind", KINDS)
def test_user_defined_effects_on_every_sensor(kind):
    worlds = 2 if kind == "camera" else 50
    (pose, _, _), (plain, _, _) = read(kind, {"drift": 0.01}, worlds=worlds, samples=5)
    way = (pose - plain)[..., 0]
    speed = way[-1, :, 0] / (5 * SURFACE.period)
    assert (speed >= 0.0).all() and speed.max() <= 0.01 and (speed > 0.0).all()
    expected = np.arange(6)[:, None, None] * SURFACE.period * speed[:, None]
    assert way == pytest.approx(np.broadcast_to(expected, way.shape), abs=1e-12)


def test_random_numbers_of_effects_are_normal_and_independent():
    (pose, _, _), (plain, _, _) = read("own", {"jitter": 1e-3, "noise": 1e-3})
    scaled = (pose - plain)[..., :2] / (math.sqrt(2.0) * 1e-3)  # independent of the noise
    assert abs(scaled.std() - 1.0) < 4 / math.sqrt(2 * scaled.size)
    assert abs((scaled[1:] * scaled[:-1]).mean()) < 4 / math.sqrt(scaled.size)


def test_estimators_see_the_sigma_of_sensor_and_effects():
    sensor = SENSORS.make("sensor", {"kind": "plain", "noise": [4e-4, 0.0], "bias": 1.0}, SURFACE, PARTS, 1, 1)
    assert sensor.all_sigma == pytest.approx(np.tile([5e-4, 5e-4, 3e-4], (2, 1)))
    sensor = SENSORS.make("sensor", {"kind": "ideal", "noise": [4e-4, 0.1], "jitter": 3e-4}, SURFACE, PARTS, 1, 1)
    assert sensor.all_sigma[:, 0] == pytest.approx(5e-4)
    env = gym.make("vibgym/Align-v0", sensor={"kind": "plain", "noise": 4e-4}).unwrapped
    env.reset(seed=0)
    assert env.core.sensing.measurement.sigma[0, 0] == pytest.approx([5e-4, 5e-4, 3e-4])
