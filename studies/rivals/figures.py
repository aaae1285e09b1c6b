"""Comparison of the machines on the same tasks and seeds: ``results/rivals.csv``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from agents.evaluation.statistics import interval_of, success_interval
from studies.common import LEVEL, RESAMPLES
from studies.rivals.by_turns import ByTurnsPolicy
from studies.rivals.machines import register
from studies.rivals.policies import rival_policy
from vibgym import Surface
from vibgym.envs.vector import batch_of, environment_id
from vibgym.files import output_directory, write_atomically
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.simulation.plant import top_slip

FIGURES, PUSH = Path("results/rivals.csv"), Path("results/rivals-push.csv")
"""Files of the tables; :mod:`studies.rivals.reach` computes the second."""

EPISODES: Mapping[str, int] = {"Transport": 200, "Align": 200, "Rotate": 200, "Sort": 100, "SortTwelve": 40}
"""Task -> number of episodes, seeds 0, 1, ..."""

OWN_SPEED = 0.100
"""m/s, the largest speed of the rigid plate in Table 1.1 (10 to 100 mm/s)."""


class Contender(NamedTuple):
    """A machine with its settings."""

    title: str
    action: str  # action of the environment
    own_speed: bool = False  # speed of Table 1.1 instead of that of the segmented surface


CONTENDERS: Mapping[str, Contender] = {
    "segmented": Contender("segmented surface (this thesis)", "phasor"),
    "plate": Contender("rigid plate, as fast", "plate"),
    "plate-own-speed": Contender("rigid plate, at its own speed", "plate", own_speed=True),
    "plain-plate": Contender("rigid plate, proportional pushes", "plain-plate"),
    "conveyor": Contender("conveyor cells, both ways", "conveyor"),
    "one-way": Contender("conveyor cells, one way", "one-way"),
}
"""Name -> machine; times are relative to the first."""


def strength_of(surface: Surface, speed: float) -> float:
    """Return the relative amplitude at which a uniform field accelerates a part to ``speed`` (m/s)."""
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if top_slip(middle) * surface.table_speed < speed else (low, middle)
    return high


def scene_of(name: str) -> dict[str, Any]:
    """Return the keyword arguments of the environments of a contender."""
    register()
    contender, surface = CONTENDERS[name], Surface()
    if not contender.own_speed:
        return {"action": contender.action}
    assert surface.max_amplitude is not None
    limit = strength_of(surface, OWN_SPEED) * surface.max_amplitude
    exact = dict.fromkeys(("dead_zone", "gain_spread", "phase_spread"), 0.0)
    return {"action": contender.action, "actuators": {"kind": "prototype", "limit": limit, "latency": 0, **exact}}


def policy_of(name: str, task: str) -> Policy:
    """Return the policy of a contender: *pose* with the planner, or :class:`ByTurnsPolicy` for plates and zones."""
    env = batch_of(environment_id(task), num_envs=1, **scene_of(name))
    info = TaskInfo.of(env)
    env.close()
    action = CONTENDERS[name].action
    if name == "segmented":
        return make_policy({"kind": "pose", "action": action}, info)
    make: Callable[..., Policy] = ByTurnsPolicy if "plate" in action and info.zones is not None else rival_policy
    return make(info, action)


def played(name: str, task: str, episodes: int) -> MeasuredOutcomes:
    """Return the results of the episodes of a contender."""
    return rollout(policy_of(name, task), task, seeds=range(episodes), keep=Measures, **scene_of(name))


def row_of(name: str, task: str, results: MeasuredOutcomes, first: MeasuredOutcomes) -> dict[str, Any]:
    """Return a row of the table: success rate, and times relative to the segmented surface on the same seeds.

    Args:
        results, first: episodes of the contender and of the segmented surface.
    """
    both = results.success & first.success
    ratio = np.log(results.time_to_goal[both] / first.time_to_goal[both])
    interval = success_interval(results.success, LEVEL, RESAMPLES)
    spread = interval_of(ratio[None], LEVEL, RESAMPLES) if len(ratio) > 1 else None
    return {
        "task": task,
        "machine": name,
        "episodes": len(results.seeds),
        "success": float(results.success.mean()),
        "success_low": interval.low,
        "success_high": interval.high,
        "fallen": float(results.fallen.mean()),
        "time_median": float(np.median(results.time_to_goal[results.success])) if results.success.any() else math.nan,
        "time_ratio": float(np.exp(ratio.mean())) if len(ratio) else math.nan,
        "time_ratio_low": math.nan if spread is None else math.exp(spread.low),
        "time_ratio_high": math.nan if spread is None else math.exp(spread.high),
    }


def rows(episodes: Mapping[str, int], report: Callable[[str], Any] = lambda _: None) -> list[dict[str, Any]]:
    """Return all rows of the table; ``episodes``: task -> number of episodes; ``report`` receives a line of text per row."""
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


def store(path: Path, lines: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows as CSV; return the path. Rows of other tasks stay, in the order of the tasks."""
    table = pd.DataFrame(lines)
    if "task" in table and path.exists():
        before = pd.read_csv(path, dtype=str)
        table = pd.concat([before[~before["task"].isin(table["task"])], table])
        table = table.iloc[np.argsort([list(EPISODES).index(task) for task in table["task"]], kind="stable")]
    output_directory(path.parent)
    write_atomically(path, table.to_csv(index=False))
    return path
