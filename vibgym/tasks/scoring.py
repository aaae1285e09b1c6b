"""The episodes of a batch of worlds, bound to the state that they are judged by."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from vibgym._numba.reference import Pinned
from vibgym.physics.collision.hulls import Hulls
from vibgym.physics.core.records import STATE, State
from vibgym.simulation.threads import Pool
from vibgym.tasks.episode import (
    JUDGED,
    QUANTITIES,
    Episode,
    Judged,
    Relations,
    Rules,
    Start,
    new_episode,
    new_relations,
    relate_worlds,
    score_worlds,
)

if TYPE_CHECKING:
    from vibgym.tasks.base import Task


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
        self._everyone = np.arange(worlds)

    def judged(self, relations: Relations) -> Pool[Pinned[Judged]]:
        """What kernels need to bring such relations up to date, for each thread; see :meth:`relate`."""
        return Pool(partial(_judged, relations, self.episode, self._rules, self._task.hulls))

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
        self._score(worlds, True)

    def score(self, worlds: np.ndarray | None = None) -> None:
        """Score one step against the one before: of ``worlds`` (index array), or of all."""
        self._score(self._everyone if worlds is None else worlds, False)

    def _score(self, worlds: np.ndarray, starting: bool) -> None:
        judged = self._judged.take()
        score_worlds(worlds, starting, self._state.address, judged.address)
        self._judged.give(judged)

    def relate(self, worlds: np.ndarray, pose: np.ndarray, gone: np.ndarray, judged: Pool[Pinned[Judged]]) -> None:
        """How parts at other poses than the true ones stand to their goals and to one another.

        Args:
            worlds: index array.
            pose: (worlds, parts, 3).  gone: (worlds, parts) bool, parts that are out of the way.
            judged: from :meth:`judged`, for the relations to be overwritten.
        """
        own = judged.take()
        relate_worlds(worlds, pose, gone, own.address)
        judged.give(own)


def _judged(relations: Relations, episode: Episode, rules: Rules, hulls: Hulls) -> Pinned[Judged]:
    """What one thread needs."""
    fits = np.zeros(episode.done.shape[1], dtype=bool)
    scratch = np.zeros(hulls.corner.shape), np.zeros(4), np.zeros(len(QUANTITIES)), fits
    return Pinned(JUDGED, Judged(relations, episode, rules, hulls, *scratch))
