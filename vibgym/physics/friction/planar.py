"""Planar contact, resolved in time: parts that touch nothing but the vibrating elements, sliding and sticking.

A period is divided into ``steps``. Each step cuts the outline once, at the pose predicted for its middle, and then takes
``substeps`` Runge-Kutta steps (Kutta's 3/8 rule, whose even weights suit a periodic drive) of the friction dynamics on these
pieces: fourth order in time where no element edge is crossed, second order across edges. Cutting is what edges need and
friction is what the fast table needs, so each gets its own step. Trigonometry of the drive is tabulated at the stage times.

Parts of one kind go in bundles, of as many worlds as there are. Cutting is done one part after the other; friction is a
short series in the moments of the pressure (:mod:`vibgym.physics.contact_area.pressure_moments`) and runs for the whole
bundle at once, in vector instructions. A part where that series is not good enough, because slip varies too much across it
or nearly vanishes, or that sticks, takes the step again on its own, by contact points
(:mod:`vibgym.physics.friction.by_points`). No lane ever looks at another, so a part's numbers do not depend on its company.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.contact_area.outline import NEGLIGIBLE_PIECE, cut_outline, support_holds
from vibgym.physics.contact_area.pressure_moments import (
    LANES,
    MOMENT_ROWS,
    PIECE_FIELDS,
    clear_pieces,
    collect_pieces,
    pressure_moments,
    read_phasors,
)
from vibgym.physics.core.jit import inlined, jit
from vibgym.physics.core.records import Body, State, Table
from vibgym.physics.friction.by_points import careful_step, cuts_needed, new_contact, place_outline
from vibgym.physics.friction.wrench import expanded_wrench

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


@inlined
def kutta_lanes(moments, gravity, speed, h, c, s, pose, velocity, own, lanes):
    """One step of Kutta's 3/8 rule for every lane.

    Args:
        moments: flat (row, lane), of the pressure.
        gravity, speed: of the table.  h: s.
        c, s: cos wt and sin wt at the four stages.
        pose, velocity: flat (3, lane), changed in place.
        own: flat (4, lane): largest ``(omega / |u|)^2`` and smallest ``|u|^2`` so far, brought up to date; friction, and one
            over the inertia per mass (m^-2). In one array, since the compiler gives up vectorising where many may overlap.
    """
    third, eighth = h / 3.0, h / 8.0
    c0, c1, c2, c3 = c
    s0, s1, s2, s3 = s
    for j in range(lanes):
        m, t = own[2 * LANES + j], own[3 * LANES + j]
        g = m * gravity
        vx, vy, spin = velocity[j], velocity[LANES + j], velocity[2 * LANES + j]
        ax, ay, aw, square, varies = expanded_wrench(
            moments, j, g, -m * c0, m * s0, -speed * s0 - vx, speed * c0 - vy, spin
        )
        least, most = square, varies
        aw *= t
        bx, by, bw, square, varies = expanded_wrench(
            moments, j, g, -m * c1, m * s1,
            -speed * s1 - (vx + third * ax), speed * c1 - (vy + third * ay), spin + third * aw,
        )  # fmt: skip
        least, most = min(least, square), max(most, varies)
        bw *= t
        cx, cy, cw, square, varies = expanded_wrench(
            moments, j, g, -m * c2, m * s2,
            -speed * s2 - (vx + h * bx - third * ax), speed * c2 - (vy + h * by - third * ay),
            spin + h * bw - third * aw,
        )  # fmt: skip
        least, most = min(least, square), max(most, varies)
        cw *= t
        dx, dy, dw, square, varies = expanded_wrench(
            moments, j, g, -m * c3, m * s3,
            -speed * s3 - (vx + h * (ax - bx + cx)), speed * c3 - (vy + h * (ay - by + cy)), spin + h * (aw - bw + cw),
        )  # fmt: skip
        dw *= t
        own[j] = max(own[j], max(most, varies))
        own[LANES + j] = min(own[LANES + j], min(least, square))
        pose[j] += h * (vx + eighth * (ax + 2.0 * bx + cx))
        pose[LANES + j] += h * (vy + eighth * (ay + 2.0 * by + cy))
        pose[2 * LANES + j] += h * (spin + eighth * (aw + 2.0 * bw + cw))
        velocity[j] = vx + eighth * (ax + 3.0 * (bx + cx) + dx)
        velocity[LANES + j] = vy + eighth * (ay + 3.0 * (by + cy) + dy)
        velocity[2 * LANES + j] = spin + eighth * (aw + 3.0 * (bw + cw) + dw)


@jit
def slide_bundle(table, scheme, node, moments, pose, velocity, own, lanes):
    """All substeps of one step for every lane, from node ``node`` of the scheme's tables on; see :func:`kutta_lanes`."""
    h = table.period / (scheme.steps * scheme.substeps)
    cosine, sine = scheme.cosine, scheme.sine
    for j in range(lanes):
        own[j], own[LANES + j] = 0.0, math.inf
    for _ in range(scheme.substeps):
        c = cosine[node], cosine[node + 1], cosine[node + 2], cosine[node + 3]
        s = sine[node], sine[node + 1], sine[node + 2], sine[node + 3]
        kutta_lanes(moments, table.gravity, table.speed, h, c, s, pose, velocity, own, lanes)
        node += 3


