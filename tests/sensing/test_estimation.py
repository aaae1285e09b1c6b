"""Estimators: exact for an exact model, equal to a textbook filter in the linear case, with consistent sigmas."""

import math

import gymnasium as gym
import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.sensing import ESTIMATORS, SENSORS, Reading

EXACT = {"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0}


def batch(worlds, sensor, task="Align", actuators="prototype", **settings):
    settings = {"action": "patch", "autoreset_mode": "Disabled", **settings}
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, sensor=sensor, actuators=actuators, **settings).unwrapped


@pytest.mark.parametrize("task, periods, latency, delay", [
    ("Align", 1, 0, 0), ("Align", 1, 1, 0), ("Sort", 1, 2, 1), ("Align", 1, 0, 3), ("Align", 3, 3, 0), ("Sort", 3, 0, 2),
    ("Align", 2, 4, 3),
])  # fmt: skip
def test_an_exact_model_predicts_the_state_at_the_next_command(task, periods, latency, delay):
    sensor = {"kind": "pose", "noise": 0.0, "delay": delay, "estimator": "model"}
    env = batch(4, sensor, task, {**EXACT, "latency": latency}, periods_per_step=periods)
    env.reset(seed=3)
    random, known, true = np.random.default_rng(1), [], []
    for _ in range(8):
        measured = env.core.sensing.measurement
        known.append((measured.pose.copy(), measured.mean_velocity.copy()))
        true.append((env.truth.pose, env.truth.mean_velocity))
        env.core.pipeline.run(random.uniform(-1, 1, env.action_space.shape).astype(np.float32))
    ahead = latency // periods
    on = ~env.truth.fallen  # contacts amplify rounding
    for k in range(2, 8 - ahead):
        assert known[k][0][on] == pytest.approx(true[k + ahead][0][on], abs=1e-5), k
        assert known[k][1][on] == pytest.approx(true[k + ahead][1][on], abs=1e-3), k


class Still:
    """Actuators without an effect, for estimators without a model."""

    def prepare(self, command):
        pass


@pytest.mark.parametrize("delay, latency", [(0, 0), (0, 2), (3, 0), (2, 1)])
def test_the_filter_equals_the_textbook_filter(delay, latency):
    """Compare with matrices: x' = F x with white acceleration, readings of x[0], and F of the lead for the measurement."""
    surface, part = Surface(), Part.rectangle(0.05, 0.035, friction=0.58)
    sensor = SENSORS.make("sensor", {"kind": "pose", "noise": [1e-4, 3e-3], "delay": delay}, surface, [part], 1, 1)
    own = ESTIMATORS.make("estimator", {"kind": "kalman", "drift": 0.1}, sensor, Still(), latency, ())
    c, t = 0.5 * part.friction * surface.gravity / surface.table_speed, surface.period
    floor, drift = 1.5, 0.1

    def propagate(time):
        e = math.exp(-c * time)
        way = (1 - e) / c
        fall = (time - way) / c
        return np.array([[1, way, fall], [0, e, way], [0, 0, 1]]), np.array([fall, way, 0.0])

    f, g = propagate(t)
    q = floor**2 * np.outer(g, g) + np.diag([0, 0, drift**2 * t])
    random = np.random.default_rng(0)
    way = 0.3 + np.cumsum(random.normal(0, 2e-3, 60))
    x, p = np.array([way[0], 0.0, 0.0]), np.diag([1e-8, 1e-6, 1.0])
    reading = Reading(np.zeros((1, 1, 3)), np.zeros((1, 1, 3)), np.zeros((1, 1), bool), np.ones((1, 1), bool))
    reading.pose[0, 0, 0] = way[0]
    own.reset(np.arange(1), reading)
    # Until the first step's reading is due, readings are those of the start and not used by the filter.
    for k in range(1, 60):
        missed = k % 7 == 3
        reading.pose[0, 0, 0], reading.seen[0, 0] = way[k], not missed
        own.predict(None)
        own.correct(reading)
        x, p = f @ x, f @ p @ f.T + q
        if not missed:
            gain = p[:, 0] / (p[0, 0] + 1e-8)
            if (way[k] - x[0]) ** 2 > 25.0 * (p[0, 0] + 1e-8):
                continue
            x, p = x + gain * (way[k] - x[0]), p - np.outer(gain, p[0])
        ahead, spread = x, p
        for _ in range(delay + latency):
            ahead, spread = f @ ahead, f @ spread @ f.T + floor**2 * np.outer(g, g)
        known = own.measurement
        assert known.pose[0, 0, 0] == pytest.approx(ahead[0], abs=1e-9)
        assert known.mean_velocity[0, 0, 0] == pytest.approx(ahead[1], abs=1e-7)
        assert known.sigma[0, 0, 0] == pytest.approx(math.sqrt(spread[0, 0]), rel=1e-6)
        assert known.age[0, 0] == (delay + 1 if missed else delay)


def test_variances_stay_positive_for_any_readings():
    """With jumping readings and exact sensor and model, rounding must not cause negative variances."""
    surface, part, random = Surface(), Part.rectangle(0.05, 0.035, friction=0.0), np.random.default_rng(0)
    for noise in ([0.0, 0.0], [1e-9, 1.0]):
        sensor = SENSORS.make("sensor", {"kind": "pose", "noise": noise}, surface, [part], 4, 1)
        settings = {"kind": "kalman", "acceleration": 1e-12, "unknown": 0.0, "drift": 0.0}
        own = ESTIMATORS.make("estimator", settings, sensor, Still(), 0, ())
        reading = Reading(np.zeros((4, 1, 3)), np.zeros((4, 1, 3)), np.zeros((4, 1), bool), np.ones((4, 1), bool))
        own.reset(np.arange(4), reading)
        for k in range(200):
            reading.pose[...] = random.uniform(0, 10.0 if k % 3 else 1e-3, (4, 1, 3))
            reading.seen[...] = random.random((4, 1)) < (0.1 if k % 100 > 50 else 0.8)
            own.predict(None)
            own.correct(reading)
            variances = own._filter.record.covariance[..., [0, 3, 5]]
            assert (variances >= 0.0).all() and np.isfinite(own.measurement.pose).all(), k


