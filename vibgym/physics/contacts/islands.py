"""Islands: the parts of a world that go through a period together, each island as if nothing else were on the table.

A part alone is not in any. Two parts are joined if they touch when the period begins, or if their ways through it, each taken
as if the other were not there, may have crossed. A part's way is that without contacts; once it is in an island, it is the
way that the island takes. So islands are run, their ways compared with those of all others, and those that cross are
joined, taken back to the period's start, and run as one, until none do.

What an island does depends on its own parts alone, which are sorted by where they lie. So does which parts it has: whether
two ways cross is a question to these two, and of parts that end up in one island no step on the way there has looked at any
other. When the rounds are over, every pair of parts of different islands has been proven to stay apart: it was not near to
begin with, farther apart than both could get, or its ways do not cross.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import IN_TOUCH, circle_gap, pair_capacity, paths_cross
from vibgym.physics.contacts.coupling import Encounter, collide_period, order_pairs
from vibgym.physics.core.records import Scheme, friction_in, incline_size
from vibgym.physics.planar.workspace import Scene

CLOSE = 5e-3
"""m; what begins a period nearer than this to a part of an island is taken along: else most would have to be run again."""


class Islands(NamedTuple):
    """Working arrays for the parts of the world at hand."""

    parent: np.ndarray  # (parts,) of a forest: a tree is an island, or a part alone
    waiting: np.ndarray  # (parts,) bool: of a root, its island has to be run
    ran: np.ndarray  # (parts,) bool: in this round
    first: np.ndarray  # (parts,) of a root, one of the parts of its island, -1: none
    following: np.ndarray  # (parts,) another one
    slot: np.ndarray  # (parts,) of the island at hand
    entry: np.ndarray  # (parts,) the first pair of each part, see link_pairs
    link: np.ndarray  # (2 * pairs,) the next one
    bound: np.ndarray  # (parts,) m, way that is expected of a part at most
    far: np.ndarray  # (parts,) m, way that it has made at most
    calls: np.ndarray  # (parts,) of the solver, of a root
    deepest: np.ndarray  # (parts,) m, of a root
    beyond: np.ndarray  # (parts,) indices of parts that moved farther than their bound


def new_islands(parts: int) -> Islands:
    """Working arrays for worlds with so many parts."""

    def numbers() -> np.ndarray:
        return np.zeros(parts, np.int64)

    def flags() -> np.ndarray:
        return np.zeros(parts, np.bool_)

    return Islands(
        parent=numbers(),
        waiting=flags(),
        ran=flags(),
        first=numbers(),
        following=numbers(),
        slot=numbers(),
        entry=numbers(),
        link=np.empty(2 * pair_capacity(parts), np.int64),
        bound=np.zeros(parts),
        far=np.zeros(parts),
        calls=numbers(),
        deepest=np.zeros(parts),
        beyond=numbers(),
    )


@borrowing
def root_of(islands, part):
    """The part that stands for an island."""
    parent = islands.parent
    while parent[part] != part:
        parent[part] = parent[parent[part]]
        part = parent[part]
    return part


@borrowing
def join(islands, i, j):
    """Make one island of two, which has to be run."""
    one, other = root_of(islands, i), root_of(islands, j)
    if other < one:
        one, other = other, one
    islands.parent[other] = one
    islands.waiting[one] = True


@borrowing
def link_pairs(islands, pairs, n):
    """Make a list of each part's pairs: ``2 k`` is pair ``k`` seen from its first part, ``2 k + 1`` from its second."""
    for part in range(islands.entry.shape[0]):
        islands.entry[part] = -1
    for k in range(n):
        for end in range(2):
            part = pairs[k, end]
            if part >= 0:
                islands.link[2 * k + end] = islands.entry[part]
                islands.entry[part] = 2 * k + end


@borrowing
def gather_islands(islands):
    """Make a list of the parts of every island that has to be run."""
    parts = islands.parent.shape[0]
    for part in range(parts):
        islands.first[part] = -1
        islands.ran[part] = False
    for part in range(parts):
        root = root_of(islands, part)
        if islands.waiting[root]:
            islands.following[part] = islands.first[root]
            islands.first[root] = part


@borrowing
def lies_before(pose, part, other):
    """The order of an island's parts, which is that of their places and not of their numbers."""
    if pose[part, 0] != pose[other, 0]:
        return pose[part, 0] < pose[other, 0]
    return pose[part, 1] < pose[other, 1] or (pose[part, 1] == pose[other, 1] and pose[part, 2] < pose[other, 2])


