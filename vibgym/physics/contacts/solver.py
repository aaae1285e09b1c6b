"""One step of the contact solver of another library (pymunk), called by address; see
:mod:`vibgym.physics.contacts.coupling`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing, call_foreign
from vibgym.kernels.vector import LANES

JOLT = 0.1
"""m/s; where contacts change a part's velocity by more, it has been hit, not held: what lies beneath it is looked at again, and
the solver does not start from the impulses of that impact."""

FEWEST_ROUNDS, MOST_ROUNDS = 10, 1000
"""Rounds of the solver over all contacts in a step."""

FAR_AWAY = 1e3
"""m; where the solver keeps parts that are not on the table."""


class Solver(NamedTuple):
    """Addresses of the solver's functions and objects; see :mod:`vibgym.simulation.contact_space`."""

    spaces: np.ndarray  # (spaces,) by how many shapes they have served: the more, the slower
    room: np.ndarray  # (spaces,) shapes that each is for, in ascending order
    step: int  # void(space, float64 h)
    each: int  # void(space, function, batch): for every body in order
    put: int  # function: body from batch
    take: int  # function: body to batch
    update: int  # void(body, float64 h): position by velocity and by what undoes overlap
    add_body: int  # (space, body)
    remove_body: int  # (space, body)
    add: int  # (space, shape)
    remove: int  # (space, shape)
    number_from: int  # void(space, int): number that the next shape gets
    set_mass: int  # void(body, float64 kg)
    set_moment: int  # void(body, float64 kg m^2)
    set_rounds: int  # void(space, int): rounds over all contacts in a step
    set_slop: int  # void(space, float64 m): overlap that is left alone
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
    material: np.ndarray  # (parts,) of walls for each part
    bars: np.ndarray  # (spaces, 4, materials) shapes of the walls, 0: none
    raised: np.ndarray  # (4, materials) bool: those that are in the space


@borrowing
def rounds_needed(parts, ratio):
    """Rounds of the solver: a push has to find its way through a heap, and from heavy to light parts.

    A light part between a heavy one and a wall takes up a share ``light / heavy`` of the push in each round.

    Args:
        parts: their number.
        ratio: of the largest mass to the smallest.
    """
    return int(min(FEWEST_ROUNDS + np.rint(2.0 * math.sqrt(parts) + ratio), float(MOST_ROUNDS)))


@borrowing
def space_for(encounter):
    """Which space serves an island: one that has never served many more shapes."""
    solver, shapes, which = encounter.solver, 0, 0
    for slot in range(encounter.parts):
        part = encounter.scene.workspace.part[slot]
        shapes += solver.owner[part + 1] - solver.owner[part]
    while solver.room[which] < shapes:
        which += 1
    return which


@borrowing
def enter_bodies(solver, space, properties, factor, part, parts):
    """Put the bodies of the first ``parts`` in ``part`` into a space, with the factors on the masses of all."""
    heaviest, lightest = 0.0, math.inf
    for slot in range(parts):
        p = part[slot]
        mass = factor[p] * properties.mass[p]
        heaviest, lightest = max(heaviest, mass), min(lightest, mass)
        call_foreign(solver.add_body, (space, solver.bodies[p]))
        call_foreign(solver.set_mass, (solver.bodies[p], mass))
        call_foreign(solver.set_moment, (solver.bodies[p], mass * properties.gyration[p]))
    call_foreign(solver.set_rounds, (space, rounds_needed(parts, heaviest / lightest)))


@borrowing
def enter_shapes(encounter, space):
    """Put their shapes in, where the bodies are now; the first has the number 0."""
    solver = encounter.solver
    call_foreign(solver.number_from, (space, 0))
    for slot in range(encounter.parts):
        p = encounter.scene.workspace.part[slot]
        call_foreign(solver.update, (solver.bodies[p], 0.0))  # shapes are entered where their bodies are
        for k in range(solver.owner[p], solver.owner[p + 1]):
            call_foreign(solver.add, (space, solver.shapes[k]))


@borrowing
def raise_walls(encounter, n):
    """Put the walls in that any of the ``n`` pairs has to do with, for the materials of its parts."""
    if encounter.walls == 0:
        return
    solver, pairs, which = encounter.solver, encounter.contacts.pairs, space_for(encounter)
    materials = solver.bars.shape[2]
    for pair in range(n):
        if pairs[pair, 1] < 0:
            wall, material = -1 - pairs[pair, 1], solver.material[encounter.scene.workspace.part[pairs[pair, 0]]]
            if not solver.raised[wall, material]:
                solver.raised[wall, material] = True
                call_foreign(solver.number_from, (solver.spaces[which], wall * materials + material))
                call_foreign(solver.add, (solver.spaces[which], solver.bars[which, wall, material]))