class Bundle(NamedTuple):
    """Working arrays for parts of one kind side by side, one a lane; flat arrays have the lane as their inner index."""

    world: np.ndarray  # (lane,)
    part: np.ndarray  # (lane,)
    active: np.ndarray  # (lane,) bool: still on the table
    careful: np.ndarray  # (lane,) bool: takes this step by contact points
    pose: np.ndarray  # flat (3, lane)
    velocity: np.ndarray  # flat (3, lane)
    old_pose: np.ndarray  # of the step's start, to take it again
    old_velocity: np.ndarray
    begun_pose: np.ndarray  # of the period's start, for means and divergence
    begun_velocity: np.ndarray
    own: np.ndarray  # flat (4, lane), see kutta_lanes
    share: np.ndarray  # (lane,) one over the supported area, in cells
    held: np.ndarray  # (lane,) number of pieces
    pieces: np.ndarray  # flat (piece, field, lane)
    rows: np.ndarray  # (pieces,) elements of the lane at hand
    columns: np.ndarray
    known: np.ndarray  # (lane, slots, slots), see read_phasors
    known_c: np.ndarray
    known_s: np.ndarray
    moments: np.ndarray  # flat (row, lane)
    spare: np.ndarray


@jit
def new_bundle(table, radius):
    """Working arrays for parts of up to ``radius`` m."""
    across = int(2.0 * radius / table.element_size) + 3
    slots = 1
    while slots < across:
        slots *= 2
    return Bundle(
        np.zeros(LANES, np.int64), np.zeros(LANES, np.int64), np.zeros(LANES, np.bool_), np.zeros(LANES, np.bool_),
        np.zeros(3 * LANES), np.zeros(3 * LANES), np.empty(3 * LANES), np.empty(3 * LANES),
        np.empty(3 * LANES), np.empty(3 * LANES), np.empty(4 * LANES),
        np.zeros(LANES), np.zeros(LANES, np.int64), np.zeros((across * across + 1) * PIECE_FIELDS * LANES),
        np.empty(across * across, np.int64), np.empty(across * across, np.int64),
        np.full((LANES, slots, slots), -1, np.int64), np.empty((LANES, slots, slots)), np.empty((LANES, slots, slots)),
        np.empty(MOMENT_ROWS * LANES), np.empty(MOMENT_ROWS * LANES),
    )  # fmt: skip


@inlined
def place_ahead(table, body, x, y, heading, outline_x, outline_y):
    """Write the outline at a pose, in elements; returns 0 on the table, 1 if the part falls, 2 if it cannot be placed."""
    if not abs(x + y + heading) < math.inf:
        return 2
    if outside(table, x, y):
        return 1
    pitch = table.element_size
    place_outline(body, x, y, heading, 1.0 / pitch, outline_x, outline_y)
    if not body.convex and not support_holds(outline_x, outline_y, table.columns, table.rows, x / pitch, y / pitch):
        return 1
    return 0


@inlined
def cut_lane(
    table, body, drive, world, lane, x, y, outline_x, outline_y, cells, box, pieces, rows, columns, known, known_c, known_s
):  # fmt: skip
    """Cut the placed outline into the lane's pieces and read their phasors; returns their number and one over their area."""
    smallest = NEGLIGIBLE_PIECE * body.area / (table.element_size * table.element_size)
    cut_outline(outline_x, outline_y, cells, box)
    held, area = collect_pieces(cells, box, table, x, y, smallest, pieces, rows, columns, lane)
    read_phasors(drive, world, rows, columns, held, known, known_c, known_s, pieces, lane)
    return held, (1.0 / area if held > 0 else 0.0)


