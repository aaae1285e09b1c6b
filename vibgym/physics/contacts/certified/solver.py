"""Contacts at rest: impulses at all contact points of an island, before and after a step by friction alone.

Strang's splitting (G. Strang, On the Construction and Comparison of Difference Schemes, SIAM J. Numer. Anal. 5, 1968; with
known forces it is the velocity Verlet method): the mean force of the last step acts at each point for half of the step before
friction (:func:`kick`), the rest of the impulses after it (:func:`solve`). If the contact has ended by then, the first half is
taken back. Then no point approaches, and the sum of both impulses presses and its friction is at most ``mu`` times the normal
one: projected Gauss-Seidel iteration (:mod:`vibgym.physics.contacts.impulses`), which starts from the same force (E. Catto,
Iterative Dynamics with Temporal Coherence, GDC 2005). Impulses that differ from those expected also move the parts, for half of
the step. The error is of second order in the step, with these exceptions of first order:

- No force is known in the first step of a period, since the state is poses and velocities alone, and at new contacts.
- A new contact or an impact changes velocities by more than forces do. Its parts, and those that it moves through others, have
  no force in the next step, and their impulses do not move them.

A second iteration moves parts apart that overlap by more than the slop. Contacts do not rebound here:
:mod:`vibgym.physics.contacts.certified.impact` computes rebounds first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.certified.approach import part_motion, place_slot
from vibgym.physics.contacts.certified.impact import CONTACT_FROM
from vibgym.physics.contacts.hulls import kept_contact
from vibgym.physics.contacts.impulses import (
    ALLOWED,
    GAP,
    HIT_SPEED,
    KICK,
    KICK_ALONG,
    MOVED,
    NORMAL,
    NORMAL_MASS,
    TANGENTIAL,
    UNLIMITED,
    Points,
    add_manifold,
    apply,
    energy,
    iterate,
    new_points,
    normal_speed,
    point_capacity,
    rounds_needed,
)
from vibgym.physics.contacts.manifold import hull_points, wall_manifold
from vibgym.physics.core.records import incline_size

STILL_SPEED, STILL_MOVE = 3e-4, 1e-5
"""Largest change (m/s; m) in an iteration at which it ends, for parts of equal mass. It is divided by the largest ratio of
masses: the larger, the slower the convergence."""

COLD = 4
"""Most iterations over those needed from the impulses of the last step, for contacts without."""

CORRECTION_RATE = 3450.0
"""Rate at which overlap beyond the slop decays, 1/s: half of it in 0.2 ms. Positions alone change, so no energy is gained."""

NEARBY = 2e-4
"""Largest gap (m) of points that the correction of overlap includes: it may turn a part such that another corner overlaps."""

STEADY = 1e-3
"""Closing speed at the start of a step (m/s) above which a contact is new."""

LARGEST_PUSH = 1.0
"""Acceleration of any point of a part by all its contacts, over gravity and incline, above which no forces of an island are
used: friction and incline cause forces, so that larger ones are those of an impact, or the iteration has not converged."""


class Solver(NamedTuple):
    """Contact points of an island's step, and the impulses of the last one in the period."""

    points: Points
    hull: np.ndarray  # (points, 2) hulls of a point, the second ``-1 - wall`` at a wall
    place: np.ndarray  # (points, 2) m
    last_body: np.ndarray  # (points, 2) bodies of the last step's points
    last_hull: np.ndarray  # (points, 2)
    last_place: np.ndarray  # (points, 2) m
    last_arms: np.ndarray  # (points, 6) normal and lever arms, the first columns of a point
    last_force: np.ndarray  # (points, 2) N, normal and tangential
    last_count: np.ndarray  # (1,) number of the last step's points
    push: np.ndarray  # (parts + 1, 3) m/s^2, rad/s^2, accelerations of the parts by these forces
    unsteady: np.ndarray  # (parts + 1,) bool: its velocity was changed by a new contact, directly or through others


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
        last_arms=np.zeros((capacity, 6)),
        last_force=numbers(),
        last_count=np.zeros(1, np.int64),
        push=np.zeros((parts + 1, 3)),
        unsteady=np.zeros(parts + 1, np.bool_),
    )


