"""One step of one world by contact points: where slip nearly vanishes, where it turns across the part, where it sticks.

The series of :mod:`vibgym.physics.friction.wrench` needs slip that varies little under the part. Elsewhere friction is
summed over contact points, four a piece, and the pieces are cut finer the more slip varies across an element. Slip that
comes near zero turns fast: substeps are shortened in proportion to it, and the last stretch is taken by implicit steps, in
which friction takes hold or lets go (:mod:`vibgym.physics.friction.static`). A part that sticks moves with the table until
static friction cannot carry it any longer; that instant is found by bisection.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.contact_area.outline import MOMENTS, NEGLIGIBLE_PIECE, POINTS_PER_PIECE, contact_points, cut_outline
from vibgym.physics.core.drive import element_phasor
from vibgym.physics.core.jit import jit
from vibgym.physics.friction.static import holds, slip_step
from vibgym.physics.friction.wrench import sliding_wrench

FINEST_PIECES = 8
"""Most cells across an element (or across a smaller part) that the spin rule asks for."""

SHORTEST = 1 / 32
"""Length of the implicit steps, as a share of a substep."""

TURN = 0.5
"""Largest change of slip in an explicit step, as a share of the slip."""


MOST_TURN, MOST_TRAVEL, MOST_CUTS = 0.5, 0.5, 64
"""A part that turns by more than this angle (rad) in a step, or travels by more of an element, is cut more often."""


class Contact(NamedTuple):
    """Working arrays of the cut and its points."""

    outline_x: np.ndarray  # (n,)
    outline_y: np.ndarray
    cells: np.ndarray  # (cells, MOMENTS)
    box: np.ndarray  # (4,)
    points: np.ndarray  # (3, capacity): weight, x, y
    under: np.ndarray  # (capacity,) element under each piece
    phasor_c: np.ndarray  # (capacity,) m/s^2
    phasor_s: np.ndarray
    load: np.ndarray  # (capacity,)


@jit
def most_split(table, body, scheme):
    """Largest number of cells per element and direction that a call can use."""
    if scheme.pieces > 0:
        return scheme.pieces
    size = min(table.element_size, 2.0 * body.radius)
    return int(math.ceil(FINEST_PIECES * table.element_size / size))


@jit
def spin_split(table, body, speed, spin):
    """Cells per element that the spin asks for: none extra until ``omega x size`` reaches the slip speed.

    Four points carry a piece's second moments exactly; what they miss grows with the change of slip across the piece.
    """
    size = min(table.element_size, 2.0 * body.radius)
    across = abs(spin) * size
    if across < speed:
        return 1
    pieces = min(1.0 + across / max(speed, 1e-9 * across + 1e-300), float(FINEST_PIECES))
    return int(math.ceil(math.floor(pieces) * table.element_size / size))


@jit
def cells_across(table, body, split):
    """Most cells along a side of the box around a part, with ``split`` cells per element and direction."""
    return int(2.0 * body.radius / table.element_size * split) + 3


@jit
def contact_arrays(corners, across):
    """Working arrays for outlines of up to so many corners and cells along a side."""
    capacity = across * across * POINTS_PER_PIECE + 8
    return Contact(
        np.empty(corners),
        np.empty(corners),
        np.empty((across * across, MOMENTS)),
        np.empty(4, np.int64),
        np.empty((3, capacity)),
        np.empty(capacity, np.int64),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(capacity),
    )


@jit
def new_contact(table, body, scheme):
    """Working arrays for one kind of part under a scheme."""
    return contact_arrays(body.outline.shape[0], cells_across(table, body, most_split(table, body, scheme)))


@jit
def contact_for(contact, body):
    """The same arrays, cut to the part's corners."""
    corners = body.outline.shape[0]
    return Contact(
        contact.outline_x[:corners], contact.outline_y[:corners], contact.cells, contact.box,
        contact.points, contact.under, contact.phasor_c, contact.phasor_s, contact.load,
    )  # fmt: skip


@jit
def place_outline(body, x, y, heading, scale, outline_x, outline_y):
    """Outline in the world frame, in units of ``1 / scale``."""
    cosine, sine = 1.0, 0.0
    if body.turns:
        cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(body.outline.shape[0]):
        bx, by = body.outline[k, 0], body.outline[k, 1]
        outline_x[k] = (x + cosine * bx - sine * by) * scale
        outline_y[k] = (y + sine * bx + cosine * by) * scale


