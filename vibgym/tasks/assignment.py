"""Assignment of goals to parts of a kind: at the start of an episode, and by exchanges during it."""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.assignment import assign

EXCHANGE = 0.010
"""m, minimum reduction of two parts' distances to their goals for an exchange; prevents repeated exchanges to and fro."""


def give_out(kind: np.ndarray, present: np.ndarray, pose: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Return goals reassigned to the present parts within each kind; arguments and result as of :func:`reassign`."""
    result = np.array(goal)
    reassign(kind, present, np.ascontiguousarray(pose), result)
    return result


@jit(allocates=True)
def reassign(kind, present, pose, goal):
    """Reassign the goals of the present parts within each kind, in place: the sum of the cubed distances is the least.

    Args:
        kind: (parts,).  present: (worlds, parts) bool.
        pose, goal: (worlds, parts, 3) m, m, rad.
    """
    parts = kind.shape[0]
    members, column_of, goals = np.empty(parts, np.int64), np.empty(parts, np.int64), np.empty((parts, 3))
    for w in range(pose.shape[0]):
        for own in range(kind.max() + 1):
            count = 0
            for p in range(parts):
                if present[w, p] and kind[p] == own:
                    members[count] = p
                    goals[count] = goal[w, p]
                    count += 1
            cost = np.empty((count, count))
            for i in range(count):
                for j in range(count):
                    dx, dy = goals[j, 0] - pose[w, members[i], 0], goals[j, 1] - pose[w, members[i], 1]
                    cost[i, j] = (dx * dx + dy * dy) ** 1.5
            assign(cost, column_of)
            for i in range(count):
                goal[w, members[i]] = goals[column_of[i]]


@jit
def exchange_goals(kind, present, pose, goal, gain, worlds):
    """Exchange goals of two parts of a kind, in place, where the sum of their cubed distances, each plus ``gain``, decreases.

    Args:
        kind: (parts,).  present: (worlds, parts) bool.
        pose, goal: (worlds, parts, 2 or 3) m, m, rad.
        gain: m.
        worlds: (n,) index.
    """
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for i in range(kind.shape[0]):
            for j in range(i):
                if kind[i] != kind[j] or not (present[w, i] and present[w, j]):
                    continue
                now = cubed_distance(pose[w], i, goal[w], i, 0.0) + cubed_distance(pose[w], j, goal[w], j, 0.0)
                then = cubed_distance(pose[w], i, goal[w], j, gain) + cubed_distance(pose[w], j, goal[w], i, gain)
                if then < now:
                    for axis in range(goal.shape[2]):
                        goal[w, i, axis], goal[w, j, axis] = goal[w, j, axis], goal[w, i, axis]


@jit
def cubed_distance(pose, i, goal, j, gain):
    """Return the cube of the distance from pose i to goal j plus ``gain``, m^3."""
    x, y = goal[j, 0] - pose[i, 0], goal[j, 1] - pose[i, 1]
    distance = math.sqrt(x * x + y * y) + gain
    return distance * distance * distance
