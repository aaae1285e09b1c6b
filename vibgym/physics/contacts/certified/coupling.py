"""Parts in contact: friction with the table coupled to a contact solver within the period.

Each coupling step moves the parts by friction alone, between two halves of the contact impulses, and corrects the poses
(:mod:`vibgym.physics.contacts.certified.solver`). The solver only detects contacts of outlines that overlap, so conservative
advancement limits the step such that overlaps stay small. Fast parts therefore meet at the right time and place and cannot pass
through each other; parts that rest against each other need no short steps. Steps in which nothing can touch skip the solver.

The parts of an island advance together, independently of all others. The solver starts each island's period from poses and
velocities alone, so that a state consists of these and results do not depend on its history.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import (
    Circles,
    curvature_bound,
    near_pairs,
    new_circles,
    pair_capacity,
    travel_bound,
)
from vibgym.physics.contacts.certified.approach import conservative_step, invalidate_placement
from vibgym.physics.contacts.certified.impact import CONTACT_FROM, clear_hits, resolve_impacts
from vibgym.physics.contacts.certified.solver import (
    Solver,
    begin_contacts,
    discard_forces,
    find_contacts,
    kick,
    solve,
)
from vibgym.physics.contacts.hulls import Hulls
from vibgym.physics.contacts.impulses import HIT_SPEED, ImpactProperties
from vibgym.physics.core.records import friction_in, incline_size
from vibgym.physics.planar.stepper import apply_friction, cut_stale, friction_step, load_part, store_parts
from vibgym.physics.planar.workspace import FixedScene, Scene

REFRESH_SPEED = 0.1
"""Change of a part's velocity along x or y by contacts (m/s) from which on the list of near pairs is updated."""

SHORTEST = 1.0 / 16384.0
"""Shortest coupling step over the longest."""


class Contacts(NamedTuple):
    """Working arrays for one island, whose parts are in the first slots of the scene's workspace."""

    placed: np.ndarray  # (corners, 4)
    fresh: np.ndarray  # (slots,) bool: ``placed`` is up to date
    step_start: np.ndarray  # (slots, 3) poses at the step's start
    start_velocity: np.ndarray  # (slots, 3) velocities then
    pushed: np.ndarray  # (slots, 2) m/s, change of velocity by contacts since the period began
    speed: np.ndarray  # (slots, 3) velocities at the last update of ``pairs``
    travelled: np.ndarray  # (slots,) m, bound on the distance travelled by any point since the period's start
    travelled_at_cut: np.ndarray  # (slots,) m, the same at the last cut
    step_bound: np.ndarray  # (slots,) m, bound on the motion in the next step
    circles: Circles
    found: np.ndarray  # (pairs, 2) unordered
    pairs: np.ndarray  # (pairs, 2) slot and slot, or slot and ``-1 - wall``, ordered
    row: np.ndarray  # (slots + 1,) index of each slot's first pair
    separation: np.ndarray  # (pairs,) m, gap at the last test, plus ``travelled`` of both at that time
    first_feature: np.ndarray  # (pairs,) index of each pair's first row of ``feature``
    feature: np.ndarray  # (pairs of hulls, 2) see :func:`vibgym.physics.contacts.hulls.kept_contact`
    close: np.ndarray  # (pairs,) bool: may touch in this step
    impact: np.ndarray  # (pairs,) bool: may touch, and approach faster than parts at rest against each other
    hit: np.ndarray  # (slots,) bool: in an impact of this step
    deepest: np.ndarray  # (1,) m, smallest gap at the end of a step in this island


def new_contacts(parts: int, hulls: Hulls) -> Contacts:
    """Allocate working arrays for any island of a world with these parts."""
    capacity = pair_capacity(parts)
    return Contacts(
        placed=np.zeros(hulls.corner.shape),
        fresh=np.zeros(parts, np.bool_),
        step_start=np.zeros((parts, 3)),
        start_velocity=np.zeros((parts, 3)),
        pushed=np.zeros((parts, 2)),
        speed=np.zeros((parts, 3)),
        travelled=np.zeros(parts),
        travelled_at_cut=np.zeros(parts),
        step_bound=np.zeros(parts),
        circles=new_circles(parts),
        found=np.empty((capacity, 2), np.int64),
        pairs=np.empty((capacity, 2), np.int64),
        row=np.zeros(parts + 1, np.int64),
        separation=np.empty(capacity),
        first_feature=np.zeros(capacity, np.int64),
        feature=np.full((pair_capacity(len(hulls.rounding)), 2), -1),
        close=np.zeros(capacity, np.bool_),
        impact=np.zeros(capacity, np.bool_),
        hit=np.zeros(parts, np.bool_),
        deepest=np.zeros(1),
    )


class Coupling(NamedTuple):
    """Step sizes of the coupling by kind of part; an island uses the finest of its parts."""

    steps: np.ndarray  # (kinds,) cuts a period
    substeps: np.ndarray  # (kinds,) Runge-Kutta steps from cut to cut
    bend: np.ndarray  # (kinds,) m, limit of ``mu g h^2`` for a coupling step ``h``; infinite: none
    overlap: np.ndarray  # (kinds,) m that an impact may add to the overlap of two parts
    slop: np.ndarray  # (kinds,) m of overlap that the solver does not correct
    fewest: int  # coupling steps in a period


