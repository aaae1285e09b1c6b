"""Contacts at rest: impulses at all contact points of an island after a step by friction alone.

No point approaches, and friction at a point is at most ``mu`` times its normal impulse: projected Gauss-Seidel iteration
(:mod:`vibgym.physics.contacts.impulses`), which starts from the impulses of the period's last step (E. Catto, Iterative
Dynamics with Temporal Coherence, GDC 2005). A second iteration moves parts apart that overlap by more than the slop.

Contacts do not rebound here: :mod:`vibgym.physics.contacts.certified.impact` computes rebounds first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.certified.approach import part_motion, place_slot
from vibgym.physics.contacts.certified.impact import CONTACT_FROM
from vibgym.physics.contacts.hulls import hull_contact
from vibgym.physics.contacts.impulses import (
    ALLOWED,
    GAP,
    HIT_SPEED,
    MOVED,
    NORMAL,
    NORMAL_MASS,
    TANGENTIAL,
    UNLIMITED,
    Points,
    add_manifold,
    apply,
    iterate,
    new_points,
    normal_speed,
    point_capacity,
    rounds_needed,
)
from vibgym.physics.contacts.manifold import hull_points, wall_manifold

STILL_SPEED, STILL_MOVE = 1e-4, 1e-6
"""Largest change (m/s; m) in an iteration at which it ends, for parts of equal mass. It is divided by the largest ratio of
masses: the larger, the slower the convergence."""

COLD = 4
"""Most iterations over those needed from the impulses of the last step, for contacts without."""

CORRECTION_RATE = 3450.0
"""Rate at which overlap beyond the slop decays, 1/s: half of it in 0.2 ms. Positions alone change, so no energy is gained."""

NEARBY = 2e-4
"""Largest gap (m) of points that the correction of overlap includes: it may turn a part such that another corner overlaps."""


class Solver(NamedTuple):
    """Contact points of an island's step, and the impulses of the last one in the period."""

    points: Points
    hull: np.ndarray  # (points, 2) hulls of a point, the second ``-1 - wall`` at a wall
    place: np.ndarray  # (points, 2) m
    last_body: np.ndarray  # (points, 2) bodies of the last step's points
    last_hull: np.ndarray  # (points, 2)
    last_place: np.ndarray  # (points, 2) m
    last_impulse: np.ndarray  # (points, 2) N s, normal and tangential
    last_count: np.ndarray  # (1,) number of the last step's points
    last_span: np.ndarray  # (1,) s, its length


def new_solver(parts: int, hulls: int) -> Solver:
    """Allocate working arrays for up to ``parts`` parts with ``hulls`` in all."""
    capacity = point_capacity(hulls)

    def indices() -> np.ndarray:
        return np.zeros((capacity, 2), np.int64)

    def numbers() -> np.ndarray:
        return np.zeros((capacity, 2))

    return Solver(
        points=new_points(parts + 1, capacity),
        hull=indices(),
        place=numbers(),
        last_body=indices(),
        last_hull=indices(),
        last_place=numbers(),
        last_impulse=numbers(),
        last_count=np.zeros(1, np.int64),
        last_span=np.zeros(1),
    )


@jit
def begin_contacts(island):
    """Compute the inverse masses of an island's parts (the last body is the walls), and discard the last impulses."""
    properties, factor, inverse = island.properties, island.scene.state.mass[island.world], island.solver.points.inverse
    for slot in range(island.parts):
        part = island.scene.workspace.part[slot]
        mass = factor[part] * properties.mass[part]
        inverse[slot, 0], inverse[slot, 1] = 1.0 / mass, 1.0 / (mass * properties.gyration[part])
    inverse[island.parts, 0] = inverse[island.parts, 1] = 0.0
    island.solver.last_count[0] = 0


@jit
def add_points(island, n, i, j, a, b, manifold, friction, h):
    """Add the points of a manifold between two slots, or a slot and a wall (``j = -1 - wall``); return their new number."""
    solver, first = island.solver, n
    x, y, _, _, _ = part_motion(island.scene.workspace, i)
    u, w = x, y
    if j >= 0:
        u, w, _, _, _ = part_motion(island.scene.workspace, j)
    body = j if j >= 0 else island.parts
    n = add_manifold(solver.points, n, i, body, x, y, u, w, manifold, friction, 0.0, h)
    for k in range(first, n):
        solver.hull[k, 0], solver.hull[k, 1] = a, b
        solver.place[k, 0], solver.place[k, 1] = manifold.x, manifold.y
        if k > first:
            solver.place[k, 0], solver.place[k, 1] = manifold.other_x, manifold.other_y
        if solver.points.value[k, GAP] > -CONTACT_FROM:
            solver.points.value[k, ALLOWED] = UNLIMITED
    return n


