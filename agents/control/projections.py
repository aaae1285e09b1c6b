"""Alternating projections: phasors that do what parts want, of elements that rest or move far enough. Compiled.

The wish is projected onto what elements can do, what is then missing is added to the wish as the phasors of least norm, and so
on from several starts. Of all that was come by, the one with the least expected error is taken: what is missing, and what the
spread of the elements' gains and phases makes of each piece's push.

Parts that share elements are served together, as a group; all others by themselves. A world's phasors are the same bits alone
and in a batch: the starts are a fixed table.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.control.allocation import DAMPING
from agents.control.pieces import cut_parts
from vibgym.physics.core.jit import borrowing

STARTS, ROUNDS = 16, 8
"""Starts, the least-norm phasors first, and projections from each."""

SPREAD = 0.1
"""Expected error of an element's push over its size: 5 % of gain and 5 degrees of phase."""


class Limits(NamedTuple):
    """What elements can do, as shares of full amplitude, and how it is looked for."""

    least: float  # smallest amplitude but rest
    most: float
    start: np.ndarray  # (STARTS, slots, 2) what is added to the least-norm phasors


class Work(NamedTuple):
    """Scratch of one world."""

    group: np.ndarray  # (parts,) int64: the first part with which each shares elements, directly or not
    slot: np.ndarray  # (elements,) int64: where an element stands in the list of its group; -1: not under a part
    element: np.ndarray  # (room,) int64: the list
    covered: np.ndarray  # (room,) share of parts on it
    at: np.ndarray  # (parts,) int64: where a part stands in its group
    gram: np.ndarray  # (3 parts, 3 parts): Gram matrix and its Cholesky factor
    missing: np.ndarray  # (3 parts,)
    wish: np.ndarray  # (room, 2) phasors, accumulated
    done: np.ndarray  # (room, 2) the same as the elements can do it
    best: np.ndarray  # (room, 2)


def new_work(parts: int, elements: int, room: int) -> Work:
    """Scratch for worlds of so many parts, elements and pieces."""
    return Work(
        group=np.zeros(parts, dtype=np.int64),
        slot=np.full(elements, -1, dtype=np.int64),
        element=np.zeros(room, dtype=np.int64),
        covered=np.zeros(room),
        at=np.zeros(parts, dtype=np.int64),
        gram=np.zeros((3 * parts, 3 * parts)),
        missing=np.zeros(3 * parts),
        wish=np.zeros((room, 2)),
        done=np.zeros((room, 2)),
        best=np.zeros((room, 2)),
    )


def start_table(slots: int, size: float) -> np.ndarray:
    """Vectors (STARTS, slots, 2) spread evenly over the disc of radius ``size``, those of the first start zero."""
    k = np.arange(STARTS * slots, dtype=np.float64).reshape(STARTS, slots)
    # Kronecker's sequence; powers of the plastic number fill the square evenly (M. Roberts 2018).
    radius, turn = size * np.sqrt(k * 0.7548776662466927 % 1.0), 2.0 * math.pi * (k * 0.5698402909980532 % 1.0)
    table = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    table[0] = 0.0
    return table


@borrowing
def group_parts(pieces, count, parts, group, slot):
    """Number the parts by the groups that share elements; leaves -1 in ``slot``."""
    for p in range(parts):
        group[p] = p
    for i in range(count):
        e, p = pieces.element[i], pieces.part[i]
        if slot[e] < 0:
            slot[e] = p
        elif group[slot[e]] != group[p]:
            low, high = min(group[slot[e]], group[p]), max(group[slot[e]], group[p])
            for q in range(parts):
                if group[q] == high:
                    group[q] = low
    for i in range(count):
        slot[pieces.element[i]] = -1


@borrowing
def factor(matrix, n):
    """Cholesky's factor of a positive definite matrix, in its lower triangle."""
    for j in range(n):
        for i in range(j, n):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(value) if i == j else value / matrix[j, j]


@borrowing
def solve(matrix, n, values):
    """Solve with the factor of :func:`factor`, in place."""
    for i in range(n):
        for k in range(i):
            values[i] -= matrix[i, k] * values[k]
        values[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            values[i] -= matrix[k, i] * values[k]
        values[i] /= matrix[i, i]


@borrowing
def gather(pieces, count, own, work):
    """List a group's parts and elements, and factor the Gram matrix of its fields; returns the numbers of both."""
    group, slot, at, gram = work.group, work.slot, work.at, work.gram
    parts, elements = 0, 0
    for p in range(group.shape[0]):
        if group[p] == own:
            at[p] = parts
            parts += 1
    for i in range(count):
        if group[pieces.part[i]] == own:
            e = pieces.element[i]
            if slot[e] < 0:
                slot[e] = elements
                work.element[elements], work.covered[elements] = e, 0.0
                elements += 1
            work.covered[slot[e]] += pieces.share[i]
    for i in range(3 * parts):
        for j in range(3 * parts):
            gram[i, j] = DAMPING if i == j else 0.0
    for i in range(count):
        p = pieces.part[i]
        if group[p] != own:
            continue
        a, ax, ay, p = pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1], 3 * at[p]
        for j in range(count):
            if pieces.element[j] != pieces.element[i]:
                continue
            weight = 1.0 / work.covered[slot[pieces.element[i]]]
            b, bx, by, q = pieces.share[j], pieces.lever[j, 0], pieces.lever[j, 1], 3 * at[pieces.part[j]]
            gram[p, q] += weight * a * b
            gram[p + 1, q + 1] += weight * a * b
            gram[p, q + 2] -= weight * a * by
            gram[p + 1, q + 2] += weight * a * bx
            gram[p + 2, q] -= weight * ay * b
            gram[p + 2, q + 1] += weight * ax * b
            gram[p + 2, q + 2] += weight * (ax * bx + ay * by)
    factor(gram, 3 * parts)
    return parts, elements