@borrowing
def undo_overlap(encounter, space, h):
    """Move parts by what undoes overlap: a velocity of its own, which acts in this step only.

    Args:
        encounter: its solver after the step, with zeros for velocities in its data.
        space: address.
        h: s, the step's length.
    """
    solver, settled, workspace = encounter.solver, encounter.contacts.settled, encounter.scene.workspace
    data, pose = solver.data, workspace.pose
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.put, solver.put_velocity))
    for slot in range(encounter.parts):
        call_foreign(solver.update, (solver.bodies[workspace.part[slot]], h))
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.take, solver.take_pose))
    for slot in range(encounter.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(3):
            if not workspace.away[slot]:
                pose[g, k * LANES + lane] += data[3 * slot + k] - settled[slot, k]


@borrowing
def solve(encounter, n, h, entered, undo):
    """Apply the solver's contact impulses to velocities, and its overlap correction to poses.

    Args:
        encounter: see :class:`vibgym.physics.contacts.coupling.Encounter`.
        n: pairs that may touch, for walls.
        h: s, the step's length.
        entered: whether the parts are in the solver already.
        undo: whether any overlap is deep enough to be undone.

    Returns:
        Whether any part was hit: its velocity has changed by more than ``JOLT``. Such parts are marked as stale.
    """
    solver, space = encounter.solver, encounter.solver.spaces[space_for(encounter)]
    if not entered:
        factor, part = encounter.scene.state.mass[encounter.world], encounter.scene.workspace.part
        enter_bodies(solver, space, encounter.properties, factor, part, encounter.parts)
        call_foreign(solver.set_slop, (space, encounter.slop))
    write_bodies(encounter, space, h)
    if not entered:
        enter_shapes(encounter, space)
        raise_walls(encounter, n)
    # The solver begins with the last step's impulses. It would scale them with the step, but not its record of them, and
    # parts would stick together by the difference.
    call_foreign(solver.last_step, (space, h))
    call_foreign(solver.step, (space, h))
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.take, solver.take_all))
    hit = read_bodies(encounter)
    if undo:
        undo_overlap(encounter, space, h)
    return hit


@borrowing
def write_bodies(encounter, space, h):
    """Write poses and velocities of the parts to the solver's bodies."""
    solver, workspace = encounter.solver, encounter.scene.workspace
    data, pose, velocity, away = solver.data, workspace.pose, workspace.velocity, workspace.away
    for slot in range(encounter.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(3):
            speed = 0.0 if away[slot] else velocity[g, k * LANES + lane]
            # The solver's step begins with a move by velocity; friction has already done that.
            data[6 * slot + k] = FAR_AWAY * (slot + 1) if away[slot] else pose[g, k * LANES + lane] - h * speed
            data[6 * slot + 3 + k] = speed
    for k in range(6):  # the last body is that of the walls
        data[6 * encounter.parts + k] = 0.0
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.put, solver.put_all))


@borrowing
def read_bodies(encounter):
    """Take velocities from the solver's data, and leave poses in ``contacts.settled`` and zeros in their place; returns whether
    any part was hit."""
    solver, hulls, contacts = encounter.solver, encounter.hulls, encounter.contacts
    workspace, sticking = encounter.scene.workspace, encounter.scene.state.sticking
    data, velocity, away, hit = solver.data, workspace.velocity, workspace.away, False
    for slot in range(encounter.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        change = 0.0
        for k in range(3):
            at = k * LANES + lane
            # Bodies that touch nothing keep every bit.
            if not away[slot] and data[6 * slot + 3 + k] != velocity[g, at]:
                arm = 1.0 if k < 2 else hulls.radius[part]
                change = max(change, arm * abs(data[6 * slot + 3 + k] - velocity[g, at]))
                velocity[g, at] = data[6 * slot + 3 + k]
                sticking[encounter.world, part] = False  # a part that is pushed sticks no longer
            contacts.settled[slot, k] = data[6 * slot + k]
            data[3 * slot + k] = 0.0
        if change > JOLT:
            workspace.stale[slot] = True
            hit = True
    for k in range(3):
        data[3 * encounter.parts + k] = 0.0
    return hit


@borrowing
def forget_impacts(encounter, hit):
    """Make the solver forget the impulses on parts that were hit: those of an impact are no guess for what follows. Their
    shapes keep their numbers, in the order of which the solver looks at them."""
    solver, space, number = encounter.solver, encounter.solver.spaces[space_for(encounter)], 0
    for slot in range(encounter.parts):
        p = encounter.scene.workspace.part[slot]
        for k in range(solver.owner[p], solver.owner[p + 1]):
            if hit[slot]:
                call_foreign(solver.remove, (space, solver.shapes[k]))
                call_foreign(solver.number_from, (space, number))
                call_foreign(solver.add, (space, solver.shapes[k]))
            number += 1


@borrowing
def leave(encounter):
    """Take the island out of the solver, so that the next one finds it as this one did."""
    solver, which = encounter.solver, space_for(encounter)
    space = solver.spaces[which]
    for slot in range(encounter.parts):
        p = encounter.scene.workspace.part[slot]
        for k in range(solver.owner[p], solver.owner[p + 1]):
            call_foreign(solver.remove, (space, solver.shapes[k]))
        call_foreign(solver.remove_body, (space, solver.bodies[p]))
    for wall in range(solver.raised.shape[0]):
        for material in range(solver.raised.shape[1]):
            if solver.raised[wall, material]:
                solver.raised[wall, material] = False
                call_foreign(solver.remove, (space, solver.bars[which, wall, material]))
