"""Worlds with several parts, or with walls: each period, only what a world needs.

1. Worlds in which nothing is near enough to touch within the period (:mod:`vibgym.physics.neighbours`) go straight through
   :func:`vibgym.physics.planar.slide_rows`, with the numbers of worlds that have one part.
2. Worlds with near pairs take the same way first, and their paths are written down. Where no pair has touched, that is all.
3. The others, and worlds in which something touches at the start, take the period with contacts
   (:mod:`vibgym.physics.contacts`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.physics._jit import jit
from vibgym.physics.careful import cells_across, contact_arrays, most_split
from vibgym.physics.contacts import collide_period, new_workshop
from vibgym.physics.neighbours import NEAR, NEVER, TOUCHING, near_pairs, pair_capacity, paths_cross, standing
from vibgym.physics.planar import Scheme, slide_rows
from vibgym.physics.records import body_of

FREE, LOOKED, CONTACT, CALLS = 0, 1, 2, 3
"""Columns of the counts: periods in which nothing was near, in which nothing near touched, with contacts; solver calls."""

COUNTS = 4


class CrowdScheme(NamedTuple):
    """Step sizes of every kind without contacts, and of all parts with contacts."""

    steps: np.ndarray  # (kinds,)
    substeps: np.ndarray  # (kinds,)
    pieces: int
    lanes: int
    cosine: np.ndarray  # tables of all kinds, one after the other
    sine: np.ndarray
    first: np.ndarray  # (kinds + 1,) of each kind's tables
    contact_steps: int  # cuts a period
    contact_substeps: int  # steps of the coupling in each, at least
    walls: int  # set of walls, a bit each


@jit
def scheme_of(scheme, kind):
    """The scheme of a kind without contacts."""
    first, stop = scheme.first[kind], scheme.first[kind + 1]
    return Scheme(
        scheme.steps[kind], scheme.substeps[kind], scheme.pieces, scheme.lanes,
        scheme.cosine[first:stop], scheme.sine[first:stop],
    )  # fmt: skip


@jit
def advance_crowds(start, stop, drive, table, bodies, hulls, scheme, solver, state, counts, periods):
    """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place.

    Args:
        counts: (worlds, COUNTS) int64, added to.
    """
    worlds, parts, base = stop - start, state.pose.shape[1], start * state.pose.shape[1]
    kinds = bodies.area.shape[0]
    with_contacts = Scheme(
        scheme.contact_steps, scheme.contact_substeps, scheme.pieces, scheme.lanes, scheme.cosine[:0], scheme.sine[:0]
    )
    corners, across = 0, 0
    for kind in range(kinds):
        body = body_of(bodies, kind)
        corners = max(corners, body.outline.shape[0])
        across = max(across, cells_across(table, body, most_split(table, body, with_contacts)))
    contact = contact_arrays(corners, across)
    shop = new_workshop(table, bodies, hulls)
    pairs = np.empty((worlds, pair_capacity(parts), 2), np.int64)
    found, mode = np.zeros(worlds, np.int64), np.zeros(worlds, np.int64)
    reach, order = np.empty(parts), np.zeros(parts, np.int64)
    rows = np.empty(worlds * parts, np.int64)
    paths = np.empty((worlds * parts, scheme.steps.max() + 1, 3))
    placed = np.zeros(hulls.corner.shape)
    # What the period began with, of worlds that may have to take it again.
    pose, velocity, mean_velocity = (
        np.empty((worlds, parts, 3)),
        np.empty((worlds, parts, 3)),
        np.empty((worlds, parts, 3)),
    )
    fallen, sticking = np.empty((worlds, parts), np.bool_), np.empty((worlds, parts), np.bool_)

    for _ in range(periods):
        record = False
        for w in range(worlds):
            world = start + w
            found[w], mode[w] = 0, NEVER
            if not state.diverged[world]:
                found[w] = near_pairs(
                    table, bodies, hulls, scheme.walls, state.pose[world], state.velocity[world], state.fallen[world],
                    pairs[w], reach, order,
                )  # fmt: skip
            if found[w] > 0:
                mode[w] = standing(table, hulls, state.pose[world], pairs[w], found[w], placed)
            if mode[w] == NEAR:
                record = True
                pose[w], velocity[w], mean_velocity[w] = (
                    state.pose[world],
                    state.velocity[world],
                    state.mean_velocity[world],
                )
                fallen[w], sticking[w] = state.fallen[world], state.sticking[world]

        for kind in range(kinds):
            n = 0
            for w in range(worlds):
                for p in range(parts):
                    if mode[w] != TOUCHING and bodies.kind[p] == kind:
                        rows[n] = base + w * parts + p
                        n += 1
            if n > 0:
                slide_rows(
                    rows[:n],
                    drive,
                    table,
                    body_of(bodies, kind),
                    scheme_of(scheme, kind),
                    state,
                    1,
                    record,
                    paths,
                    base,
                )

        for w in range(worlds):
            world = start + w
            if mode[w] == NEAR and not state.diverged[world]:
                if paths_cross(table, bodies, hulls, paths, scheme.steps, w * parts, pairs[w], found[w], placed):
                    mode[w] = TOUCHING
                    state.pose[world], state.velocity[world], state.mean_velocity[world] = (
                        pose[w],
                        velocity[w],
                        mean_velocity[w],
                    )
                    state.fallen[world], state.sticking[world] = fallen[w], sticking[w]
                else:
                    counts[world, LOOKED] += 1
            elif mode[w] != TOUCHING:
                counts[world, FREE] += 1
            if mode[w] == TOUCHING:
                counts[world, CONTACT] += 1
                counts[world, CALLS] += collide_period(
                    world, drive, table, bodies, hulls, with_contacts, solver, contact, state, pairs[w], found[w], shop
                )
