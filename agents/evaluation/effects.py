"""Which effect of the hardware breaks which policy: one task, one effect at a time, and all together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from agents.evaluation.statistics import quartiles, success_interval
from vibgym.policies.rollout import Outcomes


@dataclass(frozen=True)
class Cell:
    """One policy in one case. Quartiles of times are over the successes, of errors over all episodes."""

    case: str
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
    position_error_median_m: float
    heading_error_median_rad: float
    fallen: int


@dataclass(frozen=True)
class Effects:
    """The study's table."""

    task: str
    seeds: tuple[int, ...]
    cases: dict[str, dict[str, Any]]  # name -> arguments of the environment
    policies: tuple[str, ...]
    cells: tuple[Cell, ...]  # case after case, in the order of the policies
    outcomes: Mapping[tuple[str, str], Outcomes] = field(default_factory=dict)  # by (case, policy)

    def rows(self) -> Iterable[tuple[str, tuple[Cell, ...]]]:
        """Every case with its cells."""
        for row, case in enumerate(self.cases):
            yield case, self.cells[row * len(self.policies) :][: len(self.policies)]

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        head = {"task": self.task, "seeds": self.seeds, "cases": self.cases}
        episodes = [
            {"case": case, "policy": policy, **one}
            for (case, policy), found in self.outcomes.items()
            for one in episodes_of(found)
        ]
        return {**head, "results": [asdict(cell) for cell in self.cells], "episodes": episodes}


def episodes_of(found: Outcomes) -> list[dict[str, Any]]:
    """One mapping per episode, with names as in episodes.csv."""
    columns = {
        "seed": found.seeds,
        "success": found.success.tolist(),
        "steps": found.steps.tolist(),
        "time_to_goal_s": found.time_to_goal.tolist(),
        "position_error_m": found.position_error.tolist(),
        "heading_error_rad": found.heading_error.tolist(),
        "fallen": found.fallen.tolist(),
    }
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def cell_of(case: str, policy: str, found: Outcomes, level: float, resamples: int) -> Cell:
    """Statistics of one policy in one case."""
    interval = success_interval(found.success, level, resamples)
    time = quartiles(found.time_to_goal)
    return Cell(
        case=case,
        policy=policy,
        episodes=len(found.seeds),
        successes=int(found.success.sum()),
        success_rate=float(found.success.mean()),
        success_low=interval.low,
        success_high=interval.high,
        success_interval_method=interval.method,
        time_to_goal_q25_s=time.lower,
        time_to_goal_median_s=time.median,
        time_to_goal_q75_s=time.upper,
        position_error_median_m=quartiles(found.position_error).median,
        heading_error_median_rad=quartiles(found.heading_error).median,
        fallen=int(found.fallen.sum()),
    )
