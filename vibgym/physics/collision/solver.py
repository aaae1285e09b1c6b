"""One step of the contact solver of another library (pymunk), called by address; see
:mod:`vibgym.physics.collision.coupling`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym._numba.foreign import call_foreign
from vibgym._numba.jit import borrowing
from vibgym.physics.planar.pressure_moments import LANES

JOLT = 0.1
"""m/s; where contacts change a part's velocity by more, it has been hit, not held: what lies beneath it is looked at again, and
the solver does not start from the impulses of that impact."""

FEWEST_ROUNDS, MOST_ROUNDS = 10, 1000
"""Rounds of the solver over all contacts in a step."""

FAR_AWAY = 1e3
"""m; where the solver keeps parts that are not on the table."""


class Solver(NamedTuple):
    """Addresses of the solver's functions and objects; see :mod:`vibgym.simulation.contact_space`."""

    space: int
    step: int  # void(space, float64 h)
    each: int  # void(space, function, batch): for every body in order
    put: int  # function: body from batch
    take: int  # function: body to batch
    update: int  # void(body, float64 h): position by velocity and by what undoes overlap
    add: int  # (space, shape)
    remove: int  # (space, shape)
    number_from: int  # void(space, int): number that the next shape gets
    set_mass: int  # void(body, float64 kg)
    set_moment: int  # void(body, float64 kg m^2)
    set_rounds: int  # void(space, int): rounds over all contacts in a step
    last_step: int  # void(space, float64 h): the length that impulses of the last step are remembered for
    put_all: int  # batches: x, y, heading, vx, vy, spin
    put_velocity: int
    take_all: int  # as put_all
    take_pose: int  # x, y, heading
    data: np.ndarray  # float64, of all batches
    cursor: np.ndarray  # (1,) int32, where the next batch begins
    bodies: np.ndarray  # (parts,) int64
    shapes: np.ndarray  # (shapes,) int64
    owner: np.ndarray  # (parts + 1,) first shape of each part
    fixed: int  # shapes of the walls, which are numbered first
    slop: float  # m of overlap that the solver leaves alone


@borrowing
def rounds_needed(parts, ratio):
    """Rounds of the solver: a push has to find its way through a heap, and from heavy to light parts.

    A light part between a heavy one and a wall takes up a share ``light / heavy`` of the push in each round.

    Args:
        parts: their number.
        ratio: of the largest mass to the smallest.
    """
    return min(FEWEST_ROUNDS + int(np.rint(2.0 * math.sqrt(parts) + ratio)), MOST_ROUNDS)


@borrowing
def enter(solver, properties, factor):
    """Put a world's parts into the solver, with the factors (parts,) on their masses."""
    heaviest, lightest = 0.0, math.inf
    for p in range(solver.bodies.shape[0]):
        mass = factor[p] * properties.mass[p]
        heaviest, lightest = max(heaviest, mass), min(lightest, mass)
        call_foreign(solver.set_mass, (solver.bodies[p], mass))
        call_foreign(solver.set_moment, (solver.bodies[p], mass * properties.gyration[p]))
    call_foreign(solver.set_rounds, (solver.space, rounds_needed(solver.bodies.shape[0], heaviest / lightest)))
    call_foreign(solver.number_from, (solver.space, solver.fixed))
    for p in range(solver.bodies.shape[0]):
        call_foreign(solver.update, (solver.bodies[p], 0.0))  # shapes are entered where their bodies are
    for k in range(solver.shapes.shape[0]):
        call_foreign(solver.add, (solver.space, solver.shapes[k]))


