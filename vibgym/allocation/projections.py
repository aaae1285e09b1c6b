"""Alternating projections: phasors with a wanted effect, of elements that rest or move at least a smallest amplitude.

The target phasors are projected onto the feasible ones, the missing effect is added to the target with phasors of least norm,
and so on, from several starts spread over the disc of infeasible pushes. Of all iterates, the one with the least expected error
is taken: the missing effect, and the effect of the spread of the elements' gains and phases.

Elements without a smallest amplitude need no starts, see :mod:`vibgym.allocation.convex`.

Parts that share elements are allocated together, as a group. The starts are a fixed table, so that a world's phasors are the
same bits alone and in a batch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.allocation.convex import project
from vibgym.allocation.cut import Outlines, Pieces, cut_parts, new_pieces
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

DAMPING = 0.003
"""Damping of conflicting targets, as a share of the mean square."""

STARTS, ROUNDS = 64, 16
"""Starts, the least-norm phasors first, and projections from each, where less is wanted than an element's smallest amplitude
gives. Starts are the innermost index, so that loops over them become vector instructions."""

FEW_STARTS, FEW_ROUNDS = 8, 8
"""The same for larger wanted effects."""

HALVING = 4
"""Projections after which the worse half of many starts is dropped."""

SPREAD = 0.16
"""Expected error of an element's push over its size: 5 % of gain and 5 degrees of phase are 0.10. A little more makes parts
rest longer at a goal, since it penalizes pulses of many elements against each other."""

SLOTS = 64
"""Elements of a group with different starts."""

TINY = 1e-300  # replaces a length of zero in divisions


class Limits(NamedTuple):
    """Feasible amplitudes, as shares of full amplitude, and parameters of the search."""

    least: float  # smallest amplitude other than 0
    most: float
    start: np.ndarray  # (SLOTS, 2, STARTS), what is added to the least-norm phasors
    starts: int = STARTS  # numbers that kernels take at run time: loops over constants are unrolled, not vectorised
    rounds: int = ROUNDS
    few_starts: int = FEW_STARTS
    few_rounds: int = FEW_ROUNDS
    soft: float = 0.0  # width of a dead zone that is compensated, below which commands are raised
    power: float = 1.0  # of a command over that width by which it is multiplied


class Problem(NamedTuple):
    """Parts, elements and their limits."""

    outlines: Outlines
    limits: Limits
    gain: np.ndarray  # (worlds or 1, elements) from commanded to actual phasors
    spread: np.ndarray  # (worlds or 1, elements) expected error of an element's push over its size


class Scratch(NamedTuple):
    """Scratch of one world."""

    pieces: Pieces
    group: np.ndarray  # (parts,) int64: the first part with which each shares elements, directly or not
    slot: np.ndarray  # (elements,) int64: index of an element in its group; -1: not under a part
    first: np.ndarray  # (parts + 1,) int64: first piece of each part, and the one after the last
    earlier: np.ndarray  # (room,) int64: of each piece of the group, the one before it on the same element, or -1
    latest: np.ndarray  # (room,) int64: the last piece on each element
    element: np.ndarray  # (room,) int64: elements of the group
    covered: np.ndarray  # (room,) shares of parts on each of them, summed
    part_index: np.ndarray  # (room,) int64: of each piece of the group, three times the index of its part
    element_index: np.ndarray  # (room,) int64: of each piece, index of its element
    lever: np.ndarray  # (3, room): of each piece, share and lever in radii of gyration, times the gain of its element
    weight: np.ndarray  # (room,): of each piece, one over the shares on its element
    variance: np.ndarray  # (room,) of each piece, squared error of its push over the element's squared push
    inverse: np.ndarray  # (3 parts, 3 parts): of the Gram matrix
    wanted: np.ndarray  # (3 parts,) wanted effect on the group's parts
    missing: np.ndarray  # (3 parts, STARTS) missing effect
    command: np.ndarray  # (3 parts, STARTS) strengths of the fields with the missing effect
    target: np.ndarray  # (room, 2, STARTS) accumulated phasors
    expected: np.ndarray  # (STARTS,) squared error
    strength: np.ndarray  # (2, 3 parts) of vibgym.allocation.convex: of a projection, and the best ones
    push: np.ndarray  # (2, room): best feasible phasors of the elements, x and y


def new_scratch(surface: Surface, kinds: Sequence[Part]) -> Scratch:
    """Return scratch memory of one thread."""
    pieces, parts = new_pieces(surface, kinds), len(kinds)
    room = -(-len(pieces.part) // LANES) * LANES  # whole vectors
    return Scratch(
        pieces=pieces,
        group=np.zeros(parts, dtype=np.int64),
        slot=np.full(surface.rows * surface.columns, -1, dtype=np.int64),
        first=np.zeros(parts + 1, dtype=np.int64),
        earlier=np.zeros(room, dtype=np.int64),
        latest=np.zeros(room, dtype=np.int64),
        element=np.zeros(room, dtype=np.int64),
        covered=np.zeros(room),
        part_index=np.zeros(room, dtype=np.int64),
        element_index=np.zeros(room, dtype=np.int64),
        lever=np.zeros((3, room)),
        weight=np.zeros(room),
        variance=np.zeros(room),
        inverse=np.zeros((3 * parts, 3 * parts)),
        wanted=np.zeros(3 * parts),
        missing=np.zeros((3 * parts, STARTS)),
        command=np.zeros((3 * parts, STARTS)),
        target=np.zeros((room, 2, STARTS)),
        expected=np.zeros(STARTS),
        strength=np.zeros((2, 3 * parts)),
        push=np.zeros((2, room)),
    )


def start_table(size: float) -> np.ndarray:
    """Return vectors (SLOTS, 2, STARTS), spread evenly over the disc of radius ``size``; zeros for the first start."""
    k = np.arange(STARTS * SLOTS, dtype=np.float64).reshape(STARTS, SLOTS).T
    # Kronecker's sequence; powers of the plastic number fill the square evenly (M. Roberts 2018).
    radius, turn = size * np.sqrt(k * 0.7548776662466927 % 1.0), 2.0 * math.pi * (k * 0.5698402909980532 % 1.0)
    table = np.ascontiguousarray(np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1))
    table[..., 0] = 0.0
    return table


@jit
def group_parts(pieces, count, parts, group, slot, first):
    """Find the first piece of each part, and number the parts by the groups that share elements; leaves -1 in ``slot``."""
    at = 0
    for p in range(parts):
        group[p], first[p] = p, at
        while at < count and pieces.part[at] == p:
            at += 1
    first[parts] = at
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


@jit
def invert(matrix, n):
    """Invert a positive definite matrix (n, n) in place by Gauss-Jordan elimination, without pivoting."""
    for k in range(n):
        pivot = 1.0 / matrix[k, k]
        matrix[k, k] = 1.0
        for j in range(n):
            matrix[k, j] *= pivot
        for i in range(n):
            if i != k:
                share = matrix[i, k]
                matrix[i, k] = 0.0
                for j in range(n):
                    matrix[i, j] -= share * matrix[k, j]


@jit
def add_pair(gram, weight, lever, p, i, q, j):
    """Add the product of fields ``p`` and ``q`` (first row of a part) on pieces ``i`` and ``j`` of an element."""
    a, ax, ay = weight * lever[0, i], weight * lever[1, i], weight * lever[2, i]
    b, bx, by = lever[0, j], lever[1, j], lever[2, j]
    gram[p, q] += a * b
    gram[p + 1, q + 1] += a * b
    gram[p, q + 2] -= a * by
    gram[p + 1, q + 2] += a * bx
    gram[p + 2, q] -= ay * b
    gram[p + 2, q + 1] += ax * b
    gram[p + 2, q + 2] += ax * bx + ay * by


@jit
def gather(problem, world, wanted, own, work):
    """List a group's parts, elements and pieces, and invert the Gram matrix of its fields; returns the numbers of all three.

    A part's field is a uniform push and a rotation. The pushes have the least mean square over the covered area among all
    pushes with the wanted effect; under a single part they are therefore uniform.
    """
    group, slot, inverse, lever, pieces = work.group, work.slot, work.inverse, work.lever, work.pieces
    gain = problem.gain[min(world, problem.gain.shape[0] - 1)]
    spread = problem.spread[min(world, problem.spread.shape[0] - 1)]
    parts, elements, n = 0, 0, 0
    for p in range(group.shape[0]):
        if group[p] != own:
            continue
        for k in range(3):
            work.wanted[3 * parts + k] = wanted[p, k]
        for i in range(work.first[p], work.first[p + 1]):
            e, share, ax, ay = pieces.element[i], pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1]
            if slot[e] < 0:
                slot[e] = elements
                work.element[elements], work.covered[elements], work.latest[elements] = e, 0.0, -1
                elements += 1
            at = slot[e]
            work.covered[at] += share
            work.earlier[n], work.latest[at] = work.latest[at], n
            work.part_index[n], work.element_index[n] = 3 * parts, at
            lever[0, n], lever[1, n], lever[2, n] = gain[e] * share, gain[e] * ax, gain[e] * ay
            work.variance[n] = spread[e] * spread[e] * (share * share + ax * ax + ay * ay)
            n += 1
        parts += 1
    for i in range(3 * parts):
        for j in range(3 * parts):
            inverse[i, j] = DAMPING if i == j else 0.0
    for i in range(n):
        work.weight[i] = 1.0 / work.covered[work.element_index[i]]
        add_pair(inverse, work.weight[i], lever, work.part_index[i], i, work.part_index[i], i)
        j = work.earlier[i]
        while j >= 0:
            add_pair(inverse, work.weight[i], lever, work.part_index[i], i, work.part_index[j], j)
            add_pair(inverse, work.weight[i], lever, work.part_index[j], j, work.part_index[i], i)
            j = work.earlier[j]
    invert(inverse, 3 * parts)
    return parts, elements, n


@jit(inline=True)
def want(missing, wanted, n, lanes):
    """Initialize the missing effect with the wanted one."""
    for k in range(n):
        whole = wanted[k]
        for lane in range(lanes):
            missing[k, lane] = whole


@jit(inline=True)
def give(missing, p, lane, a, ax, ay, x, y):
    """Subtract the effect of push ``(x, y)`` on a piece of share ``a`` and lever ``(ax, ay)`` from the missing effect."""
    missing[p, lane] -= a * x
    missing[p + 1, lane] -= a * y
    missing[p + 2, lane] -= ax * y - ay * x


@jit
def miss(work, parts, n, lanes):
    """Compute the effect that each start's target lacks, ``work.missing``."""
    target, missing = work.target, work.missing
    want(missing, work.wanted, 3 * parts, lanes)
    for i in range(n):
        p, j = work.part_index[i], work.element_index[i]
        a, ax, ay = work.lever[0, i], work.lever[1, i], work.lever[2, i]
        for lane in range(lanes):
            give(missing, p, lane, a, ax, ay, target[j, 0, lane], target[j, 1, lane])