class ContactScene(NamedTuple):
    """Constant data of several parts or walls, pinned in memory."""

    friction: FixedScene  # with a slot for every part of a world
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    coupling: Coupling
    walls: int


CONTACT_SCENE: Layout[ContactScene] = Layout("CONTACT_SCENE", __name__)
contact_scene_at = CONTACT_SCENE.at


class Island(NamedTuple):
    """An island of parts that may touch; kernels pass it by reference."""

    scene: Scene
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    world: int
    parts: int  # in the first slots
    couplings: int  # coupling steps from cut to cut
    overlap: float  # m that an impact may add to the overlap of two parts
    slop: float  # m of overlap that the solver does not correct
    walls: int  # set of walls, a bit each


@jit
def order_pairs(contacts, hulls, part, parts, n):
    """Sort the ``n`` pairs of ``contacts.found`` by slots, walls last, into ``contacts.pairs``; nothing is known of them.

    Args:
        part: (slots,) index of the part in each of the first ``parts`` slots.
    """
    near, pairs, row, features = contacts.found, contacts.pairs, contacts.row, 0
    for slot in range(parts + 1):
        row[slot] = 0
    for k in range(n):
        i, j = near[k, 0], near[k, 1]
        row[(j if 0 <= j < i else i) + 1] += 1
    for slot in range(parts):
        row[slot + 1] += row[slot]
    for k in range(n):
        i, j = near[k, 0], near[k, 1]
        if 0 <= j < i:
            i, j = j, i
        row[i] += 1
        at = row[i] - 1
        pairs[at, 0], pairs[at, 1] = i, j
    for slot in range(parts):
        low = row[slot - 1] if slot > 0 else 0  # ``row[slot]`` is now the end of the slot's pairs
        for k in range(low + 1, row[slot]):
            j = pairs[k, 1]
            key, at = (j if j >= 0 else parts - 1 - j), k
            while at > low and (pairs[at - 1, 1] if pairs[at - 1, 1] >= 0 else parts - 1 - pairs[at - 1, 1]) > key:
                pairs[at, 1] = pairs[at - 1, 1]
                at -= 1
            pairs[at, 1] = j
    for k in range(n):
        contacts.separation[k], contacts.first_feature[k] = -math.inf, features
        one, other = part[pairs[k, 0]], part[max(pairs[k, 1], 0)]
        if pairs[k, 1] >= 0:
            features += (hulls.owner[one + 1] - hulls.owner[one]) * (hulls.owner[other + 1] - hulls.owner[other])
    for k in range(features):
        contacts.feature[k, 0] = contacts.feature[k, 1] = -1