@jit
def cut_into_points(table, body, split, drive, world, x, y, heading, contact):
    """Contact points and their phasors at a pose; returns how many (a multiple of eight), 0 if nothing is supported."""
    pitch = table.element_size / split
    place_outline(body, x, y, heading, 1.0 / pitch, contact.outline_x, contact.outline_y)
    cut_outline(contact.outline_x, contact.outline_y, contact.cells, contact.box)
    n = contact_points(
        contact.cells, contact.box, table.rows, table.columns, split, pitch, x, y,
        NEGLIGIBLE_PIECE * body.area / (pitch * pitch), contact.points, contact.under,
    )  # fmt: skip
    read, c, s = -1, 0.0, 0.0
    for piece in range(n // POINTS_PER_PIECE):
        element = contact.under[piece]
        if element != read:
            c, s = element_phasor(drive, world, element // table.columns, element % table.columns)
            read = element
        for k in range(POINTS_PER_PIECE * piece, POINTS_PER_PIECE * piece + POINTS_PER_PIECE):
            contact.phasor_c[k], contact.phasor_s[k] = c, s
    return n


@jit
def slide(table, body, contact, n, phase, h, x, y, heading, vx, vy, spin):
    """One step of length ``h`` of Kutta's 3/8 rule from ``phase = w t`` on."""
    weight, rx, ry = contact.points[0], contact.points[1], contact.points[2]
    pc, ps = contact.phasor_c, contact.phasor_s
    g, speed, mu, turn = table.gravity, table.speed, body.friction, body.friction / body.gyration
    third = h / 3.0
    advance = 2.0 * math.pi / table.period * third
    c, s = math.cos(phase), math.sin(phase)
    ax, ay, aw = sliding_wrench(weight, rx, ry, pc, ps, n, g, c, s, -speed * s - vx, speed * c - vy, spin)
    ax, ay, aw = mu * ax, mu * ay, turn * aw
    c, s = math.cos(phase + advance), math.sin(phase + advance)
    bx, by, bw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + third * ax), speed * c - (vy + third * ay), spin + third * aw,
    )  # fmt: skip
    bx, by, bw = mu * bx, mu * by, turn * bw
    c, s = math.cos(phase + 2.0 * advance), math.sin(phase + 2.0 * advance)
    cx, cy, cw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + h * bx - third * ax), speed * c - (vy + h * by - third * ay), spin + h * bw - third * aw,
    )  # fmt: skip
    cx, cy, cw = mu * cx, mu * cy, turn * cw
    c, s = math.cos(phase + 3.0 * advance), math.sin(phase + 3.0 * advance)
    dx, dy, dw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + h * (ax - bx + cx)), speed * c - (vy + h * (ay - by + cy)), spin + h * (aw - bw + cw),
    )  # fmt: skip
    dx, dy, dw = mu * dx, mu * dy, turn * dw
    x += h * (vx + 0.125 * h * (ax + 2.0 * bx + cx))
    y += h * (vy + 0.125 * h * (ay + 2.0 * by + cy))
    heading += h * (spin + 0.125 * h * (aw + 2.0 * bw + cw))
    vx += 0.125 * h * (ax + 3.0 * (bx + cx) + dx)
    vy += 0.125 * h * (ay + 3.0 * (by + cy) + dy)
    spin += 0.125 * h * (aw + 3.0 * (bw + cw) + dw)
    return x, y, heading, vx, vy, spin


@jit
def release(table, body, contact, n, start, stop):
    """First phase ``w t`` after ``start`` at which static friction cannot carry the part along; ``stop`` if it always can.

    Bisection: it is looked for at ``stop``, at ``start``, then between them.
    """
    at, held_until, lost_at = stop, start, stop
    for look in range(44):
        held = holds(
            table, body.static_friction, contact.points, contact.phasor_c, contact.phasor_s, n, body.gyration,
            math.cos(at), math.sin(at), contact.load,
        )  # fmt: skip
        if look == 0:
            if held:
                return stop
            at = start
            continue
        if look == 1 and not held:
            return start
        if held:
            held_until = at
        else:
            lost_at = at
        at = 0.5 * (held_until + lost_at)
        if at <= held_until or at >= lost_at:
            break
    return lost_at


