"""Planar contact, resolved in time: one part per world on the vibrating elements, sliding and sticking.

A period is divided into ``steps``. Each step cuts the outline once, at the pose predicted for its middle, and then takes
``substeps`` Runge-Kutta steps (Kutta's 3/8 rule, whose even weights suit a periodic drive) of the friction dynamics on these
pieces: fourth order in time where no element edge is crossed, second order across edges. Cutting is what edges need and
friction is what the fast table needs, so each gets its own step. Trigonometry of the drive is tabulated at the stage times.

Worlds go in bundles. Cutting is done one world after the other; friction is a short series in the moments of the pressure
(:mod:`vibgym.physics.pressure_moments`) and runs for the whole bundle at once, in vector instructions. A world where that
series is not good enough, because slip varies too much across the part or nearly vanishes, or where the part sticks, takes
the step again on its own, by contact points (:mod:`vibgym.physics.careful`). No lane ever looks at another, so a world's
numbers do not depend on its company.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics._jit import jit
from vibgym.physics.careful import careful_step, cuts_needed, most_split, new_contact, place_outline
from vibgym.physics.contact_area import NEGLIGIBLE_PIECE, cut_outline, support_holds
from vibgym.physics.friction import expanded_wrench
from vibgym.physics.pressure_moments import (
    LANES,
    MOMENT_ROWS,
    PIECE_FIELDS,
    clear_pieces,
    collect_pieces,
    pressure_moments,
    read_phasors,
)
from vibgym.physics.records import Body, State, Table

__all__ = ["Body", "Scheme", "State", "Table", "advance_worlds"]

LARGEST_VARIATION = 0.45
"""Of slip across the part, ``omega r / |u|``, up to which the series is used. Measured there: at most 0.14 % of friction in
force and 0.4 % of friction times the radius of gyration in torque, and 0.03 % and 0.12 % at two thirds of it."""

SMALLEST_SLIP = 0.6
"""As a share of what slip can change in a substep, below which a step is taken carefully."""


class Scheme(NamedTuple):
    """Step sizes and their tables."""

    steps: int
    substeps: int
    pieces: int  # cells per element and direction; 0: series where it holds, else by spin
    lanes: int  # LANES, handed in at run time
    cosine: np.ndarray  # (3 * steps * substeps + 1) cos wt at the stage times
    sine: np.ndarray


@jit
def outside(table, x, y):
    """Whether a centre of mass has left the surface (or is not a number)."""
    return not (
        x >= 0.0 and y >= 0.0 and x <= table.columns * table.element_size and y <= table.rows * table.element_size
    )


@jit
def slide_bundle(table, body, scheme, node, moments, pose, velocity, bounds, lanes):
    """All substeps of one step for every lane.

    Args:
        node: of the tables, where the step begins.
        moments: flat (row, lane), of the pressure.
        pose, velocity: flat (3, lane), changed in place.
        bounds: flat (2, lane), overwritten with the largest ``(omega / |u|)^2`` and the smallest ``|u|^2`` on the way.
        lanes: ``LANES``.
    """
    h = table.period / (scheme.steps * scheme.substeps)
    third, eighth = h / 3.0, h / 8.0
    mu, speed = body.friction, table.speed
    turn = 1.0 / body.gyration
    g = mu * table.gravity
    for j in range(lanes):
        bounds[j], bounds[LANES + j] = 0.0, math.inf
    for _ in range(scheme.substeps):
        c0, c1, c2, c3 = scheme.cosine[node], scheme.cosine[node + 1], scheme.cosine[node + 2], scheme.cosine[node + 3]
        s0, s1, s2, s3 = scheme.sine[node], scheme.sine[node + 1], scheme.sine[node + 2], scheme.sine[node + 3]
        node += 3
        for j in range(lanes):
            vx, vy, spin = velocity[j], velocity[LANES + j], velocity[2 * LANES + j]
            ax, ay, aw, square, varies = expanded_wrench(
                moments, j, g, -mu * c0, mu * s0, -speed * s0 - vx, speed * c0 - vy, spin
            )
            least, most = square, varies
            aw *= turn
            bx, by, bw, square, varies = expanded_wrench(
                moments, j, g, -mu * c1, mu * s1,
                -speed * s1 - (vx + third * ax), speed * c1 - (vy + third * ay), spin + third * aw,
            )  # fmt: skip
            least, most = min(least, square), max(most, varies)
            bw *= turn
            cx, cy, cw, square, varies = expanded_wrench(
                moments, j, g, -mu * c2, mu * s2,
                -speed * s2 - (vx + h * bx - third * ax), speed * c2 - (vy + h * by - third * ay),
                spin + h * bw - third * aw,
            )  # fmt: skip
            least, most = min(least, square), max(most, varies)
            cw *= turn
            dx, dy, dw, square, varies = expanded_wrench(
                moments, j, g, -mu * c3, mu * s3,
                -speed * s3 - (vx + h * (ax - bx + cx)), speed * c3 - (vy + h * (ay - by + cy)), spin + h * (aw - bw + cw),
            )  # fmt: skip
            dw *= turn
            bounds[j] = max(bounds[j], max(most, varies))
            bounds[LANES + j] = min(bounds[LANES + j], min(least, square))
            pose[j] += h * (vx + eighth * (ax + 2.0 * bx + cx))
            pose[LANES + j] += h * (vy + eighth * (ay + 2.0 * by + cy))
            pose[2 * LANES + j] += h * (spin + eighth * (aw + 2.0 * bw + cw))
            velocity[j] = vx + eighth * (ax + 3.0 * (bx + cx) + dx)
            velocity[LANES + j] = vy + eighth * (ay + 3.0 * (by + cy) + dy)
            velocity[2 * LANES + j] = spin + eighth * (aw + 3.0 * (bw + cw) + dw)


@jit
def advance_worlds(start, stop, drive, table, body, scheme, state, periods):
    """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""
    pitch = table.element_size
    step = table.period / scheme.steps
    omega = 2.0 * math.pi / table.period
    slow = SMALLEST_SLIP * (table.speed * omega + 2.0 * body.friction * table.gravity) * step / scheme.substeps
    least_square = slow * slow
    most_square = (LARGEST_VARIATION / body.radius) ** 2
    smallest = NEGLIGIBLE_PIECE * body.area / (pitch * pitch)
    by_points = scheme.pieces > 0

    contact = new_contact(table, body, most_split(table, body, scheme))
    across = int(2.0 * body.radius / pitch) + 3
    pieces = np.zeros((across * across + 1) * PIECE_FIELDS * LANES)
    rows, columns = np.empty(across * across, np.int64), np.empty(across * across, np.int64)
    slots = 1
    while slots < across:
        slots *= 2
    known = np.empty((LANES, slots, slots), np.int64)
    known_c, known_s = np.empty((LANES, slots, slots)), np.empty((LANES, slots, slots))
    moments, spare = np.empty(MOMENT_ROWS * LANES), np.empty(MOMENT_ROWS * LANES)
    pose, velocity = np.zeros(3 * LANES), np.zeros(3 * LANES)
    begun_pose, begun_velocity = np.empty((3, LANES)), np.empty((3, LANES))  # of the period, for means and divergence
    old_pose, old_velocity = np.empty(3 * LANES), np.empty(3 * LANES)  # of the step, to take it again
    bounds, share = np.empty(2 * LANES), np.empty(LANES)
    active, careful = np.zeros(LANES, np.bool_), np.zeros(LANES, np.bool_)

    for first in range(start, stop, LANES):
        count = min(LANES, stop - first)
        known[:] = -1
        for lane in range(LANES):
            active[lane] = lane < count
            for k in range(3):
                pose[k * LANES + lane] = state.pose[first + lane, 0, k] if active[lane] else 0.0
                velocity[k * LANES + lane] = state.velocity[first + lane, 0, k] if active[lane] else 0.0
        for _ in range(periods):
            anything = False
            for lane in range(LANES):
                world = first + lane
                active[lane] = lane < count and not (state.fallen[world, 0] or state.diverged[world])
                anything = anything or active[lane]
                for k in range(3):
                    begun_pose[k, lane] = pose[k * LANES + lane]
                    begun_velocity[k, lane] = velocity[k * LANES + lane]
            if not anything:
                break
            node = 0
            for _ in range(scheme.steps):
                most = 0
                bundled = False
                for lane in range(LANES):
                    careful[lane] = False
                    share[lane] = 0.0
                    held = 0
                    if active[lane]:
                        world = first + lane
                        # Where the part will be in the middle of the step decides on what it rests.
                        x = pose[lane] + 0.5 * step * velocity[lane]
                        y = pose[LANES + lane] + 0.5 * step * velocity[LANES + lane]
                        heading = pose[2 * LANES + lane] + 0.5 * step * velocity[2 * LANES + lane]
                        if not abs(x + y + heading) < math.inf:  # no outline can be placed there
                            active[lane] = False
                            state.diverged[world] = True
                            continue
                        if outside(table, x, y):
                            active[lane] = False
                            state.fallen[world, 0] = True
                            continue
                        place_outline(body, x, y, heading, 1.0 / pitch, contact.outline_x, contact.outline_y)
                        if not body.convex and not support_holds(
                            contact.outline_x, contact.outline_y, table.columns, table.rows, x / pitch, y / pitch
                        ):
                            active[lane] = False
                            state.fallen[world, 0] = True
                            continue
                        careful[lane] = (
                            by_points
                            or state.sticking[world, 0]
                            or cuts_needed(
                                table, step, velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]
                            )
                            > 1
                        )
                        if not careful[lane]:
                            cut_outline(contact.outline_x, contact.outline_y, contact.cells, contact.box)
                            held, area = collect_pieces(
                                contact.cells, contact.box, table, x, y, smallest, pieces, rows, columns, lane
                            )
                            read_phasors(
                                drive,
                                world,
                                rows,
                                columns,
                                held,
                                known[lane],
                                known_c[lane],
                                known_s[lane],
                                pieces,
                                lane,
                            )
                            if held == 0:
                                active[lane] = False
                                state.fallen[world, 0] = True
                                continue
                            share[lane] = 1.0 / area
                            bundled = True
                    if held > most:
                        for other in range(lane):
                            clear_pieces(pieces, other, most, held)
                        most = held
                    clear_pieces(pieces, lane, held, most)

                if bundled:
                    for lane in range(LANES):
                        clear_pieces(pieces, lane, most, most + most % 2)  # they are taken in twos
                    for k in range(3 * LANES):
                        old_pose[k], old_velocity[k] = pose[k], velocity[k]
                    held_by = pressure_moments(pieces, most, pitch, share, moments, spare, scheme.lanes)
                    slide_bundle(table, body, scheme, node, held_by, pose, velocity, bounds, scheme.lanes)
                for lane in range(LANES):
                    if bundled and not (active[lane] and not careful[lane]):
                        for k in range(lane, 3 * LANES, LANES):
                            pose[k], velocity[k] = old_pose[k], old_velocity[k]
                    elif bundled:
                        total = abs(pose[lane] + pose[LANES + lane] + pose[2 * LANES + lane])
                        total += abs(velocity[lane] + velocity[LANES + lane] + velocity[2 * LANES + lane])
                        if not (
                            bounds[lane] <= most_square and bounds[LANES + lane] >= least_square and total < math.inf
                        ):
                            careful[lane] = True
                            for k in range(lane, 3 * LANES, LANES):
                                pose[k], velocity[k] = old_pose[k], old_velocity[k]
                    if active[lane] and careful[lane]:
                        world = first + lane
                        x, y, heading, vx, vy, spin, stuck, supported = careful_step(
                            table, body, scheme, drive, world, node, contact,
                            pose[lane], pose[LANES + lane], pose[2 * LANES + lane],
                            velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane],
                            state.sticking[world, 0],
                        )  # fmt: skip
                        state.sticking[world, 0] = stuck
                        pose[lane], pose[LANES + lane], pose[2 * LANES + lane] = x, y, heading
                        velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane] = vx, vy, spin
                        if not supported:
                            active[lane] = False
                            state.fallen[world, 0] = True
                node += 3 * scheme.substeps

            for lane in range(count):
                world = first + lane
                total = 0.0
                for k in range(lane, 3 * LANES, LANES):
                    total += pose[k] + velocity[k]
                # A comparison, since isfinite(a + b) does not survive reassociation (see _jit).
                if not abs(total) < math.inf or state.diverged[world]:
                    # Keep the last state that made sense; nobody gets to see the other one.
                    state.diverged[world], state.fallen[world, 0] = True, False
                    for k in range(3):
                        pose[k * LANES + lane], velocity[k * LANES + lane] = (
                            begun_pose[k, lane],
                            begun_velocity[k, lane],
                        )
                if state.fallen[world, 0]:
                    state.sticking[world, 0] = False
                    for k in range(lane, 3 * LANES, LANES):
                        velocity[k] = 0.0

        for lane in range(count):
            world = first + lane
            for k in range(3):
                state.pose[world, 0, k] = pose[k * LANES + lane]
                state.velocity[world, 0, k] = velocity[k * LANES + lane]
                state.mean_velocity[world, 0, k] = (pose[k * LANES + lane] - begun_pose[k, lane]) / table.period
