"""Outcomes of controllers in episodes with new seeds: successes, times and collisions."""

import math

import numpy as np
import pytest

from tests.policies.helpers import HARDWARE, POSE_TASKS, episodes, info_of
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout

LONG = {"periods_per_step": 4}
SMALL = {
    "surface": {"rows": 10, "columns": 16, "element_size": 0.02},
    "parts": [{"shape": "disc", "radius": 0.03, "friction": 0.4}],
}
NEAR_BORDER = {"task_settings": {"gap_mm": 37, "rows": 2}}
FULL_WIDTH = {"task_settings": {"heading_deg": 90}}
FEW = {"parts": ["steel_block", "aluminium_block"] * 3, "randomize": {"parts": [1, 6]}}


def wrench(kind, **settings):
    return {"kind": kind, "action": "wrench", **settings}


def prototype(**change):
    return {**HARDWARE, "actuators": {"kind": "prototype", **change}}


CASES = [
    # controller, task, environment, episodes, least successes, mean time below (s), collisions at most
    *(("local_field", task, {}, 100, 99, most) for task, most in zip(POSE_TASKS, (1.45, 1.55, 1.1), strict=True)),
    *(("local_field", task, HARDWARE, 100, 99, most) for task, most in zip(POSE_TASKS, (1.6, 1.75, 1.1), strict=True)),
    *(("local_field", task, LONG, 100, 99, 2.0) for task in POSE_TASKS),
    *(("pose", task, hardware, 60, 60, 1.6) for task in POSE_TASKS for hardware in ({}, HARDWARE)),
    *(("lqr", task, hardware, 60, 60, 1.7) for task in POSE_TASKS for hardware in ({}, HARDWARE)),
    *(("planner", task, {}, 30, 30, 9.0) for task in POSE_TASKS),
    ("pid", "Transport", {}, 30, 30, 9.0),
    ("pid", "Align", {}, 100, 99, 9.0),
    ("open_loop", "Transport", {}, 100, 95, 9.0),
    ("open_loop", "Rotate", {}, 200, 14, 9.0),
    ("open_loop", "Rotate", LONG, 200, 14, 9.0),
    ("local_field", "Transport", SMALL, 20, 19, 9.0),
    ("local_field", "Align", prototype(dead_zone=1.5e-4), 40, 39, 9.0),
    ("local_field", "Align", prototype(dead_zone_form="soft"), 40, 39, 9.0),
    ("local_field", "Align", prototype(dead_zone_form="cubic"), 40, 39, 9.0),
    ("local_field", "Align", prototype(limit=2.5e-4), 40, 39, 9.0),
    ("local_field", "Align", prototype(latency=2), 40, 39, 9.0),
    (wrench("pose"), "Align", {}, 40, 40, 1.5),
    (wrench("lqr"), "Align", HARDWARE, 40, 40, 1.8),
    (wrench("pose"), "Rotate", HARDWARE, 40, 40, 0.9),
    (wrench("local_field"), "Transport", {}, 40, 40, 1.5),
    ("planner", "Sort", {}, 12, 12, 3.4, 0.5),
    ("planner", "Singulate", {}, 12, 12, 1.4, 0.5),
    ("planner", "Sort", HARDWARE, 12, 12, 9.0, 1.0),
    ("planner", "Singulate", HARDWARE, 12, 12, 9.0, 1.0),
    ("local_field", "Singulate", HARDWARE, 12, 12, 9.0, 1.0),
    ("two_phases", "Pack", {}, 40, 39, 2.6, 2.0),
    ("planner", "Sort", LONG, 30, 30, 3.6),
    ("planner", "Singulate", LONG, 30, 30, 1.6),
    ("pose", "Sort", HARDWARE, 12, 12, 9.0),
    ("lqr", "Sort", HARDWARE, 12, 12, 9.0),
    (wrench("planner", law="pose"), "Sort", HARDWARE, 12, 12, 9.0),
    ({"kind": "planner", "law": "pose"}, "Pack", NEAR_BORDER, 30, 29, 2.6),
    ("two_phases", "Pack", HARDWARE, 20, 18, 3.0),
    ("two_phases", "Pack", FULL_WIDTH, 12, 11, 4.5),
    ("two_phases", "Pack", FEW, 20, 19, 30.0),
    (wrench("two_phases"), "PackFull", {}, 20, 19, 4.5),
]


@pytest.mark.parametrize(
    "policy, task, environment, count, least, most, collisions", [(*case, math.inf)[:7] for case in CASES]
)
def test_episodes_succeed_in_time(policy, task, environment, count, least, most, collisions):
    outcome = episodes(policy, task, count, **environment)
    assert outcome.success >= least and outcome.time < most and outcome.collisions <= collisions


@pytest.mark.parametrize("task, most, hardware", [
    ("Swap", 4.5, {}), ("SwapCrowded", 6.5, {}), ("Swap", 5.5, HARDWARE),
])  # fmt: skip
def test_parts_pass_one_another(task, most, hardware):
    result = rollout("lanes", task, seeds=range(50, 58), keep=Measures, **hardware)
    assert (
        result.success.mean() >= 0.875 and np.nanmedian(result.time_to_goal) < most and result.collisions.mean() < 5.0
    )


@pytest.mark.parametrize("action", ["wrench", "phasor"])
def test_a_part_is_pushed_to_its_goal(action):
    result = rollout({"kind": "push", "action": action}, "Push", seeds=range(8), keep=Measures)
    assert result.success.mean() >= 7 / 8 and not result.fallen.any()


def test_pushers_on_the_same_side_do_not_block_each_other():
    """Seeds in which both were on one side, and each obstructed the other."""
    assert rollout("push", "PushAny", seeds=[0, 35, 71, 106]).success.all()


@pytest.mark.parametrize("policy, task, environment, count, most", [
    ("zero", "Align", {}, 100, 5),
    ({"kind": "pid", "anti_windup": False}, "Transport", {}, 30, 27),
])  # fmt: skip
def test_controllers_that_cannot_succeed_do_not(policy, task, environment, count, most):
    assert episodes(policy, task, count, **environment).success <= most


def test_the_dead_zone_must_be_known():
    """A controller for ideal elements on the prototype."""
    assert episodes(make_policy("local_field", info_of("Align")), "Align", 50, **HARDWARE).success <= 30