@jit
def find_contacts(island, pairs, n, h):
    """Find the contact points of the pairs that may touch; pairs with fallen parts no longer count.

    Args:
        pairs: (pairs, 2), of which the first ``n`` are near.
        h: s, the step's length.

    Returns:
        Number of points and the smallest gap, m.
    """
    scene, hulls, properties, contacts = island.scene, island.hulls, island.properties, island.contacts
    workspace, placed, count, smallest = scene.workspace, contacts.placed, 0, math.inf
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        if workspace.away[i] or (j >= 0 and workspace.away[j]):
            contacts.close[pair] = False
        if not contacts.close[pair]:
            continue
        place_slot(island, i)
        one = workspace.part[i]
        if j < 0:
            for a in range(hulls.owner[one], hulls.owner[one + 1]):
                manifold = wall_manifold(scene.table, hulls, placed, a, -1 - j, NEARBY)
                smallest = min(smallest, manifold.gap)
                count = add_points(island, count, i, j, a, j, manifold, properties.friction[one], h)
            continue
        place_slot(island, j)
        other = workspace.part[j]
        friction = math.sqrt(properties.friction[one] * properties.friction[other])
        for a in range(hulls.owner[one], hulls.owner[one + 1]):
            for b in range(hulls.owner[other], hulls.owner[other + 1]):
                gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
                smallest = min(smallest, gap)
                if gap < NEARBY:
                    manifold = hull_points(hulls, placed, a, b, gap, nx, ny, owner, NEARBY)
                    count = add_points(island, count, i, j, a, b, manifold, friction, h)
    return count, smallest


@jit
def start_from_last(solver, n, h):
    """Start the ``n`` points from the impulses of the nearest points of the last step between the same hulls.

    In a step of ``h`` s that is shorter than the last one, impulses are smaller in proportion. In a longer one they are not
    enlarged: after a short step they may be those of an impact, not of a force.
    """
    points, last, share = solver.points, solver.last_count[0], min(h / solver.last_span[0], 1.0)
    for k in range(n if last > 0 else 0):
        i, j, nearest, match = points.body[k, 0], points.body[k, 1], math.inf, -1
        for old in range(last if points.value[k, ALLOWED] == 0.0 else 0):
            if (
                solver.last_hull[old, 0] == solver.hull[k, 0] and solver.last_hull[old, 1] == solver.hull[k, 1]
                and solver.last_body[old, 0] == i and solver.last_body[old, 1] == j
            ):  # fmt: skip
                dx = solver.last_place[old, 0] - solver.place[k, 0]
                dy = solver.last_place[old, 1] - solver.place[k, 1]
                if dx * dx + dy * dy < nearest:
                    nearest, match = dx * dx + dy * dy, old
        if match >= 0:
            value = points.value[k]
            value[NORMAL] = share * solver.last_impulse[match, 0]
            value[TANGENTIAL] = share * solver.last_impulse[match, 1]
            apply(value, points.inverse, points.velocity, i, j, value[NORMAL], value[TANGENTIAL])


@jit
def keep_impulses(solver, n, h):
    """Store the ``n`` points and their impulses for the next step."""
    points = solver.points
    for k in range(n):
        for end in range(2):
            solver.last_body[k, end], solver.last_hull[k, end] = points.body[k, end], solver.hull[k, end]
            solver.last_place[k, end] = solver.place[k, end]
        solver.last_impulse[k, 0], solver.last_impulse[k, 1] = points.value[k, NORMAL], points.value[k, TANGENTIAL]
    solver.last_count[0], solver.last_span[0] = n, h


@jit
def clear_impulses(island, hit):
    """Clear the kept impulses of parts that were hit, which are no initial guess for the next step."""
    solver = island.solver
    for k in range(solver.last_count[0]):
        i, j = solver.last_body[k, 0], solver.last_body[k, 1]
        if hit[i] or (j < island.parts and hit[j]):
            solver.last_impulse[k, 0] = solver.last_impulse[k, 1] = 0.0


