"""Helpers of the tests of policies."""

import math
from typing import Any, NamedTuple

import numpy as np

from tests.envs.helpers import single
from vibgym import Surface
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.parts import part_from

POSE_TASKS = ("Transport", "Align", "Rotate")
ARRANGED_TASKS = ("Sort", "SortThreeKinds", "Singulate")
FRESH = 7_000_000  # first of the seeds that neither training nor reports use
HARDWARE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}

SURFACE = Surface()
STEEL, ALUMINIUM = part_from("steel_block"), part_from("aluminium_block")
DISC = part_from({"shape": "disc", "radius": 0.020, "friction": 0.6})


def info_of(name: str = "Align", **settings: Any) -> TaskInfo:
    """Return the task info of an environment."""
    return TaskInfo.of(single(name, **{"action": "field", **settings}))


class Outcome(NamedTuple):
    """Results of a policy's first episodes."""

    success: int
    time: float  # s, mean of successes; nan without
    collisions: float  # new contacts of pairs per episode


def episodes(policy: Any, name: str, worlds: int = 100, first: int = FRESH, **settings: Any) -> Outcome:
    """Run a policy for one episode in each world."""
    found = rollout(policy, name, seeds=range(first, first + worlds), keep=Measures, **settings)
    time = found.time_to_goal[found.success].mean() if found.success.any() else math.nan
    return Outcome(int(found.success.sum()), float(time), float(np.nan_to_num(found.collisions).mean()))
