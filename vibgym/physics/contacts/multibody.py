"""Worlds with several parts, or with walls: a period in three steps.

1. :func:`broad_phase` finds the near pairs. Parts that touch initially are left to step 3.
2. All other parts advance without contacts (:func:`vibgym.physics.planar.friction.slide_rows`), with the same bits as alone.
3. :func:`resolve` compares the paths of near pairs. Parts whose paths cross return to the start of the period and advance with
   contacts in islands (:mod:`vibgym.physics.contacts.islands`, :mod:`vibgym.physics.contacts.coupling`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, reference
from vibgym.physics.contacts.broad_phase import (
    CONTACT,
    FREE,
    IN_TOUCH,
    NEAR,
    Paths,
    circle_gap,
    near_pairs,
    pair_capacity,
    pair_gap,
    travel_bound,
)
from vibgym.physics.contacts.coupling import contact_scene_at
from vibgym.physics.contacts.hulls import load_hulls, place_hulls
from vibgym.physics.contacts.impact import load_properties
from vibgym.physics.contacts.islands import (
    CLOSE,
    Islands,
    begin_islands,
    gather_islands,
    join_crossing_islands,
    link_pairs,
    mark_touching,
    new_islands,
    run_island,
)
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import State, friction_in, incline_size, kind_in, new_state, state_at

CALLS = 3
"""Column of the counts with calls of the solver; the columns before count periods ``FREE``, ``NEAR`` and ``CONTACT``."""

COUNTS = 4


class BroadPhase(NamedTuple):
    """Near pairs, paths and islands of a block of worlds, found before contacts are resolved."""

    pairs: np.ndarray  # (worlds, capacity, 2)
    found: np.ndarray  # (worlds,) number of pairs
    gap: np.ndarray  # (worlds, capacity) m, lower bound at the period's start; -1: both are in one island
    driven: np.ndarray  # (worlds, parts) bool: in an island from the start
    rows: np.ndarray  # (kinds, worlds * parts) parts without contacts, as world * parts + part
    count: np.ndarray  # (kinds,) number of rows
    paths: np.ndarray  # (worlds * parts, most steps + 1, 3)
    travel: np.ndarray  # (parts, most steps) m, of the current world
    path_steps: np.ndarray  # (parts,) likewise
    steps: np.ndarray  # (kinds,) steps a period of each kind
    kept: State  # at the period's start, of worlds with near pairs
    islands: Islands


BROAD_PHASE: Layout[BroadPhase] = Layout("BROAD_PHASE", __name__)
broad_phase_at = BROAD_PHASE.at


def new_broad_phase(worlds: int, parts: int, steps: np.ndarray) -> BroadPhase:
    """Allocate arrays for a block of ``worlds``, for kinds that take ``steps`` (kinds,) a period."""
    capacity, most = pair_capacity(parts), int(steps.max())
    return BroadPhase(
        pairs=np.empty((worlds, capacity, 2), np.int64),
        found=np.zeros(worlds, np.int64),
        gap=np.empty((worlds, capacity)),
        driven=np.zeros((worlds, parts), np.bool_),
        rows=np.empty((len(steps), worlds * parts), np.int64),
        count=np.zeros(len(steps), np.int64),
        paths=np.empty((worlds * parts, most + 1, 3)),
        travel=np.zeros((parts, most)),
        path_steps=np.zeros(parts, np.int64),
        steps=steps,
        kept=new_state(worlds, parts),
        islands=new_islands(parts),
    )


@jit
def load_world(fixed, world):
    """Load hulls and properties for impacts of a world's parts."""
    if load_hulls(fixed.hulls, world):
        load_properties(fixed.properties, fixed.hulls.loaded)


@jit
def copy_part(source, world, target, to, part):
    """Copy a part's motion and flags from one state to another."""
    for k in range(3):
        target.pose[to, part, k] = source.pose[world, part, k]
        target.velocity[to, part, k] = source.velocity[world, part, k]
        target.mean_velocity[to, part, k] = source.mean_velocity[world, part, k]
    target.fallen[to, part], target.sticking[to, part] = source.fallen[world, part], source.sticking[world, part]


@jit
def find_pairs(fixed, state, world, pairs):
    """Write the near pairs of a world and return their number."""
    table, bodies, circles, count = fixed.friction.table, fixed.friction.bodies, fixed.contacts.circles, 0
    incline = incline_size(state, world)
    for part in range(state.pose.shape[1]):
        if not state.fallen[world, part]:
            mu = friction_in(bodies, state, world, part)
            way = travel_bound(table, mu, incline, state.velocity[world, part, 0], state.velocity[world, part, 1])
            circles.part[count], circles.reach[count] = part, fixed.hulls.radius[part] + way
            circles.x[count], circles.y[count] = state.pose[world, part, 0], state.pose[world, part, 1]
            count += 1
    n = near_pairs(table, fixed.walls, circles, count, pairs)
    for k in range(n):
        pairs[k, 0] = circles.part[pairs[k, 0]]
        if pairs[k, 1] >= 0:
            pairs[k, 1] = circles.part[pairs[k, 1]]
    return n


