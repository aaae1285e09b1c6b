"""Parts in touch: the contact solver of another library (pymunk), coupled to friction within the period.

Friction moves the parts for a short while as if they were alone; then the solver changes their velocities by the impulses of
the contacts, and their positions as far as they overlap. The solver only sees contacts once outlines overlap, so the while is
cut short whenever parts would run into one another by more than a small overlap: fast parts meet at the right time and
place and never pass through one another, and parts at rest against one another do not need short steps. In a while in which
nothing can touch, the solver is not called.

The solver starts each world's period afresh from poses and velocities: it keeps nothing from one period to the next, so a
state is restored by these alone, and results do not depend on which worlds it saw before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym._numba.jit import borrowing
from vibgym._numba.reference import Layout, reference
from vibgym.physics.collision.approach import safe_step
from vibgym.physics.collision.broad_phase import near_pairs, pair_capacity, pair_gap
from vibgym.physics.collision.hulls import Hulls, place_hulls
from vibgym.physics.collision.impact_sequence import CONTACT_FROM, ImpactProperties, resolve_impacts, weigh_parts
from vibgym.physics.collision.solver import JOLT, Solver, forget_impacts, leave, solve
from vibgym.physics.core.records import friction_in, incline_size
from vibgym.physics.planar.pressure_moments import LANES
from vibgym.physics.planar.stepper import apply_friction, cut_stale, enter_part
from vibgym.physics.planar.workspace import FixedScene, Scene, Step

STRAY = 0.1
"""m/s along x or y by which contacts may change a part's velocity before the list of pairs that may touch is made anew."""

SHORTEST = 1.0 / 2048.0
"""Length of the shortest step of the coupling, as a share of the longest."""


class Contacts(NamedTuple):
    """Working arrays for the parts of one world; part k is in slot k of the scene's workspace."""

    placed: np.ndarray  # (corners, 4)
    settled: np.ndarray  # (parts, 3) poses before overlaps are undone
    speed: np.ndarray  # (parts, 3) velocities, for the list of pairs
    reach: np.ndarray  # (parts,) see near_pairs
    order: np.ndarray  # (parts,)
    close: np.ndarray  # (pairs,) bool: may touch in this step
    impact: np.ndarray  # (pairs,) bool: come together in it faster than parts that rest against one another
    hit: np.ndarray  # (parts,) bool: by an impact of this step
    deepest: np.ndarray  # (1,) m, smallest gap that a step has ended with since this was set to zero


def new_contacts(parts: int, hulls: Hulls) -> Contacts:
    """Working arrays for any world with these parts."""
    return Contacts(
        placed=np.zeros(hulls.corner.shape),
        settled=np.zeros((parts, 3)),
        speed=np.zeros((parts, 3)),
        reach=np.zeros(parts),
        order=np.zeros(parts, np.int64),
        close=np.zeros(pair_capacity(parts), np.bool_),
        impact=np.zeros(pair_capacity(parts), np.bool_),
        hit=np.zeros(parts, np.bool_),
        deepest=np.zeros(1),
    )


class FixedEncounter(NamedTuple):
    """What stays the same from call to call, pinned in memory."""

    friction: FixedScene  # with the steps for contacts, and a slot for every part of a world
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    couplings: int
    bend: float
    overlap: float
    walls: int


FIXED_ENCOUNTER: Layout[FixedEncounter] = Layout("FIXED_ENCOUNTER", __name__)
fixed_encounter_at = FIXED_ENCOUNTER.at


class Encounter(NamedTuple):
    """Worlds in which parts may touch; kernels hand it on by reference."""

    scene: Scene
    hulls: Hulls
    solver: Solver
    properties: ImpactProperties
    contacts: Contacts
    couplings: int  # fewest steps of the coupling from cut to cut
    bend: float  # m that ``mu g h^2`` may be in such a step ``h``; infinite: the number of steps does not depend on friction
    overlap: float  # m that an impact may add to the overlap of two parts
    walls: int  # set of walls, a bit each


@borrowing
def smallest_gap(encounter, pairs, n):
    """Gap of the closest of the pairs that may touch, where the parts are placed now, m; parts that have just fallen touch
    nothing any more."""
    contacts, away, smallest = encounter.contacts, encounter.scene.workspace.away, math.inf
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]):
            contacts.close[pair] = False
        if contacts.close[pair]:
            smallest = min(smallest, pair_gap(encounter.scene.table, encounter.hulls, contacts.placed, i, j))
    return smallest


