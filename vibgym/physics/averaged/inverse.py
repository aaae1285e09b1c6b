"""Phasors of the elements under a part that give it a mean acceleration: the averaged model turned round, compiled.

To first order the phasors of least norm, and to second Broyden's method from there. What cannot be had is cut down.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym._numba.jit import borrowing
from vibgym.physics.averaged.along_way import evaluate, write_map
from vibgym.physics.averaged.least_norm import least_norm

ITERATIONS = 30
SCALINGS = 20
AT_LIMIT = 1e-4  # by which amplitudes may be above it while a wrench is cut down; in the end they are put on it
PASSES = 3
CLOSE = 1e-12  # error of the solution, over mu g
REACHED = 1e-10
LARGEST = 4.0
"""Times mu g: no change that is larger can be had, and Broyden's method starts from the smaller one of the same direction."""


class Kept(NamedTuple):
    """What has been found for every world, so that it can be corrected."""

    count: np.ndarray  # (worlds,) elements
    elements: np.ndarray  # (worlds, n)
    phasors: np.ndarray  # (worlds, 2 n) m/s^2
    slope: np.ndarray  # (worlds, 3, 2 n) of the mean acceleration in the phasors


def new_kept(worlds: int, n: int) -> Kept:
    """Room for parts on up to ``n`` elements."""
    return Kept(
        np.zeros(worlds, dtype=np.int64), np.empty((worlds, n), dtype=np.int64), np.empty((worlds, 2 * n)),
        np.empty((worlds, 3, 2 * n)),
    )  # fmt: skip


@borrowing
def row_times(matrix, i, vector, n):
    """Scalar product of a row and a vector."""
    total = 0.0
    for k in range(n):
        total += matrix[i, k] * vector[k]
    return total


@borrowing
def solve(task, count, target, close):
    """Phasors that give ``target``, from those at hand, by Broyden's method; each step is the one of least norm.

    The slope starts as that of first order, of which second order is a small change.
    """
    room = task.room
    slope, phasors, step = room.slope, room.phasors, room.step
    left, value, before = room.vectors[3], room.vectors[4], room.vectors[5]
    for i in range(3):
        for k in range(2 * count):
            slope[i, k] = room.linear[i, k]
    evaluate(task, count, value)
    for _ in range(ITERATIONS):
        for i in range(3):
            left[i], before[i] = target[i] - value[i], value[i]
        least_norm(slope, 2 * count, left, room.matrix[0], room.matrix[1], step)
        square = 0.0
        for k in range(2 * count):
            phasors[k] += step[k]
            square += step[k] * step[k]
        evaluate(task, count, value)
        moved = 0.0
        for i in range(3):
            expected = row_times(slope, i, step, 2 * count)
            moved = max(moved, abs(expected))
            left[i] = value[i] - before[i] - expected
        if moved <= close:  # before rounding errors get into the slope
            break
        for i in range(3):
            for k in range(2 * count):
                slope[i, k] += left[i] / square * step[k]


@borrowing
def largest(phasors, count):
    """Length of the longest phasor."""
    most = 0.0
    for j in range(count):
        c, s = phasors[2 * j], phasors[2 * j + 1]
        most = max(most, math.sqrt(c * c + s * s))
    return most


@borrowing
def invert(task, count, wrench, kept, world, near):
    """Phasors for a wrench (3), cut down to the limit along its difference from what friction does with elements at rest.

    ``near``: those near the ones that are kept, or else those near rest.
    """
    room = task.room
    idle, change, target, value = room.vectors[0], room.vectors[1], room.vectors[2], room.vectors[4]
    size = task.body.friction * task.table.gravity
    for k in range(2 * count):
        room.phasors[k] = 0.0
    evaluate(task, count, idle)
    length = 0.0
    for i in range(3):
        change[i] = wrench[i] - idle[i]
        length += change[i] * change[i]
    # The farthest point of the outline can turn the part more than push it.
    reach = LARGEST * size * (1.0 + task.body.radius / math.sqrt(task.body.gyration))
    scale = min(1.0, reach / max(math.sqrt(length), 1e-300))
    if near:
        for k in range(2 * count):
            room.phasors[k] = kept.phasors[world, k]
    for _ in range(SCALINGS):
        for i in range(3):
            target[i] = idle[i] + scale * change[i]
        solve(task, count, target, CLOSE * size)
        most = largest(room.phasors, count)
        if most <= task.limit * (1.0 + AT_LIMIT) or task.limit == 0.0:
            break
        scale *= task.limit / most
        for k in range(2 * count):
            room.phasors[k] = 0.0
    most = largest(room.phasors, count)
    if most > task.limit:
        for k in range(2 * count):
            room.phasors[k] *= task.limit / most
        evaluate(task, count, value)


@borrowing
def invert_world(task, pose, velocity, wrench, offset, kept, world, near):
    """Invert a world for ``wrench + offset``; returns the number of elements, 0 without support, and whether that is reached.

    Leaves the phasors in ``task.room``, and what they give in its row of ``vectors`` for values. ``near``: the same has been
    reached with less offset by the phasors that are kept. Where elements hardly move the part in some direction, others far
    from these may do the same, and what was found to be wrong with the averaged model would not hold for them.
    """
    room, body = task.room, task.body
    arm, size = math.sqrt(body.gyration), body.friction * task.table.gravity
    most = LARGEST * size * (1.0 + body.radius / arm)
    value, wanted, bent = room.vectors[4], room.vectors[6], room.vectors[7]
    length = 0.0
    for i in range(3):
        unit = arm if i == 2 else 1.0
        wanted[i], bent[i] = unit * (wrench[world, i] + offset[world, i]), unit * wrench[world, i]
        length += bent[i] * bent[i]
    scale = min(1.0, most / max(math.sqrt(length), 1e-300))
    bent[0], bent[1], bent[2] = scale * bent[0], scale * bent[1], scale * bent[2] / arm
    count, reached = 0, False
    for turn in range(PASSES):
        count = write_map(task, pose, velocity, bent, world)
        if count == 0:
            break
        invert(task, count, wanted, kept, world, near and turn == 0)
        error = max(abs(value[0] - wanted[0]), abs(value[1] - wanted[1]), abs(value[2] - wanted[2]))
        reached = error <= REACHED * size
        if reached or task.times[task.times.shape[0] - 1] == 0.0:
            break
        # What cannot be had does not bend the way either: once more along the way of what can.
        for i in range(3):
            bent[i] = value[i] / (arm if i == 2 else 1.0) - offset[world, i]
    return count, reached