@jit
def correct_overlap(points, n, rounds, still, slop, share):
    """Compute ``points.move`` such that overlap beyond ``slop`` m decreases by ``share``; iterate until ``still``, m."""
    move, inverse = points.move, points.inverse
    for k in range(n):
        points.value[k, MOVED] = 0.0
    for _ in range(rounds):
        most = 0.0
        for k in range(n):
            value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
            wanted = share * max(-slop - value[GAP], 0.0) - max(value[GAP], 0.0)
            new = max(value[MOVED] + (wanted - normal_speed(value, move, i, j)) * value[NORMAL_MASS], 0.0)
            if new != value[MOVED]:
                apply(value, inverse, move, i, j, new - value[MOVED], 0.0)
                most = max(most, abs(new - value[MOVED]) / value[NORMAL_MASS])
                value[MOVED] = new
        if most < still:
            break


@jit
def limit_turns(island):
    """Scale ``points.move`` of all parts such that none turns so far that its outline leaves its tangent by the slop."""
    move, radius, scale = island.solver.points.move, island.hulls.radius, 1.0
    for slot in range(island.parts):
        turn = abs(move[slot, 2])
        most = math.sqrt(2.0 * island.slop / radius[island.scene.workspace.part[slot]])
        if turn * scale > most:
            scale = most / turn
    for slot in range(island.parts if scale < 1.0 else 0):
        for k in range(3):
            move[slot, k] *= scale


@jit
def load_velocities(island):
    """Load the velocities of an island's parts; return the largest ratio of their masses."""
    workspace, points = island.scene.workspace, island.solver.points
    least, most = math.inf, 0.0
    for slot in range(island.parts):
        velocity, lane = workspace.velocity[slot // LANES], slot % LANES
        for k in range(3):
            points.velocity[slot, k], points.move[slot, k] = velocity[k * LANES + lane], 0.0
        least, most = min(least, points.inverse[slot, 0]), max(most, points.inverse[slot, 0])
    for k in range(3):
        points.velocity[island.parts, k] = points.move[island.parts, k] = 0.0
    return most / least


@jit
def write_motion(island):
    """Write velocities and displacements of the parts that contacts have changed; mark hit ones in ``workspace.stale``.

    Returns:
        Whether any part was hit.
    """
    workspace, points, any_hit = island.scene.workspace, island.solver.points, False
    for slot in range(island.parts):
        g, lane, part, change, moved = slot // LANES, slot % LANES, workspace.part[slot], 0.0, False
        if workspace.away[slot]:
            continue
        for k in range(3):
            at = k * LANES + lane
            difference = abs(points.velocity[slot, k] - workspace.velocity[g, at])
            change = max(change, difference * (1.0 if k < 2 else island.hulls.radius[part]))
            moved = moved or points.velocity[slot, k] != workspace.velocity[g, at]
            workspace.velocity[g, at] = points.velocity[slot, k]
            workspace.pose[g, at] += points.move[slot, k]
        if moved:
            island.scene.state.sticking[island.world, part] = False  # a pushed part no longer sticks
        if change > HIT_SPEED:
            workspace.stale[slot] = any_hit = True
    return any_hit


@jit
def solve(island, n, h, undo):
    """Apply the impulses of the ``n`` points of :func:`find_contacts` to velocities, and correct overlap in poses.

    Args:
        h: s, the step's length.
        undo: whether any overlap is deep enough to be corrected.

    Returns:
        Whether any part's velocity has changed by more than ``HIT_SPEED``. Such parts are marked in ``workspace.stale``.
    """
    solver, points = island.solver, island.solver.points
    ratio = load_velocities(island)
    rounds = COLD * rounds_needed(island.parts, ratio)
    start_from_last(solver, n, h)
    iterate(points, n, rounds, STILL_SPEED / ratio)
    keep_impulses(solver, n, h)
    if undo:
        share = 1.0 - math.exp(-CORRECTION_RATE * h)
        correct_overlap(points, n, rounds, STILL_MOVE / ratio, island.slop + CONTACT_FROM, share)
        limit_turns(island)
    return write_motion(island)
