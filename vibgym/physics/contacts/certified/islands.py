"""Islands: groups of parts that may interact within a period; each advances independently of all other parts.

Two parts belong to the same island if they touch at the start of the period, or if their paths may have crossed. Paths are
first computed without contacts, then with those of the island. Islands whose paths cross those of other parts are merged,
reset to the start of the period, and advanced again, until no paths cross.

An island's result depends on its own parts only, which are sorted by pose. So does its composition: whether two paths cross
depends on these two paths only. In the end every pair of parts of different islands is proven to stay apart: it was not near,
it was farther apart than both could travel, or the paths do not cross.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import IN_TOUCH, circle_gap, pair_capacity, paths_cross
from vibgym.physics.contacts.certified.coupling import Island, advance_island, order_pairs
from vibgym.physics.core.records import Scheme, friction_in, incline_size, kind_in
from vibgym.physics.planar.workspace import Scene

CLOSE = 5e-3
"""Gap (m) at the start of a period below which a part joins an island; most such islands would have to be run again."""


class Islands(NamedTuple):
    """Working arrays for the parts of one world: a union-find forest with lists of members."""

    parent: np.ndarray  # (parts,) parent in the forest; a tree is an island or a single part
    waiting: np.ndarray  # (parts,) bool, of a root: the island has to be run
    ran: np.ndarray  # (parts,) bool: was run in this round
    first: np.ndarray  # (parts,) of a root, first member of its list, -1: none
    following: np.ndarray  # (parts,) next member
    slot: np.ndarray  # (parts,) slot in the current island
    entry: np.ndarray  # (parts,) first pair of each part, see link_pairs
    link: np.ndarray  # (2 * pairs,) next pair
    expected_travel: np.ndarray  # (parts,) m, bound on the distance travelled that the broad phase assumed
    travelled: np.ndarray  # (parts,) m, bound on the distance travelled
    calls: np.ndarray  # (parts,) of a root, calls of the solver
    deepest: np.ndarray  # (parts,) m, of a root, smallest gap
    exceeding: np.ndarray  # (parts,) bool: travelled farther than expected in this period


def new_islands(parts: int) -> Islands:
    """Allocate working arrays for a world with ``parts`` parts."""

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
        expected_travel=np.zeros(parts),
        travelled=np.zeros(parts),
        calls=numbers(),
        deepest=np.zeros(parts),
        exceeding=flags(),
    )


@jit
def root_of(islands, part):
    """Return the root of a part's island."""
    parent = islands.parent
    while parent[part] != part:
        parent[part] = parent[parent[part]]
        part = parent[part]
    return part


@jit
def join(islands, i, j):
    """Merge two islands; the result has to be run."""
    one, other = root_of(islands, i), root_of(islands, j)
    if other < one:
        one, other = other, one
    islands.parent[other] = one
    islands.waiting[one] = True


@jit
def link_pairs(islands, pairs, n):
    """Build linked lists of each part's pairs: entry ``2 k`` is pair ``k`` for its first part, ``2 k + 1`` for its second."""
    for part in range(islands.entry.shape[0]):
        islands.entry[part] = -1
    for k in range(n):
        for end in range(2):
            part = pairs[k, end]
            if part >= 0:
                islands.link[2 * k + end] = islands.entry[part]
                islands.entry[part] = 2 * k + end


@jit
def gather_islands(islands):
    """Build linked lists of the members of every island that has to be run."""
    parts = islands.parent.shape[0]
    for part in range(parts):
        islands.first[part] = -1
        islands.ran[part] = False
    for part in range(parts):
        root = root_of(islands, part)
        if islands.waiting[root]:
            islands.following[part] = islands.first[root]
            islands.first[root] = part


@jit
def precedes(pose, part, other):
    """Return whether a part precedes another one in an island: order by pose, not by index."""
    if pose[part, 0] != pose[other, 0]:
        return pose[part, 0] < pose[other, 0]
    return pose[part, 1] < pose[other, 1] or (pose[part, 1] == pose[other, 1] and pose[part, 2] < pose[other, 2])


