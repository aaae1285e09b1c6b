"""Results of an evaluation: rollouts, one row of statistics for each, comparisons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from agents.evaluation.cost import Cost
from agents.evaluation.effects import Effects
from agents.evaluation.entries import HardwareEntry, laid_over
from agents.evaluation.log import Rollout
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import Comparison, quartiles, success_interval
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.scene import Surface


class Trial(NamedTuple):
    """What is run and judged in one piece."""

    task: str
    hardware: str
    policy: str


@dataclass(frozen=True)
class Row:
    """One trial: a row of results.csv. Quartiles of times are over the successes, of errors over all."""

    task: str
    hardware: str
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
    time_over_bound_q25: float  # multiples of each episode's least time
    time_over_bound_median: float
    time_over_bound_q75: float
    position_error_q25_m: float
    position_error_median_m: float
    position_error_q75_m: float
    heading_error_q25_rad: float
    heading_error_median_rad: float
    heading_error_q75_rad: float
    path_error_q25_m: float
    path_error_median_m: float
    path_error_q75_m: float
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
    rollouts: dict[Trial, Rollout]  # tasks, hardware and policies in the order of the settings
    rows: tuple[Row, ...]
    comparisons: tuple[Comparison, ...]
    provenance: dict[str, Any]
    cost: Cost | None = None
    effects: Effects | None = None

    @property
    def surface(self) -> Surface:
        """The table, the same in all tasks."""
        return next(iter(self.tasks.values())).surface

    @property
    def hardware(self) -> list[str]:
        """Names of all machines that something ran on, in the order of the settings."""
        ran = {trial.hardware for trial in self.rollouts}
        return [entry.name for entry in self.settings.machines() if entry.name in ran]

    def arguments_of(self, hardware: str) -> dict[str, Any]:
        """Keyword arguments of the environments on some hardware."""
        return laid_over(self.settings.environment, self._machine(hardware).arguments)

    def _machine(self, hardware: str) -> HardwareEntry:
        return next(each for each in self.settings.machines() if each.name == hardware)

    def hardware_of(self, task: str) -> list[str]:
        """Names of the machines that a task ran on."""
        return list(dict.fromkeys(trial.hardware for trial in self.rollouts if trial.task == task))

    def episodes(self, task: str, hardware: str | None = None) -> int:
        """Number of episodes of each policy on a task; on some hardware they may be fewer."""
        most = None if hardware is None else self._machine(hardware).episodes
        return len(self.settings.seed_list(task, most))

    def names(self, task: str, hardware: str) -> list[str]:
        """The policies that ran on a task on some hardware."""
        return [trial.policy for trial in self.rollouts if trial[:2] == (task, hardware)]


def row_of(trial: Trial, rollout: Rollout, level: float, resamples: int) -> Row:
    """Statistics of one rollout."""
    interval = success_interval(rollout.success, level, resamples)
    time, position, heading = map(quartiles, (rollout.time_to_goal, rollout.position_error, rollout.heading_error))
    path = quartiles(rollout.path_error)
    throughput, multiple = quartiles(rollout.throughput), quartiles(rollout.time_over_bound)
    overall, policy_rate, environment_rate = rollout.timing.rates()
    return Row(
        **trial._asdict(),
        episodes=len(rollout.seeds),
        successes=int(rollout.success.sum()),
        success_rate=float(rollout.success.mean()),
        success_low=interval.low,
        success_high=interval.high,
        success_interval_method=interval.method,
        time_to_goal_q25_s=time.lower,
        time_to_goal_median_s=time.median,
        time_to_goal_q75_s=time.upper,
        time_over_bound_q25=multiple.lower,
        time_over_bound_median=multiple.median,
        time_over_bound_q75=multiple.upper,
        position_error_q25_m=position.lower,
        position_error_median_m=position.median,
        position_error_q75_m=position.upper,
        heading_error_q25_rad=heading.lower,
        heading_error_median_rad=heading.median,
        heading_error_q75_rad=heading.upper,
        path_error_q25_m=path.lower,
        path_error_median_m=path.median,
        path_error_q75_m=path.upper,
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
