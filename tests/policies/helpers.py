"""Helpers of the tests of policies."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from tests.envs.helpers import single
from vibgym import Surface
from vibgym.policies.classical.measured import Measured
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.parts import part_from

POSE_TASKS = ("Transport", "Align", "Rotate")
ARRANGED_TASKS = ("Sort", "SortThreeKinds", "Singulate")
FRESH = 7_000_000  # first of the seeds that neither training nor reports use
HARDWARE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}
TILTING = {
    "model": "tilting",
    "randomize": {"patches": [0.75, 1.25], "disturbance": {"rate": 0.25, "tilt_deg": 3.0}},
}

SURFACE = Surface()
STEEL, ALUMINIUM = part_from("steel_block"), part_from("aluminium_block")
DISC = part_from({"shape": "disc", "radius": 0.020, "friction": 0.6})


def info_of(name: str = "Align", **settings: Any) -> TaskInfo:
    """Return the task info of an environment."""
    return TaskInfo.of(single(name, **{"action": "field", **settings}))


def measurement(info: TaskInfo, worlds: int = 1, **values: Any) -> Measured:
    """Return a measurement of present, straight parts at rest at their goals, with other values of some fields.

    Args:
        values: arrays that broadcast to (worlds, parts) and the shape of a part's value.
    """
    shape = (worlds, len(info.parts))
    rest = Measured.of(np.zeros((worlds, info.layout.size)), info)
    rest = dataclasses.replace(
        rest, present=np.ones(shape, dtype=bool), heading=np.zeros(shape), displacement=np.zeros((*shape, 2)),
        gap=np.full(shape, math.inf),
    )  # fmt: skip
    other = {}
    for name, value in values.items():
        default = getattr(rest, name)
        wide = np.broadcast_to(np.asarray(value, dtype=default.dtype), (*shape, *default.shape[2:]))
        other[name] = wide.copy()
    return dataclasses.replace(rest, **other)


class Outcome(NamedTuple):
    """Results of a policy's first episodes."""

    success: int
    time: float  # s, mean of successes; nan without
    collisions: float  # new contacts of pairs per episode


def episodes(policy: Any, name: str, worlds: int = 100, first: int = FRESH, **settings: Any) -> Outcome:
    """Run a policy for one episode in each world."""
    result = rollout(policy, name, seeds=range(first, first + worlds), keep=Measures, **settings)
    time = result.time_to_goal[result.success].mean() if result.success.any() else math.nan
    return Outcome(int(result.success.sum()), float(time), float(np.nan_to_num(result.collisions).mean()))