@inlined
def bundle_moments(table, pieces, held, share, moments, spare, lanes):
    """Moments of the pressure under all lanes, ``held`` pieces each; returns the array that holds them."""
    most = 0
    for lane in range(lanes):
        most = max(most, held[lane])
    most += most % 2  # they are taken in twos
    for lane in range(lanes):
        clear_pieces(pieces, lane, held[lane], most)
    return pressure_moments(pieces, most, table.element_size, share, moments, spare, lanes)


@inlined
def finite_lane(values, lane):
    """Whether the lane's three numbers are finite. A comparison, since isfinite(a + b) does not survive reassociation."""
    return abs(values[lane] + values[LANES + lane] + values[2 * LANES + lane]) < math.inf


@inlined
def copy_lane(source, target, lane):
    """Copy the lane's three numbers."""
    for k in range(lane, 3 * LANES, LANES):
        target[k] = source[k]


@jit
def limits(table, body, h):
    """Largest ``(omega / |u|)^2`` and smallest ``|u|^2`` for which the series is good enough in substeps of ``h`` s."""
    harshest = table.speed * 2.0 * math.pi / table.period + 2.0 * body.friction * table.gravity
    slow = SMALLEST_SLIP * harshest * h
    return (LARGEST_VARIATION / body.radius) ** 2, slow * slow


@jit
def slide_rows(rows, drive, table, body, scheme, state, periods, record, paths, base):
    """Advance parts without contacts by whole periods under a held drive, changing ``state`` in place.

    Args:
        rows: (n,) parts of one kind, as ``world * parts + part``.
        body: that kind.
        record: whether to write down where they pass.
        paths: (rows, steps + 1, 3) poses of the last period at the ends of its steps, if asked for; row ``base`` is its first.
    """
    parts = state.pose.shape[1]
    step = table.period / scheme.steps
    most_square, least_square = limits(table, body, step / scheme.substeps)
    contact = new_contact(table, body, scheme)
    bundle = new_bundle(table, body.radius)
    bundle.own[2 * LANES : 3 * LANES], bundle.own[3 * LANES :] = body.friction, 1.0 / body.gyration
    pose, velocity = bundle.pose, bundle.velocity
    active, careful = bundle.active, bundle.careful

    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        bundle.known[:] = -1
        for lane in range(LANES):
            row = rows[first + min(lane, count - 1)]
            bundle.world[lane], bundle.part[lane] = row // parts, row % parts
            for k in range(3):
                at = k * LANES + lane
                pose[at] = state.pose[bundle.world[lane], bundle.part[lane], k] if lane < count else 0.0
                velocity[at] = state.velocity[bundle.world[lane], bundle.part[lane], k] if lane < count else 0.0
        for _ in range(periods):
            anything = False
            for lane in range(LANES):
                world, part = bundle.world[lane], bundle.part[lane]
                active[lane] = lane < count and not (state.fallen[world, part] or state.diverged[world])
                anything = anything or active[lane]
            bundle.begun_pose[:], bundle.begun_velocity[:] = pose, velocity
            if record:
                for lane in range(count):
                    for k in range(3):
                        paths[rows[first + lane] - base, 0, k] = pose[k * LANES + lane]
            if not anything:
                break
            for turn in range(scheme.steps):
                node = 3 * scheme.substeps * turn
                bundled = prepare_step(table, body, scheme, drive, state, bundle, contact, step)
                if bundled:
                    bundle.old_pose[:], bundle.old_velocity[:] = pose, velocity
                    moments = bundle_moments(
                        table, bundle.pieces, bundle.held, bundle.share, bundle.moments, bundle.spare, scheme.lanes
                    )
                    slide_bundle(table, scheme, node, moments, pose, velocity, bundle.own, scheme.lanes)
                for lane in range(LANES):
                    if bundled and not (active[lane] and not careful[lane]):
                        copy_lane(bundle.old_pose, pose, lane)
                        copy_lane(bundle.old_velocity, velocity, lane)
                    elif bundled and not (
                        bundle.own[lane] <= most_square
                        and bundle.own[LANES + lane] >= least_square
                        and finite_lane(pose, lane)
                        and finite_lane(velocity, lane)
                    ):
                        careful[lane] = True
                        copy_lane(bundle.old_pose, pose, lane)
                        copy_lane(bundle.old_velocity, velocity, lane)
                    if active[lane] and careful[lane]:
                        take_care(table, body, scheme, drive, node, state, bundle, lane, contact)
                if record:
                    for lane in range(count):
                        for k in range(3):
                            paths[rows[first + lane] - base, turn + 1, k] = pose[k * LANES + lane]
            for lane in range(count):
                settle_period(state, bundle, lane)
        for lane in range(count):
            world, part = bundle.world[lane], bundle.part[lane]
            for k in range(3):
                at = k * LANES + lane
                state.pose[world, part, k], state.velocity[world, part, k] = pose[at], velocity[at]
                state.mean_velocity[world, part, k] = (pose[at] - bundle.begun_pose[at]) / table.period