LEARNED, SPOKEN = "vibgym/policies/trained/shipped/align.json", {"action": "wrench", "observation": "parts"}
"""Return a policy trained on ideal hardware, with its action and observation."""


def steered(env, steps, skip=5):
    """Return errors of measurements against the truth at their instants, and sigmas, under the learned policy."""
    policy = make_policy(LEARNED, TaskInfo.of(env))
    assert {"action": policy.action, "observation": policy.observation} == SPOKEN
    observation, _ = env.reset(seed=0)
    ahead, known, errors, sigmas, state = env.core.actuators.latency, [], [], [], None
    for k in range(steps):
        measured = env.core.sensing.measurement
        known.append((measured.pose.copy(), measured.sigma.copy()))
        action, state = policy.predict(observation, state)
        env.core.pipeline.run(env.core.action.check(action, env.num_envs))
        observation = env.core.observed(env.core.options.observation)
        if k >= skip and k + 1 - ahead < len(known):
            pose, sigma = known[k + 1 - ahead]
            errors.append(pose - env.truth.pose)
            sigmas.append(sigma)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize("sensor", [{}, {"delay": 2}, {"dropout": 0.3}])
def test_sigmas_agree_with_errors(sensor):
    """On the prototype, the mean of (error / sigma)^2 is near 1."""
    env = batch(48, {"kind": "pose", **sensor, "estimator": "model"}, **SPOKEN)
    errors, sigmas = steered(env, 40)
    squares = ((errors / sigmas) ** 2).mean(axis=(0, 1, 2))
    assert (squares > 0.25).all() and (squares < 1.6).all(), squares
    bare = batch(48, {"kind": "pose", **sensor}, **SPOKEN)
    worse, _ = steered(bare, 40)
    assert np.sqrt((errors[..., :2] ** 2).mean()) < 0.2 * np.sqrt((worse[..., :2] ** 2).mean())


def test_recovery_from_unmodelled_disturbances():
    env = batch(2, {"kind": "pose", "estimator": "model"}, "Sort")
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(10):
        env.core.pipeline.run(still)
    env.core.simulator.state.pose[1, 2] += [0.02, -0.01, 0.4]
    for _ in range(8):
        env.core.pipeline.run(still)
    error = env.core.sensing.measurement.pose - env.truth.pose
    assert np.abs(error[..., :2]).max() < 5e-4 and np.degrees(np.abs(error[..., 2]).max()) < 1.0


def test_a_part_that_falls_in_the_model_only_is_placed_at_its_reading():
    env = batch(2, {"kind": "pose", "estimator": "model"})
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, dtype=np.float32)
    front = env.core.sensing.estimator._predictor.state
    front.pose[0, 0, 1], front.fallen[0, 0] = -0.01, True
    front.diverged[1] = True
    for _ in range(3):
        env.core.pipeline.run(still)
    known = env.core.sensing.measurement
    assert not front.fallen.any() and not front.diverged.any() and not known.gone.any()
    assert np.abs(known.pose - env.truth.pose)[..., :2].max() < 1e-3
    env.core.simulator.state.fallen[0, 0] = True  # a fallen part is reported as gone
    env.core.pipeline.run(still)
    assert known.gone[0, 0] and not known.gone[1, 0]


def test_without_readings_the_prediction_continues_with_larger_sigma():
    env = batch(4, {"kind": "pose", "dropout": 1.0, "estimator": "model", "report": ["age", "sigma"]}, actuators=EXACT)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    ages, sigmas = [], []
    for _ in range(12):
        observation, *_, info = env.step(0.3 * random.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        ages.append(info["measured"]["age"][:, 0])
        sigmas.append(info["measured"]["sigma"][:, 0, 0])
    assert (np.array(ages) == np.arange(1, 13)[:, None]).all() and (np.diff(sigmas, axis=0) > 0).all()
    layout = TaskInfo.of(env).layout
    assert [row.name for row in env.observation_layout][-2:] == ["age", "sigma"] and layout.size == 18 + 3
    assert layout.quantity(observation, "age")[:, 0, 0] == pytest.approx(12.0, abs=1e-3)
    reported = layout.quantity(observation, "sigma")[:, 0]
    assert reported[:, 0] == pytest.approx(math.sqrt(2) * sigmas[-1], rel=1e-3)


def test_a_learned_policy_needs_the_model_on_the_prototype():
    """A policy trained on ideal hardware fails with present measurements and succeeds with predicted ones."""
    success = {}
    for estimator in ("none", "model"):
        env = batch(20, {"kind": "pose", "estimator": estimator}, **SPOKEN)
        policy, state = make_policy(LEARNED, TaskInfo.of(env)), None
        observation, _ = env.reset(seed=100)
        held = np.zeros(20, dtype=bool)
        for _ in range(100):
            action, state = policy.predict(observation, state)
            env.core.pipeline.run(env.core.action.check(action, 20))
            observation = env.core.observed(env.core.options.observation)
            held |= env.core.episode.success
        success[estimator] = held.mean()
    assert success == {"none": 0.0, "model": 1.0}
