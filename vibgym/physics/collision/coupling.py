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

from vibgym.physics.collision.approach import safe_step
from vibgym.physics.collision.broad_phase import near_pairs, pair_capacity, pair_gap
from vibgym.physics.collision.hulls import Hulls, place_hulls
from vibgym.physics.collision.solver import JOLT, forget_impacts, leave, solve
from vibgym.physics.contact_area.pressure_moments import LANES
from vibgym.physics.core.jit import borrowing
from vibgym.physics.core.records import Bodies, Scheme, Table
from vibgym.physics.friction.stepper import apply_friction, cut_stale, enter_part
from vibgym.physics.friction.workspace import Step, Workspace, new_workspace

SHORTEST = 1.0 / 2048.0
"""Length of the shortest step of the coupling, as a share of the longest."""

CONTACT_FROM = 2e-6
"""m of overlap from which the solver, whose shapes are a little smaller, sees a contact."""


class Contacts(NamedTuple):
    """Working arrays for the parts of one world."""

    friction: Workspace  # part k is in slot k
    placed: np.ndarray  # (corners, 4)
    settled: np.ndarray  # (parts, 3) poses before overlaps are undone
    speed: np.ndarray  # (parts, 3) velocities, for the list of pairs
    reach: np.ndarray  # (parts,) see near_pairs
    order: np.ndarray  # (parts,)
    close: np.ndarray  # (pairs,) bool: may touch in this step


def new_contacts(table: Table, bodies: Bodies, hulls: Hulls, scheme: Scheme) -> Contacts:
    """Working arrays for any world with these parts."""
    parts = len(bodies.kind)
    return Contacts(
        friction=new_workspace(table, bodies, scheme, parts),
        placed=np.zeros(hulls.corner.shape),
        settled=np.zeros((parts, 3)),
        speed=np.zeros((parts, 3)),
        reach=np.zeros(parts),
        order=np.zeros(parts, np.int64),
        close=np.zeros(pair_capacity(parts), np.bool_),
    )


@borrowing
def smallest_gap(table, hulls, pairs, n, contacts):
    """Gap of the closest of the pairs that may touch, where the parts are placed now, m."""
    smallest = math.inf
    for pair in range(n):
        if contacts.close[pair]:
            smallest = min(smallest, pair_gap(table, hulls, contacts.placed, pairs[pair, 0], pairs[pair, 1]))
    return smallest