@borrowing
def sort_parts(member, n, pose):
    """Bring an island's parts into their order: a heap sort, for it needs no more room."""
    for end in range(n - 1, 0, -1):
        # The first time all of the heap is built, later only its top sinks.
        for top in range((n - 2) // 2 if end == n - 1 else 0, -1, -1):
            at, part = top, member[top]
            while 2 * at + 1 <= end:
                below = 2 * at + 1
                if below < end and lies_before(pose, member[below], member[below + 1]):
                    below += 1
                if not lies_before(pose, part, member[below]):
                    break
                member[at] = member[below]
                at = below
            member[at] = part
        member[0], member[end] = member[end], member[0]


@borrowing
def put_together(islands, root, pairs, workspace, pose, contacts):
    """Write an island's parts into slots, and its pairs into ``contacts.pairs``; returns the numbers of both."""
    parts, part = 0, islands.first[root]
    while part >= 0:
        workspace.part[parts] = part
        parts += 1
        part = islands.following[part]
    sort_parts(workspace.part, parts, pose)
    for slot in range(parts):
        islands.slot[workspace.part[slot]] = slot
    n = 0
    for slot in range(parts):
        entry = islands.entry[workspace.part[slot]]
        while entry >= 0:
            other = pairs[entry >> 1, 1]
            if entry & 1 == 0 and (other < 0 or root_of(islands, other) == root):
                contacts.found[n, 0] = slot
                contacts.found[n, 1] = other if other < 0 else islands.slot[other]
                n += 1
            entry = islands.link[entry]
    order_pairs(contacts, parts, n)
    return parts, n


@borrowing
def scheme_of(fixed, part, parts):
    """The steps of an island: those of the kind among its parts that takes most."""
    coupling, kinds, finest = fixed.coupling, fixed.friction.bodies.kind, part[0]
    for slot in range(parts):
        if coupling.steps[kinds[part[slot]]] > coupling.steps[kinds[finest]]:
            finest = part[slot]
    steps, substeps, base = coupling.steps[kinds[finest]], coupling.substeps[kinds[finest]], fixed.friction.scheme
    return Scheme(steps, substeps, base.pieces, base.cosine, base.sine)


@borrowing
def run_island(islands, root, fixed, drive, state, world, pairs, paths):
    """Take an island through the period, from the state that its parts have.

    Args:
        pairs: of the world, see :func:`link_pairs`.
        paths: overwritten for its parts.
    """
    friction, coupling, contacts = fixed.friction, fixed.coupling, fixed.contacts
    kinds, part = friction.bodies.kind, friction.workspace.part
    parts, n = put_together(islands, root, pairs, friction.workspace, state.pose[world], contacts)
    scheme = scheme_of(fixed, part, parts)
    groups = (parts + LANES - 1) // LANES
    scene = Scene(friction.table, friction.bodies, reference(scheme), drive, state, friction.workspace, groups)
    bend, overlap, slop, most = math.inf, math.inf, math.inf, 0.0
    for slot in range(parts):
        kind = kinds[part[slot]]
        bend, overlap = min(bend, coupling.bend[kind]), min(overlap, coupling.overlap[kind])
        slop, most = min(slop, coupling.slop[kind]), max(most, friction_in(friction.bodies, state, world, part[slot]))
    # So many steps that friction and incline add little to an overlap in each.
    pull = most * friction.table.gravity + 0.5 * incline_size(state, world)
    needed = max(float(coupling.fewest), friction.table.period * math.sqrt(pull / bend))
    couplings = int(math.ceil(needed / scheme.steps - 1e-9))
    contacts.deepest[0] = 0.0
    encounter = Encounter(
        reference(scene), fixed.hulls, fixed.solver, fixed.properties, contacts, world, parts, couplings, overlap, slop,
        fixed.walls,
    )  # fmt: skip
    islands.calls[root] = collide_period(reference(encounter), n, paths)
    islands.deepest[root] = contacts.deepest[0]
    for slot in range(parts):
        islands.ran[part[slot]] = True
        islands.far[part[slot]] = 0.0
        for step in range(scheme.steps):
            islands.far[part[slot]] += paths.travel[part[slot], step]


@borrowing
def may_cross(islands, fixed, state, world, paths, i, j):
    """Whether two parts' ways may have crossed; seldom asked for parts that never came near one another."""
    table, hulls = fixed.friction.table, fixed.hulls
    apart = circle_gap(table, hulls, i, paths.pose[i, 0], j, paths.pose[j, 0])
    if apart > islands.far[i] + islands.far[j]:
        return False
    return paths_cross(table, fixed.friction.bodies, hulls, state, world, paths, i, j, fixed.contacts.placed)


@borrowing
def join_crossing_islands(islands, fixed, state, world, pairs, paths, away, beyond):
    """Join the islands that have just been run with parts whose paths may cross theirs.

    Args:
        away: (parts,) bool, parts that had fallen before the period.
        beyond: how many parts have come farther than expected, in ``islands.beyond``.

    Returns:
        The number of these now.
    """
    parts = islands.parent.shape[0]
    for part in range(parts):
        if islands.ran[part] and islands.far[part] > islands.bound[part]:
            known = False
            for k in range(beyond):
                known = known or islands.beyond[k] == part
            if not known:
                islands.beyond[beyond] = part
                beyond += 1
    for part in range(parts):
        if not islands.ran[part]:
            continue
        entry = islands.entry[part]
        while entry >= 0:
            other = pairs[entry >> 1, 1 - (entry & 1)]
            twice = other >= 0 and islands.ran[other] and other < part
            if other >= 0 and not twice and root_of(islands, other) != root_of(islands, part):
                if may_cross(islands, fixed, state, world, paths, part, other):
                    join(islands, part, other)
            entry = islands.link[entry]
        # The list of pairs does not hold for parts that were pushed hard.
        all_of_them = islands.far[part] > islands.bound[part]
        for k in range(parts if all_of_them else beyond):
            other = k if all_of_them else islands.beyond[k]
            if not away[other] and root_of(islands, other) != root_of(islands, part):
                if may_cross(islands, fixed, state, world, paths, part, other):
                    join(islands, part, other)
    return beyond


@borrowing
def mark_touching(pairs, n, gap, driven):
    """Mark parts in touch with, or close to, a marked part in ``driven``; the pairs of both get a gap of -1."""
    for k in range(n):
        i, j = pairs[k, 0], pairs[k, 1]
        if gap[k] < IN_TOUCH or (j >= 0 and gap[k] < CLOSE and (driven[i] or driven[j])):
            gap[k] = -1.0
    for k in range(n):
        if gap[k] == -1.0:
            driven[pairs[k, 0]] = True
            if pairs[k, 1] >= 0:
                driven[pairs[k, 1]] = True


@borrowing
def begin_islands(islands, fixed, state, world, pairs, n, gap, paths, away):
    """Find the first islands of a world: what touched to begin with, parts alone whose ways have crossed, or that a wall was in
    the way of, and what is close to any of these.

    Args:
        state: after the parts that nothing touched have gone through the period.
        pairs: of which ``n`` are near.
        gap: (pairs,) as :func:`mark_touching` left it.
        away: (parts,) bool, parts that had fallen before the period.
    """
    table, bodies, hulls, placed = fixed.friction.table, fixed.friction.bodies, fixed.hulls, fixed.contacts.placed
    crossed = islands.ran
    for part in range(islands.parent.shape[0]):
        islands.parent[part], islands.waiting[part], crossed[part] = part, False, False
        islands.far[part], paths.driven[part] = islands.bound[part], False
    for k in range(n):
        if gap[k] == -1.0:
            paths.driven[pairs[k, 0]] = True
            if pairs[k, 1] >= 0:
                paths.driven[pairs[k, 1]] = True
    for k in range(n):
        i, j = pairs[k, 0], pairs[k, 1]
        if paths.driven[i] or (j >= 0 and paths.driven[j]):
            continue
        # A wall may be in the way of a part that leaves the table.
        off = j < 0 and state.fallen[world, i] and not away[i]
        if off or paths_cross(table, bodies, hulls, state, world, paths, i, j, placed):
            gap[k], crossed[i] = -1.0, True
            if j >= 0:
                crossed[j] = True
    mark_touching(pairs, n, gap, crossed)
    for k in range(n):
        if gap[k] == -1.0:
            join(islands, pairs[k, 0], pairs[k, 1] if pairs[k, 1] >= 0 else pairs[k, 0])
