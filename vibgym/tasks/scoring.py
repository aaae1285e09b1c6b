"""The episodes of a batch of worlds, bound to the state that they are judged by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from vibgym.kernels.reference import Pinned, bound
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


Stage = Callable[[np.ndarray], None]


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
        players: (worlds, parts) bool, live: the parts of the episodes, on the table or not.
        rewarded: (worlds, parts) bool, live: the parts whom a step's reward is of.
        changed: (worlds, parts) bool, live: parts that have arrived or left in a step.
    """

    def __init__(self, task: Task, state: State, periods: int, motion: int = 0) -> None:
        worlds, parts = state.pose.shape[:2]
        self._task, self._rules, self._state = task, task.rules(periods), Pinned(STATE, state)
        self.relations = new_relations(worlds, parts)
        self.episode = new_episode(worlds, parts, len(self._rules.term), motion)
        self.players = self.rewarded = self.episode.present
        self.changed = self.episode.arrived
        self._judged = self.judged(self.relations)
        self._everyone = np.arange(worlds)

    def judged(self, relations: Relations) -> Pinned[Judged]:
        """What kernels need to bring such relations up to date, in one thread at a time; see :meth:`relating`."""
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

    def part_facts(self) -> dict[str, np.ndarray]:
        """What ``info["parts"]`` says besides what it says of every task's parts, each (worlds, parts); live arrays."""
        return {}

    def lines(self, world: int) -> list[np.ndarray]:
        """Lines (n, 2), m, along which the goals of a world's parts move, one for each part; none where they stay."""
        return []

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        """Start the episodes of ``worlds`` (index array), whose parts have been put down."""
        self.episode.goal[worlds], self.episode.present[worlds] = start.goal, start.present
        score_worlds(self._state.address, self._judged.address, True, worlds)

    def score(self) -> None:
        """Score one step of every world against the one before."""
        for stage in self.stages():
            stage(self._everyone)

    def stages(self) -> list[Stage]:
        """What scores a step of some worlds, one after the other, each called with their index array.

        It has working arrays of its own: those of several calls of this may be at work at the same time, on different worlds.
        """
        return [bound(score_worlds, self._state, self.judged(self.relations), False)]

    def relating(self, relations: Relations) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
        """What brings relations to other poses than the true ones up to date; as with :meth:`stages`.

        It is called with an index array of worlds, poses (worlds, parts, 3), and which parts are out of the way.
        """
        return bound(relate_worlds, self.judged(relations))
