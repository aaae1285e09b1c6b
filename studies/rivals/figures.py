"""All machines on the same tasks and seeds: ``results/rivals.csv``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.evaluation.statistics import interval_of, success_interval
from studies.rivals.contenders import CONTENDERS, policy_of, scene_of
from vibgym.policies.measures import Measured, Measures
from vibgym.policies.rollout import rollout

LEVEL, RESAMPLES = 0.95, 9999

EPISODES: Mapping[str, int] = {"Transport": 200, "Align": 200, "Rotate": 200, "Sort": 100, "SortTwelve": 40}
"""Of each task, seeds 0, 1, ...: few of the longest."""


def played(name: str, task: str, episodes: int) -> Measured:
    """Episodes of a contender."""
    return rollout(policy_of(name, task), task, seeds=range(episodes), keep=Measures, **scene_of(name))


def row_of(name: str, task: str, own: Measured, first: Measured) -> dict[str, Any]:
    """A line of the table: how often it succeeds, and its times over the segmented surface's on the same seeds.

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


def rows(
    episodes: Mapping[str, int] = EPISODES,
    names: Sequence[str] = tuple(CONTENDERS),
    report: Callable[[str], Any] = lambda _: None,
) -> list[dict[str, Any]]:
    """All lines of the table.

    Args:
        episodes: of each task.
        names: of :data:`.contenders.CONTENDERS`, in addition to the first.
        report: called with a line of text for every result.
    """
    result = []
    for task, count in episodes.items():
        first = played("segmented", task, count)
        for name in dict.fromkeys(("segmented", *names)):
            row = row_of(name, task, first if name == "segmented" else played(name, task, count), first)
            report(
                f"{task} {name}: {100.0 * row['success']:.1f} %, {row['time_median']:.2f} s, x {row['time_ratio']:.2f}"
            )
            result.append(row)
    return result
