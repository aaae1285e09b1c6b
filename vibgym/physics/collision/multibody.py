"""Worlds with several parts, or with walls: each period, only what a world needs.

1. :func:`broad_phase` finds out in which worlds anything is near enough to touch within the period.
2. Where something touches already, the period is taken with contacts. All others go through
   :func:`vibgym.physics.planar.friction.slide_rows`, kind by kind, with the numbers of worlds that have one part.
3. :func:`resolve` compares the paths of what was near. Worlds in which no pair has touched are done; the others go back to
   the period's start and take it with contacts (:mod:`vibgym.physics.collision.coupling`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym._numba.jit import borrowing
from vibgym._numba.reference import Layout, reference
from vibgym.physics.collision.broad_phase import (
    CONTACT,
    FREE,
    NEAR,
    near_pairs,
    pair_capacity,
    paths_cross,
    proximity,
)
from vibgym.physics.collision.coupling import Encounter, collide_period, fixed_encounter_at
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import State, new_state, state_at
from vibgym.physics.planar.workspace import Scene

CALLS = 3
"""Column of the counts with calls of the solver; those before it count periods ``FREE``, ``NEAR`` and with ``CONTACT``."""

COUNTS = 4


class Prospect(NamedTuple):
    """What is known of a block of worlds before a period."""

    mode: np.ndarray  # (worlds,) FREE, NEAR or CONTACT
    pairs: np.ndarray  # (worlds, capacity, 2)
    found: np.ndarray  # (worlds,) number of pairs
    rows: np.ndarray  # (kinds, worlds * parts) what goes without contacts, as world * parts + part
    count: np.ndarray  # (kinds,) number of rows
    paths: np.ndarray  # (worlds * parts, most steps + 1, 3)
    steps: np.ndarray  # (kinds,) steps a period of each kind
    kept: State  # of the worlds that may have to take the period again


PROSPECT: Layout[Prospect] = Layout("PROSPECT", __name__)
prospect_at = PROSPECT.at


def new_prospect(worlds: int, parts: int, steps: np.ndarray) -> Prospect:
    """Arrays for a block of ``worlds`` with so many parts, of kinds that take ``steps`` a period."""
    return Prospect(
        mode=np.zeros(worlds, np.int64),
        pairs=np.empty((worlds, pair_capacity(parts), 2), np.int64),
        found=np.zeros(worlds, np.int64),
        rows=np.empty((len(steps), worlds * parts), np.int64),
        count=np.zeros(len(steps), np.int64),
        paths=np.empty((worlds * parts, int(steps.max()) + 1, 3)),
        steps=steps,
        kept=new_state(worlds, parts),
    )


@borrowing
def copy_world(source, world, target, to):
    """Copy a world's parts from one state to another, but for the conditions, which stay as they are."""
    for p in range(source.pose.shape[1]):
        for k in range(3):
            target.pose[to, p, k], target.velocity[to, p, k] = source.pose[world, p, k], source.velocity[world, p, k]
            target.mean_velocity[to, p, k] = source.mean_velocity[world, p, k]
        target.fallen[to, p], target.sticking[to, p] = source.fallen[world, p], source.sticking[world, p]


@borrowing
def broad_phase(start, stop, fixed, state, prospect):
    """Find what may touch in worlds ``start`` to ``stop`` within the next period, and write it into ``prospect``.

    Args:
        fixed, state, prospect: addresses of pinned records.

    Returns:
        Whether any world has near pairs, whose paths must be written down, and whether any touches.
    """
    fixed, state, prospect = fixed_encounter_at(fixed), state_at(state), prospect_at(prospect)
    table, bodies, hulls, contacts = fixed.friction.table, fixed.friction.bodies, fixed.hulls, fixed.contacts
    parts = state.pose.shape[1]
    any_near, any_touching = False, False
    for kind in range(prospect.count.shape[0]):
        prospect.count[kind] = 0
    for world in range(start, stop):
        w = world - start
        pairs = prospect.pairs[w]
        found, mode = 0, FREE
        if not state.diverged[world]:
            found = near_pairs(
                table, bodies, hulls, fixed.walls, state, world,
                state.pose[world], state.velocity[world], state.fallen[world], 0.0, pairs, contacts.reach, contacts.order,
            )  # fmt: skip
        if found > 0:
            mode = proximity(table, hulls, state.pose[world], pairs, found, contacts.placed)
        prospect.found[w], prospect.mode[w] = found, mode
        if mode == NEAR:
            any_near = True
            copy_world(state, world, prospect.kept, w)
        if mode == CONTACT:
            any_touching = True
            continue
        for p in range(parts):
            kind = bodies.kind[p]
            prospect.rows[kind, prospect.count[kind]] = world * parts + p
            prospect.count[kind] += 1
    return any_near, any_touching


@borrowing
def was_hit(world, w, encounter, prospect):
    """Whether the period that a world has taken without contacts would have had some."""
    scene, kept = encounter.scene, prospect.kept
    parts = scene.state.pose.shape[1]
    for p in range(parts):  # a wall may be in the way of a part that leaves the table
        if encounter.walls != 0 and scene.state.fallen[world, p] and not kept.fallen[w, p]:
            return True
    return paths_cross(
        scene.table, scene.bodies, encounter.hulls, scene.state, world, prospect.paths, prospect.steps, w * parts,
        prospect.pairs[w], prospect.found[w], encounter.contacts.placed,
    )  # fmt: skip


@borrowing
def resolve(start, stop, fixed, drive, state, prospect, counts):
    """After the period without contacts: take it with contacts in the worlds that need it.

    Args:
        fixed, drive, state, prospect: addresses of pinned records.
        counts: (worlds, COUNTS) int64, added to.
    """
    fixed, state, prospect = fixed_encounter_at(fixed), state_at(state), prospect_at(prospect)
    friction = fixed.friction
    scene = Scene(
        friction.table, friction.bodies, friction.scheme, reference(pinned_drive(drive)), state, friction.workspace
    )
    encounter = reference(
        Encounter(
            reference(scene), fixed.hulls, fixed.solver, fixed.properties, fixed.contacts,
            fixed.couplings, fixed.bend, fixed.overlap, fixed.walls,
        )
    )  # fmt: skip
    for world in range(start, stop):
        w = world - start
        mode = prospect.mode[w]
        if mode == NEAR and state.diverged[world]:
            mode = FREE
        elif mode == NEAR and was_hit(world, w, encounter, prospect):
            mode = CONTACT
            copy_world(prospect.kept, w, state, world)
        counts[world, mode] += 1
        if mode == CONTACT:
            counts[world, CALLS] += collide_period(world, encounter, prospect.pairs[w], prospect.found[w])
