"""Results of a comparison: a row of statistics for each policy, its runs, and all that is compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.comparison.curves import Curve
from agents.comparison.differences import Difference
from agents.comparison.profiles import Profile
from agents.comparison.resampling import Statistic, drawn, iqm, iqm_of, mean_of, percentiles
from agents.comparison.sample import Sample
from agents.comparison.settings import ComparisonSettings
from agents.comparison.studies import Case, Line
from agents.evaluation.statistics import Interval, bootstrap, exact, quartiles, success_interval
from vibgym.policies.task_info import TaskInfo


@dataclass(frozen=True)
class Row:
    """One policy on one task and hardware, or one run of its training: a row of compare.csv.

    Interquartile means are over all episodes, a failure counting as the longest one; medians are over the successes.
    """

    task: str
    hardware: str
    policy: str
    group: str
    training_seed: int | None  # None: all runs together
    runs: int
    episodes: int  # of each run
    successes: int  # of all runs
    success_rate: float
    success_low: float
    success_high: float
    success_interval_method: str
    time_iqm_s: float
    time_iqm_low_s: float
    time_iqm_high_s: float
    over_bound_iqm: float
    over_bound_iqm_low: float
    over_bound_iqm_high: float
    iqm_interval_method: str
    time_median_s: float
    over_bound_median: float
    collisions_mean: float  # pairs newly in touch, an episode
    collisions_low: float
    collisions_high: float
    fallen: int
    diverged: int


@dataclass(frozen=True)
class Cell:
    """One row of a matrix in one case: what was found, or why nothing was."""

    policy: str
    case: str
    refusal: str  # why the policy cannot act here; empty where it can
    episodes: int
    runs: int
    success_rate: float
    success_low: float
    success_high: float
    success_interval_method: str
    time_median_s: float


@dataclass(frozen=True)
class Matrix:
    """Policies by cases."""

    name: str
    lines: tuple[Line, ...]
    cases: tuple[Case, ...]
    cells: tuple[tuple[Cell, ...], ...]  # of each line


@dataclass(frozen=True)
class Step:
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
    steps: tuple[Step, ...]


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


def success_of(success: np.ndarray, level: float, resamples: int) -> Interval:
    """Interval of a success rate from a table (runs, episodes) bool.

    Where all runs do alike in all episodes the exact one of as many episodes as one run has: runs on the same episodes are no
    more of them.
    """
    runs, episodes = success.shape
    if runs == 1:
        return success_interval(success[0], level, resamples)
    if success.all() or not success.any():
        return exact(int(success[0].sum()), episodes, level)
    return _over_runs(mean_of(success), success, level, resamples)


def iqm_interval(table: np.ndarray, level: float, resamples: int) -> Interval | None:
    """Interval of the interquartile mean of a table (runs, episodes); None where all its cells are equal."""
    if np.ptp(table) < 1e-9:
        return None
    if len(table) == 1:
        return bootstrap(table[0], level, resamples, iqm)
    return _over_runs(iqm_of(table), table, level, resamples)


def _mean_interval(table: np.ndarray, level: float, resamples: int) -> Interval | None:
    if np.ptp(table) == 0.0:
        return None
    if len(table) == 1:
        return bootstrap(table[0], level, resamples)
    return _over_runs(mean_of(table), table, level, resamples)


def _over_runs(statistic: Statistic, table: np.ndarray, level: float, resamples: int) -> Interval:
    runs, episodes = table.shape
    return percentiles(drawn(statistic, runs, episodes, resamples), level, runs)


def row_of(
    place: tuple[str, str],
    names: tuple[str, str],
    seed: int | None,
    sample: Sample,
    level: float,
    resamples: int,
) -> Row:
    """Statistics of a policy, or of one of its runs.

    Args:
        place: task and hardware.
        names: of policy and group.
        seed: of the run's training.
        sample: its episodes.
        level: of the intervals.
        resamples: draws of the bootstrap.
    """
    success = success_of(sample.success, level, resamples)
    time = iqm_interval(sample.limited_time, level, resamples)
    multiple = iqm_interval(sample.limited_multiple, level, resamples) if sample.bounded else None
    counted = bool(np.isfinite(sample.collisions).all())
    collisions = _mean_interval(sample.collisions, level, resamples) if counted else None
    return Row(
        task=place[0],
        hardware=place[1],
        policy=names[0],
        group=names[1],
        training_seed=seed,
        runs=sample.runs,
        episodes=len(sample.seeds),
        successes=int(sample.success.sum()),
        success_rate=float(sample.success.mean()),
        success_low=success.low,
        success_high=success.high,
        success_interval_method=success.method,
        time_iqm_s=float(iqm(sample.limited_time.ravel())),
        time_iqm_low_s=_low(time),
        time_iqm_high_s=_high(time),
        over_bound_iqm=float(iqm(sample.limited_multiple.ravel())) if sample.bounded else math.nan,
        over_bound_iqm_low=_low(multiple),
        over_bound_iqm_high=_high(multiple),
        iqm_interval_method="" if time is None else time.method,
        time_median_s=quartiles(sample.time).median,
        over_bound_median=quartiles(sample.time / sample.bound).median,
        collisions_mean=float(sample.collisions.mean()) if counted else math.nan,
        collisions_low=_low(collisions),
        collisions_high=_high(collisions),
        fallen=int(sample.fallen.sum()),
        diverged=int(sample.diverged.sum()),
    )


def _low(interval: Interval | None) -> float:
    return math.nan if interval is None else interval.low


def _high(interval: Interval | None) -> float:
    return math.nan if interval is None else interval.high


def best_classical(rows: Sequence[Row]) -> Row | None:
    """Of the classical policies on a task and hardware the one with the most successes; of equal ones that with the lowest
    interquartile mean of its times. It is chosen on the same episodes on which others are compared with it, so that chance may
    favour it a little, and never them."""
    classical = [row for row in rows if row.group == "classical" and row.training_seed is None]
    return min(classical, key=lambda row: (-row.successes, row.time_iqm_s), default=None)


def cell_of(policy: str, case: str, success: np.ndarray, time: np.ndarray, level: float, resamples: int) -> Cell:
    """Statistics of (runs, episodes) of one row of a matrix in one case."""
    interval = success_of(success, level, resamples)
    return Cell(
        policy=policy,
        case=case,
        refusal="",
        episodes=success.shape[1],
        runs=success.shape[0],
        success_rate=float(success.mean()),
        success_low=interval.low,
        success_high=interval.high,
        success_interval_method=interval.method,
        time_median_s=quartiles(time).median,
    )


def refused_cell(policy: str, case: str, reason: str) -> Cell:
    """Of a policy that cannot act."""
    return Cell(policy, case, reason, 0, 0, math.nan, math.nan, math.nan, "", math.nan)
