"""Goal exchange between parts of a kind during an episode: such parts are interchangeable, so that none has to be passed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import bound
from vibgym.physics.core.records import State
from vibgym.tasks.scoring import Scoring, Stage

if TYPE_CHECKING:
    from vibgym.tasks.base import Task


EXCHANGE = 0.010
"""m, minimum reduction of two parts' distances to their goals for an exchange; prevents repeated exchanges to and fro."""


@borrowing
def exchange_goals(kind, present, pose, goal, gain, worlds):
    """Let parts of a kind exchange goals, in place, where their ways, each cubed with ``gain`` (m) more, then add up to less.

    Args:
        kind: (parts,).  present: (worlds, parts) bool.
        pose, goal: (worlds, parts, 2 or 3) m, m, rad.
        worlds: (n,) index.
    """
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for i in range(kind.shape[0]):
            for j in range(i):
                if kind[i] != kind[j] or not (present[w, i] and present[w, j]):
                    continue
                now = cubed_way(pose[w], i, goal[w], i, 0.0) + cubed_way(pose[w], j, goal[w], j, 0.0)
                then = cubed_way(pose[w], i, goal[w], j, gain) + cubed_way(pose[w], j, goal[w], i, gain)
                if then < now:
                    for axis in range(goal.shape[2]):
                        goal[w, i, axis], goal[w, j, axis] = goal[w, j, axis], goal[w, i, axis]


@borrowing
def cubed_way(pose, i, goal, j, gain):
    """Cube of the way from pose i to goal j and ``gain`` more, m^3."""
    x, y = goal[j, 0] - pose[i, 0], goal[j, 1] - pose[i, 1]
    way = math.sqrt(x * x + y * y) + gain
    return way * way * way


class FreeScoring(Scoring):
    """Scores episodes in which parts of a kind exchange goals where that makes their ways shorter.

    Args:
        task, state, periods: see :class:`vibgym.tasks.scoring.Scoring`.
        free: whether parts exchange goals.
    """

    def __init__(self, task: Task, state: State, periods: int, free: bool = True) -> None:
        super().__init__(task, state, periods)
        self._free, self._kind, self._pose = free, np.ascontiguousarray(task.kind), state.pose

    def stages(self) -> list[Stage]:
        exchange = bound(exchange_goals, self._kind, self.episode.present, self._pose, self.episode.goal, EXCHANGE)
        return [*([exchange] if self._free else []), *super().stages()]
