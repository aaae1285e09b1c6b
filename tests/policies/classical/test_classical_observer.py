"""Disturbance observer: its pole, the steady state, and success on rigid parts."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import FRESH, HARDWARE, TILTING, episodes, info_of
from vibgym.policies.classical.outputs import GAIN, MOST, OUTPUTS
from vibgym.policies.classical.steering import Steering
from vibgym.policies.registry import make_policy

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
    everywhere, given = np.ones((2, parts), dtype=bool), np.zeros((2, parts, 3))

    class Seen:
        present = everywhere
        rate = velocity

    for k in range(30):
        # What a part does by the model: mean velocity over the last period, and velocity at the start of the next step.
        Seen.rate = velocity - policy.gaining[:, None] * (given + true)
        observer.update(Seen, everywhere, given, memory)
        estimate = memory.acceleration
        assert estimate == pytest.approx(true * (1.0 - (1.0 - GAIN) ** k), rel=1e-9, abs=1e-12)
        believed = Seen.rate + policy.gaining[:, None] * (given + estimate)
        memory = memory._replace(start=believed, valid=everywhere)
        given = generator.normal(0.0, 1.0, (2, parts, 3))
        velocity = velocity + policy.gained[:, None] * (given + true)
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
    assert estimate[0, 1:, 0] == pytest.approx(MOST * policy.info.plant.push[1:])
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
