"""A step of pymunk's contact solver, called by address; see :mod:`vibgym.physics.contacts.coupling`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing, call_foreign
from vibgym.kernels.vector import LANES

HIT_SPEED = 0.1
"""Change of velocity by contacts (m/s) above which a part was hit, not held: its contact area is cut again, and the solver does
not start from the impulses of that impact."""

FEWEST_ROUNDS, MOST_ROUNDS = 10, 1000
"""Limits of the solver's iterations over all contacts in a step."""

FAR_AWAY = 1e3
"""Coordinate (m) at which the solver's bodies of fallen parts are stored."""


class Solver(NamedTuple):
    """Addresses of the solver's functions and objects; see :mod:`vibgym.simulation.contact_space`."""

    spaces: np.ndarray  # (spaces,) separate spaces by size: those that have contained many shapes are slower
    capacity: np.ndarray  # (spaces,) largest number of shapes in each, ascending
    step: int  # void(space, float64 h)
    each: int  # void(space, function, batch): for every body in order
    put: int  # function: body from batch
    take: int  # function: body to batch
    update: int  # void(body, float64 h): position by velocity and overlap correction
    add_body: int  # (space, body)
    remove_body: int  # (space, body)
    add: int  # (space, shape)
    remove: int  # (space, shape)
    number_from: int  # void(space, int): id of the next shape
    set_mass: int  # void(body, float64 kg)
    set_moment: int  # void(body, float64 kg m^2)
    set_rounds: int  # void(space, int): iterations in a step
    set_slop: int  # void(space, float64 m): overlap that is not corrected
    last_step: int  # void(space, float64 h): length of the last step, for its cached impulses
    put_all: int  # batches: x, y, heading, vx, vy, spin
    put_velocity: int
    take_all: int  # as put_all
    take_pose: int  # x, y, heading
    data: np.ndarray  # (values,) float64, buffer of all batches
    cursor: np.ndarray  # (1,) int32, start of the next batch
    bodies: np.ndarray  # (parts,) int64
    shapes: np.ndarray  # (shapes,) int64
    owner: np.ndarray  # (parts + 1,) first shape of each part
    material: np.ndarray  # (parts,) index of the wall material
    wall_shapes: np.ndarray  # (spaces, 4, materials) shapes, 0: none
    added_walls: np.ndarray  # (4, materials) bool: shapes in the space


@borrowing
def rounds_needed(parts, ratio):
    """Return the solver's iterations: impulses must propagate through a heap, and from heavy to light parts.

    A light part between a heavy one and a wall transmits a share ``light / heavy`` of the impulse in each iteration.

    Args:
        parts: number of parts.
        ratio: largest mass over smallest.
    """
    return int(min(FEWEST_ROUNDS + np.rint(2.0 * math.sqrt(parts) + ratio), float(MOST_ROUNDS)))


@borrowing
def space_index(island):
    """Return the index of the smallest space with enough capacity for an island's shapes."""
    solver, shapes, which = island.solver, 0, 0
    for slot in range(island.parts):
        part = island.scene.workspace.part[slot]
        shapes += solver.owner[part + 1] - solver.owner[part]
    while solver.capacity[which] < shapes:
        which += 1
    return which


@borrowing
def add_bodies(solver, space, properties, factor, part, parts):
    """Add the bodies of the first ``parts`` in ``part`` to a space; ``factor``: (all parts,) on mass."""
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
def add_shapes(island, space):
    """Add the shapes of the island's parts at their bodies' poses; ids start at 0."""
    solver = island.solver
    call_foreign(solver.number_from, (space, 0))
    for slot in range(island.parts):
        p = island.scene.workspace.part[slot]
        call_foreign(solver.update, (solver.bodies[p], 0.0))  # sets the transform at which shapes are added
        for k in range(solver.owner[p], solver.owner[p + 1]):
            call_foreign(solver.add, (space, solver.shapes[k]))


@borrowing
def add_walls(island, n):
    """Add the walls in the first ``n`` pairs, for the materials of their parts."""
    if island.walls == 0:
        return
    solver, pairs, which = island.solver, island.contacts.pairs, space_index(island)
    materials = solver.wall_shapes.shape[2]
    for pair in range(n):
        if pairs[pair, 1] < 0:
            wall, material = -1 - pairs[pair, 1], solver.material[island.scene.workspace.part[pairs[pair, 0]]]
            if not solver.added_walls[wall, material]:
                solver.added_walls[wall, material] = True
                call_foreign(solver.number_from, (solver.spaces[which], wall * materials + material))
                call_foreign(solver.add, (solver.spaces[which], solver.wall_shapes[which, wall, material]))


