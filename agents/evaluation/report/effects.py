"""Which effect of the hardware breaks which policy: one task, one effect at a time, and all together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from agents.evaluation.records import Row, episodes_of, spread, successes
from agents.evaluation.statistics import quartiles
from vibgym.policies.rollout import Outcomes


@dataclass(frozen=True)
class Effects:
    """The study's table."""

    task: str
    seeds: tuple[int, ...]
    cases: dict[str, dict[str, Any]]  # name -> arguments of the environment
    policies: tuple[str, ...]
    cells: tuple[Row, ...]  # case after case, in the order of the policies
    outcomes: Mapping[tuple[str, str], Outcomes] = field(default_factory=dict)  # by (case, policy)

    def rows(self) -> Iterable[tuple[str, tuple[Row, ...]]]:
        """Every case with its cells."""
        for row, case in enumerate(self.cases):
            yield case, self.cells[row * len(self.policies) :][: len(self.policies)]

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        head = {"task": self.task, "seeds": self.seeds, "cases": self.cases}
        episodes = [
            one
            for (case, policy), found in self.outcomes.items()
            for one in episodes_of(found, case=case, policy=policy)
        ]
        return {**head, "results": [vars(cell) for cell in self.cells], "episodes": episodes}


def cell_of(case: str, policy: str, found: Outcomes, level: float, resamples: int) -> Row:
    """Statistics of one policy in one case. Quartiles of times are over the successes, of errors over all episodes."""
    return Row(
        case=case,
        policy=policy,
        **successes(found.success, level, resamples),
        **spread("time_to_goal", found.time_to_goal, "_s"),
        position_error_median_m=quartiles(found.position_error).median,
        heading_error_median_rad=quartiles(found.heading_error).median,
        fallen=int(found.fallen.sum()),
    )
