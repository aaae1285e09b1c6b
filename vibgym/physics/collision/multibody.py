"""Worlds with several parts, or with walls: each period, only what a world needs.

1. :func:`survey` finds out in which worlds anything is near enough to touch within the period
   (:mod:`vibgym.physics.collision.broad_phase`).
2. Where something touches already, the period is taken with contacts. All others go through
   :func:`vibgym.physics.friction.planar.slide_rows`, kind by kind, with the numbers of worlds that have one part.
3. :func:`follow_up` compares the paths of what was near. Worlds in which no pair has touched are done; the others go back to
   the period's start and take it with contacts (:mod:`vibgym.physics.collision.coupling`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.physics.collision.broad_phase import NEAR, NEVER, TOUCHING, near_pairs, pair_capacity, paths_cross, standing
from vibgym.physics.collision.coupling import collide_period, new_workshop
from vibgym.physics.core.jit import jit
from vibgym.physics.core.records import State, body_of
from vibgym.physics.friction.by_points import cells_across, contact_arrays, most_split
from vibgym.physics.friction.planar import Scheme

FREE, LOOKED, CONTACT, CALLS = 0, 1, 2, 3
"""Columns of the counts: periods in which nothing was near, in which nothing near touched, with contacts; solver calls."""

COUNTS = 4


class Survey(NamedTuple):
    """What is known of a block of worlds before a period."""

    mode: np.ndarray  # (worlds,) NEVER, NEAR or TOUCHING
    pairs: np.ndarray  # (worlds, capacity, 2)
    found: np.ndarray  # (worlds,) number of pairs
    rows: np.ndarray  # (kinds, worlds * parts) what goes without contacts, as world * parts + part
    count: np.ndarray  # (kinds,) number of rows
    paths: np.ndarray  # (worlds * parts, most steps + 1, 3)
    kept: State  # of the worlds that may have to take the period again


def new_survey(worlds: int, kinds: int, parts: int, steps: int) -> Survey:
    """Arrays for a block of ``worlds`` and up to ``steps`` steps a period."""
    flags = (worlds, parts)
    return Survey(
        mode=np.zeros(worlds, np.int64),
        pairs=np.empty((worlds, pair_capacity(parts), 2), np.int64),
        found=np.zeros(worlds, np.int64),
        rows=np.empty((kinds, worlds * parts), np.int64),
        count=np.zeros(kinds, np.int64),
        paths=np.empty((worlds * parts, steps + 1, 3)),
        kept=State(
            np.empty((*flags, 3)), np.empty((*flags, 3)), np.empty((*flags, 3)),
            np.empty(flags, bool), np.empty(flags, bool), np.empty(flags, bool), np.empty(worlds, bool),
        ),
    )  # fmt: skip


class CrowdScheme(NamedTuple):
    """Steps, and what may be hit."""

    steps: np.ndarray  # (kinds,) without contacts
    with_contacts: Scheme  # of all parts where there are contacts
    couplings: int  # fewest steps of the coupling from cut to cut
    overlap: float  # m that a blow may add to the overlap of two parts
    walls: int  # set of walls, a bit each


@jit
def survey(start, stop, table, bodies, hulls, walls, state, seen):
    """Find what may touch in worlds ``start`` to ``stop`` within the next period, and write it into ``seen``.

    Returns:
        Whether any world has near pairs, whose paths must be written down, and whether any touches.
    """
    parts = state.pose.shape[1]
    reach, order = np.empty(parts), np.zeros(parts, np.int64)
    placed = np.zeros(hulls.corner.shape)
    any_near, any_touching = False, False
    kept = seen.kept
    seen.count[:] = 0
    for world in range(start, stop):
        w = world - start
        seen.found[w], seen.mode[w] = 0, NEVER
        if not state.diverged[world]:
            seen.found[w] = near_pairs(
                table, bodies, hulls, walls, state.pose[world], state.velocity[world], state.fallen[world],
                0.0, seen.pairs[w], reach, order,
            )  # fmt: skip
        if seen.found[w] > 0:
            seen.mode[w] = standing(table, hulls, state.pose[world], seen.pairs[w], seen.found[w], placed)
        if seen.mode[w] == NEAR:
            any_near = True
            kept.pose[w], kept.velocity[w] = state.pose[world], state.velocity[world]
            kept.mean_velocity[w] = state.mean_velocity[world]
            kept.fallen[w], kept.sticking[w] = state.fallen[world], state.sticking[world]
        if seen.mode[w] == TOUCHING:
            any_touching = True
        else:
            for p in range(parts):
                kind = bodies.kind[p]
                seen.rows[kind, seen.count[kind]] = world * parts + p
                seen.count[kind] += 1
    return any_near, any_touching


@jit
def follow_up(start, stop, drive, table, bodies, hulls, scheme, solver, state, seen, counts):
    """After the period without contacts: take it with contacts in the worlds that need it.

    Args:
        counts: (worlds, COUNTS) int64, added to.
    """
    parts = state.pose.shape[1]
    corners, across = 0, 0
    for kind in range(bodies.area.shape[0]):
        body = body_of(bodies, kind)
        corners = max(corners, body.outline.shape[0])
        across = max(across, cells_across(table, body, most_split(table, body, scheme.with_contacts)))
    contact = contact_arrays(corners, across)
    shop = new_workshop(table, bodies, hulls)
    kept = seen.kept
    for world in range(start, stop):
        w = world - start
        if seen.mode[w] == NEAR and not state.diverged[world]:
            lost = False  # a wall may be in the way of a part that leaves the table
            for p in range(parts):
                lost = lost or (scheme.walls != 0 and state.fallen[world, p] and not kept.fallen[w, p])
            if lost or paths_cross(
                table, bodies, hulls, seen.paths, scheme.steps, w * parts, seen.pairs[w], seen.found[w], shop.placed
            ):
                seen.mode[w] = TOUCHING
                state.pose[world], state.velocity[world] = kept.pose[w], kept.velocity[w]
                state.mean_velocity[world] = kept.mean_velocity[w]
                state.fallen[world], state.sticking[world] = kept.fallen[w], kept.sticking[w]
            else:
                counts[world, LOOKED] += 1
        elif seen.mode[w] != TOUCHING:
            counts[world, FREE] += 1
        if seen.mode[w] == TOUCHING:
            counts[world, CONTACT] += 1
            counts[world, CALLS] += collide_period(
                world, drive, table, bodies, hulls, scheme.with_contacts, scheme.couplings, scheme.overlap, solver, contact,
                scheme.walls, state, seen.pairs[w], seen.found[w], shop,
            )  # fmt: skip