@borrowing
def place_parts(hulls, parts, contacts):
    """Place the hulls of all parts that are on the table."""
    for p in range(parts):
        if not contacts.friction.away[p]:
            at, lane = contacts.friction.pose[p // LANES], p % LANES
            place_hulls(hulls, p, at[lane], at[LANES + lane], at[2 * LANES + lane], contacts.placed)


@borrowing
def pairs_now(table, bodies, hulls, walls, contacts, pairs):
    """Write the pairs that may come to touch from now on into ``pairs``; returns their number."""
    workspace = contacts.friction
    for p in range(bodies.kind.shape[0]):
        g, lane = p // LANES, p % LANES
        for k in range(3):
            contacts.settled[p, k] = workspace.pose[g, k * LANES + lane]
            contacts.speed[p, k] = workspace.velocity[g, k * LANES + lane]
    return near_pairs(
        table, bodies, hulls, walls, contacts.settled, contacts.speed, workspace.away, JOLT * table.period, pairs,
        contacts.reach, contacts.order,
    )  # fmt: skip


@borrowing
def step_of(table, scheme, workspace, phase, span):
    """A step of ``span`` s from ``phase = w t`` on, in the scheme's Runge-Kutta steps or shorter ones."""
    substeps = int(math.ceil(span * scheme.steps * scheme.substeps / table.period - 1e-9))
    h = span / substeps
    third = 2.0 * math.pi / table.period * h / 3.0
    for k in range(substeps):
        at = phase + 3 * k * third
        for stage in range(4):
            workspace.cosine[4 * k + stage] = math.cos(at + stage * third)
            workspace.sine[4 * k + stage] = math.sin(at + stage * third)
    return Step(phase, span, h, substeps, workspace.cosine, workspace.sine, 0, 4)


@borrowing
def enter_world(table, bodies, state, world, contacts):
    """Put a world's parts into the slots."""
    parts = bodies.kind.shape[0]
    for slot in range(contacts.friction.away.shape[0]):
        part = min(slot, parts - 1)
        enter_part(
            table, bodies, state, contacts.friction, slot, world, part, slot >= parts or state.fallen[world, part]
        )


@borrowing
def leave_world(table, state, world, workspace):
    """Take a world's parts out of the slots after a period; one with a number that makes no sense keeps its last state."""
    total = 0.0
    for g in range(workspace.pose.shape[0]):
        for k in range(3 * LANES):
            total += abs(workspace.pose[g, k]) + abs(workspace.velocity[g, k])
    if state.diverged[world] or not total < math.inf:
        state.diverged[world] = True
        return
    for p in range(state.pose.shape[1]):
        g, lane = p // LANES, p % LANES
        fallen = state.fallen[world, p]
        for k in range(3):
            place = workspace.pose[g, k * LANES + lane]
            state.mean_velocity[world, p, k] = (place - state.pose[world, p, k]) / table.period
            state.pose[world, p, k] = place
            state.velocity[world, p, k] = 0.0 if fallen else workspace.velocity[g, k * LANES + lane]
        if fallen:
            state.sticking[world, p] = False


@borrowing
def collide_period(world, drive, table, bodies, hulls, scheme, solver, state, pairs, n, contacts):
    """Advance one world by a period with contacts, changing ``state`` in place.

    Args:
        scheme: see :class:`vibgym.physics.collision.multibody.MultibodyScheme`.
        pairs: (capacity, 2) of which ``n`` may come to touch, see :func:`vibgym.physics.collision.broad_phase.near_pairs`;
        overwritten.

    Returns:
        How often the solver was called.
    """
    parts, steps, workspace = bodies.kind.shape[0], scheme.with_contacts, contacts.friction
    span = table.period / steps.steps
    longest = span / scheme.couplings
    enter_world(table, bodies, state, world, contacts)
    calls, placed, pushed = 0, False, False
    for turn in range(steps.steps):
        elapsed, stale = 0.0, True
        for slot in range(workspace.stale.shape[0]):
            workspace.stale[slot] = True
        while elapsed < span:
            left = span - elapsed
            if stale:
                if pushed:  # parts now go where friction alone would not have taken them
                    n = pairs_now(table, bodies, hulls, scheme.walls, contacts, pairs)
                cut_stale(table, bodies, steps, drive, state, workspace, left, True)
                stale = False
            if not placed:
                place_parts(hulls, parts, contacts)
            longest_now = left if left < (1.0 + 1e-9) * longest else longest
            h, touching, impact = safe_step(
                table, bodies, hulls, scheme.overlap, pairs, n, contacts, longest_now, SHORTEST * longest
            )
            elapsed = span if h == left else elapsed + h
            phase = 2.0 * math.pi / table.period * (turn * span + span - left)
            apply_friction(table, bodies, steps, drive, state, workspace, step_of(table, steps, workspace, phase, h))
            place_parts(hulls, parts, contacts)
            placed = True
            if touching:
                gap = smallest_gap(table, hulls, pairs, n, contacts)
                if gap < -CONTACT_FROM:
                    undo = gap < -solver.slop
                    stale = solve(solver, hulls, state.sticking[world], contacts, h, calls > 0, impact, undo)
                    calls += 1
                    placed, pushed = not undo, True
                    if stale:
                        forget_impacts(solver, workspace.stale)
    if calls > 0:
        leave(solver)
    leave_world(table, state, world, workspace)
    return calls
