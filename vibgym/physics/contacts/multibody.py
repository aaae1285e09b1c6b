"""Worlds with several parts, or with walls: each period, only what each part needs.

1. :func:`broad_phase` finds out which parts are near enough to touch within the period.
2. What touches already goes with contacts. All other parts go through
   :func:`vibgym.physics.planar.friction.slide_rows`, kind by kind, with the numbers of worlds that have one part.
3. :func:`resolve` compares the paths of what was near. Where none have crossed, that is all; other parts go back to
   the period's start and take it with contacts (:mod:`vibgym.physics.contacts.coupling`), together with what they meet
   (:mod:`vibgym.physics.contacts.islands`) and nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
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
from vibgym.physics.contacts.coupling import fixed_encounter_at
from vibgym.physics.contacts.hulls import place_hulls
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
from vibgym.physics.core.records import State, friction_in, incline_size, new_state, state_at

CALLS = 3
"""Column of the counts with calls of the solver; those before it count periods ``FREE``, ``NEAR`` and with ``CONTACT``."""

COUNTS = 4


class BroadPhase(NamedTuple):
    """Near pairs, paths and islands of a block of worlds, found before contacts are resolved."""

    pairs: np.ndarray  # (worlds, capacity, 2)
    found: np.ndarray  # (worlds,) number of pairs
    gap: np.ndarray  # (worlds, capacity) m at the period's start, or less; -1: both are joined
    driven: np.ndarray  # (worlds, parts) bool: touches something, or is taken along
    rows: np.ndarray  # (kinds, worlds * parts) what goes without contacts, as world * parts + part
    count: np.ndarray  # (kinds,) number of rows
    paths: np.ndarray  # (worlds * parts, most steps + 1, 3)
    travel: np.ndarray  # (parts, most steps) of the world at hand
    path_steps: np.ndarray  # (parts,) likewise
    steps: np.ndarray  # (kinds,) steps a period of each kind
    kept: State  # of the worlds in which parts may have to take the period again
    islands: Islands


BROAD_PHASE: Layout[BroadPhase] = Layout("BROAD_PHASE", __name__)
broad_phase_at = BROAD_PHASE.at


def new_broad_phase(worlds: int, parts: int, steps: np.ndarray) -> BroadPhase:
    """Arrays for a block of ``worlds`` with so many parts, of kinds that take ``steps`` a period."""
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


@borrowing
def copy_part(source, world, target, to, part):
    """Copy a part from one state to another, but for the conditions, which stay as they are."""
    for k in range(3):
        target.pose[to, part, k], target.velocity[to, part, k] = (
            source.pose[world, part, k],
            source.velocity[world, part, k],
        )
        target.mean_velocity[to, part, k] = source.mean_velocity[world, part, k]
    target.fallen[to, part], target.sticking[to, part] = source.fallen[world, part], source.sticking[world, part]


@borrowing
def find_pairs(fixed, state, world, pairs):
    """Write the pairs of a world that may come to touch within a period without contacts; returns their number."""
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


@borrowing
def find_touching(fixed, pose, pairs, n, gap, driven):
    """Write the gaps of a world's pairs at its pose (parts, 3), or less where that is plenty, and mark the parts that touch
    anything, and those close to one that does."""
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


@borrowing
def broad_phase(start, stop, fixed, state, prospect):
    """Find what may touch in worlds ``start`` to ``stop`` within the next period, and write it into ``prospect``.

    Args:
        fixed, state, prospect: addresses of pinned records.

    Returns:
        Whether any world has near pairs, whose paths must be written down.
    """
    fixed, state, prospect = fixed_encounter_at(fixed), state_at(state), broad_phase_at(prospect)
    parts, any_near = state.pose.shape[1], False
    for kind in range(prospect.count.shape[0]):
        prospect.count[kind] = 0
    for world in range(start, stop):
        w, found = world - start, 0
        if not state.diverged[world]:
            found = find_pairs(fixed, state, world, prospect.pairs[w])
        prospect.found[w] = found
        if found > 0:
            any_near = True
            find_touching(fixed, state.pose[world], prospect.pairs[w], found, prospect.gap[w], prospect.driven[w])
        for part in range(parts):
            state.pushed[world, part, 0] = state.pushed[world, part, 1] = 0.0
            if found > 0:
                copy_part(state, world, prospect.kept, w, part)
            if found == 0 or not prospect.driven[w, part]:
                kind = fixed.friction.bodies.kind[part]
                prospect.rows[kind, prospect.count[kind]] = world * parts + part
                prospect.count[kind] += 1
    return any_near


@borrowing
def begin_world(world, w, fixed, state, prospect, paths):
    """Find the first islands of a world, see :func:`vibgym.physics.contacts.islands.begin_islands`."""
    table, bodies, islands, kept = fixed.friction.table, fixed.friction.bodies, prospect.islands, prospect.kept
    incline = incline_size(state, world)
    for part in range(state.pose.shape[1]):
        mu, velocity = friction_in(bodies, state, world, part), kept.velocity[w, part]
        islands.bound[part] = travel_bound(table, mu, incline, velocity[0], velocity[1])
        paths.steps[part] = prospect.steps[bodies.kind[part]]
    pairs, found = prospect.pairs[w], prospect.found[w]
    link_pairs(islands, pairs, found)
    begin_islands(islands, fixed, state, world, pairs, found, prospect.gap[w], paths, kept.fallen[w])


@borrowing
def run_waiting(world, w, fixed, drive, state, prospect, paths):
    """Take the islands of a world that wait for it through the period; returns whether there were any."""
    islands, kept, any_run = prospect.islands, prospect.kept, False
    gather_islands(islands)
    for root in range(state.pose.shape[1]):
        if islands.waiting[root]:
            islands.waiting[root], any_run = False, True
            part = islands.first[root]
            while part >= 0:
                copy_part(kept, w, state, world, part)
                part = islands.following[part]
            run_island(islands, root, fixed, drive, state, world, prospect.pairs[w], paths)
    return any_run


@borrowing
def resolve_world(world, w, fixed, drive, state, prospect, counts):
    """Take a world's parts that need it through the period with contacts.

    Returns:
        What the world's period was.
    """
    islands, parts, first = prospect.islands, state.pose.shape[1], w * state.pose.shape[1]
    paths = reference(
        Paths(prospect.paths[first : first + parts], prospect.path_steps, prospect.driven[w], prospect.travel)
    )
    begin_world(world, w, fixed, state, prospect, paths)
    mode, beyond = NEAR, 0
    while not state.diverged[world] and run_waiting(world, w, fixed, drive, state, prospect, paths):
        mode = CONTACT
        beyond = join_crossing_islands(
            islands, fixed, state, world, prospect.pairs[w], paths, prospect.kept.fallen[w], beyond
        )
    if state.diverged[world]:
        for part in range(parts):
            copy_part(prospect.kept, w, state, world, part)
        return mode
    for part in range(parts):
        if paths.driven[part] and islands.parent[part] == part:
            counts[world, CALLS] += islands.calls[part]
            fixed.contacts.deepest[1] = min(fixed.contacts.deepest[1], islands.deepest[part])
    return mode


@borrowing
def resolve(start, stop, fixed, drive, state, prospect, counts):
    """After the period without contacts: take it with contacts where it needs them.

    Args:
        fixed, drive, state, prospect: addresses of pinned records.
        counts: (worlds, COUNTS) int64, added to.
    """
    fixed, state, prospect = fixed_encounter_at(fixed), state_at(state), broad_phase_at(prospect)
    drive = reference(pinned_drive(drive))
    for world in range(start, stop):
        w = world - start
        mode = FREE
        if prospect.found[w] > 0:
            mode = resolve_world(world, w, fixed, drive, state, prospect, counts)
        counts[world, mode] += 1