@jit
def sort_parts(member, n, pose):
    """Sort an island's parts in place (heap sort)."""
    for end in range(n - 1, 0, -1):
        # The first iteration builds the heap; later ones sift its top down.
        for top in range((n - 2) // 2 if end == n - 1 else 0, -1, -1):
            at, part = top, member[top]
            while 2 * at + 1 <= end:
                below = 2 * at + 1
                if below < end and precedes(pose, member[below], member[below + 1]):
                    below += 1
                if not precedes(pose, part, member[below]):
                    break
                member[at] = member[below]
                at = below
            member[at] = part
        member[0], member[end] = member[end], member[0]


@jit
def load_members(islands, root, pairs, workspace, pose, contacts, hulls):
    """Write an island's parts into slots and its pairs into ``contacts.pairs``; return the numbers of both."""
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
    order_pairs(contacts, hulls, workspace.part, parts, n)
    return parts, n


@jit
def scheme_of(fixed, world, part, parts):
    """Return an island's step sizes: those of its kind with the most steps."""
    coupling, bodies = fixed.coupling, fixed.friction.bodies
    finest = kind_in(bodies, world, part[0])
    for slot in range(parts):
        kind = kind_in(bodies, world, part[slot])
        if coupling.steps[kind] > coupling.steps[finest]:
            finest = kind
    steps, substeps, base = coupling.steps[finest], coupling.substeps[finest], fixed.friction.scheme
    return Scheme(steps, substeps, base.pieces, base.cosine, base.sine)


@jit
def run_island(islands, root, fixed, drive, state, world, pairs, paths):
    """Advance an island by a period.

    Args:
        pairs: near pairs of the world, see :func:`link_pairs`.
        paths: overwritten for its parts.
    """
    friction, coupling, contacts = fixed.friction, fixed.coupling, fixed.contacts
    part = friction.workspace.part
    parts, n = load_members(islands, root, pairs, friction.workspace, state.pose[world], contacts, fixed.hulls)
    scheme = scheme_of(fixed, world, part, parts)
    groups = (parts + LANES - 1) // LANES
    scene = Scene(friction.table, friction.bodies, reference(scheme), drive, state, friction.workspace, groups)
    bend, overlap, slop, most = math.inf, math.inf, math.inf, 0.0
    for slot in range(parts):
        kind = kind_in(friction.bodies, world, part[slot])
        bend, overlap = min(bend, coupling.bend[kind]), min(overlap, coupling.overlap[kind])
        slop, most = min(slop, coupling.slop[kind]), max(most, friction_in(friction.bodies, state, world, part[slot]))
    # Enough steps that friction and incline add little to an overlap in each.
    pull = most * friction.table.gravity + 0.5 * incline_size(state, world)
    needed = max(float(coupling.fewest), friction.table.period * math.sqrt(pull / bend))
    couplings = int(math.ceil(needed / scheme.steps - 1e-9))
    contacts.deepest[0] = 0.0
    island = Island(
        reference(scene), fixed.hulls, fixed.solver, fixed.properties, contacts, world, parts, couplings, overlap, slop,
        fixed.walls,
    )  # fmt: skip
    islands.calls[root] = advance_island(reference(island), n, paths)
    islands.deepest[root] = contacts.deepest[0]
    for slot in range(parts):
        islands.ran[part[slot]] = True
        islands.travelled[part[slot]] = 0.0
        for step in range(scheme.steps):
            islands.travelled[part[slot]] += paths.travel[part[slot], step]


@jit
def may_cross(islands, fixed, state, world, paths, i, j):
    """Return whether two parts' paths may have crossed."""
    table, hulls = fixed.friction.table, fixed.hulls
    apart = circle_gap(table, hulls, i, paths.pose[i, 0], j, paths.pose[j, 0])
    if apart > islands.travelled[i] + islands.travelled[j]:
        return False
    return paths_cross(table, fixed.friction.bodies, hulls, state, world, paths, i, j, fixed.contacts.placed)


@jit
def join_crossing_islands(islands, fixed, state, world, pairs, count, paths, away):
    """Merge the islands that were run in this round with parts whose paths may cross theirs.

    Args:
        pairs, count: near pairs of the world, and their number.
        away: (parts,) bool, parts that had fallen before the period.
    """
    parts, any_exceeding = islands.parent.shape[0], False
    for part in range(parts):
        if islands.ran[part] and islands.travelled[part] > islands.expected_travel[part]:
            islands.exceeding[part] = True
        any_exceeding = any_exceeding or islands.exceeding[part]
    for k in range(count):
        i, j = pairs[k, 0], pairs[k, 1]
        if j < 0 or not (islands.ran[i] or islands.ran[j]) or root_of(islands, i) == root_of(islands, j):
            continue
        if not islands.ran[i] or (islands.ran[j] and j < i):
            i, j = j, i
        if may_cross(islands, fixed, state, world, paths, i, j):
            join(islands, i, j)
    # The near pairs are incomplete for parts that travelled farther than expected.
    for part in range(parts if any_exceeding else 0):
        for other in range(parts if islands.ran[part] else 0):
            if (islands.exceeding[part] or islands.exceeding[other]) and not away[other]:
                if root_of(islands, other) != root_of(islands, part):
                    if may_cross(islands, fixed, state, world, paths, part, other):
                        join(islands, part, other)


@jit
def mark_touching(pairs, n, gap, driven):
    """Mark parts in ``driven`` that touch each other or are close to a marked part; their pairs get a gap of -1."""
    for k in range(n):
        i, j = pairs[k, 0], pairs[k, 1]
        if gap[k] < IN_TOUCH or (j >= 0 and gap[k] < CLOSE and (driven[i] or driven[j])):
            gap[k] = -1.0
    for k in range(n):
        if gap[k] == -1.0:
            driven[pairs[k, 0]] = True
            if pairs[k, 1] >= 0:
                driven[pairs[k, 1]] = True


@jit
def begin_islands(islands, fixed, state, world, pairs, n, gap, paths, away):
    """Find the first islands: parts that touch initially, parts whose paths have crossed each other or a wall, and close ones.

    Args:
        state: after the period of the parts without initial contacts.
        pairs: (pairs, 2), of which the first ``n`` are near.
        gap: (pairs,) from :func:`mark_touching`.
        away: (parts,) bool, parts that had fallen before the period.
    """
    table, bodies, hulls, placed = fixed.friction.table, fixed.friction.bodies, fixed.hulls, fixed.contacts.placed
    crossed = islands.ran
    for part in range(islands.parent.shape[0]):
        islands.parent[part], islands.waiting[part], crossed[part] = part, False, False
        islands.travelled[part], paths.driven[part] = islands.expected_travel[part], False
        islands.exceeding[part] = False
    for k in range(n):
        if gap[k] == -1.0:
            paths.driven[pairs[k, 0]] = True
            if pairs[k, 1] >= 0:
                paths.driven[pairs[k, 1]] = True
    for k in range(n):
        i, j = pairs[k, 0], pairs[k, 1]
        if paths.driven[i] or (j >= 0 and paths.driven[j]):
            continue
        # A part that has left the table may have crossed a wall.
        off = j < 0 and state.fallen[world, i] and not away[i]
        if off or paths_cross(table, bodies, hulls, state, world, paths, i, j, placed):
            gap[k], crossed[i] = -1.0, True
            if j >= 0:
                crossed[j] = True
    mark_touching(pairs, n, gap, crossed)
    for k in range(n):
        if gap[k] == -1.0:
            join(islands, pairs[k, 0], pairs[k, 1] if pairs[k, 1] >= 0 else pairs[k, 0])