@jit
def try_out(limits, work, parts, n, lanes):
    """Compute the missing effect under the feasible phasors nearest to each start's target, and the expected error squared."""
    target, missing, expected = work.target, work.missing, work.expected
    least, half, most = limits.least, 0.5 * limits.least, limits.most
    for lane in range(lanes):
        expected[lane] = 0.0
    want(missing, work.wanted, 3 * parts, lanes)
    for i in range(n):
        p, j, variance = work.part_index[i], work.element_index[i], work.variance[i]
        a, ax, ay = work.lever[0, i], work.lever[1, i], work.lever[2, i]
        for lane in range(lanes):
            x, y = target[j, 0, lane], target[j, 1, lane]
            length = math.sqrt(x * x + y * y)
            allowed = nearest(length, least, half, most)
            scale = allowed / (length + TINY)
            give(missing, p, lane, a, ax, ay, scale * x, scale * y)
            expected[lane] += variance * allowed * allowed
    for k in range(3 * parts):
        for lane in range(lanes):
            expected[lane] += missing[k, lane] * missing[k, lane]


@jit(inline=True)
def nearest(length, least, half, most):
    """Return the nearest feasible amplitude, 0 or within the limits; ``half`` is half of the least."""
    allowed = length if length > least else least
    allowed = allowed if allowed < most else most
    return allowed if length > half else 0.0


