"""What the tests of policies share."""

import math
from typing import Any, NamedTuple

import numpy as np

from tests.envs.helpers import batch, single
from vibgym import Surface
from vibgym.config import part_from
from vibgym.policies.task_info import TaskInfo

POSE_TASKS = ("Transport", "Align", "Rotate")
ARRANGED_TASKS = ("Sort", "SortThreeKinds", "Singulate")
FRESH = 7_000_000  # the first of seeds that no training and no report uses

SURFACE = Surface()
STEEL, ALUMINIUM = part_from("steel_block"), part_from("aluminium_block")
DISC = part_from({"shape": "disc", "radius": 0.020, "friction": 0.6})


def info_of(name: str = "Align", **settings: Any) -> TaskInfo:
    """What a policy may know of an environment."""
    return TaskInfo.of(single(name, **{"action": "field", **settings}))


class Outcome(NamedTuple):
    """Of a policy's first episodes."""

    success: int
    time: float  # s, mean of successes; nan without
    collisions: float  # pairs newly in touch, an episode


def episodes(policy: Any, name: str, worlds: int = 100, first: int = FRESH, **settings: Any) -> Outcome:
    """Run a policy in as many worlds, an episode in each."""
    env = batch(name, worlds, action=policy.action, observation=policy.observation, **settings)
    seen, info = env.reset(seed=first)
    alive, succeeded, steps = np.ones(worlds, bool), np.zeros(worlds, bool), np.zeros(worlds)
    none = np.zeros(worlds, dtype=int)
    touching, collisions, state, start = info.get("touching", none), 0, None, alive.copy()
    while alive.any():
        action, state = policy.predict(seen, state, start)
        seen, _, terminated, truncated, info = env.step(action)
        start = terminated | truncated
        collisions += np.maximum(info.get("touching", none) - touching, 0)[alive].sum()
        touching = info.get("touching", none)
        steps += alive
        succeeded |= alive & info["is_success"]
        alive &= ~start
    time = env.unwrapped.step_time * steps[succeeded].mean() if succeeded.any() else math.nan
    return Outcome(int(succeeded.sum()), float(time), float(collisions / worlds))
