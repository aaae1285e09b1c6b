"""Phasors of the elements under a part that give it a mean acceleration: the averaged model turned round, compiled.

The mean acceleration is affine in the phasors to first order and quadratic to second. It is asked for at one instant, or as the
mean over a period: the part then crosses a good part of an element, and its speed changes what friction does, by a way that is
known beforehand, for it is the wanted acceleration that bends it. Two Gauss points on it integrate what lies between.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.averaged.averages import coupled, direction, first_order_at, interpolate
from vibgym.physics.averaged.contact import AveragedScheme, Workspace, cut_at, new_workspace
from vibgym.physics.averaged.least_norm import WEAKEST, least_norm
from vibgym.physics.contact_area.cut import cells_across
from vibgym.physics.contact_area.outline import POINTS_PER_PIECE
from vibgym.physics.core.jit import borrowing
from vibgym.physics.core.records import Body, Table
from vibgym.physics.core.reference import reference

ITERATIONS = 30
SCALINGS = 20
AT_LIMIT = 1e-4  # by which amplitudes may be above it while a wrench is cut down; in the end they are put on it
PASSES = 3
CLOSE = 1e-12  # error of the solution, over mu g
REACHED = 1e-10
LARGEST = 4.0
"""Times mu g: no change that is larger can be had, and Broyden's method starts from the smaller one of the same direction."""

UNEVEN = 10.0
"""How much longer than where elements move a part well a correction may be, and still be one step. Where they hardly move it in
some direction, the slope's small errors in the others count for much."""


class Room(NamedTuple):
    """Working arrays for one part at a time."""

    contact: Workspace
    elements: np.ndarray  # (n) under the part, at one of the points of its way or another
    shares: np.ndarray  # (points, 6, n) of 1, x, y, xx, xy, yy of the load
    coupling: np.ndarray  # (points, 27)
    heading: np.ndarray  # (points, 2) cosine and sine of the direction of the mean velocity
    constant: np.ndarray  # (3) m/s^2, all accelerations in this file; angular ones times the radius of gyration
    linear: np.ndarray  # (3, 2 n)
    slope: np.ndarray  # (3, 2 n)
    basis: np.ndarray  # (3, 2 n)
    phasors: np.ndarray  # (2 n) C_1, S_1, C_2, ...; m/s^2
    step: np.ndarray  # (2 n)
    vectors: np.ndarray  # (8, 3) idle, change, target, left, value, before, wrench, course
    matrix: np.ndarray  # (2, 3, 3)


class Inversion(NamedTuple):
    """What is inverted; kernels hand it on by reference."""

    table: Table
    body: Body
    scheme: AveragedScheme
    times: np.ndarray  # (points) s, after the start of the period
    weights: np.ndarray  # (points) sum 1
    limit: float  # m/s^2, largest length of a phasor
    kept: bool  # whether what is found will be corrected
    room: Room


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


def new_room(table: Table, body: Body, points: int) -> Room:
    """Working arrays for parts like ``body``."""
    contact = new_workspace(table, body)
    n = min(table.rows * table.columns, points * cells_across(table, body, 1) ** 2)
    return Room(
        contact=contact, elements=np.zeros(n, dtype=np.int64), shares=np.zeros((points, 6, n)),
        coupling=np.zeros((points, 27)), heading=np.zeros((points, 2)), constant=np.zeros(3),
        linear=np.zeros((3, 2 * n)), slope=np.zeros((3, 2 * n)), basis=np.zeros((3, 2 * n)), phasors=np.zeros(2 * n),
        step=np.zeros(2 * n),
        vectors=np.zeros((8, 3)), matrix=np.zeros((2, 3, 3)),
    )  # fmt: skip


@borrowing
def cut_on_way(task, pose, velocity, course, world, point):
    """Cut the outline at a point of the way; returns number of contact points and mean velocity there.

    Where the part would have no support it is taken where it starts.
    """
    t, contact = task.times[point], task.room.contact
    half = 0.5 * t * t
    vx, vy = velocity[world, 0] + t * course[0], velocity[world, 1] + t * course[1]
    spin = velocity[world, 2] + t * course[2]
    n = cut_at(
        task.table, task.body,
        pose[world, 0] + t * velocity[world, 0] + half * course[0],
        pose[world, 1] + t * velocity[world, 1] + half * course[1],
        pose[world, 2] + t * velocity[world, 2] + half * course[2],
        spin, contact,
    )  # fmt: skip
    if n == 0:
        n = cut_at(task.table, task.body, pose[world, 0], pose[world, 1], pose[world, 2], spin, contact)
    return n, vx, vy, spin


