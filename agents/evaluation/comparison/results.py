"""Results of a comparison: a row of statistics for each policy, its runs, and all that is compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.comparison.contenders import ComparisonSettings
from agents.evaluation.comparison.curves import Curve
from agents.evaluation.comparison.paired import Difference
from agents.evaluation.comparison.profiles import Profile
from agents.evaluation.comparison.sample import Sample
from agents.evaluation.comparison.studies import Case
from agents.evaluation.entries import Column
from agents.evaluation.records import Row, ends, successes
from agents.evaluation.resampling import interval_of, iqm, iqm_of
from agents.evaluation.statistics import quartiles
from vibgym.policies.task_info import TaskInfo


@dataclass(frozen=True)
class Matrix:
    """Policies by cases."""

    name: str
    lines: tuple[Column, ...]
    cases: tuple[Case, ...]
    cells: tuple[tuple[Row, ...], ...]  # of each line


@dataclass(frozen=True)
class Rung:
    """One row of a ladder."""

    policy: str
    action: str  # that it speaks
    steps: tuple[int, ...]  # of each run's training
    seconds: tuple[float, ...]  # of its wall time
    row: Row
    runs: tuple[Row, ...]  # empty where there is one


@dataclass(frozen=True)
class Ladder:
    """Policies that differ in one thing."""

    name: str
    task: str
    hardware: str
    steps: tuple[Rung, ...]


@dataclass(frozen=True)
class Comparison:
    """All that a comparison has found."""

    settings: ComparisonSettings
    tasks: dict[str, TaskInfo]
    samples: dict[tuple[str, str], dict[str, Sample]]  # task and hardware -> policy -> its episodes
    rows: tuple[Row, ...]
    best: dict[tuple[str, str], str]  # task and hardware -> the best classical policy; nothing where there is none
    differences: tuple[Difference, ...]
    profiles: tuple[Profile, ...]
    curves: dict[tuple[str, str], dict[int | None, Curve]]  # task and policy -> training seed -> curve
    matrices: tuple[Matrix, ...]
    ladders: tuple[Ladder, ...]
    provenance: dict[str, Any]

    def rows_of(self, task: str, hardware: str) -> list[tuple[Row, list[Row]]]:
        """Every policy's row with those of its runs, which are none where there is one."""
        some = [row for row in self.rows if (row.task, row.hardware) == (task, hardware)]
        return [
            (row, [run for run in some if run.policy == row.policy and run.training_seed is not None])
            for row in some
            if row.training_seed is None
        ]

    def hardware_of(self, task: str) -> list[str]:
        """The machines that something ran on, of a task."""
        return [hardware for each, hardware in self.samples if each == task]


def row_of(
    place: tuple[str, str],
    names: tuple[str, str],
    seed: int | None,
    sample: Sample,
    level: float,
    resamples: int,
) -> Row:
    """Statistics of a policy, or of one of its runs: a row of compare.csv.

    Interquartile means are over all episodes, a failure counting as the longest one; medians are over the successes.

    Args:
        place: task and hardware.
        names: of policy and group.
        seed: of the run's training.
        sample: its episodes.
        level: of the intervals.
        resamples: draws of the bootstrap.
    """
    asked = level, resamples
    multiple = interval_of(sample.limited_multiple, *asked, iqm, iqm_of) if sample.bounded else None
    counted = bool(np.isfinite(sample.collisions).all())
    time = interval_of(sample.limited_time, *asked, iqm, iqm_of)
    return Row(
        task=place[0],
        hardware=place[1],
        policy=names[0],
        group=names[1],
        training_seed=seed,  # None: all runs together
        runs=sample.runs,
        **successes(sample.success, *asked),  # episodes of each run, successes of all runs
        time_iqm_s=float(iqm(sample.limited_time.ravel())),
        **ends("time_iqm", time, "_s"),
        over_bound_iqm=float(iqm(sample.limited_multiple.ravel())) if sample.bounded else math.nan,
        **ends("over_bound_iqm", multiple),
        iqm_interval_method="" if time is None else time.method,
        time_median_s=quartiles(sample.time_to_goal).median,
        over_bound_median=quartiles(sample.time_over_bound).median,
        collisions_mean=float(sample.collisions.mean()) if counted else math.nan,  # pairs newly in touch, an episode
        **ends("collisions", interval_of(sample.collisions, *asked) if counted else None),
        fallen=int(sample.fallen.sum()),
        diverged=int(sample.diverged.sum()),
    )


def best_classical(rows: Sequence[Row]) -> Row | None:
    """Of the classical policies on a task and hardware the one with the most successes; of equal ones that with the lowest
    interquartile mean of its times. It is chosen on the same episodes on which others are compared with it, so that chance may
    favour it a little, and never them."""
    classical = [row for row in rows if row.group == "classical" and row.training_seed is None]
    return min(classical, key=lambda row: (-row.successes, row.time_iqm_s), default=None)


def cell_of(policy: str, case: str, success: np.ndarray, time: np.ndarray, level: float, resamples: int) -> Row:
    """Statistics of (runs, episodes) of one row of a matrix in one case."""
    found = successes(success, level, resamples)
    del found["successes"]
    median = quartiles(time).median
    return Row(policy=policy, case=case, refusal="", runs=success.shape[0], **found, time_median_s=median)


def refused_cell(policy: str, case: str, reason: str) -> Row:
    """Of a policy that cannot act: why, and nothing else."""
    rate = {"success_rate": math.nan, **ends("success", None), "success_interval_method": ""}
    return Row(policy=policy, case=case, refusal=reason, runs=0, episodes=0, **rate, time_median_s=math.nan)
