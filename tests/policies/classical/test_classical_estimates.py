"""Estimates of controllers: gains of elements from constructed pulses with known effect, and disturbances."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import FRESH, HARDWARE, TILTING, episodes, info_of, measurement
from vibgym.allocation.projections import SPREAD
from vibgym.policies.classical.gains import FAULT, GAIN_SPREAD, GainLearner, turn_pushes
from vibgym.policies.classical.outputs import GAIN, MAX, OUTPUTS
from vibgym.policies.classical.steering import Steering
from vibgym.policies.registry import make_policy

POSE = np.array([0.30, 0.10, 0.4])


def played(true, pulses=40, noise=0.0, seed=0):
    """Return gains identified for elements with gains ``true`` (elements,), from as many pulses at one position.

    The estimator corrects its nominal prediction after the latency, by a fifth of the remaining error in each step.
    """
    info = info_of("Align", actuators="prototype")
    learner, random = GainLearner(info), np.random.default_rng(seed)
    gains, shape = learner.begin(1), (1, info.surface.rows, info.surface.columns)
    left, late, off = np.zeros(3), [np.zeros(3)] * 2, np.zeros(3)
    gyration = learner.constants.gyration[0]
    for step in range(12 * pulses):
        pose = POSE + off / [1.0, 1.0, gyration] + noise * random.normal(size=3)
        learner.learn(measurement(info, centre=pose[:2], heading=pose[2]), gains)
        push = np.zeros((*shape, 2))
        if step % 12 == 0:
            under = gains.element[0, 0][gains.arm[0, 0, :, 0] > 0.0]
            push.reshape(-1, 2)[under] = 0.3 * random.normal(size=(len(under), 2))
        learner.predict(push, gains, np.zeros((1, 1, 3)))
        # By definition the position of rest is off by B sum J (h - 1) u, corrected late; the nominal shift is subtracted.
        x, y = push.reshape(-1, 2).T
        missed = np.zeros(3)
        for k, e in enumerate(gains.element[0, 0]):
            share, lx, ly = gains.arm[0, 0, k]
            if share > 0.0:
                lost = (true[e] - 1.0) * (x[e] + 1j * y[e])
                px, py = lost.real, lost.imag
                missed += learner.constants.shift[0] * np.array([share * px, share * py, lx * py - ly * px])
        late.append(missed)
        left = left + late.pop(0)
        off, left = 0.2 * left, 0.8 * left
        gains.rest[...] = POSE  # minus the nominal shift and the earlier correction: the part has not moved
    mean, spread = gains.mean[0, 0], np.sqrt(np.diagonal(gains.covariance[0, 0]))
    room = len(gains.element[0, 0])
    known = {
        int(e): (1.0 + mean[2 * k] + 1j * mean[2 * k + 1], spread[2 * k])
        for k, e in enumerate(gains.element[0, 0][:room])
        if gains.arm[0, 0, k, 0] > 0.05
    }
    return learner, gains, known


def whole():
    return np.ones(256, dtype=complex)


def test_gains_of_exact_elements_stay_one():
    _, _, known = played(whole(), noise=2e-5)
    assert len(known) >= 4
    for gain, spread in known.values():
        assert abs(gain - 1.0) < 0.1 and spread < 1.2 * GAIN_SPREAD


def test_a_dead_element_is_found():
    """Within some pulses, without an effect on the gains of neighbours."""
    _, _, known = played(whole(), pulses=1)
    dead = min(known)
    true = whole()
    true[dead] = 0.0
    learner, gains, known = played(true)
    assert abs(known[dead][0]) < 0.25
    assert all(abs(gain - 1.0) < 0.25 for e, (gain, _) in known.items() if e != dead)
    gain, _, spread = learner.known(gains)
    assert gain[0, dead] == 0.0 and spread[0, dead] <= FAULT
    elsewhere = np.setdiff1d(np.arange(256), list(gains.element[0, 0]))
    assert (gain[0, elsewhere] == 1.0).all() and (spread[0, elsewhere] == SPREAD).all()


def test_gains_and_phases_are_learnt():
    """Each alone: the error decreases by far."""
    random = np.random.default_rng(3)
    true = (1.0 + 0.08 * random.normal(size=256)) * np.exp(0.1j * random.normal(size=256))
    _, _, known = played(true, pulses=80)
    before = [abs(true[e] - 1.0) for e in known]
    after = [abs(true[e] - gain) for e, (gain, _) in known.items()]
    assert np.sqrt(np.mean(np.square(after))) < 0.5 * np.sqrt(np.mean(np.square(before)))


def test_fast_parts_are_not_used():
    info = info_of("Align", actuators="prototype")
    learner = GainLearner(info)
    gains = learner.begin(1)
    for step in range(20):
        moving = measurement(info, centre=POSE[:2] + [0.01 * step, 0.0], heading=POSE[2], velocity=[0.25, 0.0])
        unseen, doubt = learner.learn(moving, gains)
        assert (unseen == 0.0).all() and (doubt == 0.0).all()
        learner.predict(np.full((1, 8, 32, 2), 0.5), gains, np.zeros((1, 1, 3)))
    assert (gains.mean == 0.0).all() and (learner.known(gains)[0] == 1.0).all()


def test_pushes_are_turned():
    push = np.random.default_rng(0).normal(size=(2, 8, 32, 2))
    angle = np.random.default_rng(1).normal(size=(2, 256))
    got = push.copy()
    turn_pushes(angle, got.reshape(2, 256, 2))
    expected = (push[..., 0] + 1j * push[..., 1]) * np.exp(1j * angle.reshape(2, 8, 32))
    assert got[..., 0] + 1j * got[..., 1] == pytest.approx(expected)


INCLINE = 0.02  # rad
OBSERVED = {"observer": "disturbance"}
OBSERVING = Steering.Settings(**OBSERVED)
WORLDS = 3


def run(policy, steps, **settings):
    """Run Align; return the last memory, the last position errors (worlds,) m, and the environment."""
    env = batch("Align", WORLDS, action=policy["action"], **settings)
    made, state = make_policy(policy, env), None
    observation, _ = env.reset(seed=FRESH)
    for _ in range(steps):
        action, state = made.predict(observation, state)
        observation, _, _, _, info = env.step(action)
    return state, info["position_error"], env


@pytest.mark.parametrize("periods", [1, 4])
def test_constant_disturbances_are_estimated_with_the_pole_of_the_observer(periods):
    policy = Steering(info_of("Sort", periods_per_step=periods), OBSERVING)
    observer, parts = policy.observer, len(policy.info.parts)
    true = np.array([0.3, -0.2, 8.0]) * np.ones((2, parts, 1))
    generator = np.random.default_rng(1)
    memory, velocity = observer.begin(2), generator.normal(0.0, 0.1, (2, parts, 3))
    everywhere, effect = np.ones((2, parts), dtype=bool), np.zeros((2, parts, 3))

    class Seen:
        present = everywhere
        rate = velocity

    for k in range(30):
        # What a part does by the model: mean velocity over the last period, and velocity at the start of the next step.
        Seen.rate = velocity - policy.gaining[:, None] * (effect + true)
        observer.update(Seen, everywhere, effect, memory)
        estimate = memory.acceleration
        assert estimate == pytest.approx(true * (1.0 - (1.0 - GAIN) ** k), rel=1e-9, abs=1e-12)
        believed = Seen.rate + policy.gaining[:, None] * (effect + estimate)
        memory = memory._replace(start=believed, valid=everywhere)
        effect = generator.normal(0.0, 1.0, (2, parts, 3))
        velocity = velocity + policy.gained[:, None] * (effect + true)
    assert np.abs(estimate / true - 1.0).max() < 0.005


@pytest.mark.parametrize("action", OUTPUTS)
def test_steady_state_errors_vanish_and_estimates_are_the_inclines(action):
    settings = {"randomize": {"incline": [INCLINE, INCLINE]}, "task_settings": {"hold": 200}}
    lqr = {"kind": "lqr", "action": action}
    _, without, _ = run({**lqr, "observer": "none"}, 120, **settings)
    state, within, env = run(lqr | OBSERVED, 120, **settings)
    down = env.unwrapped.core.simulator.state.incline  # (worlds, 2) m/s^2
    assert np.hypot(*down.T) == pytest.approx(env.unwrapped.surface.gravity * np.sin(INCLINE))
    # The mean over a period of what remains of it at rest: friction brakes the motion that it causes in half a period.
    policy = Steering(info_of())
    expected = down / (1.0 + 0.5 * policy.info.plant.drag * policy.info.surface.period)
    estimate = state.observer.acceleration[:, 0]
    assert estimate[:, :2] == pytest.approx(expected, abs=0.01 * np.hypot(*down.T).max())
    assert without.min() > 1e-3 and within.max() < 0.05e-3


def test_estimates_are_limited_and_wait_for_parts_that_are_measured():
    policy = Steering(info_of("Sort"), OBSERVING)
    observer, shape = policy.observer, (1, len(policy.info.parts))
    yes = np.ones(shape, dtype=bool)
    memory = observer.begin(1)._replace(valid=yes)

    class Seen:
        present = np.arange(shape[1])[None] > 0
        rate = np.full((*shape, 3), 1e3)

    for _ in range(3):
        observer.update(Seen, yes, np.zeros((*shape, 3)), memory)
        estimate = memory.acceleration
    assert (estimate[:, 0] == 0.0).all()
    assert estimate[0, 1:, 0] == pytest.approx(MAX * policy.info.plant.push[1:])
    before = estimate.copy()
    observer.update(Seen, ~yes, np.zeros((*shape, 3)), memory)
    assert (memory.acceleration == before).all()


@pytest.mark.parametrize("kind, least", [("lqr", 30), ("local_field", 30), ("pose", 29)])
def test_rigid_parts_on_patches_reach_their_goals(kind, least):
    assert episodes(kind, "Align", 30, **TILTING).success >= least


def test_without_an_observer_fewer_rigid_parts_reach_their_goals():
    assert episodes({"kind": "lqr", "observer": "none"}, "Align", 30, **TILTING).success <= 26


@pytest.mark.parametrize("task, settings, observes", [
    ("Align", {"model": "tilting"}, True), ("Align", {}, False),
    ("Align", {"model": "tilting", **HARDWARE}, False), ("Sort", {"model": "tilting"}, False),
])  # fmt: skip
def test_the_default_observes_single_rigid_parts_without_a_hard_dead_zone(task, settings, observes):
    assert (make_policy("lqr", info_of(task, **settings)).observer is not None) is observes


def test_several_parts_under_the_planner_observe_and_succeed():
    assert episodes({"kind": "planner"} | OBSERVED, "Sort", 12).success == 12