@jit
def add_missing(work, parts, n, lanes):
    """Add to each start's target the phasors of least mean square over the covered area with the missing effect."""
    command, missing, target = work.command, work.missing, work.target
    for k in range(3 * parts):
        for lane in range(lanes):
            command[k, lane] = 0.0
        for j in range(3 * parts):
            share = work.inverse[k, j]
            for lane in range(lanes):
                command[k, lane] += share * missing[j, lane]
    for i in range(n):
        p, j = work.part_index[i], work.element_index[i]
        weight = work.weight[i]
        a, ax, ay = weight * work.lever[0, i], weight * work.lever[1, i], weight * work.lever[2, i]
        for lane in range(lanes):
            turn = command[p + 2, lane]
            target[j, 0, lane] += a * command[p, lane] - ay * turn
            target[j, 1, lane] += a * command[p + 1, lane] + ax * turn


@jit
def untouched(limits, work, elements):
    """Return whether the target of the first start is feasible."""
    for j in range(elements):
        x, y = work.target[j, 0, 0], work.target[j, 1, 0]
        square = x * x + y * y
        moves = x != 0.0 or y != 0.0
        if square > limits.most * limits.most or (moves and square < limits.least * limits.least):
            return False
    return True


@jit
def keep_best(limits, work, elements, lanes, least):
    """Keep the feasible phasors with the least expected error in ``work.push``, if that is less than ``least``.

    Returns:
        The least expected error so far, squared.
    """
    best = -1
    for lane in range(lanes):
        if work.expected[lane] < least:
            best, least = lane, work.expected[lane]
    if best >= 0:
        for j in range(elements):
            x, y = work.target[j, 0, best], work.target[j, 1, best]
            length = math.sqrt(x * x + y * y)
            scale = nearest(length, limits.least, 0.5 * limits.least, limits.most) / (length + TINY)
            work.push[0, j], work.push[1, j] = scale * x, scale * y
    return least


