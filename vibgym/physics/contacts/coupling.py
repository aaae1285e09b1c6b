"""Parts in touch: the contact solver of another library (pymunk), coupled to friction within the period.

Friction moves the parts for a short while as if they were alone; then the solver changes their velocities by the impulses of
the contacts, and their positions as far as they overlap. The solver only sees contacts once outlines overlap, so the while is
cut short whenever parts would run into one another by more than a small overlap: fast parts meet at the right time and
place and never pass through one another, and parts at rest against one another do not need short steps. In a while in which
nothing can touch, the solver is not called.

The parts of an island (:mod:`vibgym.physics.contacts.islands`) go through a period together, and know of no others. The solver
starts each island's period afresh from poses and velocities: it keeps nothing from one period to the next, so a
state is restored by these alone, and results do not depend on what it saw before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout, reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.approach import conservative_step, invalidate_placement, place_slot
from vibgym.physics.contacts.broad_phase import (
    Circles,
    curvature_bound,
    near_pairs,
    new_circles,
    pair_capacity,
    pair_gap,
    travel_bound,
)
from vibgym.physics.contacts.hulls import Hulls
from vibgym.physics.contacts.impact import CONTACT_FROM, ImpactProperties, resolve_impacts, weigh_parts
from vibgym.physics.contacts.solver import JOLT, Solver, forget_impacts, leave, raise_walls, solve
from vibgym.physics.core.records import friction_in, incline_size
from vibgym.physics.planar.stepper import apply_friction, cut_stale, enter_part
from vibgym.physics.planar.workspace import FixedScene, Scene, Step

STRAY = 0.1
"""m/s along x or y by which contacts may change a part's velocity before the list of pairs that may touch is made anew."""

SHORTEST = 1.0 / 2048.0
"""Length of the shortest step of the coupling, as a share of the longest."""


class Contacts(NamedTuple):
    """Working arrays for the parts of one island; its parts are in the first slots of the scene's workspace."""

    placed: np.ndarray  # (corners, 4)
    fresh: np.ndarray  # (slots,) bool: placed where the part is now
    settled: np.ndarray  # (slots, 3) poses before overlaps are undone
    begun: np.ndarray  # (slots, 3) poses at the step's start
    pushed: np.ndarray  # (slots, 2) m/s, change of velocity by contacts since the period began
    speed: np.ndarray  # (slots, 3) velocities, for the list of pairs
    gone: np.ndarray  # (slots,) m, farthest that a point of the part has got since the period's start, step by step
    turned: np.ndarray  # (slots,) the same at the last cut
    ahead: np.ndarray  # (slots,) m, see vibgym.physics.contacts.approach.bound_motion
    circles: Circles
    found: np.ndarray  # (pairs, 2) in no order
    pairs: np.ndarray  # (pairs, 2) slot and slot, or slot and ``-1 - wall``, in order
    row: np.ndarray  # (slots + 1,) where the pairs of a slot begin
    clear: np.ndarray  # (pairs,) m, gap when the pair was last looked at, and what both had ``gone`` then
    close: np.ndarray  # (pairs,) bool: may touch in this step
    impact: np.ndarray  # (pairs,) bool: come together in it faster than parts that rest against one another
    hit: np.ndarray  # (slots,) bool: by an impact of this step
    deepest: np.ndarray  # (2,) m, smallest gap that a step has ended with since each was set to zero


def new_contacts(parts: int, hulls: Hulls) -> Contacts:
    """Working arrays for any island of a world with these parts."""
    capacity = pair_capacity(parts)
    return Contacts(
        placed=np.zeros(hulls.corner.shape),
        fresh=np.zeros(parts, np.bool_),
        settled=np.zeros((parts, 3)),
        begun=np.zeros((parts, 3)),
        pushed=np.zeros((parts, 2)),
        speed=np.zeros((parts, 3)),
        gone=np.zeros(parts),
        turned=np.zeros(parts),
        ahead=np.zeros(parts),
        circles=new_circles(parts),
        found=np.empty((capacity, 2), np.int64),
        pairs=np.empty((capacity, 2), np.int64),
        row=np.zeros(parts + 1, np.int64),
        clear=np.empty(capacity),
        close=np.zeros(capacity, np.bool_),
        impact=np.zeros(capacity, np.bool_),
        hit=np.zeros(parts, np.bool_),
        deepest=np.zeros(2),
    )


