"""Worlds with several parts, or with walls: a period in three steps.

1. :func:`broad_phase` finds the near pairs. Parts that touch initially are left to step 3.
2. All other parts advance without contacts (:func:`vibgym.physics.planar.friction.slide_rows`), with the same bits as alone.
3. :func:`resolve` compares the paths of near pairs. Parts whose paths cross return to the start of the period and advance with
   contacts in islands (:mod:`vibgym.physics.contacts.certified.islands`, :mod:`vibgym.physics.contacts.certified.coupling`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, reference
from vibgym.physics.contacts.broad_phase import (
    CALLS,
    CONTACT,
    FREE,
    IN_TOUCH,
    NEAR,
    Paths,
    begin_world,
    circle_gap,
    list_others,
    load_world,
    new_rows,
    pair_capacity,
    pair_gap,
    travel_bound,
)
from vibgym.physics.contacts.certified.coupling import contact_scene_at
from vibgym.physics.contacts.certified.islands import (
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
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import State, friction_in, incline_size, kind_in, new_state, state_at


class BroadPhase(NamedTuple):
    """Near pairs, paths and islands of a block of worlds, found before contacts are resolved."""

    rows: np.ndarray  # see :class:`vibgym.physics.contacts.broad_phase.Rows`, like the next two
    count: np.ndarray
    driven: np.ndarray
    pairs: np.ndarray  # (worlds, capacity, 2)
    found: np.ndarray  # (worlds,) number of pairs
    gap: np.ndarray  # (worlds, capacity) m, lower bound at the period's start; -1: both are in one island
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
        *new_rows(worlds, parts, len(steps)),
        pairs=np.empty((worlds, capacity, 2), np.int64),
        found=np.zeros(worlds, np.int64),
        gap=np.empty((worlds, capacity)),
        paths=np.empty((worlds * parts, most + 1, 3)),
        travel=np.zeros((parts, most)),
        path_steps=np.zeros(parts, np.int64),
        steps=steps,
        kept=new_state(worlds, parts),
        islands=new_islands(parts),
    )


@jit
def copy_part(source, world, target, to, part):
    """Copy a part's motion and flags from one state to another."""
    for k in range(3):
        target.pose[to, part, k] = source.pose[world, part, k]
        target.velocity[to, part, k] = source.velocity[world, part, k]
        target.mean_velocity[to, part, k] = source.mean_velocity[world, part, k]
    target.fallen[to, part], target.sticking[to, part] = source.fallen[world, part], source.sticking[world, part]


@jit
def find_touching(fixed, pose, pairs, n, gap, driven):
    """Write the gaps of a world's near pairs (of distant ones lower bounds), and mark parts that touch or are close.

    Args:
        pose: (parts, 3).
        gap: (pairs,) m, overwritten.
        driven: (parts,) bool, False, overwritten.
    """
    table, hulls, contacts = fixed.friction.table, fixed.hulls, fixed.contacts
    for part in range(driven.shape[0]):
        contacts.fresh[part] = False
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
        w = world - start
        count = begin_world(fixed, state, world, broad.driven[w], broad.pairs[w])
        broad.found[w] = count
        if count > 0:
            any_near = True
            find_touching(fixed, state.pose[world], broad.pairs[w], count, broad.gap[w], broad.driven[w])
            for part in range(parts):
                copy_part(state, world, broad.kept, w, part)
        list_others(fixed.friction.bodies, broad, world, w)
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
    pairs, count = broad.pairs[w], broad.found[w]
    link_pairs(islands, pairs, count)
    begin_islands(islands, fixed, state, world, pairs, count, broad.gap[w], paths, kept.fallen[w])


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
def resolve_world(world, w, fixed, drive, state, broad, counts, deepest):
    """Advance a world's islands until no paths cross; return the kind of period, ``NEAR`` or ``CONTACT``."""
    islands, parts, first = broad.islands, state.pose.shape[1], w * state.pose.shape[1]
    paths = reference(Paths(broad.paths[first : first + parts], broad.path_steps, broad.driven[w], broad.travel))
    begin_islands_of_world(world, w, fixed, state, broad, paths)
    mode = NEAR
    while not state.diverged[world] and run_waiting_islands(world, w, fixed, drive, state, broad, paths):
        mode = CONTACT
        join_crossing_islands(islands, fixed, state, world, broad.pairs[w], broad.found[w], paths, broad.kept.fallen[w])
    if state.diverged[world]:
        for part in range(parts):
            copy_part(broad.kept, w, state, world, part)
        return mode
    for part in range(parts):
        if paths.driven[part] and islands.parent[part] == part:
            counts[world, CALLS] += islands.calls[part]
            deepest[world] = min(deepest[world], islands.deepest[part])
    return mode


@jit
def resolve(start, stop, fixed, drive, state, broad, counts, deepest):
    """Advance the parts with contacts, after those without have taken the period.

    Args:
        fixed, drive, state, broad: addresses of pinned records.
        counts: (worlds, COUNTS) int64, added to.
        deepest: (worlds,) m, smallest gap at the end of a step so far, updated.
    """
    fixed, state, broad = contact_scene_at(fixed), state_at(state), broad_phase_at(broad)
    drive = reference(pinned_drive(drive))
    for world in range(start, stop):
        w = world - start
        mode = FREE
        if broad.found[w] > 0:
            load_world(fixed, world)
            mode = resolve_world(world, w, fixed, drive, state, broad, counts, deepest)
        counts[world, mode] += 1
