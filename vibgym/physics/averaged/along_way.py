"""Mean acceleration of a part as a function of the phasors under it: at one instant, or as the mean along its way in a period.

It is affine in the phasors to first order and quadratic to second. Within a period the part crosses a good part of an element,
and its speed changes what friction does, by a way that is known beforehand, for it is the wanted acceleration that bends it.
Two Gauss points on it integrate what lies between.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym._numba.jit import borrowing
from vibgym.physics.averaged.averages import coupled, direction, first_order_at, interpolate
from vibgym.physics.averaged.contact import AveragedScheme, AveragedWorkspace, cut_at, new_workspace
from vibgym.physics.core.records import Body, Table
from vibgym.physics.planar.cut import cells_across
from vibgym.physics.planar.outline import POINTS_PER_PIECE


class Room(NamedTuple):
    """Working arrays for one part at a time."""

    contact: AveragedWorkspace
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