@borrowing
def column_of(room, element, count):
    """Place of an element among the ``count`` that are listed; a new one is put behind them, with zeros."""
    for j in range(count):
        if room.elements[j] == element:
            return j
    room.elements[count] = element
    for point in range(room.shares.shape[0]):
        for i in range(6):
            room.shares[point, i, count] = 0.0
    for i in range(3):
        room.linear[i, 2 * count], room.linear[i, 2 * count + 1] = 0.0, 0.0
    return count


@borrowing
def write_map(task, pose, velocity, course, world):
    """Write down the mean acceleration along the way as a function of phasors; returns how many elements, 0: no support."""
    table, body, scheme, room = task.table, task.body, task.scheme, task.room
    contact, linear = room.contact, room.linear
    cut, tables = contact.cut, scheme.tables
    points, under = cut.points, cut.under
    count, arm, inverse = 0, math.sqrt(body.gyration), 1.0 / table.speed
    for i in range(3):
        room.constant[i] = 0.0
    for point in range(task.times.shape[0]):
        n, vx, vy, spin = cut_on_way(task, pose, velocity, course, world, point)
        if n == 0:
            return 0
        size = body.friction * task.weights[point]
        shares = room.shares[point]
        length, cosine, sine = direction(vx, vy)
        interpolate(tables.coupling, tables.coupling_scale, length / table.speed, contact.scratch)
        room.heading[point, 0], room.heading[point, 1] = cosine, sine
        for k in range(27):
            room.coupling[point, k] = contact.scratch.values[k]
        for first in range(0, n, POINTS_PER_PIECE):
            if points[0, first] == 0.0:  # padding
                continue
            j = column_of(room, under[first // POINTS_PER_PIECE], count)
            count = max(count, j + 1)
            for k in range(first, first + POINTS_PER_PIECE):
                weight, x, y = points[0, k], points[1, k], points[2, k]
                shares[0, j] += weight
                shares[1, j] += weight * x
                shares[2, j] += weight * y
                shares[3, j] += weight * x * x
                shares[4, j] += weight * x * y
                shares[5, j] += weight * y * y
                gx, gy, cx, cy, sx, sy = first_order_at(
                    tables, inverse * (vx - spin * y), inverse * (vy + spin * x), contact.scratch
                )
                weight *= size
                load = weight * table.gravity
                x, y = x / arm, y / arm
                room.constant[0] += load * gx
                room.constant[1] += load * gy
                room.constant[2] += load * (x * gy - y * gx)
                linear[0, 2 * j] += weight * cx
                linear[1, 2 * j] += weight * cy
                linear[2, 2 * j] += weight * (x * cy - y * cx)
                linear[0, 2 * j + 1] += weight * sx
                linear[1, 2 * j + 1] += weight * sy
                linear[2, 2 * j + 1] += weight * (x * sy - y * sx)
    return count


@borrowing
def evaluate(task, count, value):
    """Mean acceleration under ``room.phasors``, into ``value`` (3)."""
    table, body, room = task.table, task.body, task.room
    phasors, linear, moments = room.phasors, room.linear, room.contact.moments
    for i in range(3):
        total = room.constant[i]
        for k in range(2 * count):
            total += linear[i, k] * phasors[k]
        value[i] = total
    if task.scheme.order == 1:
        return
    small, arm = body.friction * body.friction * table.period / (2.0 * math.pi), math.sqrt(body.gyration)
    for point in range(task.times.shape[0]):
        shares = room.shares[point]
        for i in range(6):
            load, c, s = 0.0, 0.0, 0.0
            for j in range(count):
                load += shares[i, j]
                c += shares[i, j] * phasors[2 * j]
                s += shares[i, j] * phasors[2 * j + 1]
            moments[i, 0], moments[i, 1], moments[i, 2] = load, c, s
        fx, fy, torque = coupled(
            room.coupling[point], moments, table.gravity, table.speed, body.gyration,
            room.heading[point, 0], room.heading[point, 1], room.contact.scratch.turned,
        )  # fmt: skip
        size = small * task.weights[point]
        value[0] += size * fx
        value[1] += size * fy
        value[2] += size / arm * torque


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