@borrowing
def undo_overlap(island, space, h):
    """Move parts by the solver's overlap correction, a pseudo-velocity of this step.

    Args:
        island: after the solver's step, with zero velocities in the solver's data.
        space: address.
        h: s, the step's length.
    """
    solver, uncorrected, workspace = island.solver, island.contacts.uncorrected, island.scene.workspace
    data, pose = solver.data, workspace.pose
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.put, solver.put_velocity))
    for slot in range(island.parts):
        call_foreign(solver.update, (solver.bodies[workspace.part[slot]], h))
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.take, solver.take_pose))
    for slot in range(island.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(3):
            if not workspace.away[slot]:
                pose[g, k * LANES + lane] += data[3 * slot + k] - uncorrected[slot, k]


@borrowing
def solve(island, n, h, in_solver, undo):
    """Apply the solver's contact impulses to velocities, and its overlap correction to poses.

    Args:
        island: see :class:`vibgym.physics.contacts.coupling.Island`.
        n: number of near pairs, for walls.
        h: s, the step's length.
        in_solver: whether the parts are in the solver's space already.
        undo: whether any overlap is deep enough to be corrected.

    Returns:
        Whether any part's velocity has changed by more than ``HIT_SPEED``. Such parts are marked in ``workspace.stale``.
    """
    solver, space = island.solver, island.solver.spaces[space_index(island)]
    if not in_solver:
        factor, part = island.scene.state.mass[island.world], island.scene.workspace.part
        add_bodies(solver, space, island.properties, factor, part, island.parts)
        call_foreign(solver.set_slop, (space, island.slop))
    write_bodies(island, space, h)
    if not in_solver:
        add_shapes(island, space)
        add_walls(island, n)
    # The solver starts from the last step's impulses. It scales them with the step but not their stored sums, so that
    # parts would stick together.
    call_foreign(solver.last_step, (space, h))
    call_foreign(solver.step, (space, h))
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.take, solver.take_all))
    hit = read_bodies(island)
    if undo:
        undo_overlap(island, space, h)
    return hit


@borrowing
def write_bodies(island, space, h):
    """Write poses and velocities of the parts to the solver's bodies."""
    solver, workspace = island.solver, island.scene.workspace
    data, pose, velocity, away = solver.data, workspace.pose, workspace.velocity, workspace.away
    for slot in range(island.parts):
        g, lane = slot // LANES, slot % LANES
        for k in range(3):
            speed = 0.0 if away[slot] else velocity[g, k * LANES + lane]
            # The solver's step starts with a motion by velocity, which the friction step already contains.
            data[6 * slot + k] = FAR_AWAY * (slot + 1) if away[slot] else pose[g, k * LANES + lane] - h * speed
            data[6 * slot + 3 + k] = speed
    for k in range(6):  # the last body is the walls'
        data[6 * island.parts + k] = 0.0
    solver.cursor[0] = 0
    call_foreign(solver.each, (space, solver.put, solver.put_all))


@borrowing
def read_bodies(island):
    """Read velocities from the solver's data and poses into ``contacts.uncorrected``; return whether any part was hit.

    The data is left with zeros, for :func:`undo_overlap`.
    """
    solver, hulls, contacts = island.solver, island.hulls, island.contacts
    workspace, sticking = island.scene.workspace, island.scene.state.sticking
    data, velocity, away, hit = solver.data, workspace.velocity, workspace.away, False
    for slot in range(island.parts):
        g, lane, part = slot // LANES, slot % LANES, workspace.part[slot]
        change = 0.0
        for k in range(3):
            at = k * LANES + lane
            # Velocities of bodies without contacts remain bit-identical.
            if not away[slot] and data[6 * slot + 3 + k] != velocity[g, at]:
                arm = 1.0 if k < 2 else hulls.radius[part]
                change = max(change, arm * abs(data[6 * slot + 3 + k] - velocity[g, at]))
                velocity[g, at] = data[6 * slot + 3 + k]
                sticking[island.world, part] = False  # a pushed part no longer sticks
            contacts.uncorrected[slot, k] = data[6 * slot + k]
            data[3 * slot + k] = 0.0
        if change > HIT_SPEED:
            workspace.stale[slot] = True
            hit = True
    for k in range(3):
        data[3 * island.parts + k] = 0.0
    return hit


@borrowing
def clear_impulses(island, hit):
    """Clear the solver's cached impulses of parts that were hit, which are no initial guess for the next step.

    Their shapes are removed and added again with the same ids, which determine the solver's order.
    """
    solver, space, number = island.solver, island.solver.spaces[space_index(island)], 0
    for slot in range(island.parts):
        p = island.scene.workspace.part[slot]
        for k in range(solver.owner[p], solver.owner[p + 1]):
            if hit[slot]:
                call_foreign(solver.remove, (space, solver.shapes[k]))
                call_foreign(solver.number_from, (space, number))
                call_foreign(solver.add, (space, solver.shapes[k]))
            number += 1


@borrowing
def remove_island(island):
    """Remove the island's shapes, bodies and walls from the solver's space."""
    solver, which = island.solver, space_index(island)
    space = solver.spaces[which]
    for slot in range(island.parts):
        p = island.scene.workspace.part[slot]
        for k in range(solver.owner[p], solver.owner[p + 1]):
            call_foreign(solver.remove, (space, solver.shapes[k]))
        call_foreign(solver.remove_body, (space, solver.bodies[p]))
    for wall in range(solver.added_walls.shape[0]):
        for material in range(solver.added_walls.shape[1]):
            if solver.added_walls[wall, material]:
                solver.added_walls[wall, material] = False
                call_foreign(solver.remove, (space, solver.wall_shapes[which, wall, material]))