@jit
def find_touching(fixed, pose, pairs, n, gap, driven):
    """Write the gaps of a world's near pairs (of distant ones lower bounds), and mark parts that touch or are close.

    Args:
        pose: (parts, 3).
        gap: (pairs,) m, overwritten.  driven: (parts,) bool, overwritten.
    """
    table, hulls, contacts = fixed.friction.table, fixed.hulls, fixed.contacts
    for part in range(driven.shape[0]):
        contacts.fresh[part] = driven[part] = False
    for k in range(n):
        i, j = pairs[k, 0], pairs[k, 1]
        gap[k] = circle_gap(table, hulls, i, pose[i], j, pose[j if j >= 0 else i])
        if gap[k] < CLOSE:
            for end in range(2):
                part = pairs[k, end]
                if part >= 0 and not contacts.fresh[part]:
                    contacts.fresh[part] = True
                    place_hulls(hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], contacts.placed)
            gap[k] = pair_gap(table, hulls, contacts.placed, i, j)
        if gap[k] < IN_TOUCH:
            driven[i] = True
            if j >= 0:
                driven[j] = True
    mark_touching(pairs, n, gap, driven)


@jit
def broad_phase(start, stop, fixed, state, broad):
    """Find the near pairs of worlds ``start`` to ``stop``, and the parts that advance without contacts.

    Args:
        fixed, state, broad: addresses of pinned records.

    Returns:
        Whether any world has near pairs, so that paths must be recorded.
    """
    fixed, state, broad = contact_scene_at(fixed), state_at(state), broad_phase_at(broad)
    parts, any_near = state.pose.shape[1], False
    for kind in range(broad.count.shape[0]):
        broad.count[kind] = 0
    for world in range(start, stop):
        w, found = world - start, 0
        load_world(fixed, world)
        if not state.diverged[world]:
            found = find_pairs(fixed, state, world, broad.pairs[w])
        broad.found[w] = found
        if found > 0:
            any_near = True
            find_touching(fixed, state.pose[world], broad.pairs[w], found, broad.gap[w], broad.driven[w])
        for part in range(parts):
            state.pushed[world, part, 0] = state.pushed[world, part, 1] = 0.0
            if found > 0:
                copy_part(state, world, broad.kept, w, part)
            if found == 0 or not broad.driven[w, part]:
                kind = kind_in(fixed.friction.bodies, world, part)
                broad.rows[kind, broad.count[kind]] = world * parts + part
                broad.count[kind] += 1
    return any_near


@jit
def begin_islands_of_world(world, w, fixed, state, broad, paths):
    """Find the first islands of a world."""
    table, bodies, islands, kept = fixed.friction.table, fixed.friction.bodies, broad.islands, broad.kept
    incline = incline_size(state, world)
    for part in range(state.pose.shape[1]):
        mu, velocity = friction_in(bodies, state, world, part), kept.velocity[w, part]
        islands.expected_travel[part] = travel_bound(table, mu, incline, velocity[0], velocity[1])
        paths.steps[part] = broad.steps[kind_in(bodies, world, part)]
    pairs, found = broad.pairs[w], broad.found[w]
    link_pairs(islands, pairs, found)
    begin_islands(islands, fixed, state, world, pairs, found, broad.gap[w], paths, kept.fallen[w])


@jit
def run_waiting_islands(world, w, fixed, drive, state, broad, paths):
    """Reset and advance the waiting islands of a world; return whether there were any."""
    islands, kept, any_run = broad.islands, broad.kept, False
    gather_islands(islands)
    for root in range(state.pose.shape[1]):
        waiting, islands.waiting[root] = islands.waiting[root], False
        if waiting and islands.first[root] >= 0:  # islands that were merged into another have no members
            any_run = True
            part = islands.first[root]
            while part >= 0:
                copy_part(kept, w, state, world, part)
                part = islands.following[part]
            run_island(islands, root, fixed, drive, state, world, broad.pairs[w], paths)
    return any_run


@jit
def resolve_world(world, w, fixed, drive, state, broad, counts):
    """Advance a world's islands until no paths cross; return the kind of period, ``NEAR`` or ``CONTACT``."""
    islands, parts, first = broad.islands, state.pose.shape[1], w * state.pose.shape[1]
    paths = reference(Paths(broad.paths[first : first + parts], broad.path_steps, broad.driven[w], broad.travel))
    begin_islands_of_world(world, w, fixed, state, broad, paths)
    mode, exceeding = NEAR, 0
    while not state.diverged[world] and run_waiting_islands(world, w, fixed, drive, state, broad, paths):
        mode = CONTACT
        exceeding = join_crossing_islands(
            islands, fixed, state, world, broad.pairs[w], paths, broad.kept.fallen[w], exceeding
        )
    if state.diverged[world]:
        for part in range(parts):
            copy_part(broad.kept, w, state, world, part)
        return mode
    for part in range(parts):
        if paths.driven[part] and islands.parent[part] == part:
            counts[world, CALLS] += islands.calls[part]
            fixed.contacts.deepest[1] = min(fixed.contacts.deepest[1], islands.deepest[part])
    return mode


@jit
def resolve(start, stop, fixed, drive, state, broad, counts):
    """Advance the parts with contacts, after those without have taken the period.

    Args:
        fixed, drive, state, broad: addresses of pinned records.
        counts: (worlds, COUNTS) int64, added to.
    """
    fixed, state, broad = contact_scene_at(fixed), state_at(state), broad_phase_at(broad)
    drive = reference(pinned_drive(drive))
    for world in range(start, stop):
        w = world - start
        mode = FREE
        if broad.found[w] > 0:
            load_world(fixed, world)
            mode = resolve_world(world, w, fixed, drive, state, broad, counts)
        counts[world, mode] += 1
