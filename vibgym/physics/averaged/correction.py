"""Inverses of many worlds, and what makes them exact: corrections by what the planar model was found to do otherwise."""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym._numba.reference import reference
from vibgym.physics.averaged.along_way import evaluate
from vibgym.physics.averaged.inverse import invert_world, largest, row_times
from vibgym.physics.averaged.least_norm import WEAKEST, least_norm

UNEVEN = 10.0
"""How much longer than where elements move a part well a correction may be, and still be one step. Where they hardly move it in
some direction, the slope's small errors in the others count for much."""


@borrowing
def sharpen(task, count):
    """Leave in ``room.slope`` that of first order, made exact in the directions that steps take by it, the span of its rows.

    Broyden's slope is good in the directions that were gone, and may be anything in others.
    """
    room, n = task.room, 2 * count
    slope, basis, phasors = room.slope, room.basis, room.phasors
    ahead, behind = room.vectors[3], room.vectors[5]
    longest = 0.0
    for i in range(3):
        for k in range(n):
            slope[i, k], basis[i, k] = room.linear[i, k], room.linear[i, k]
        longest = max(longest, row_times(slope, i, slope[i], n))
    for i in range(3):
        for j in range(i):
            share = row_times(basis, i, basis[j], n)
            for k in range(n):
                basis[i, k] -= share * basis[j, k]
        square = row_times(basis, i, basis[i], n)
        shrink = 1.0 / math.sqrt(square) if square > WEAKEST * longest else 0.0
        for k in range(n):
            basis[i, k] *= shrink
    for i in range(3):
        # What is quadratic has the slope of its chord over equal ways to both sides.
        for k in range(n):
            room.step[k] = phasors[k]
            phasors[k] = room.step[k] + task.limit * basis[i, k]
        evaluate(task, count, ahead)
        for k in range(n):
            phasors[k] = room.step[k] - task.limit * basis[i, k]
        evaluate(task, count, behind)
        for k in range(n):
            phasors[k] = room.step[k]
        for j in range(3):
            rise = 0.5 / task.limit * (ahead[j] - behind[j]) - row_times(slope, j, basis[i], n)
            for k in range(n):
                slope[j, k] += rise * basis[i, k]


@borrowing
def write_motion(task, kept, world, amplitude, phase):
    """Write down the elements' motion from the phasors that are kept."""
    frequency, count = 2.0 * math.pi / task.table.period, kept.count[world]
    for j in range(count):
        c, s = kept.phasors[world, 2 * j], kept.phasors[world, 2 * j + 1]
        length = min(math.sqrt(c * c + s * s), task.limit)
        amplitude[world, kept.elements[world, j]] = length / (frequency * frequency)
        phase[world, kept.elements[world, j]] = math.atan2(s, c)


@borrowing
def write_result(task, kept, offset, world, count, reached, amplitude, phase, achieved, reachable):
    """Write down what :func:`invert_world` has found, and keep it."""
    room, arm = task.room, math.sqrt(task.body.gyration)
    kept.count[world] = count
    if reached and task.kept and task.limit > 0.0:
        sharpen(task, count)
    for j in range(count):
        kept.elements[world, j] = room.elements[j]
    for k in range(2 * count):
        kept.phasors[world, k] = room.phasors[k]
        for i in range(3):
            kept.slope[world, i, k] = room.slope[i, k]
    write_motion(task, kept, world, amplitude, phase)
    reachable[world] = reached
    for i in range(3):
        achieved[world, i] = room.vectors[4, i] / (arm if i == 2 else 1.0) - offset[world, i]
    if count == 0:
        achieved[world, 0] = math.nan


@borrowing
def invert_worlds(start, stop, task, pose, velocity, wrench, offset, kept, amplitude, phase, achieved, reachable):
    """Invert worlds ``start`` to ``stop``.

    Args:
        pose, velocity: (worlds, 3) mean ones at the start.
        wrench: (worlds, 3) wanted; it bends the part's way. What cannot be had is cut down.
        offset: (worlds, 3) what the averaged model is known to say too much by.
        kept: overwritten.
        amplitude, phase: (worlds, elements) zeros on entry; m and rad.
        achieved: (worlds, 3), NaN without support.
        reachable: (worlds,) whether that is what was wanted.
    """
    task, kept = reference(task), reference(kept)
    for world in range(start, stop):
        count, reached = invert_world(task, pose, velocity, wrench, offset, kept, world, False)
        write_result(task, kept, offset, world, count, reached, amplitude, phase, achieved, reachable)


@borrowing
def correct_worlds(
    start, stop, task, pose, velocity, wrench, offset, missing, kept, amplitude, phase, achieved, reachable
):
    """Add what is ``missing`` (worlds, 3) to what :func:`invert_worlds` has found.

    One step with the slope at hand is enough as long as the elements can and move the part well: an error of a few per
    cent then becomes one of a few tenths. Where it is not, the world is inverted again. ``offset`` contains what is missing.
    """
    task, kept = reference(task), reference(kept)
    room, arm = task.room, math.sqrt(task.body.gyration)
    left, phasors = room.vectors[3], room.phasors
    for world in range(start, stop):
        count = kept.count[world]
        for i in range(3):
            left[i] = (arm if i == 2 else 1.0) * missing[world, i]
        if reachable[world]:
            least_norm(kept.slope[world], 2 * count, left, room.matrix[0], room.matrix[1], room.step)
            matrix, square, asked = room.matrix[0], 0.0, 0.0
            for i in range(3):
                asked += left[i] * left[i]
            for k in range(2 * count):
                phasors[k] = kept.phasors[world, k] + room.step[k]
                square += room.step[k] * room.step[k]
            even = square * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) <= UNEVEN * UNEVEN * asked
            if even and largest(phasors, count) <= task.limit:
                for k in range(2 * count):
                    kept.phasors[world, k] = phasors[k]
                write_motion(task, kept, world, amplitude, phase)
                continue
        for j in range(count):
            amplitude[world, kept.elements[world, j]], phase[world, kept.elements[world, j]] = 0.0, 0.0
        before = reachable[world]
        count, reached = invert_world(task, pose, velocity, wrench, offset, kept, world, before)
        reached = reached and before  # an offset that was found at the limit does not hold elsewhere
        write_result(task, kept, offset, world, count, reached, amplitude, phase, achieved, reachable)
