"""Along paths on the table: how far off, by all laws, one part and several, and the same bits alone."""

import numpy as np
import pytest

from studies.benchmarks.following import HARDWARE, PATHS
from studies.benchmarks.following import follow as followed
from tests.envs.helpers import batch, single
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

CORNER = [{"shape": "polyline", "points_mm": [[300, 60], [380, 60], [380, 140]]}]
TURNING = [{**CORNER[0], "heading": "along"}]
SIDE_BY_SIDE = [  # the first two 37.0 mm apart, the same way
    {"shape": "polyline", "points_mm": [[300, 40], [400, 40]]},
    {"shape": "polyline", "points_mm": [[300, 138], [400, 138]]},
    {"shape": "polyline", "points_mm": [[500, 40], [500, 140]]},
]


def follow(*arguments, **environment):
    """Errors (steps, worlds, parts, 3); parts that are not alone stay apart."""
    errors, gap = followed(*arguments, **environment)
    assert np.nanmin(gap) > 0.0368
    return errors


def rms(errors):
    """m, of the part that was worst, (worlds,)."""
    away = np.hypot(errors[..., 0], errors[..., 1])
    return np.sqrt(np.nanmean(away**2, axis=0)).max(axis=-1)


@pytest.mark.parametrize("law, most", [("pose", 0.2e-3), ("local", 0.3e-3), ("lqr", 0.4e-3), ("pid", 1.5e-3)])
def test_half_the_top_speed_round_a_corner(law, most):
    errors = follow({"kind": "local_field", "law": law}, CORNER, 3)
    assert 1e-6 < rms(errors).max() < most


@pytest.mark.parametrize("name", ["circle", "square", "three parts", "three parts side by side"])
def test_half_a_millimetre_at_half_the_top_speed(name):
    errors = follow("pose", PATHS[name], 2)
    assert rms(errors).max() < 0.3e-3
    assert np.nanmax(np.abs(errors[..., 2])) < np.radians(0.5)


def test_parts_side_by_side_and_one_that_turns_with_its_path():
    assert rms(follow("pose", SIDE_BY_SIDE, 3)).max() < 0.2e-3
    errors = follow("pose", TURNING, 3)
    assert rms(errors).max() < 0.2e-3 and np.nanmax(np.abs(errors[..., 2])) < np.radians(0.5)


def test_on_the_prototype():
    """With a dead zone, elements that are not alike, latency and noise."""
    errors = follow("pose", CORNER, 10, **HARDWARE["prototype"])
    assert np.median(rms(errors)) < 0.5e-3 and np.nanmax(np.hypot(errors[..., 0], errors[..., 1])) < 2e-3


def test_latency_costs_nothing_where_it_is_predicted():
    """The goal counts that there will be when the command begins to act: a period at 0.15 m/s is 6 mm."""
    exact = {"kind": "pose", "noise": {"position": 0.0, "heading": 0.0}, "estimator": "model"}
    alike = {"kind": "prototype", "dead_zone": 0.0, "gain_spread": 0.0, "phase_spread": 0.0}
    for latency in (1, 3):
        errors = follow("pose", CORNER, 2, actuators={**alike, "latency": latency}, sensor=exact)
        assert rms(errors).max() < 0.6e-3


def test_long_steps_keep_to_the_path():
    errors = follow("pose", CORNER, 2, periods_per_step=3)
    assert rms(errors).max() < 1.5e-3


def test_paths_that_are_drawn_are_followed():
    env = batch("Follow", 20, action="phasor", autoreset_mode="Disabled")
    policy = make_policy("pose", TaskInfo.of(env))
    seen, _ = env.reset(seed=5)
    state, alive, error = None, np.ones(20, dtype=bool), np.zeros(20)
    while alive.any():
        action, state = policy.predict(seen, state)
        seen, _, terminated, truncated, info = env.step(action)
        ended = alive & (terminated | truncated)
        assert info["is_success"][ended].all()
        error[ended] = info["path_error"][ended]
        alive &= ~ended
        if (terminated | truncated).any() and alive.any():
            seen, _ = env.reset(options={"reset_mask": terminated | truncated})
    assert 0.0 < error.max() < 0.3e-3


@pytest.mark.parametrize("task, name", [("Follow", "pose"), ("Align", "local_field"), ("Sort", "planner")])
def test_one_world_by_itself_has_the_same_bits(task, name):
    """To the bit: near a dead zone a rounding error may be another choice of elements."""
    machine = HARDWARE["prototype"]
    many, one = batch(task, 3, action="phasor", **machine), single(task, action="phasor", **machine)
    policy = make_policy(name, TaskInfo.of(one))
    seen, _ = many.reset(seed=[4, 5, 6])
    alone, _ = one.reset(seed=5)
    state = state_alone = None
    for _ in range(25):
        action, state = policy.predict(seen, state)
        by_itself, state_alone = policy.predict(alone, state_alone)
        assert action[1].tobytes() == by_itself.tobytes()
        seen, alone = many.step(action)[0], one.step(by_itself)[0]