@borrowing
def undo_overlap(solver, settled, workspace, h):
    """Move parts by what undoes overlap: a velocity of its own, which acts in this step only.

    Args:
        solver: after its step, with zeros for velocities in its data.
        settled: (parts, 3) poses before.
        h: s, the step's length.
    """
    data, pose = solver.data, workspace.pose
    solver.cursor[0] = 0
    call_foreign(solver.each, (solver.space, solver.put, solver.put_velocity))
    for p in range(solver.bodies.shape[0]):
        call_foreign(solver.update, (solver.bodies[p], h))
    solver.cursor[0] = 0
    call_foreign(solver.each, (solver.space, solver.take, solver.take_pose))
    for p in range(solver.bodies.shape[0]):
        g, lane = p // LANES, p % LANES
        for k in range(3):
            if not workspace.away[p]:
                pose[g, k * LANES + lane] += data[3 * p + k] - settled[p, k]


@borrowing
def solve(encounter, world, h, entered, undo):
    """Let the solver change velocities by the contacts' impulses, and poses by what undoes overlap.

    Args:
        encounter: see :class:`vibgym.physics.collision.coupling.Encounter`.
        h: s, the step's length.
        entered: whether the parts are in the solver already.
        undo: whether any overlap is deep enough to be undone.

    Returns:
        Whether any part was hit: its velocity has changed by more than ``JOLT``. Such parts are marked as stale.
    """
    solver, hulls, contacts = encounter.solver, encounter.hulls, encounter.contacts
    workspace, sticking = encounter.scene.workspace, encounter.scene.state.sticking
    parts, away = solver.bodies.shape[0], workspace.away
    data, cursor, pose, velocity = solver.data, solver.cursor, workspace.pose, workspace.velocity
    for p in range(parts):
        g, lane = p // LANES, p % LANES
        for k in range(3):
            speed = 0.0 if away[p] else velocity[g, k * LANES + lane]
            # The solver's step begins with a move by velocity; friction has already done that.
            data[6 * p + k] = FAR_AWAY * (p + 1) if away[p] else pose[g, k * LANES + lane] - h * speed
            data[6 * p + 3 + k] = speed
    cursor[0] = 0
    call_foreign(solver.each, (solver.space, solver.put, solver.put_all))
    if not entered:
        enter(solver, encounter.properties, encounter.scene.state.mass[world])
    # The solver begins with the last step's impulses. It would scale them with the step, but not its record of them, and
    # parts would stick together by the difference.
    call_foreign(solver.last_step, (solver.space, h))
    call_foreign(solver.step, (solver.space, h))
    cursor[0] = 0
    call_foreign(solver.each, (solver.space, solver.take, solver.take_all))
    hit = False
    for p in range(parts):
        g, lane = p // LANES, p % LANES
        change = 0.0
        for k in range(3):
            at = k * LANES + lane
            # Bodies that touch nothing keep every bit.
            if not away[p] and data[6 * p + 3 + k] != velocity[g, at]:
                arm = 1.0 if k < 2 else hulls.radius[p]
                change = max(change, arm * abs(data[6 * p + 3 + k] - velocity[g, at]))
                velocity[g, at] = data[6 * p + 3 + k]
                sticking[world, p] = False  # a part that is pushed sticks no longer
            contacts.settled[p, k] = data[6 * p + k]
            data[3 * p + k] = 0.0
        if change > JOLT:
            workspace.stale[p] = True
            hit = True
    if undo:
        undo_overlap(solver, contacts.settled, workspace, h)
    return hit


@borrowing
def forget_impacts(solver, hit):
    """Make the solver forget the impulses on parts that were hit: those of an impact are no guess for what follows."""
    for p in range(solver.bodies.shape[0]):
        if hit[p]:
            for k in range(solver.owner[p], solver.owner[p + 1]):
                call_foreign(solver.remove, (solver.space, solver.shapes[k]))
                call_foreign(solver.add, (solver.space, solver.shapes[k]))


@borrowing
def leave(solver):
    """Take the parts out of the solver, so that the next world finds it as this one did."""
    for k in range(solver.shapes.shape[0]):
        call_foreign(solver.remove, (solver.space, solver.shapes[k]))
