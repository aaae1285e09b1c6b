"""The machines in comparison on the same tasks and seeds: ``results/rivals.csv``."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import interval_of, success_interval
from studies.rivals.by_turns import ByTurnsPolicy
from studies.rivals.machines import register
from studies.rivals.policies import rival_policy
from vibgym import Surface
from vibgym.envs.vector import batch_of, environment_id
from vibgym.files import csv_text, output_directory, write_atomically
from vibgym.policies.measures import Measured, Measures
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.sliding import top_slip

FIGURES, PUSH = Path("results/rivals.csv"), Path("results/rivals-push.csv")
"""Tables, the second by :mod:`studies.rivals.reach`."""

LEVEL, RESAMPLES = 0.95, 9999

EPISODES: Mapping[str, int] = {"Transport": 200, "Align": 200, "Rotate": 200, "Sort": 100, "SortTwelve": 40}
"""Of each task, seeds 0, 1, ...: few of the longest."""

OWN_SPEED = 0.100
"""m/s, the largest speed of the rigid plate in Table 1.1 (10 to 100 mm/s)."""


class Contender(NamedTuple):
    """A machine and its settings in the comparison."""

    title: str
    action: str  # of the environment
    own_speed: bool = False  # whether it has the speed of Table 1.1 instead of the segmented surface's


CONTENDERS: Mapping[str, Contender] = {
    "segmented": Contender("segmented surface (this thesis)", "phasor"),
    "plate": Contender("rigid plate, as fast", "plate"),
    "plate-own-speed": Contender("rigid plate, at its own speed", "plate", own_speed=True),
    "plain-plate": Contender("rigid plate, pushes in proportion", "plain-plate"),
    "conveyor": Contender("conveyor cells, both ways", "conveyor"),
    "one-way": Contender("conveyor cells, one way", "one-way"),
}
"""By name; the others are compared with the first."""


def strength_of(surface: Surface, speed: float) -> float:
    """Return the amplitude, over the largest, at which a uniform field accelerates a part to ``speed`` (m/s)."""
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if top_slip(middle) * surface.table_speed < speed else (low, middle)
    return high


def scene_of(name: str) -> dict[str, Any]:
    """Return the keyword arguments of a contender's environments."""
    register()
    contender, surface = CONTENDERS[name], Surface()
    if not contender.own_speed:
        return {"action": contender.action}
    assert surface.max_amplitude is not None
    limit = strength_of(surface, OWN_SPEED) * surface.max_amplitude
    exact = dict.fromkeys(("dead_zone", "gain_spread", "phase_spread"), 0.0)
    return {"action": contender.action, "actuators": {"kind": "prototype", "limit": limit, "latency": 0, **exact}}


def policy_of(name: str, task: str) -> Policy:
    """Return a contender's policy: the pose controller under the planner; the plate serves several parts by turns."""
    env = batch_of(environment_id(task), num_envs=1, **scene_of(name))
    info = TaskInfo.of(env)
    env.close()
    action = CONTENDERS[name].action
    if name == "segmented":
        return make_policy({"kind": "pose", "action": action}, info)
    make: Callable[..., Policy] = ByTurnsPolicy if "plate" in action and info.zones is not None else rival_policy
    return make(info, action)


def played(name: str, task: str, episodes: int) -> Measured:
    """Return the episodes of a contender."""
    return rollout(policy_of(name, task), task, seeds=range(episodes), keep=Measures, **scene_of(name))


def row_of(name: str, task: str, own: Measured, first: Measured) -> dict[str, Any]:
    """Return a line of the table: success rate, and times over the segmented surface's on the same seeds.

    Args:
        own, first: episodes of the contender and of the segmented surface.
    """
    both = own.success & first.success
    ratio = np.log(own.time_to_goal[both] / first.time_to_goal[both])
    interval = success_interval(own.success, LEVEL, RESAMPLES)
    spread = interval_of(ratio[None], LEVEL, RESAMPLES) if len(ratio) > 1 else None
    return {
        "task": task,
        "machine": name,
        "episodes": len(own.seeds),
        "success": float(own.success.mean()),
        "success_low": interval.low,
        "success_high": interval.high,
        "fallen": float(own.fallen.mean()),
        "time_median": float(np.median(own.time_to_goal[own.success])) if own.success.any() else math.nan,
        "time_ratio": float(np.exp(ratio.mean())) if len(ratio) else math.nan,
        "time_ratio_low": math.nan if spread is None else math.exp(spread.low),
        "time_ratio_high": math.nan if spread is None else math.exp(spread.high),
    }


def rows(episodes: Mapping[str, int], report: Callable[[str], Any] = lambda _: None) -> list[dict[str, Any]]:
    """Return all lines of the table, from so many ``episodes`` of each task; ``report`` gets a text for each."""
    result = []
    for task, count in episodes.items():
        first = played("segmented", task, count)
        for name in CONTENDERS:
            row = row_of(name, task, first if name == "segmented" else played(name, task, count), first)
            report(
                f"{task} {name}: {100.0 * row['success']:.1f} %, {row['time_median']:.2f} s, x {row['time_ratio']:.2f}"
            )
            result.append(row)
    return result


def read(path: Path) -> list[dict[str, str]]:
    """Return the lines of a table; none if there is no file yet."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def merged(old: Sequence[Mapping[str, Any]], new: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the new lines and the old ones of other tasks, in the order of the tasks."""
    fresh = {row["task"] for row in new}
    both = [*(row for row in old if row["task"] not in fresh), *new]
    return sorted(both, key=lambda row: tuple(EPISODES).index(row["task"]))


def written(path: Path, lines: Sequence[Mapping[str, Any]]) -> Path:
    """Write a table; return its path."""
    output_directory(path.parent)
    write_atomically(path, csv_text(lines))
    return path
