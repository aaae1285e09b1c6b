"""Least time in which several parts can all be at their goals: that of the slowest, as if each were alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds.time_bound import LARGEST, TimeBound


class SeveralBound:
    """Fewest steps, and least time, in which several parts can succeed together: all at once, and held there.

    Nobody can have all parts at their goals before the slowest of them could have been there with the table to itself. That
    they are in one another's way and share elements is left out. So is what one part may do for another by a push:
    ``docs/bound.md`` says why that does not count.

    Args:
        bounds: of every part, in order; with the same surface, hold and steps.

    Raises:
        ValueError: none, or bounds that look at parts at other moments.
    """

    def __init__(self, bounds: Sequence[TimeBound]) -> None:
        self.bounds = tuple(checks.instance(f"bounds[{k}]", each, TimeBound) for k, each in enumerate(bounds))
        moments = {(each.surface.period, each.stride, each.hold) for each in self.bounds}
        if len(moments) != 1:
            raise checks.refuse("bounds", sorted(moments), "one of every part, with the same period, steps and hold")

    @property
    def step_time(self) -> float:
        """s."""
        return self.bounds[0].step_time

    def each(self, start: Any, goal: Any) -> np.ndarray:
        """Fewest steps of every part alone, int64 (n, parts).

        Args:
            start, goal: (n, parts, 3) poses, m and rad.

        Raises:
            ValueError: other shapes, or numbers that are not finite.
        """
        start, goal = self._poses("start", start), self._poses("goal", goal)
        goal = checks.array("goal", goal, start.shape)
        return np.stack([each.steps(start[:, k], goal[:, k]) for k, each in enumerate(self.bounds)], axis=1)

    def steps(self, start: Any, goal: Any, counts: np.ndarray | None = None) -> np.ndarray:
        """Fewest steps to success, int64 (n,), the hold's own included, where every part has a goal of its own.

        Args:
            start, goal: see :meth:`each`.
            counts: (n, parts) bool, which parts are there and have something asked of them; None: all.
        """
        found = self.each(start, goal)
        return np.max(found, axis=1, where=True if counts is None else counts, initial=self.bounds[0].least_steps)

    def free_steps(self, start: Any, goal: Any, group: Any, counts: np.ndarray | None = None) -> np.ndarray:
        """The same where every part may take any goal of its group: the least over all assignments of the slowest.

        Args:
            start, goal, counts: see :meth:`steps`; there are as many goals as parts, those of the parts that count.
            group: (parts,) whole numbers. Parts of a group are alike.
        """
        start, goal = self._poses("start", start), self._poses("goal", goal)
        group = checks.array("group", group, (len(self.bounds),), dtype=np.int64)
        there = np.ones(start.shape[:2], dtype=bool) if counts is None else counts
        result = np.full(len(start), self.bounds[0].least_steps)
        for name in np.unique(group):
            members = np.flatnonzero(group == name)
            size = len(members)
            rows, columns = np.repeat(members, size), np.tile(members, size)
            steps = self.bounds[members[0]].steps(start[:, rows].reshape(-1, 3), goal[:, columns].reshape(-1, 3))
            for world, cost in enumerate(steps.reshape(-1, size, size)):
                here = there[world, members]
                if here.any():
                    result[world] = max(result[world], bottleneck(cost[np.ix_(here, here)]))
        return result

    def seconds(self, start: Any, goal: Any, counts: np.ndarray | None = None) -> np.ndarray:
        """Least time to success, s (n,); see :meth:`steps`."""
        return self.step_time * self.steps(start, goal, counts)

    def _poses(self, name: str, value: Any) -> np.ndarray:
        shape = (len(np.atleast_1d(np.asarray(value))), len(self.bounds), 3)
        return checks.array(name, value, shape, least=-LARGEST, most=LARGEST)


def bottleneck(cost: np.ndarray) -> Any:
    """Largest entry of that assignment of rows to columns whose largest entry is least; ``cost`` (n, n).

    It is the least threshold at which the entries up to it hold a perfect matching, found by bisection; matchings grow by
    augmenting paths (Burkard, Dell'Amico and Martello, "Assignment problems", SIAM 2009, section 6.2).
    """
    levels = np.unique(cost)
    low, high = 0, len(levels) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if _matches(cost <= levels[middle]) else (middle + 1, high)
    return levels[low]


def _matches(allowed: np.ndarray) -> bool:
    """Whether every row can have an allowed column of its own."""
    columns, owner = [np.flatnonzero(row).tolist() for row in allowed], [-1] * len(allowed)

    def finds(row: int, seen: set[int]) -> bool:
        for column in columns[row]:
            if column not in seen:
                seen.add(column)
                if owner[column] < 0 or finds(owner[column], seen):
                    owner[column] = row
                    return True
        return False

    return all(finds(row, set()) for row in range(len(allowed)))
