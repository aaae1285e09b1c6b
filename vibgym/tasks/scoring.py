"""The episodes of a batch of worlds, bound to the state that they are judged by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibgym._numba.reference import Pinned
from vibgym.physics.core.records import STATE, State
from vibgym.tasks.episode import (
    JUDGED,
    QUANTITIES,
    Judged,
    Relations,
    Start,
    new_episode,
    new_relations,
    relate_worlds,
    score_worlds,
)

if TYPE_CHECKING:
    from vibgym.tasks.base import Task

_ALL = np.zeros(0, dtype=np.int64)


class Scoring:
    """Begins and scores the episodes of all worlds of a task.

    Args:
        task: with its parts.
        state: true state of the worlds; its arrays live as long as this and are changed in place.
        periods: oscillation periods of a step.
        motion: numbers of the motion of every goal, see :class:`vibgym.tasks.episode.Episode`.

    Attributes:
        episode: progress of every world.
        relations: how parts stand to their goals and to one another, by the true state.
    """

    def __init__(self, task: Task, state: State, periods: int, motion: int = 0) -> None:
        worlds, parts = state.pose.shape[:2]
        self._task, self._rules, self._state = task, task.rules(periods), Pinned(STATE, state)
        self.relations = new_relations(worlds, parts)
        self.episode = new_episode(worlds, parts, len(self._rules.term), motion)
        self._judged = self.judged(self.relations)

    def judged(self, relations: Relations) -> Pinned[Judged]:
        """What kernels need to bring such relations up to date; see :meth:`relate`."""
        hulls = self._task.hulls
        fits = np.zeros(self.episode.done.shape[1], dtype=bool)
        scratch = np.zeros(hulls.corner.shape), np.zeros(4), np.zeros(len(QUANTITIES)), fits
        return Pinned(JUDGED, Judged(relations, self.episode, self._rules, hulls, *scratch))

    def own_state(self) -> dict[str, np.ndarray]:
        """Live arrays that a snapshot has to hold besides the episodes and their relations."""
        return {}

    def facts(self) -> dict[str, np.ndarray]:
        """What ``info`` says besides what the task's facts are, each (worlds,); live arrays."""
        return {}

    def lines(self, world: int) -> list[np.ndarray]:
        """Lines (n, 2), m, along which the goals of a world's parts move, one for each part; none where they stay."""
        return []

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        """Start the episodes of ``worlds`` (index array), whose parts have been put down."""
        self.episode.goal[worlds], self.episode.present[worlds] = start.goal, start.present
        if len(worlds):
            score_worlds(worlds, self._state.address, self._judged.address)

    def score(self) -> None:
        """Score one step of every world against the one before."""
        score_worlds(_ALL, self._state.address, self._judged.address)

    def relate(self, pose: np.ndarray, gone: np.ndarray, judged: Pinned[Judged]) -> None:
        """How parts at other poses than the true ones stand to their goals and to one another.

        Args:
            pose: (worlds, parts, 3).  gone: (worlds, parts) bool, parts that are out of the way.
            judged: from :meth:`judged`, for the relations to be overwritten.
        """
        relate_worlds(pose, gone, judged.address)