@jit
def begin_contacts(island):
    """Compute the inverse masses of an island's parts (the last body is the walls), and discard the last forces."""
    properties, factor, inverse = island.properties, island.scene.state.mass[island.world], island.solver.points.inverse
    for slot in range(island.parts):
        part = island.scene.workspace.part[slot]
        mass = factor[part] * properties.mass[part]
        inverse[slot, 0], inverse[slot, 1] = 1.0 / mass, 1.0 / (mass * properties.gyration[part])
    inverse[island.parts, 0] = inverse[island.parts, 1] = 0.0
    discard_forces(island)


@jit
def discard_forces(island):
    """Discard the forces of the last step."""
    solver = island.solver
    solver.last_count[0] = 0
    for slot in range(island.parts + 1):
        for k in range(3):
            solver.push[slot, k] = 0.0


@jit
def kick(island, time):
    """Change velocities by the impulses of the last step's forces in ``time`` s."""
    workspace, push = island.scene.workspace, island.solver.push
    for slot in range(island.parts):
        velocity, lane, moved = workspace.velocity[slot // LANES], slot % LANES, False
        for k in range(3):
            moved = moved or push[slot, k] != 0.0
            velocity[k * LANES + lane] += time * push[slot, k]
        if moved:
            island.scene.state.sticking[island.world, workspace.part[slot]] = False  # a pushed part no longer sticks


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
        friction, combination = math.sqrt(properties.friction[one] * properties.friction[other]), 0
        for a in range(hulls.owner[one], hulls.owner[one + 1]):
            for b in range(hulls.owner[other], hulls.owner[other + 1]):
                feature = contacts.feature[contacts.first_feature[pair] + combination]
                gap, nx, ny, owner = kept_contact(hulls, placed, a, b, feature)
                combination += 1
                smallest = min(smallest, gap)
                if gap < NEARBY:
                    manifold = hull_points(hulls, placed, a, b, gap, nx, ny, owner, NEARBY)
                    count = add_points(island, count, i, j, a, b, manifold, friction, h)
    return count, smallest


@jit
def last_of(solver, k, start):
    """Return the index of the last step's point that is nearest to point ``k`` between the same hulls, -1 if there is none.

    The points of two hulls follow each other. The search begins at ``start``, since points keep their order from step to step.
    """
    last, body, hull, match, nearest = solver.last_count[0], solver.points.body[k], solver.hull[k], -1, math.inf
    for offset in range(last):
        old = start + offset if start + offset < last else start + offset - last
        if (
            solver.last_hull[old, 0] == hull[0] and solver.last_hull[old, 1] == hull[1]
            and solver.last_body[old, 0] == body[0] and solver.last_body[old, 1] == body[1]
        ):  # fmt: skip
            dx, dy = solver.last_place[old, 0] - solver.place[k, 0], solver.last_place[old, 1] - solver.place[k, 1]
            if dx * dx + dy * dy < nearest:
                nearest, match = dx * dx + dy * dy, old
        elif match >= 0:
            break
    return match


@jit
def start_from_last(island, n, h):
    """Start the ``n`` points from the last step's forces in ``h`` s: half of their impulse at the places then, half now.

    Contacts that have ended, and those of parts in an impact, have no force.

    Returns:
        Whether any point touches.
    """
    solver, points, hit, at, touching = island.solver, island.solver.points, island.contacts.hit, 0, False
    start_from_zero(points, n)
    for k in range(n):
        i, j = points.body[k, 0], points.body[k, 1]
        value, match = points.value[k], last_of(solver, k, at)
        if match >= 0:
            at = match
            struck = hit[i] or (j < island.parts and hit[j])
            if solver.last_force[match, 0] > 0.0 and not struck:
                value[ALLOWED] = 0.0
                for axis in range(2):
                    value[KICK + axis] = value[NORMAL + axis] = 0.5 * h * solver.last_force[match, axis]
                for row in (solver.last_arms[match], value):
                    apply(row, points.inverse, points.velocity, i, j, value[KICK], value[KICK_ALONG])
        touching = touching or value[ALLOWED] < UNLIMITED
    for k in range(n if touching else 0):
        value = points.value[k]
        if value[KICK] > 0.0:
            # What is left of a gap when impulses that stop the parts have moved them.
            speed = normal_speed(value, points.velocity, points.body[k, 0], points.body[k, 1])
            value[ALLOWED] = max(value[GAP] / h - 0.5 * speed, 0.0)
    return touching


@jit
def start_from_zero(points, n):
    """Start the ``n`` points without forces."""
    for k in range(n):
        value = points.value[k]
        value[NORMAL] = value[TANGENTIAL] = value[KICK] = value[KICK_ALONG] = 0.0
        value[ALLOWED] = 0.0 if value[GAP] <= -CONTACT_FROM else UNLIMITED


@jit
def change_by_contacts(island, slot):
    """Return the largest change of the velocity of any point of a part that is not written yet, m/s."""
    workspace, points = island.scene.workspace, island.solver.points
    velocity, lane, radius = workspace.velocity[slot // LANES], slot % LANES, island.hulls.radius[workspace.part[slot]]
    return max(
        abs(points.velocity[slot, 0] - velocity[lane]), abs(points.velocity[slot, 1] - velocity[LANES + lane]),
        radius * abs(points.velocity[slot, 2] - velocity[2 * LANES + lane]),
    )  # fmt: skip


@jit
def find_unsteady(island, n):
    """Mark parts in new contacts or impacts, those that were hit, and those that these press, in ``solver.unsteady``."""
    points, unsteady, spreads = island.solver.points, island.solver.unsteady, False
    for slot in range(island.parts):
        unsteady[slot] = island.contacts.hit[slot] or change_by_contacts(island, slot) > HIT_SPEED
        spreads = spreads or unsteady[slot]
    unsteady[island.parts] = False  # walls pass nothing on
    for k in range(n):
        value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
        if value[NORMAL] + value[KICK] > 0.0 and normal_speed(value, points.before, i, j) < -STEADY:
            unsteady[i] = spreads = True
            unsteady[j] = j < island.parts
    while spreads:
        spreads = False
        for k in range(n):
            value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
            if j < island.parts and unsteady[i] != unsteady[j] and value[NORMAL] + value[KICK] > 0.0:
                unsteady[i] = unsteady[j] = spreads = True


@jit
def keep_forces(island, n, h):
    """Store the ``n`` points and their mean forces for the next step; move steady parts by unexpected impulses."""
    solver, points = island.solver, island.solver.points
    for slot in range(island.parts + 1):
        for k in range(3):
            solver.push[slot, k] = 0.0
    for k in range(n):
        value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
        for end in range(2):
            solver.last_body[k, end], solver.last_hull[k, end] = points.body[k, end], solver.hull[k, end]
            solver.last_place[k, end], solver.last_force[k, end] = solver.place[k, end], 0.0
        for field in range(6):
            solver.last_arms[k, field] = value[field]
        if not (solver.unsteady[i] or solver.unsteady[j]):
            normal, tangential, kick, along = value[NORMAL], value[TANGENTIAL], value[KICK], value[KICK_ALONG]
            force, friction = (normal + kick) / h, (tangential + along) / h
            solver.last_force[k, 0], solver.last_force[k, 1] = force, friction
            apply(value, points.inverse, solver.push, i, j, force, friction)
            apply(value, points.inverse, points.move, i, j, 0.5 * h * (normal - kick), 0.5 * h * (tangential - along))
    solver.last_count[0] = n
    table, incline = island.scene.table, incline_size(island.scene.state, island.world)
    # On a level table at rest friction stops all parts, and no force lasts.
    most = LARGEST_PUSH * (table.gravity + incline) if table.speed > 0.0 or incline > 0.0 else 0.0
    for slot in range(island.parts):
        push, radius = solver.push[slot], island.hulls.radius[island.scene.workspace.part[slot]]
        if math.sqrt(push[0] * push[0] + push[1] * push[1]) + radius * abs(push[2]) > most:
            discard_forces(island)


@jit
def correct_overlap(points, n, rounds, still, slop, share):
    """Change ``points.move`` such that overlap beyond ``slop`` m decreases by ``share``; iterate until ``still``, m."""
    move, inverse, deep = points.move, points.inverse, False
    for k in range(n):
        value = points.value[k]
        value[MOVED] = 0.0
        deep = deep or value[GAP] + normal_speed(value, move, points.body[k, 0], points.body[k, 1]) < -slop
    for _ in range(rounds if deep else 0):
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
    """Load the velocities of an island's parts, now and at the step's start; return the largest ratio of their masses."""
    workspace, points = island.scene.workspace, island.solver.points
    least, most = math.inf, 0.0
    for slot in range(island.parts):
        velocity, lane = workspace.velocity[slot // LANES], slot % LANES
        for k in range(3):
            points.velocity[slot, k], points.move[slot, k] = velocity[k * LANES + lane], 0.0
            points.before[slot, k] = island.contacts.start_velocity[slot, k]
        least, most = min(least, points.inverse[slot, 0]), max(most, points.inverse[slot, 0])
    for k in range(3):
        points.velocity[island.parts, k] = points.before[island.parts, k] = points.move[island.parts, k] = 0.0
    return most / least


@jit
def write_motion(island):
    """Write velocities and displacements of the parts that contacts have changed; mark hit ones in ``workspace.stale``.

    Returns:
        Whether any part was hit.
    """
    workspace, points, any_hit = island.scene.workspace, island.solver.points, False
    for slot in range(island.parts):
        if workspace.away[slot]:
            continue
        change = change_by_contacts(island, slot)
        for k in range(3):
            at = k * LANES + slot % LANES
            workspace.velocity[slot // LANES, at] = points.velocity[slot, k]
            workspace.pose[slot // LANES, at] += points.move[slot, k]
        if change > 0.0:
            island.scene.state.sticking[island.world, workspace.part[slot]] = False  # a pushed part no longer sticks
        if change > HIT_SPEED:
            workspace.stale[slot] = any_hit = True
    return any_hit


@jit
def solve(island, n, h):
    """Apply the impulses of the ``n`` points of :func:`find_contacts` to velocities, and correct poses.

    Args:
        h: s, the step's length.

    Returns:
        Whether any parts touch, and whether the velocity of any has changed by more than ``HIT_SPEED``. Such parts are marked
        in ``workspace.stale``.
    """
    points, ratio = island.solver.points, load_velocities(island)
    rounds, before = COLD * rounds_needed(island.parts, ratio), energy(points, island.parts)
    if not start_from_last(island, n, h):
        return False, False
    iterate(points, n, rounds, STILL_SPEED / ratio)
    if energy(points, island.parts) > before:
        # Forces of the last step that no longer fit. Iterations from zero lose energy, each of them.
        load_velocities(island)
        start_from_zero(points, n)
        iterate(points, n, rounds, STILL_SPEED / ratio)
    find_unsteady(island, n)
    keep_forces(island, n, h)
    share = 1.0 - math.exp(-CORRECTION_RATE * h)
    correct_overlap(points, n, rounds, STILL_MOVE / ratio, island.slop + CONTACT_FROM, share)
    limit_turns(island)
    return True, write_motion(island)
