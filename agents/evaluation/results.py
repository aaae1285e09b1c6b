"""Results of an evaluation: rollouts, one row of statistics per policy and task, comparisons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from agents.evaluation.cost import Cost
from agents.evaluation.rollout import Rollout
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import Comparison, quartiles, success_interval
from agents.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.scene import Surface


@dataclass(frozen=True)
class Row:
    """One policy on one task: a row of results.csv. Quartiles of times are over the successes, of errors over all."""

    task: str
    policy: str
    episodes: int
    successes: int
    success_rate: float
    success_low: float
    success_high: float
    success_interval_method: str
    time_to_goal_q25_s: float
    time_to_goal_median_s: float
    time_to_goal_q75_s: float
    position_error_q25_m: float
    position_error_median_m: float
    position_error_q75_m: float
    heading_error_q25_rad: float
    heading_error_median_rad: float
    heading_error_q75_rad: float
    fallen: int
    diverged: int
    mean_return: float
    path_efficiency_median: float
    steps_per_second: float
    policy_steps_per_second: float
    environment_steps_per_second: float
    throughput_q25_parts_per_s: float
    throughput_median_parts_per_s: float
    throughput_q75_parts_per_s: float
    collisions_mean: float  # pairs newly in touch in an episode
    clearance_median_m: float  # smallest distance between parts in an episode
    parts_done_mean: float


@dataclass(frozen=True)
class Results:
    """All that an evaluation has found."""

    settings: EvaluationSettings
    tasks: dict[str, TaskInfo]
    scenery: dict[str, Scenery]  # what pictures of each task show
    policies: dict[str, str]  # name -> description
    rollouts: dict[tuple[str, str], Rollout]  # (task, policy), in the order of the settings
    rows: tuple[Row, ...]
    comparisons: tuple[Comparison, ...]
    provenance: dict[str, Any]
    cost: Cost | None = None

    @property
    def surface(self) -> Surface:
        """The table, the same in all tasks."""
        return next(iter(self.tasks.values())).surface

    def episodes(self, task: str) -> int:
        """Number of episodes of each policy on a task."""
        return len(self.settings.seed_list(task))

    def names(self, task: str) -> list[str]:
        """The policies that ran on a task."""
        return [name for each, name in self.rollouts if each == task]


def row_of(policy: str, rollout: Rollout, level: float, resamples: int) -> Row:
    """Statistics of one rollout."""
    interval = success_interval(rollout.success, level, resamples)
    time, position, heading = map(quartiles, (rollout.time_to_goal, rollout.position_error, rollout.heading_error))
    throughput = quartiles(rollout.throughput)
    overall, policy_rate, environment_rate = rollout.timing.rates()
    return Row(
        task=rollout.task,
        policy=policy,
        episodes=len(rollout.seeds),
        successes=int(rollout.success.sum()),
        success_rate=float(rollout.success.mean()),
        success_low=interval.low,
        success_high=interval.high,
        success_interval_method=interval.method,
        time_to_goal_q25_s=time.lower,
        time_to_goal_median_s=time.median,
        time_to_goal_q75_s=time.upper,
        position_error_q25_m=position.lower,
        position_error_median_m=position.median,
        position_error_q75_m=position.upper,
        heading_error_q25_rad=heading.lower,
        heading_error_median_rad=heading.median,
        heading_error_q75_rad=heading.upper,
        fallen=int(rollout.fallen.sum()),
        diverged=int(rollout.diverged.sum()),
        mean_return=float(rollout.returns.mean()),
        path_efficiency_median=quartiles(rollout.path_efficiency).median,
        steps_per_second=overall,
        policy_steps_per_second=policy_rate,
        environment_steps_per_second=environment_rate,
        throughput_q25_parts_per_s=throughput.lower,
        throughput_median_parts_per_s=throughput.median,
        throughput_q75_parts_per_s=throughput.upper,
        collisions_mean=float(rollout.collisions.mean()),
        clearance_median_m=quartiles(rollout.clearance).median,
        parts_done_mean=float(rollout.parts_done.mean()),
    )