@borrowing
def place_parts(encounter):
    """Place the hulls of all parts that are on the table."""
    workspace = encounter.scene.workspace
    for p in range(encounter.solver.bodies.shape[0]):
        if not workspace.away[p]:
            at, lane = workspace.pose[p // LANES], p % LANES
            place_hulls(encounter.hulls, p, at[lane], at[LANES + lane], at[2 * LANES + lane], encounter.contacts.placed)


@borrowing
def pairs_now(encounter, pairs):
    """Write the pairs that may come to touch from now on into ``pairs``; returns their number."""
    scene, contacts = encounter.scene, encounter.contacts
    workspace = scene.workspace
    for p in range(encounter.solver.bodies.shape[0]):
        g, lane = p // LANES, p % LANES
        for k in range(3):
            contacts.settled[p, k] = workspace.pose[g, k * LANES + lane]
            contacts.speed[p, k] = workspace.velocity[g, k * LANES + lane]
    return near_pairs(
        scene.table, scene.bodies, encounter.hulls, encounter.walls, scene.state, workspace.world[0],
        contacts.settled, contacts.speed, workspace.away, 1.5 * STRAY * scene.table.period, pairs, contacts.reach,
        contacts.order,
    )  # fmt: skip


@borrowing
def strayed(encounter):
    """Whether any part has been pushed to a velocity at which the list of pairs does not hold."""
    workspace, speed = encounter.scene.workspace, encounter.contacts.speed
    for p in range(encounter.solver.bodies.shape[0]):
        velocity, lane = workspace.velocity[p // LANES], p % LANES
        if not workspace.away[p] and (
            abs(velocity[lane] - speed[p, 0]) > STRAY or abs(velocity[LANES + lane] - speed[p, 1]) > STRAY
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
    for k in range(substeps):
        at = phase + 3 * k * third
        for stage in range(4):
            cosine[4 * k + stage] = math.cos(at + stage * third)
            sine[4 * k + stage] = math.sin(at + stage * third)
    return Step(phase, span, h, substeps, cosine, sine, 0, 4)


@borrowing
def enter_world(scene, world):
    """Put a world's parts into the slots."""
    state = scene.state
    parts = state.pose.shape[1]
    for slot in range(scene.workspace.away.shape[0]):
        part = min(slot, parts - 1)
        enter_part(scene, slot, world, part, slot >= parts or state.fallen[world, part])


@borrowing
def leave_world(scene, world):
    """Take a world's parts out of the slots after a period; one with a number that makes no sense keeps its last state."""
    state, pose, velocity = scene.state, scene.workspace.pose, scene.workspace.velocity
    total = 0.0
    for g in range(pose.shape[0]):
        for k in range(3 * LANES):
            total += abs(pose[g, k]) + abs(velocity[g, k])
    if state.diverged[world] or not total < math.inf:
        state.diverged[world] = True
        return
    for p in range(state.pose.shape[1]):
        g, lane = p // LANES, p % LANES
        fallen = state.fallen[world, p]
        for k in range(3):
            place = pose[g, k * LANES + lane]
            state.mean_velocity[world, p, k] = (place - state.pose[world, p, k]) / scene.table.period
            state.pose[world, p, k] = place
            state.velocity[world, p, k] = 0.0 if fallen else velocity[g, k * LANES + lane]
        if fallen:
            state.sticking[world, p] = False


@borrowing
def couplings_needed(encounter, world):
    """Fewest steps of the coupling from cut to cut: so many that friction and incline add little to an overlap in each."""
    scene = encounter.scene
    friction = 0.0
    for part in range(encounter.solver.bodies.shape[0]):
        friction = max(friction, friction_in(scene.bodies, scene.state, world, part))
    pull = friction * scene.table.gravity + 0.5 * incline_size(scene.state, world)
    steps = scene.table.period / scene.scheme.steps * math.sqrt(pull / encounter.bend)
    return max(encounter.couplings, int(math.ceil(steps - 1e-9)))


@borrowing
def collide_period(world, encounter, pairs, n):
    """Advance one world by a period with contacts, changing the state in place.

    Args:
        pairs: (capacity, 2) of which ``n`` may come to touch, see :func:`vibgym.physics.collision.broad_phase.near_pairs`;
        overwritten.

    Returns:
        How often the solver was called.
    """
    scene, solver, contacts = encounter.scene, encounter.solver, encounter.contacts
    workspace, steps = scene.workspace, scene.scheme.steps
    span = scene.table.period / steps
    longest = span / couplings_needed(encounter, world)
    enter_world(scene, world)
    weigh_parts(encounter.properties, scene.state.mass[world])
    calls, placed = 0, False
    for turn in range(steps):
        elapsed, stale = 0.0, True
        for slot in range(workspace.stale.shape[0]):
            workspace.stale[slot] = True
        while elapsed < span:
            left = span - elapsed
            if stale:
                cut_stale(scene, left, True)
                stale = False
            if not placed:
                place_parts(encounter)
            most = left if left < (1.0 + 1e-9) * longest else longest
            h, touching, impact = safe_step(encounter, pairs, n, most, SHORTEST * longest)
            elapsed = span if h == left else elapsed + h
            phase = 2.0 * math.pi / scene.table.period * (turn * span + span - left)
            apply_friction(scene, reference(step_of(scene, phase, h)))
            place_parts(encounter)
            placed = True
            if touching:
                gap = smallest_gap(encounter, pairs, n)
                contacts.deepest[0] = min(contacts.deepest[0], gap)
                if gap < -CONTACT_FROM:
                    undo = gap < -solver.slop
                    if impact:
                        hit, stale = resolve_impacts(encounter, pairs, n, JOLT)
                        if hit and calls > 0:
                            forget_impacts(solver, contacts.hit)
                    stale = solve(encounter, world, h, calls > 0, undo) or stale
                    calls += 1
                    placed = not undo
                    if calls == 1 or strayed(encounter):  # parts now go where friction alone would not have taken them
                        n = pairs_now(encounter, pairs)
                    if stale:
                        forget_impacts(solver, workspace.stale)
    if calls > 0:
        leave(solver)
    leave_world(scene, world)
    return calls