@jit
def halve(work, parts, elements, lanes):
    """Keep the better of starts ``i`` and ``i + lanes / 2``; returns the number left."""
    half = lanes // 2
    for lane in range(half):
        if work.expected[lane + half] < work.expected[lane]:
            for j in range(elements):
                for k in range(2):
                    work.target[j, k, lane] = work.target[j, k, lane + half]
            for k in range(3 * parts):
                work.missing[k, lane] = work.missing[k, lane + half]
    return half


@jit
def begin(limits, work, parts, elements, n, lanes):
    """Initialize the targets of ``lanes`` starts."""
    for j in range(elements):
        for k in range(2):
            for lane in range(lanes):
                work.target[j, k, lane] = limits.start[j % SLOTS, k, lane]
    miss(work, parts, n, lanes)
    add_missing(work, parts, n, lanes)


@jit
def allocate_group(problem, world, wanted, own, work):
    """Compute phasors for a group of parts, ``work.push``; returns the number of elements."""
    limits = problem.limits
    parts, elements, n = gather(problem, world, wanted, own, work)
    if limits.least == 0.0:
        project(limits, work, parts, elements, n)
        return elements
    size = 0.0
    for k in range(3 * parts):
        size += work.wanted[k] * work.wanted[k]
    small = size < parts * limits.least * limits.least
    begin(limits, work, parts, elements, n, 1)
    if untouched(limits, work, elements):
        for j in range(elements):
            work.push[0, j], work.push[1, j] = work.target[j, 0, 0], work.target[j, 1, 0]
        return elements
    lanes, rounds = (limits.starts, limits.rounds) if small else (limits.few_starts, limits.few_rounds)
    if lanes > 1:
        begin(limits, work, parts, elements, n, lanes)
    least = math.inf
    for turn in range(rounds):
        try_out(limits, work, parts, n, lanes)
        least = keep_best(limits, work, elements, lanes, least)
        if small and turn % HALVING == HALVING - 1:
            lanes = halve(work, parts, elements, lanes)
        add_missing(work, parts, n, lanes)
    return elements


@jit
def phasor(limits, x, y):
    """Return the phasor ``-(y, x)`` of a push; below the width of a soft dead zone it is longer."""
    longer, length = 1.0, math.sqrt(x * x + y * y)
    if 0.0 < length < limits.soft:
        longer = (length / limits.soft) ** limits.power
    return -longer * y, -longer * x


@jit
def turn_round(limits, push, action):
    """Write pushes (n,) x, y, x, y, ... as phasors, float32, into ``action``."""
    limits = reference(limits)
    for k in range(0, push.shape[0], 2):
        action[k], action[k + 1] = phasor(limits, push[k], push[k + 1])


@jit
def allocate_world(problem, world, pose, present, wanted, work, push, as_phasors):
    """Compute the pushes of all elements of a world.

    Args:
        pose, present, wanted: (parts, 3), (parts,) and (parts, 3), see :meth:`vibgym.allocation.Allocator.pushes`.
        work: scratch.
        push: (2 elements,), overwritten with pushes x, y, x, y, ..., or with their phasors if ``as_phasors``.
    """
    group, limits = work.group, problem.limits
    push[:] = 0.0
    count = cut_parts(problem.outlines, world, pose, present, work.pieces)
    group_parts(work.pieces, count, pose.shape[0], group, work.slot, work.first)
    for own in range(pose.shape[0]):
        if group[own] != own or not present[own]:
            continue
        moves = False
        for p in range(own, pose.shape[0]):
            if group[p] == own and present[p]:
                moves = moves or wanted[p, 0] != 0.0 or wanted[p, 1] != 0.0 or wanted[p, 2] != 0.0
        if not moves:
            continue
        for j in range(allocate_group(problem, world, wanted, own, work)):
            e, x, y = work.element[j], work.push[0, j], work.push[1, j]
            work.slot[e] = -1
            push[2 * e], push[2 * e + 1] = phasor(limits, x, y) if as_phasors else (x, y)


@jit
def allocate(start, stop, problem, pose, present, wanted, work, push):
    """Compute the pushes (worlds, 2 elements) of worlds ``start`` to ``stop``, see :func:`allocate_world`."""
    problem, work = reference(problem), reference(work)
    for w in range(start, stop):
        allocate_world(problem, w, pose[w], present[w], wanted[w], work, push[w], False)