@jit
def near_rest(table, body, contact, n, phase, h, x, y, heading, vx, vy, spin, stuck):
    """A substep of length ``h`` from ``phase = w t`` on, while slip is small or the part sticks."""
    omega = 2.0 * math.pi / table.period
    harshest = table.speed * omega + 2.0 * body.friction * table.gravity  # m/s^2, that slip can change with
    shortest = SHORTEST * h
    stop = phase + omega * h
    let_go = -1.0  # the phase at which static friction was found too weak
    while phase < stop:
        c0, s0 = math.cos(phase), math.sin(phase)
        slip_x, slip_y = -table.speed * s0 - vx, table.speed * c0 - vy
        if stuck or (slip_x == 0.0 and slip_y == 0.0 and spin == 0.0 and phase != let_go):
            let_go = release(table, body, contact, n, phase, stop)
            stuck = let_go == stop
            c1, s1 = math.cos(let_go), math.sin(let_go)
            x += table.radius * (c1 - c0)
            y += table.radius * (s1 - s0)
            vx, vy, spin = -table.speed * s1, table.speed * c1, 0.0
            phase = let_go
            continue
        fastest = math.sqrt(slip_x * slip_x + slip_y * slip_y + body.gyration * spin * spin)
        left = (stop - phase) / omega
        step = TURN * fastest / max(harshest, 1e-300)
        explicit = step > shortest
        step = max(step, shortest)
        last = step >= (1.0 - 1e-9) * left
        if last:
            step = left
        after = stop if last else phase + omega * step
        c3, s3 = math.cos(after), math.sin(after)
        if explicit:
            x, y, heading, vx, vy, spin = slide(table, body, contact, n, phase, step, x, y, heading, vx, vy, spin)
        else:
            slip_x, slip_y, spin, way_x, way_y, turned = slip_step(
                table, body.friction, contact.points, contact.phasor_c, contact.phasor_s, n, body.gyration, contact.load,
                phase, step, slip_x, slip_y, spin,
            )  # fmt: skip
            x += table.radius * (c3 - c0) - way_x
            y += table.radius * (s3 - s0) - way_y
            heading += turned
            vx, vy = -table.speed * s3 - slip_x, table.speed * c3 - slip_y
            stuck = slip_x == 0.0 and slip_y == 0.0 and spin == 0.0
        phase = after
        if not abs(x + y + heading + vx + vy + spin) < math.inf:
            break
    return x, y, heading, vx, vy, spin, stuck


@jit
def cuts_needed(table, step, vx, vy, spin):
    """Cuts that a step takes: one, and more for a part that turns or travels far in it."""
    way = math.sqrt(vx * vx + vy * vy) * step / (MOST_TRAVEL * table.element_size)
    return int(math.ceil(min(max(abs(spin) * step / MOST_TURN, way, 1.0), float(MOST_CUTS))))


@jit
def careful_span(
    table, body, pieces, drive, world, phase, span, substeps, contact, x, y, heading, vx, vy, spin, stuck
):  # fmt: skip
    """``span`` s from ``phase = w t`` on, in ``substeps`` Runge-Kutta steps or a few more.

    Args:
        pieces: cells per element and direction; 0: as the spin asks for.

    Returns:
        Pose, velocity, whether the part sticks, and whether anything supported it.
    """
    omega = 2.0 * math.pi / table.period
    cuts = cuts_needed(table, span, vx, vy, spin)
    substeps = (substeps + cuts - 1) // cuts
    h = span / (cuts * substeps)
    slow = (table.speed * omega + 2.0 * body.friction * table.gravity) * h  # the most that slip can change in a substep
    for cut in range(cuts):
        begin = phase + omega * h * (cut * substeps)
        slip_x, slip_y = -table.speed * math.sin(begin) - vx, table.speed * math.cos(begin) - vy
        split = pieces
        if split == 0:
            split = spin_split(table, body, math.sqrt(slip_x * slip_x + slip_y * slip_y), spin)
        ahead = 0.5 * span / cuts
        n = cut_into_points(
            table, body, split, drive, world, x + ahead * vx, y + ahead * vy, heading + ahead * spin, contact
        )
        if n == 0:
            return x, y, heading, vx, vy, spin, stuck, False
        for substep in range(substeps):
            at = begin + omega * h * substep
            slip_x, slip_y = -table.speed * math.sin(at) - vx, table.speed * math.cos(at) - vy
            if stuck or slip_x * slip_x + slip_y * slip_y + body.gyration * spin * spin <= slow * slow:
                x, y, heading, vx, vy, spin, stuck = near_rest(
                    table, body, contact, n, at, h, x, y, heading, vx, vy, spin, stuck
                )
            else:
                x, y, heading, vx, vy, spin = slide(table, body, contact, n, at, h, x, y, heading, vx, vy, spin)
            if not abs(x + y + heading + vx + vy + spin) < math.inf:
                return x, y, heading, vx, vy, spin, stuck, True
    return x, y, heading, vx, vy, spin, stuck, True


@jit
def careful_step(table, body, scheme, drive, world, node, contact, x, y, heading, vx, vy, spin, stuck):
    """One step of the scheme from table node ``node`` on; see :func:`careful_span`."""
    step = table.period / scheme.steps
    phase = 2.0 * math.pi / table.period * (step / (3 * scheme.substeps)) * node
    x, y, heading, vx, vy, spin, stuck, supported = careful_span(
        table, body, scheme.pieces, drive, world, phase, step, scheme.substeps, contact,
        x, y, heading, vx, vy, spin, stuck,
    )  # fmt: skip
    if stuck:  # exactly, on the tabulated values
        after = node + 3 * scheme.substeps
        vx, vy = -table.speed * scheme.sine[after], table.speed * scheme.cosine[after]
    return x, y, heading, vx, vy, spin, stuck, supported
