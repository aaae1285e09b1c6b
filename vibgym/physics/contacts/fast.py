"""Fast contacts: a few contact steps in a period, for training (``contacts="fast"`` of the planar model).

Each step moves all parts by friction alone, finds the outlines that overlap, and resolves their contact points at once
(:mod:`vibgym.physics.contacts.impulses`). There is no conservative advancement: parts may overlap by some millimetres before an
impact is found and by some tenths of a millimetre after a step. The certified contacts of
:mod:`vibgym.physics.contacts.certified` bound both.

Parts with near pairs of several worlds fill the lanes of the friction stepper together. Lanes are independent, and contacts
are resolved world by world, so that results do not depend on other worlds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import (
    CALLS,
    CONTACT,
    FREE,
    NEAR,
    Circles,
    begin_world,
    list_others,
    load_world,
    near_pairs,
    new_circles,
    pair_capacity,
    rows_at,
)
from vibgym.physics.contacts.hulls import Hulls, place_hulls
from vibgym.physics.contacts.impulses import (
    GAP,
    HIT_SPEED,
    ImpactProperties,
    Points,
    add_manifold,
    new_points,
    point_capacity,
    rounds_needed,
    solve_points,
)
from vibgym.physics.contacts.manifold import hull_manifold, wall_manifold
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import state_at
from vibgym.physics.planar.stepper import apply_friction, cut_stale, friction_step, load_part, store_parts
from vibgym.physics.planar.workspace import FixedScene, scene_of

MARGIN = 2e-3
"""Gap (m) up to which outlines have contact points, which then allow no more than closing it in a step."""


class FastContacts(NamedTuple):
    """Working arrays of a thread."""

    placed: np.ndarray  # (corners, 4)
    fresh: np.ndarray  # (parts,) bool: ``placed`` is up to date
    circles: Circles
    found: np.ndarray  # (pairs, 2)
    points: Points  # with a body for each part of a world, and the walls
    before: np.ndarray  # (slots, 3) velocities at the step's start
    pushed: np.ndarray  # (slots, 2) m/s, change of velocity by contacts since the period began
    first: np.ndarray  # (slots + 1,) first slot of each world
    world: np.ndarray  # (slots,) worlds
    touched: np.ndarray  # (slots,) contact steps with contact points in each of these worlds
    deepest: np.ndarray  # (slots,) m, smallest gap at the end of a step, likewise


class FastScene(NamedTuple):
    """Constant data of several parts or walls with fast contacts, pinned in memory."""

    friction: FixedScene  # with slots for several worlds; the scheme is that of the kind with the most steps
    hulls: Hulls
    properties: ImpactProperties
    contacts: FastContacts
    couplings: int  # contact steps from cut to cut
    slop: float  # m of overlap that is not corrected
    walls: int  # set of walls, a bit each


FAST_SCENE: Layout[FastScene] = Layout("FAST_SCENE", __name__)
fast_scene_at = FAST_SCENE.at


def new_fast_contacts(parts: int, slots: int, hulls: Hulls) -> FastContacts:
    """Allocate working arrays for worlds with ``parts``, several of them in ``slots``."""
    return FastContacts(
        placed=np.zeros(hulls.corner.shape),
        fresh=np.zeros(parts, np.bool_),
        circles=new_circles(parts),
        found=np.empty((pair_capacity(parts), 2), np.int64),
        points=new_points(parts + 1, point_capacity(len(hulls.rounding))),
        before=np.zeros((slots, 3)),
        pushed=np.zeros((slots, 2)),
        first=np.zeros(slots + 1, np.int64),
        world=np.zeros(slots, np.int64),
        touched=np.zeros(slots, np.int64),
        deepest=np.zeros(slots),
    )


@jit
def find_rows(start, stop, fixed, state, rows, whole):
    """Find the parts with near pairs of worlds ``start`` to ``stop``, and list the others.

    Args:
        fixed, state, rows: addresses of pinned records.
        whole: treat all parts on the table as near where any of them are.

    Returns:
        Whether any parts are near one another.
    """
    fixed, state, rows = fast_scene_at(fixed), state_at(state), rows_at(rows)
    near, any_near = fixed.contacts.found, False
    for kind in range(rows.count.shape[0]):
        rows.count[kind] = 0
    for world in range(start, stop):
        driven = rows.driven[world - start]
        n = begin_world(fixed, state, world, driven, near)
        for k in range(n):
            driven[near[k, 0]] = any_near = True
            if near[k, 1] >= 0:
                driven[near[k, 1]] = True
        for part in range(driven.shape[0] if whole and n > 0 else 0):
            driven[part] = not state.fallen[world, part]
        list_others(fixed.friction.bodies, rows, world, world - start)
    return any_near


@jit
def load_worlds(scene, contacts, driven, world, stop, base):
    """Load the parts with near pairs from ``world`` on into slots, as long as there is room.

    Args:
        driven: (worlds, parts) bool, from :class:`Rows`; ``driven[0]`` is world ``base``.

    Returns:
        Number of worlds in ``contacts``, and the first world that has not been loaded.
    """
    workspace, parts, slots, count = scene.workspace, driven.shape[1], 0, 0
    contacts.first[0] = 0
    while world < stop and slots + parts <= workspace.away.shape[0]:
        for part in range(parts):
            if driven[world - base, part]:
                load_part(scene, slots, world, part, False)
                contacts.pushed[slots, 0] = contacts.pushed[slots, 1] = 0.0
                slots += 1
        if slots > contacts.first[count]:
            contacts.world[count], contacts.touched[count], contacts.deepest[count] = world, 0, 0.0
            count += 1
            contacts.first[count] = slots
        world += 1
    for slot in range(slots, (slots + LANES - 1) // LANES * LANES):
        workspace.away[slot] = True
    return count, world


@jit
def load_bodies(scene, fixed, first, parts):
    """Load velocities, inverse masses and bounding circles of a world's parts; return circles and iterations.

    Args:
        first: slot of the first of them.
    """
    contacts, points, workspace, state = fixed.contacts, fixed.contacts.points, scene.workspace, scene.state
    properties, circles, count = fixed.properties, fixed.contacts.circles, 0
    lightest, heaviest = math.inf, 0.0
    for k in range(parts):
        slot = first + k
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        mass = state.mass[workspace.world[slot], part] * properties.mass[part]
        lightest, heaviest = min(lightest, mass), max(heaviest, mass)
        points.inverse[k, 0], points.inverse[k, 1] = 1.0 / mass, 1.0 / (mass * properties.gyration[part])
        contacts.fresh[k] = False
        for axis in range(3):
            points.velocity[k, axis] = workspace.velocity[g, axis * LANES + lane]
            points.before[k, axis], points.move[k, axis] = contacts.before[slot, axis], 0.0
        if not workspace.away[slot]:
            circles.part[count], circles.reach[count] = k, fixed.hulls.radius[part] + 0.5 * MARGIN
            circles.x[count], circles.y[count] = workspace.pose[g, lane], workspace.pose[g, LANES + lane]
            count += 1
    for axis in range(3):
        points.velocity[parts, axis] = points.before[parts, axis] = points.move[parts, axis] = 0.0
    points.inverse[parts, 0] = points.inverse[parts, 1] = 0.0
    return count, rounds_needed(parts, heaviest / lightest)


@jit
def place_body(scene, fixed, first, k):
    """Place the hulls of a world's part ``k`` unless they are up to date; return its x and y, m, and its index."""
    workspace, slot = scene.workspace, first + k
    at, lane, part = workspace.pose[slot // LANES], slot % LANES, workspace.part[slot]
    if not fixed.contacts.fresh[k]:
        fixed.contacts.fresh[k] = True
        place_hulls(fixed.hulls, part, at[lane], at[LANES + lane], at[2 * LANES + lane], fixed.contacts.placed)
    return at[lane], at[LANES + lane], part


@jit
def find_points(scene, fixed, first, parts, count, h):
    """Find the contact points of a world; return their number.

    Args:
        first, parts: slots.  count: number of circles.
    """
    hulls, properties, contacts = fixed.hulls, fixed.properties, fixed.contacts
    near, circles, points, placed, n = contacts.found, contacts.circles, contacts.points, contacts.placed, 0
    for pair in range(near_pairs(scene.table, fixed.walls, circles, count, near)):
        i, j = near[pair, 0], near[pair, 1]
        x, y, one = place_body(scene, fixed, first, i)
        restitution, friction = properties.restitution[one], properties.friction[one]
        if j < 0:
            for a in range(hulls.owner[one], hulls.owner[one + 1]):
                manifold = wall_manifold(scene.table, hulls, placed, a, -1 - j, MARGIN)
                n = add_manifold(points, n, i, parts, x, y, x, y, manifold, friction, restitution, h)
            continue
        u, w, other = place_body(scene, fixed, first, j)
        restitution = math.sqrt(restitution * properties.restitution[other])
        friction = math.sqrt(friction * properties.friction[other])
        for a in range(hulls.owner[one], hulls.owner[one + 1]):
            for b in range(hulls.owner[other], hulls.owner[other + 1]):
                manifold = hull_manifold(hulls, placed, a, b, u - x, w - y, MARGIN)
                n = add_manifold(points, n, i, j, x, y, u, w, manifold, friction, restitution, h)
    return n


@jit
def measure_overlap(scene, fixed):
    """Return the largest overlap of the loaded parts with one another or with walls, m."""
    contacts, overlap = fixed.contacts, 0.0
    load_world(fixed, contacts.world[0])
    count, _ = load_bodies(scene, fixed, 0, contacts.first[1])
    for k in range(find_points(scene, fixed, 0, contacts.first[1], count, 1.0)):
        overlap = max(overlap, -contacts.points.value[k, GAP])
    contacts.deepest[0] = min(contacts.deepest[0], -overlap)
    return overlap


@jit
def write_bodies(scene, fixed, first, parts):
    """Write velocities and poses of a world's parts after contacts."""
    points, pushed, workspace = fixed.contacts.points, fixed.contacts.pushed, scene.workspace
    for k in range(parts):
        slot = first + k
        g, lane, part, most = slot // LANES, slot % LANES, workspace.part[slot], 0.0
        pose, velocity = workspace.pose[g], workspace.velocity[g]
        for axis in range(3):
            at = axis * LANES + lane
            change = points.velocity[k, axis] - velocity[at]
            velocity[at] = points.velocity[k, axis]
            pose[at] += points.move[k, axis]
            most = max(most, abs(change) * (1.0 if axis < 2 else fixed.hulls.radius[part]))
            if axis < 2:
                pushed[slot, axis] += change
        if most > 0.0:
            scene.state.sticking[workspace.world[slot], part] = False  # a pushed part no longer sticks
        if most > HIT_SPEED:
            workspace.stale[slot] = True


@jit
def resolve_contacts(scene, fixed, index, h):
    """Resolve the contacts of a world after a step of ``h`` s by friction alone.

    Args:
        index: of the world in ``contacts``.
    """
    contacts = fixed.contacts
    load_world(fixed, contacts.world[index])
    first, parts = contacts.first[index], contacts.first[index + 1] - contacts.first[index]
    count, rounds = load_bodies(scene, fixed, first, parts)
    n = find_points(scene, fixed, first, parts, count, h)
    if n > 0:
        gap = solve_points(contacts.points, n, parts, rounds, fixed.slop)
        contacts.deepest[index] = min(contacts.deepest[index], gap)
        contacts.touched[index] += 1
        write_bodies(scene, fixed, first, parts)


@jit
def slide_slots(scene, fixed, slots, step):
    """Move the parts in the first ``slots`` by friction alone in contact step number ``step``; return its length, s."""
    contacts, workspace, steps = fixed.contacts, scene.workspace, scene.scheme.steps
    h, within = scene.table.period / (steps * fixed.couplings), step % fixed.couplings
    if within == 0:
        for slot in range(slots):
            workspace.stale[slot] = True
    cut_stale(scene, (fixed.couplings - within) * h, True)
    for slot in range(slots):
        for axis in range(3):
            at = axis * LANES + slot % LANES
            contacts.before[slot, axis] = workspace.velocity[slot // LANES, at]
    apply_friction(scene, reference(friction_step(scene, 2.0 * math.pi / scene.table.period * h * step, h)))
    return h


@jit
def advance_worlds(scene, fixed, count):
    """Advance the parts in all slots by a period."""
    for step in range(scene.scheme.steps * fixed.couplings):
        h = slide_slots(scene, fixed, fixed.contacts.first[count], step)
        for index in range(count):
            resolve_contacts(scene, fixed, index, h)


@jit
def store_worlds(scene, contacts, count, counts, deepest):
    """Store the parts of the loaded worlds after a period, and count it; see :func:`drive_together`."""
    for index in range(count):
        at = contacts.world[index]
        store_parts(scene, at, contacts.first[index], contacts.first[index + 1], contacts.pushed)
        counts[at, FREE] -= 1
        counts[at, CONTACT if contacts.touched[index] > 0 else NEAR] += 1
        counts[at, CALLS] += contacts.touched[index]
        deepest[at] = min(deepest[at], contacts.deepest[index])


@jit
def drive_together(start, stop, fixed, drive, state, rows, counts, deepest):
    """Advance the parts with near pairs of worlds ``start`` to ``stop`` by a period.

    Args:
        fixed, drive, state, rows: addresses of pinned records.
        counts: (worlds, COUNTS) int64, added to.
        deepest: (worlds,) m, smallest gap at the end of a step so far, updated.
    """
    fixed, state, rows = fast_scene_at(fixed), state_at(state), rows_at(rows)
    friction, contacts, world = fixed.friction, fixed.contacts, start
    drive = reference(pinned_drive(drive))
    for k in range(start, stop):
        counts[k, FREE] += 1
    loading = reference(scene_of(friction, drive, state, friction.workspace.pose.shape[0]))
    while world < stop:
        count, world = load_worlds(loading, contacts, rows.driven, world, stop, start)
        scene = reference(scene_of(friction, drive, state, (contacts.first[count] + LANES - 1) // LANES))
        advance_worlds(scene, fixed, count)
        store_worlds(scene, contacts, count, counts, deepest)
