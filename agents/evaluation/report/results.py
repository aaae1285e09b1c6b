"""Results of an evaluation: rollouts, one row of statistics for each, comparisons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from agents.evaluation.cost import Cost
from agents.evaluation.log import Rollout
from agents.evaluation.quantities import RATES
from agents.evaluation.records import Row, Trial, spread, successes
from agents.evaluation.report.effects import Effects
from agents.evaluation.report.load import Load
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import PairedComparison, quartiles
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.scene import Surface


@dataclass(frozen=True)
class Results:
    """All that an evaluation has found."""

    settings: EvaluationSettings
    tasks: dict[str, TaskInfo]
    scenery: dict[str, Scenery]  # what pictures of each task show
    policies: dict[str, str]  # name -> description
    rollouts: dict[Trial, Rollout]  # tasks, hardware and policies in the order of the settings
    rows: tuple[Row, ...]
    comparisons: tuple[PairedComparison, ...]
    provenance: dict[str, Any]
    cost: Cost | None = None
    effects: Effects | None = None
    load: Load | None = None

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
        return self.settings.environments()[hardware]

    def hardware_of(self, task: str) -> list[str]:
        """Names of the machines that a task ran on."""
        return list(dict.fromkeys(trial.hardware for trial in self.rollouts if trial.task == task))

    def episodes(self, task: str, hardware: str | None = None) -> int:
        """Number of episodes of each policy on a task; on some hardware they may be fewer."""
        most = next((each.episodes for each in self.settings.machines() if each.name == hardware), None)
        return len(self.settings.seed_list(task, most))

    def names(self, task: str, hardware: str) -> list[str]:
        """The policies that ran on a task on some hardware."""
        return [trial.policy for trial in self.rollouts if trial[:2] == (task, hardware)]


def row_of(trial: Trial, rollout: Rollout, level: float, resamples: int) -> Row:
    """Statistics of one rollout: a row of results.csv. Quartiles of times are over the successes, of errors over all."""
    overall, policy_rate, environment_rate = rollout.timing.rates()
    return Row(
        **trial._asdict(),
        **successes(rollout.success, level, resamples),
        **spread("time_to_goal", rollout.time_to_goal, "_s"),
        **spread("time_over_bound", rollout.time_over_bound),  # multiples of each episode's least time
        **spread("position_error", rollout.position_error, "_m"),
        **spread("heading_error", rollout.heading_error, "_rad"),
        **spread("path_error", rollout.path_error, "_m"),
        fallen=int(rollout.fallen.sum()),
        diverged=int(rollout.diverged.sum()),
        mean_return=float(rollout.returns.mean()),
        path_efficiency_median=quartiles(rollout.path_efficiency).median,
        steps_per_second=overall,
        policy_steps_per_second=policy_rate,
        environment_steps_per_second=environment_rate,
        **spread("throughput", rollout.throughput, "_parts_per_s"),
        collisions_mean=float(rollout.collisions.mean()),  # pairs newly in touch in an episode
        clearance_median_m=quartiles(rollout.clearance).median,  # smallest distance between parts in an episode
        parts_done_mean=float(rollout.parts_done.mean()),
        rate_over_bound_mean=float(rollout.rate_over_bound.mean()),
        **{
            f"{name}_mean": float(rollout.fact(name).mean()) for name in RATES
        },  # parts a minute, where they come and go
        transit_mean_s=float(rollout.fact("transit").mean()),
        on_table_mean=float(rollout.fact("on_table").mean()),
        **spread("pattern_error", rollout.fact("pattern_error"), "_m"),
        **spread("coverage", rollout.fact("coverage")),
    )