@borrowing
def miss(pieces, count, own, wanted, phasors, work):
    """What the group's parts lack under ``phasors``, in ``work.missing``; returns the expected error, squared."""
    missing, expected = work.missing, 0.0
    for p in range(work.group.shape[0]):
        if work.group[p] == own:
            for k in range(3):
                missing[3 * work.at[p] + k] = wanted[p, k]
    for i in range(count):
        if work.group[pieces.part[i]] != own:
            continue
        a, ax, ay = pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1]
        j, p = work.slot[pieces.element[i]], 3 * work.at[pieces.part[i]]
        x, y = phasors[j, 0], phasors[j, 1]
        missing[p] -= a * x
        missing[p + 1] -= a * y
        missing[p + 2] -= ax * y - ay * x
        expected += SPREAD * SPREAD * (a * a + ax * ax + ay * ay) * (x * x + y * y)
    for p in range(work.group.shape[0]):
        if work.group[p] == own:
            for k in range(3):
                expected += missing[3 * work.at[p] + k] ** 2
    return expected


@borrowing
def add_missing(pieces, count, own, parts, work):
    """Add to the wish the phasors of least mean square over the covered area that do what is missing."""
    command = work.missing
    solve(work.gram, 3 * parts, command)
    for i in range(count):
        if work.group[pieces.part[i]] != own:
            continue
        j, p = work.slot[pieces.element[i]], 3 * work.at[pieces.part[i]]
        a, ax, ay = pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1]
        work.wish[j, 0] += (a * command[p] - ay * command[p + 2]) / work.covered[j]
        work.wish[j, 1] += (a * command[p + 1] + ax * command[p + 2]) / work.covered[j]


@borrowing
def project(limits, elements, wish, done):
    """The nearest that elements can do: rest, or an amplitude within the limits; returns whether the dead zone took any."""
    taken = False
    for j in range(elements):
        x, y = wish[j, 0], wish[j, 1]
        length = math.sqrt(x * x + y * y)
        scale = 1.0
        if length > limits.most:
            scale = limits.most / length
        elif length < limits.least:
            scale = limits.least / length if length > 0.5 * limits.least else 0.0
            taken = taken or length > 0.0
        done[j, 0], done[j, 1] = scale * x, scale * y
    return taken


@borrowing
def serve_group(limits, pieces, count, own, wanted, work):
    """Find phasors for a group of parts, into ``work.best``; returns the number of elements."""
    parts, elements = gather(pieces, count, own, work)
    wish, done, best, least = work.wish, work.done, work.best, math.inf
    for start in range(limits.start.shape[0]):
        for j in range(elements):
            done[j, 0], done[j, 1] = 0.0, 0.0
            wish[j, 0] = limits.start[start, j % limits.start.shape[1], 0]
            wish[j, 1] = limits.start[start, j % limits.start.shape[1], 1]
        miss(pieces, count, own, wanted, wish, work)
        add_missing(pieces, count, own, parts, work)
        for turn in range(ROUNDS):
            taken = project(limits, elements, wish, done)
            expected = miss(pieces, count, own, wanted, done, work)
            if expected < least:
                least = expected
                for j in range(elements):
                    best[j, 0], best[j, 1] = done[j, 0], done[j, 1]
            if start == 0 and turn == 0 and not taken:
                return elements  # those of least norm will do
            add_missing(pieces, count, own, parts, work)
    return elements


@borrowing
def serve(outlines, limits, pose, present, wanted, pieces, work, push):
    """Pushes of all elements of all worlds, see :meth:`agents.control.dead_zone.DeadZoneAllocator.pushes`.

    Args:
        outlines: of :func:`agents.control.pieces.outlines_of`.
        limits: of the elements.
        pose, wanted: (worlds, parts, 3).  present: (worlds, parts) bool.
        pieces, work: scratch.
        push: (worlds, rows, columns, 2), overwritten.
    """
    for w in range(pose.shape[0]):
        push[w] = 0.0
        count = cut_parts(outlines, pose[w], present[w], pieces)
        group_parts(pieces, count, pose.shape[1], work.group, work.slot)
        for own in range(pose.shape[1]):
            if work.group[own] != own or not present[w, own]:
                continue
            moves = False
            for p in range(pose.shape[1]):
                if work.group[p] == own and present[w, p]:
                    moves = moves or wanted[w, p, 0] != 0.0 or wanted[w, p, 1] != 0.0 or wanted[w, p, 2] != 0.0
            if not moves:
                continue
            elements = serve_group(limits, pieces, count, own, wanted[w], work)
            for j in range(elements):
                row, column = work.element[j] // outlines.columns, work.element[j] % outlines.columns
                push[w, row, column, 0], push[w, row, column, 1] = work.best[j, 0], work.best[j, 1]
                work.slot[work.element[j]] = -1
