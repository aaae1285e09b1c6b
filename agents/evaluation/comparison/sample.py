"""The episodes of one policy with all the runs of its training, as arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from vibgym.policies.measures import Measured


@dataclass(frozen=True)
class Sample(Measured):
    """What the runs of one policy's training achieve on one task and hardware.

    Arrays are (runs, episodes); column e is the same start and goal for all runs, and for all other policies. There is one run
    where a policy is not trained, or was trained once.
    """

    limit: float  # s, the longest episode

    @classmethod
    def of(cls, runs: Sequence[Measured], limit: float) -> Sample:
        """From the episodes of every run, all on the same seeds.

        Args:
            runs: of one policy.
            limit: s, the longest episode.
        """
        first = runs[0]
        if any(run.seeds != first.seeds for run in runs):
            raise ValueError("runs: other seeds; allowed: the same episodes for all")
        head = {name: getattr(first, name) for name in ("task", "seeds", "step_time")}
        return cls(**head, limit=limit, **_arrays(first, lambda name: np.array([getattr(run, name) for run in runs])))

    @property
    def runs(self) -> int:
        """Number of training runs."""
        return len(self.success)

    @property
    def limited_time(self) -> np.ndarray:
        """Time to goal, s, in which a failure counts as the longest episode, however it ended."""
        return np.where(self.success, self.time_to_goal, self.limit)

    @property
    def limited_multiple(self) -> np.ndarray:
        """The same as a multiple of each episode's bound; nan where none is known."""
        return self.limited_time / self.bound

    @property
    def bounded(self) -> bool:
        """Whether the bound of every episode is known."""
        return bool(np.isfinite(self.bound).all())

    def run(self, index: int) -> Sample:
        """One run alone."""
        return replace(self, **_arrays(self, lambda name: getattr(self, name)[index : index + 1]))


def _arrays(found: Measured, make: Callable[[str], np.ndarray]) -> dict[str, Any]:
    """What ``make`` gives for each field that is an array."""
    return {
        each.name: make(each.name) for each in fields(Measured) if isinstance(getattr(found, each.name), np.ndarray)
    }
