"""The episodes of one policy with all the runs of its training, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibgym.policies.measures import Measured


@dataclass(frozen=True)
class Sample:
    """What the runs of one policy's training achieve on one task and hardware.

    Arrays are (runs, episodes); column e is the same start and goal for all runs, and for all other policies. There is one run
    where a policy is not trained, or was trained once.
    """

    seeds: tuple[int, ...]  # of the episodes
    limit: float  # s, the longest episode
    success: np.ndarray  # bool
    time: np.ndarray  # s to the goal, hold included; nan without success
    bound: np.ndarray  # s, least time that any policy needs; nan where it is not known
    collisions: np.ndarray  # pairs newly in touch; nan where the task does not count them
    fallen: np.ndarray  # bool
    diverged: np.ndarray  # bool

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
        stack = {
            name: np.array([getattr(run, name) for run in runs])
            for name in ("success", "bound", "collisions", "fallen", "diverged")
        }
        return cls(first.seeds, limit, time=np.array([run.time_to_goal for run in runs]), **stack)

    @property
    def runs(self) -> int:
        """Number of training runs."""
        return len(self.success)

    @property
    def limited_time(self) -> np.ndarray:
        """Time to goal, s, in which a failure counts as the longest episode, however it ended."""
        return np.where(self.success, self.time, self.limit)

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
        arrays = {
            name: getattr(self, name)[index : index + 1]
            for name in ("success", "time", "bound", "collisions", "fallen", "diverged")
        }
        return Sample(self.seeds, self.limit, **arrays)