@inlined
def prepare_step(table, body, scheme, drive, state, bundle, contact, step):
    """Decide for every lane how it takes a step, and cut those that go together; False if none does."""
    bundled = False
    for lane in range(LANES):
        bundle.careful[lane] = False
        bundle.held[lane], bundle.share[lane] = 0, 0.0
        if not bundle.active[lane]:
            continue
        world, part = bundle.world[lane], bundle.part[lane]
        # Where the part will be in the middle of the step decides on what it rests.
        vx, vy, spin = bundle.velocity[lane], bundle.velocity[LANES + lane], bundle.velocity[2 * LANES + lane]
        x, y = bundle.pose[lane] + 0.5 * step * vx, bundle.pose[LANES + lane] + 0.5 * step * vy
        heading = bundle.pose[2 * LANES + lane] + 0.5 * step * spin
        fate = place_ahead(table, body, x, y, heading, contact.outline_x, contact.outline_y)
        if fate == 0:
            if scheme.pieces > 0 or state.sticking[world, part] or cuts_needed(table, step, vx, vy, spin) > 1:
                bundle.careful[lane] = True
            else:
                bundle.held[lane], bundle.share[lane] = cut_lane(
                    table, body, drive, world, lane, x, y, contact.outline_x, contact.outline_y, contact.cells, contact.box,
                    bundle.pieces, bundle.rows, bundle.columns,
                    bundle.known[lane], bundle.known_c[lane], bundle.known_s[lane],
                )  # fmt: skip
                if bundle.held[lane] > 0:
                    bundled = True
                else:
                    fate = 1
        if fate > 0:
            bundle.active[lane] = False
            state.fallen[world, part] = fate == 1
            state.diverged[world] = state.diverged[world] or fate == 2
    return bundled


@jit
def take_care(table, body, scheme, drive, node, state, bundle, lane, contact):
    """Take the lane's step by contact points."""
    world, part = bundle.world[lane], bundle.part[lane]
    pose, velocity = bundle.pose, bundle.velocity
    x, y, heading, vx, vy, spin, stuck, supported = careful_step(
        table, body, scheme, drive, world, node, contact,
        pose[lane], pose[LANES + lane], pose[2 * LANES + lane],
        velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane],
        state.sticking[world, part],
    )  # fmt: skip
    state.sticking[world, part] = stuck
    pose[lane], pose[LANES + lane], pose[2 * LANES + lane] = x, y, heading
    velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane] = vx, vy, spin
    if not supported:
        bundle.active[lane] = False
        state.fallen[world, part] = True


@inlined
def settle_period(state, bundle, lane):
    """After a period: a part whose numbers make no sense goes back to where it was, one that has fallen rests."""
    world, part = bundle.world[lane], bundle.part[lane]
    if state.diverged[world] or not (finite_lane(bundle.pose, lane) and finite_lane(bundle.velocity, lane)):
        # Keep the last state that made sense; nobody gets to see the other one.
        state.diverged[world], state.fallen[world, part] = True, False
        copy_lane(bundle.begun_pose, bundle.pose, lane)
        copy_lane(bundle.begun_velocity, bundle.velocity, lane)
    if state.fallen[world, part]:
        state.sticking[world, part] = False
        for k in range(lane, 3 * LANES, LANES):
            bundle.velocity[k] = 0.0


def advance_worlds(start, stop, drive, table, body, scheme, state, periods):
    """Advance worlds ``start`` to ``stop``, each with one part, by whole periods under a held drive.

    Not compiled itself: the same compiled code then serves worlds with one part and with many, to the last bit.
    """
    slide_rows(np.arange(start, stop), drive, table, body, scheme, state, periods, False, np.empty((0, 0, 3)), 0)
