"""One law, spoken as phasors and as wanted accelerations: parts go the same ways."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import episodes, info_of
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

HARDWARE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}


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
def test_wrenches_ask_for_the_pushes_that_phasors_make(hardware):
    """From rest, a part moves alike within what allocating half a step later makes of it."""
    info = info_of("Align", **hardware)
    kind = {"kind": "pose", "learn": False}
    phasor, wrench = (
        played(make_policy({**kind, "action": action}, info), 8, **hardware) for action in ("phasor", "wrench")
    )
    way = np.linalg.norm(phasor[-1, :, 0, :2] - phasor[0, :, 0, :2], axis=-1)
    off = np.linalg.norm(wrench[-1, :, 0, :2] - phasor[-1, :, 0, :2], axis=-1)
    assert np.median(way) > 0.03 and np.median(off) < 0.04 * np.median(way)


@pytest.mark.parametrize("task, kind, hardware, most", [
    ("Align", "pose", {}, 1.5),
    ("Align", "lqr", HARDWARE, 1.8),
    ("Rotate", "pose", HARDWARE, 0.9),
    ("Transport", "local_field", {}, 1.5),
])  # fmt: skip
def test_parts_reach_their_goals(task, kind, hardware, most):
    policy = make_policy({"kind": kind, "action": "wrench"}, info_of(task, **hardware))
    outcome = episodes(policy, task, 40, **hardware)
    assert policy.action == "wrench" and outcome.success == 40 and outcome.time < most


def test_the_planner_sorts_by_wrenches_on_the_prototype():
    policy = make_policy({"kind": "planner", "law": "pose", "action": "wrench"}, info_of("Sort", **HARDWARE))
    assert episodes(policy, "Sort", 12, **HARDWARE).success == 12


def test_a_part_that_slides_home_is_let_rest():
    """Elements are off under parts in motion of which the law wants nothing, though zeros would ask for a push."""
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


def test_absent_parts_want_nothing():
    settings = {"randomize": {"parts": [2, 3]}}
    env = batch("Sort", 4, action="wrench", **settings)
    policy = make_policy({"kind": "planner", "law": "pose", "action": "wrench"}, TaskInfo.of(env))
    seen, _ = env.reset(seed=2)
    action, _ = policy.predict(seen)
    there = env.unwrapped.truth.present
    wanted = action.reshape(4, 6, 3)
    assert not wanted[~there].any() and wanted[there].any(axis=-1).all() and not there.all()
    assert action.dtype == np.float32 and policy.predict(seen[0])[0].shape == (18,)


def test_other_actions_are_refused():
    for kind in ("pose", "local_field"):
        with pytest.raises(ValueError, match=r"action"):
            make_policy({"kind": kind, "action": "patch"}, info_of("Align"))
    with pytest.raises(ValueError, match=r"action"):
        make_policy({"kind": "planner", "action": 3}, info_of("Sort"))