class Coupling(NamedTuple):
    """How finely friction and contacts take turns: by each kind, since an island goes by those of its own parts."""

    steps: np.ndarray  # (kinds,) cuts a period
    substeps: np.ndarray  # (kinds,) Runge-Kutta steps from cut to cut
    bend: np.ndarray  # (kinds,) m that ``mu g h^2`` may be in a step ``h`` of the coupling; infinite: any
    overlap: np.ndarray  # (kinds,) m that an impact may add to the overlap of two parts
    slop: np.ndarray  # (kinds,) m of overlap that the solver leaves alone
    fewest: int  # steps of the coupling in a period


class FixedEncounter(NamedTuple):
    """What stays the same from call to call, pinned in memory."""

    friction: FixedScene  # with a slot for every part of a world
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    coupling: Coupling
    walls: int


FIXED_ENCOUNTER: Layout[FixedEncounter] = Layout("FIXED_ENCOUNTER", __name__)
fixed_encounter_at = FIXED_ENCOUNTER.at


class Encounter(NamedTuple):
    """An island of parts that may touch; kernels hand it on by reference."""

    scene: Scene
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    world: int
    parts: int  # in the first slots
    couplings: int  # steps of the coupling from cut to cut
    overlap: float  # m that an impact may add to the overlap of two parts
    slop: float  # m of overlap that the solver leaves alone
    walls: int  # set of walls, a bit each


@borrowing
def smallest_gap(encounter, pairs, n):
    """Gap of the closest of the pairs that may touch, m; parts that have just fallen touch nothing any more."""
    contacts, workspace, smallest = encounter.contacts, encounter.scene.workspace, math.inf
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        if workspace.away[i] or (j >= 0 and workspace.away[j]):
            contacts.close[pair] = False
        if contacts.close[pair]:
            place_slot(encounter, i)
            other = j
            if j >= 0:
                place_slot(encounter, j)
                other = workspace.part[j]
            gap = pair_gap(encounter.scene.table, encounter.hulls, contacts.placed, workspace.part[i], other)
            smallest = min(smallest, gap)
    return smallest


@borrowing
def order_pairs(contacts, parts, n):
    """Write the ``n`` pairs that were found into ``contacts.pairs``, in the order of their slots, walls last."""
    found, pairs, row = contacts.found, contacts.pairs, contacts.row
    for slot in range(parts + 1):
        row[slot] = 0
    for k in range(n):
        i, j = found[k, 0], found[k, 1]
        row[(j if 0 <= j < i else i) + 1] += 1
    for slot in range(parts):
        row[slot + 1] += row[slot]
    # From behind, so that what is left are the places where the slots begin.
    for k in range(n):
        i, j = found[k, 0], found[k, 1]
        if 0 <= j < i:
            i, j = j, i
        row[i] += 1
        at = row[i] - 1
        pairs[at, 0], pairs[at, 1] = i, j
    for slot in range(parts):
        low = row[slot - 1] if slot > 0 else 0  # each row now ends where the next one began
        for k in range(low + 1, row[slot]):
            j = pairs[k, 1]
            key, at = (j if j >= 0 else parts - 1 - j), k
            while at > low and (pairs[at - 1, 1] if pairs[at - 1, 1] >= 0 else parts - 1 - pairs[at - 1, 1]) > key:
                pairs[at, 1] = pairs[at - 1, 1]
                at -= 1
            pairs[at, 1] = j
    for k in range(n):
        contacts.clear[k] = -math.inf