@jit
def update_pairs(island):
    """Write the near pairs into ``contacts.pairs`` and return their number."""
    scene, contacts = island.scene, island.contacts
    workspace, circles, count = scene.workspace, contacts.circles, 0
    incline = incline_size(scene.state, island.world)
    for slot in range(island.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        for k in range(3):
            contacts.speed[slot, k] = workspace.velocity[g, k * LANES + lane]
        if not workspace.away[slot]:
            mu = friction_in(scene.bodies, scene.state, island.world, part)
            way = travel_bound(scene.table, mu, incline, contacts.speed[slot, 0], contacts.speed[slot, 1])
            circles.part[count] = slot
            circles.x[count], circles.y[count] = workspace.pose[g, lane], workspace.pose[g, LANES + lane]
            circles.reach[count] = island.hulls.radius[part] + way + 1.5 * REFRESH_SPEED * scene.table.period
            count += 1
    n = near_pairs(scene.table, island.walls, circles, count, contacts.found)
    order_pairs(contacts, island.hulls, workspace.part, island.parts, n)
    return n


@jit
def pairs_outdated(island):
    """Return whether any part's velocity differs by more than ``REFRESH_SPEED`` from that at the last update of the pairs."""
    workspace, speed = island.scene.workspace, island.contacts.speed
    for slot in range(island.parts):
        velocity, lane = workspace.velocity[slot // LANES], slot % LANES
        if not workspace.away[slot] and (
            abs(velocity[lane] - speed[slot, 0]) > REFRESH_SPEED
            or abs(velocity[LANES + lane] - speed[slot, 1]) > REFRESH_SPEED
        ):
            return True
    return False


@jit
def load_island(island):
    """Load the parts into their slots."""
    scene, contacts = island.scene, island.contacts
    workspace = scene.workspace
    for slot in range(island.parts):
        load_part(scene, slot, island.world, workspace.part[slot], False)
        for k in range(3):
            contacts.step_start[slot, k] = workspace.pose[slot // LANES, k * LANES + slot % LANES]
        contacts.travelled[slot] = contacts.travelled_at_cut[slot] = contacts.pushed[slot, 0] = contacts.pushed[
            slot, 1
        ] = 0.0
    for slot in range(island.parts, LANES * scene.groups):
        workspace.away[slot] = True


@jit
def measure_travel(island):
    """Add the distance that each part has travelled in a step."""
    workspace, contacts = island.scene.workspace, island.contacts
    for slot in range(island.parts):
        at, lane, step_start = workspace.pose[slot // LANES], slot % LANES, contacts.step_start[slot]
        dx, dy, turn = at[lane] - step_start[0], at[LANES + lane] - step_start[1], at[2 * LANES + lane] - step_start[2]
        radius = island.hulls.radius[workspace.part[slot]]
        contacts.travelled[slot] += math.sqrt(dx * dx + dy * dy) + radius * abs(turn)
        for k in range(3):
            step_start[k] = at[k * LANES + lane]


@jit
def record_paths(island, paths, turn, step):
    """Record the poses after ``turn`` cuts, and bounds on the motion since the last one; ``step``: s, longest coupling step."""
    scene, contacts = island.scene, island.contacts
    workspace = scene.workspace
    for slot in range(island.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        for k in range(3):
            paths.pose[part, turn, k] = workspace.pose[g, k * LANES + lane]
        if turn > 0:
            bend = curvature_bound(scene.table, scene.bodies, island.hulls, scene.state, island.world, part, step)
            paths.travel[part, turn - 1] = contacts.travelled[slot] - contacts.travelled_at_cut[slot] + bend
        else:
            paths.steps[part], paths.driven[part] = scene.scheme.steps, True
        contacts.travelled_at_cut[slot] = contacts.travelled[slot]


@jit
def add_contact_velocity(island, sign):
    """Accumulate the velocity change by contacts: call with ``sign`` -1 before contacts are resolved and 1 after."""
    velocity, pushed = island.scene.workspace.velocity, island.contacts.pushed
    for slot in range(island.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(2):
            pushed[slot, k] += sign * velocity[g, k * LANES + lane]


@jit
def coupling_step(island, n, h, phase, first):
    """Take a coupling step: half of the impulses of contacts, friction, and the other half.

    Args:
        n: number of near pairs in ``contacts.pairs``.
        h: result of :func:`vibgym.physics.contacts.certified.approach.conservative_step`.
        phase: w t at the start.
        first: whether no parts have touched in this period.

    Returns:
        Whether any parts touch, whether any must be cut again, and the new number of near pairs.
    """
    scene, contacts = island.scene, island.contacts
    for slot in range(island.parts):
        for k in range(3):
            contacts.start_velocity[slot, k] = scene.workspace.velocity[slot // LANES, k * LANES + slot % LANES]
    kick(island, 0.5 * h.h)
    apply_friction(scene, reference(friction_step(scene, phase, h.h)))
    kick(island, -0.5 * h.h)  # back, since the contacts may have ended
    invalidate_placement(island)
    touching, stale = False, False
    clear_hits(island)
    if h.touching:
        count, gap = find_contacts(island, contacts.pairs, n, h.h)
        contacts.deepest[0] = min(contacts.deepest[0], gap)
        if count > 0:
            add_contact_velocity(island, -1.0)
            hit = h.impact and gap < -CONTACT_FROM and resolve_impacts(island, contacts.pairs, n, HIT_SPEED)
            touching, stale = solve(island, count, h.h)
            stale = stale or hit
            add_contact_velocity(island, 1.0)
        if touching:
            invalidate_placement(island)
            if first or pairs_outdated(island):
                n = update_pairs(island)
    if not touching:
        discard_forces(island)
    measure_travel(island)
    return touching, stale, n


@jit
def advance_island(island, n, paths):
    """Advance an island by a period with contacts, changing the state in place.

    Args:
        n: number of near pairs in ``contacts.pairs``, which is overwritten.
        paths: overwritten for the island's parts.

    Returns:
        Number of calls of the solver.
    """
    scene, contacts = island.scene, island.contacts
    workspace, steps = scene.workspace, scene.scheme.steps
    span = scene.table.period / steps
    longest = span / island.couplings
    load_island(island)
    begin_contacts(island)
    invalidate_placement(island)
    record_paths(island, paths, 0, longest)
    calls = 0
    for turn in range(steps):
        elapsed, stale = 0.0, True
        for slot in range(LANES * scene.groups):
            workspace.stale[slot] = True
        while elapsed < span:
            left = span - elapsed
            if stale:
                cut_stale(scene, left, True)
            most = left if left < (1.0 + 1e-9) * longest else longest
            step = conservative_step(island, contacts.pairs, n, most, SHORTEST * longest)
            elapsed = span if step.h == left else elapsed + step.h
            phase = 2.0 * math.pi / scene.table.period * (turn * span + span - left)
            called, stale, n = coupling_step(island, n, step, phase, calls == 0)
            if called:
                calls += 1
        record_paths(island, paths, turn + 1, longest)
    store_parts(scene, island.world, 0, island.parts, contacts.pushed)
    return calls
