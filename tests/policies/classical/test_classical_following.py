"""Following paths with all controllers, with phasors and with wrenches."""

import numpy as np
import pytest

from studies.benchmarks.following import PATHS
from studies.benchmarks.following import follow as followed
from tests.envs.helpers import batch
from tests.policies.helpers import HARDWARE, info_of
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo

CORNER = [{"shape": "polyline", "points_mm": [[300, 60], [380, 60], [380, 140]]}]
TURNING = [{**CORNER[0], "heading": "along"}]
SIDE_BY_SIDE = [  # the first two 37.0 mm apart, in the same direction
    {"shape": "polyline", "points_mm": [[300, 40], [400, 40]]},
    {"shape": "polyline", "points_mm": [[300, 138], [400, 138]]},
    {"shape": "polyline", "points_mm": [[500, 40], [500, 140]]},
]

EXACT = {"kind": "pose", "noise": {"position": 0.0, "heading": 0.0}, "estimator": "model"}
ALIKE = {"kind": "prototype", "dead_zone": 0.0, "gain_spread": 0.0, "phase_spread": 0.0}


def follow(*arguments, **environment):
    """Return errors (steps, worlds, parts, 3); several parts must stay apart."""
    errors, gap = followed(*arguments, **environment)
    assert np.nanmin(gap) > 0.0368
    return errors


def rms(errors):
    """Return the error of the worst part, (worlds,) m."""
    away = np.hypot(errors[..., 0], errors[..., 1])
    return np.sqrt(np.nanmean(away**2, axis=0)).max(axis=-1)


@pytest.mark.parametrize("policy, path, worlds, environment, most", [
    ("pose", PATHS["circle"], 2, {}, 0.3e-3), ("pose", PATHS["square"], 2, {}, 0.3e-3),
    ("pose", PATHS["three parts"], 2, {}, 0.3e-3), ("pose", PATHS["three parts side by side"], 2, {}, 0.3e-3),
    ("pose", TURNING, 3, {}, 0.2e-3),
    ("pose", CORNER, 3, {}, 0.2e-3), ("pose", SIDE_BY_SIDE, 3, {}, 0.2e-3),
    ({"kind": "local_field", "law": "local"}, CORNER, 3, {}, 0.3e-3),
    ({"kind": "local_field", "law": "lqr"}, CORNER, 3, {}, 0.4e-3),
    ({"kind": "local_field", "law": "pid"}, CORNER, 3, {}, 1.5e-3),
    ("pose", CORNER, 2, {"periods_per_step": 3}, 1.5e-3),
    ("pose", CORNER, 2, {"actuators": {**ALIKE, "latency": 1}, "sensor": EXACT}, 0.6e-3),
    ("pose", CORNER, 2, {"actuators": {**ALIKE, "latency": 3}, "sensor": EXACT}, 0.6e-3),
])  # fmt: skip
def test_errors_at_half_the_top_speed(policy, path, worlds, environment, most):
    """The goal at the instant at which the command begins to act counts: a period of latency at 0.15 m/s is 6 mm."""
    errors = follow(policy, path, worlds, **environment)
    assert 1e-6 < rms(errors).max() < most
    assert policy != "pose" or environment or np.nanmax(np.abs(errors[..., 2])) < np.radians(0.5)


def test_on_the_prototype():
    """With a dead zone, spread between elements, latency and noise."""
    errors = follow("pose", CORNER, 10, **HARDWARE)
    assert np.median(rms(errors)) < 0.5e-3 and np.nanmax(np.hypot(errors[..., 0], errors[..., 1])) < 2e-3


def test_drawn_paths_are_followed():
    result = rollout("pose", "Follow", seeds=range(5, 25))
    assert result.success.all() and 0.0 < result.path_error.max() < 0.3e-3


def played(policy, steps, **settings):
    """Poses (steps, worlds, parts, 3) under a policy on Align."""
    env = batch("Align", 20, action=policy.action, **settings)
    seen, _ = env.reset(seed=11)
    state, poses = None, []
    for _ in range(steps):
        action, state = policy.predict(seen, state)
        seen, *_ = env.step(action)
        poses.append(env.unwrapped.truth.pose.copy())
    return np.array(poses)


@pytest.mark.parametrize("hardware", [{}, HARDWARE], ids=["ideal", "prototype"])
def test_wrenches_give_the_pushes_of_phasors(hardware):
    """From rest, motions agree within the effect of allocating half a step later."""
    info = info_of("Align", **hardware)
    kind = {"kind": "pose", "learn": False}
    phasor, wrench = (
        played(make_policy({**kind, "action": action}, info), 8, **hardware) for action in ("phasor", "wrench")
    )
    displacement = np.linalg.norm(phasor[-1, :, 0, :2] - phasor[0, :, 0, :2], axis=-1)
    off = np.linalg.norm(wrench[-1, :, 0, :2] - phasor[-1, :, 0, :2], axis=-1)
    assert np.median(displacement) > 0.03 and np.median(off) < 0.04 * np.median(displacement)


def test_elements_rest_under_parts_that_coast_to_their_goals():
    """Elements rest under moving parts without a command, although zeros would require a push."""
    env = batch("Align", 12, action="wrench", **HARDWARE)
    policy, state, rests, driven = make_policy({"kind": "pose", "action": "wrench"}, TaskInfo.of(env)), None, 0, 0
    seen, _ = env.reset(seed=5)
    for _ in range(60):
        action, state = policy.predict(seen, state)
        seen, *_ = env.step(action)
        moving = np.linalg.norm(Measured.of(seen, policy.info).velocity[:, 0], axis=-1) > 1e-4
        off = np.array([not env.unwrapped.phasors(world).any() for world in range(12)])
        rests += (off & moving & action.any(axis=-1)).sum()
        driven += (~off).sum()
    assert rests > 60 and driven > 200


def test_absent_parts_have_no_acceleration():
    settings = {"randomize": {"parts": [2, 3]}}
    env = batch("Sort", 4, action="wrench", **settings)
    policy = make_policy({"kind": "planner", "law": "pose", "action": "wrench"}, TaskInfo.of(env))
    seen, _ = env.reset(seed=2)
    action, _ = policy.predict(seen)
    there = env.unwrapped.truth.present
    wanted = action.reshape(4, 6, 3)
    assert not wanted[~there].any() and wanted[there].any(axis=-1).all() and not there.all()
    assert action.dtype == np.float32 and policy.predict(seen[0])[0].shape == (18,)