@borrowing
def pairs_now(encounter):
    """Write the pairs that may come to touch from now on into ``contacts.pairs``; returns their number."""
    scene, contacts = encounter.scene, encounter.contacts
    workspace, circles, count = scene.workspace, contacts.circles, 0
    incline = incline_size(scene.state, encounter.world)
    for slot in range(encounter.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        for k in range(3):
            contacts.speed[slot, k] = workspace.velocity[g, k * LANES + lane]
        if not workspace.away[slot]:
            mu = friction_in(scene.bodies, scene.state, encounter.world, part)
            way = travel_bound(scene.table, mu, incline, contacts.speed[slot, 0], contacts.speed[slot, 1])
            circles.part[count] = slot
            circles.x[count], circles.y[count] = workspace.pose[g, lane], workspace.pose[g, LANES + lane]
            circles.reach[count] = encounter.hulls.radius[part] + way + 1.5 * STRAY * scene.table.period
            count += 1
    n = near_pairs(scene.table, encounter.walls, circles, count, contacts.found)
    for k in range(n):
        contacts.found[k, 0] = circles.part[contacts.found[k, 0]]
        if contacts.found[k, 1] >= 0:
            contacts.found[k, 1] = circles.part[contacts.found[k, 1]]
    order_pairs(contacts, encounter.parts, n)
    return n


@borrowing
def pairs_outdated(encounter):
    """Return whether any part's velocity differs so much from that at the broad phase that its list of pairs is outdated."""
    workspace, speed = encounter.scene.workspace, encounter.contacts.speed
    for slot in range(encounter.parts):
        velocity, lane = workspace.velocity[slot // LANES], slot % LANES
        if not workspace.away[slot] and (
            abs(velocity[lane] - speed[slot, 0]) > STRAY or abs(velocity[LANES + lane] - speed[slot, 1]) > STRAY
        ):
            return True
    return False


@borrowing
def step_of(scene, phase, span):
    """A step of ``span`` s from ``phase = w t`` on, in the scheme's Runge-Kutta steps or shorter ones."""
    table, scheme, cosine, sine = scene.table, scene.scheme, scene.workspace.cosine, scene.workspace.sine
    substeps = int(math.ceil(span * scheme.steps * scheme.substeps / table.period - 1e-9))
    h = span / substeps
    third = 2.0 * math.pi / table.period * h / 3.0
    c, s, turn, rise = math.cos(phase), math.sin(phase), math.cos(third), math.sin(third)
    for node in range(3 * substeps + 1):  # a substep begins where the last one ends
        cosine[node], sine[node] = c, s
        c, s = c * turn - s * rise, s * turn + c * rise
    return Step(phase, span, h, substeps, cosine, sine, 0, 3)


@borrowing
def enter_island(encounter):
    """Put the parts into their slots."""
    scene, contacts = encounter.scene, encounter.contacts
    workspace = scene.workspace
    for slot in range(encounter.parts):
        enter_part(scene, slot, encounter.world, workspace.part[slot], False)
        for k in range(3):
            contacts.begun[slot, k] = workspace.pose[slot // LANES, k * LANES + slot % LANES]
        contacts.gone[slot] = contacts.turned[slot] = contacts.pushed[slot, 0] = contacts.pushed[slot, 1] = 0.0
    for slot in range(encounter.parts, LANES * scene.groups):
        workspace.away[slot] = True


@borrowing
def leave_island(encounter):
    """Take the parts out of their slots after a period; where a number makes no sense, the world keeps its last state."""
    scene, world, pushed = encounter.scene, encounter.world, encounter.contacts.pushed
    state, pose, velocity = scene.state, scene.workspace.pose, scene.workspace.velocity
    total = 0.0
    for slot in range(encounter.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(lane, 3 * LANES, LANES):
            total += abs(pose[g, k]) + abs(velocity[g, k])
    if state.diverged[world] or not total < math.inf:
        state.diverged[world] = True
        return
    for slot in range(encounter.parts):
        g, lane, part = slot // LANES, slot % LANES, scene.workspace.part[slot]
        fallen = state.fallen[world, part]
        for k in range(3):
            place = pose[g, k * LANES + lane]
            state.mean_velocity[world, part, k] = (place - state.pose[world, part, k]) / scene.table.period
            state.pose[world, part, k] = place
            state.velocity[world, part, k] = 0.0 if fallen else velocity[g, k * LANES + lane]
        for k in range(2):
            state.pushed[world, part, k] = pushed[slot, k]
        if fallen:
            state.sticking[world, part] = False


@borrowing
def measure_ways(encounter):
    """After a step: how far each part has got in it."""
    workspace, contacts = encounter.scene.workspace, encounter.contacts
    for slot in range(encounter.parts):
        at, lane, begun = workspace.pose[slot // LANES], slot % LANES, contacts.begun[slot]
        dx, dy, turn = at[lane] - begun[0], at[LANES + lane] - begun[1], at[2 * LANES + lane] - begun[2]
        radius = encounter.hulls.radius[workspace.part[slot]]
        contacts.gone[slot] += math.sqrt(dx * dx + dy * dy) + radius * abs(turn)
        for k in range(3):
            begun[k] = at[k * LANES + lane]


@borrowing
def write_paths(encounter, paths, turn, step):
    """Write down where the parts are after ``turn`` cuts, and how far they may have been meanwhile from where they were at the
    last one; ``step``: s, the longest that friction took alone."""
    scene, contacts = encounter.scene, encounter.contacts
    workspace = scene.workspace
    for slot in range(encounter.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        for k in range(3):
            paths.pose[part, turn, k] = workspace.pose[g, k * LANES + lane]
        if turn > 0:
            bend = curvature_bound(scene.table, scene.bodies, encounter.hulls, scene.state, encounter.world, part, step)
            paths.travel[part, turn - 1] = contacts.gone[slot] - contacts.turned[slot] + bend
        else:
            paths.steps[part], paths.driven[part] = scene.scheme.steps, True
        contacts.turned[slot] = contacts.gone[slot]


@borrowing
def add_contact_velocity(encounter, sign):
    """Accumulate the velocity change by contacts: call with ``sign`` -1 before contacts are resolved and 1 after."""
    velocity, pushed = encounter.scene.workspace.velocity, encounter.contacts.pushed
    for slot in range(encounter.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(2):
            pushed[slot, k] += sign * velocity[g, k * LANES + lane]


@borrowing
def take_step(encounter, n, h, phase, entered):
    """One step of the coupling: friction alone, then what contacts do.

    Args:
        n: pairs in ``contacts.pairs`` that may come to touch.
        h: what :func:`vibgym.physics.contacts.approach.conservative_step` returned.
        phase: w t at its start.
        entered: whether the parts are in the solver already.

    Returns:
        Whether the solver was called, whether any part is to be cut again, and the number of pairs from now on.
    """
    scene, contacts = encounter.scene, encounter.contacts
    apply_friction(scene, reference(step_of(scene, phase, h.h)))
    invalidate_placement(encounter)
    called, stale = False, False
    if h.touching:
        pairs = contacts.pairs
        gap = smallest_gap(encounter, pairs, n)
        contacts.deepest[0] = min(contacts.deepest[0], gap)
        if gap < -CONTACT_FROM:
            undo = gap < -encounter.slop
            add_contact_velocity(encounter, -1.0)
            if h.impact:
                hit, stale = resolve_impacts(encounter, pairs, n, JOLT)
                if hit and entered:
                    forget_impacts(encounter, contacts.hit)
            stale = solve(encounter, n, h.h, entered, undo) or stale
            called = True
            add_contact_velocity(encounter, 1.0)
            if undo:
                invalidate_placement(encounter)
            if not entered or pairs_outdated(encounter):  # parts now go where friction alone would not have taken them
                n = pairs_now(encounter)
                raise_walls(encounter, n)
            if stale:
                forget_impacts(encounter, scene.workspace.stale)
    measure_ways(encounter)
    return called, stale, n


@borrowing
def collide_period(encounter, n, paths):
    """Advance an island by a period with contacts, changing the state in place.

    Args:
        n: pairs in ``contacts.pairs`` that may come to touch; overwritten.
        paths: where to write down where its parts go.

    Returns:
        How often the solver was called.
    """
    scene, contacts = encounter.scene, encounter.contacts
    workspace, steps = scene.workspace, scene.scheme.steps
    span = scene.table.period / steps
    longest = span / encounter.couplings
    enter_island(encounter)
    weigh_parts(encounter)
    invalidate_placement(encounter)
    write_paths(encounter, paths, 0, longest)
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
            step = conservative_step(encounter, contacts.pairs, n, most, SHORTEST * longest)
            elapsed = span if step.h == left else elapsed + step.h
            phase = 2.0 * math.pi / scene.table.period * (turn * span + span - left)
            called, stale, n = take_step(encounter, n, step, phase, calls > 0)
            if called:
                calls += 1
        write_paths(encounter, paths, turn + 1, longest)
    if calls > 0:
        leave(encounter)
    leave_island(encounter)
    return calls
