"""Steps of one part by contact points: for slip that nearly vanishes or varies strongly across the part, and for sticking.

The series of :mod:`vibgym.physics.planar.wrench` requires slip that varies little under the part. Otherwise friction is summed
over contact points, four per piece, and pieces are cut finer the more slip varies across an element. Slip near zero turns
fast: substeps are shortened in proportion to it, and the last ones are implicit, in which the part may stick or slip
(:mod:`vibgym.physics.planar.static`). A part that sticks moves with the table until static friction is too weak; bisection
finds that instant.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.physics.core.records import Motion, body_incline, is_finite, law_factor, most_friction
from vibgym.physics.planar.contact_area import points_at, spin_split
from vibgym.physics.planar.static import slip_step, static_friction_holds
from vibgym.physics.planar.wrench import sliding_wrench, varying_wrench

SHORTEST = 1 / 32
"""Length of the implicit steps over that of a substep."""

TURN = 0.5
"""Largest relative change of slip in an explicit step."""

MAX_TURN, MAX_TRAVEL, MAX_CUTS = 0.5, 0.5, 64
"""Rotation (rad) and travel (elements) in a step above which a part is cut more often, and the limit of cuts."""


@jit
def slide(table, body, cut, n, phase, h, motion):
    """Take a step of ``h`` s by Kutta's 3/8 rule from ``phase = w t`` on."""
    weight, rx, ry = cut.points[0], cut.points[1], cut.points[2]
    pc, ps = cut.phasor_c, cut.phasor_s
    x, y, heading, vx, vy, spin = motion
    g, speed, mu, turn = table.gravity, table.speed, body.friction, body.friction / body.gyration
    px, py = body.incline_x, body.incline_y
    third = h / 3.0
    advance = 2.0 * math.pi / table.period * third
    c, s = math.cos(phase), math.sin(phase)
    ax, ay, aw = sliding_wrench(weight, rx, ry, pc, ps, n, g, c, s, -speed * s - vx, speed * c - vy, spin)
    ax, ay, aw = mu * ax + px, mu * ay + py, turn * aw
    c, s = math.cos(phase + advance), math.sin(phase + advance)
    bx, by, bw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + third * ax), speed * c - (vy + third * ay), spin + third * aw,
    )  # fmt: skip
    bx, by, bw = mu * bx + px, mu * by + py, turn * bw
    c, s = math.cos(phase + 2.0 * advance), math.sin(phase + 2.0 * advance)
    cx, cy, cw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + h * bx - third * ax), speed * c - (vy + h * by - third * ay), spin + h * bw - third * aw,
    )  # fmt: skip
    cx, cy, cw = mu * cx + px, mu * cy + py, turn * cw
    c, s = math.cos(phase + 3.0 * advance), math.sin(phase + 3.0 * advance)
    dx, dy, dw = sliding_wrench(
        weight, rx, ry, pc, ps, n, g, c, s,
        -speed * s - (vx + h * (ax - bx + cx)), speed * c - (vy + h * (ay - by + cy)), spin + h * (aw - bw + cw),
    )  # fmt: skip
    dx, dy, dw = mu * dx + px, mu * dy + py, turn * dw
    x += h * (vx + 0.125 * h * (ax + 2.0 * bx + cx))
    y += h * (vy + 0.125 * h * (ay + 2.0 * by + cy))
    heading += h * (spin + 0.125 * h * (aw + 2.0 * bw + cw))
    vx += 0.125 * h * (ax + 3.0 * (bx + cx) + dx)
    vy += 0.125 * h * (ay + 3.0 * (by + cy) + dy)
    spin += 0.125 * h * (aw + 3.0 * (bw + cw) + dw)
    return Motion(x, y, heading, vx, vy, spin)


@jit
def varying_acceleration(table, body, cut, n, phase, vx, vy, spin):
    """Return acceleration and angular acceleration by friction whose coefficient depends on speed."""
    c, s, speed = math.cos(phase), math.sin(phase), table.speed
    ax, ay, aw = varying_wrench(
        cut.points[0], cut.points[1], cut.points[2], cut.phasor_c, cut.phasor_s, n, table.gravity, c, s,
        -speed * s - vx, speed * c - vy, spin, body.law,
    )  # fmt: skip
    mu = body.friction
    return mu * ax + body.incline_x, mu * ay + body.incline_y, mu / body.gyration * aw


@jit
def slide_varying(table, body, cut, n, phase, h, motion):
    """Take a step as :func:`slide`, with a coefficient of friction that depends on speed.

    Apart from it, since branches there would round the results of constant coefficients differently.
    """
    x, y, heading, vx, vy, spin = motion
    third, advance = h / 3.0, 2.0 * math.pi / table.period * (h / 3.0)
    ax, ay, aw = varying_acceleration(table, body, cut, n, phase, vx, vy, spin)
    bx, by, bw = varying_acceleration(
        table, body, cut, n, phase + advance, vx + third * ax, vy + third * ay, spin + third * aw
    )
    cx, cy, cw = varying_acceleration(
        table, body, cut, n, phase + 2.0 * advance, vx + h * bx - third * ax, vy + h * by - third * ay,
        spin + h * bw - third * aw,
    )  # fmt: skip
    dx, dy, dw = varying_acceleration(
        table, body, cut, n, phase + 3.0 * advance, vx + h * (ax - bx + cx), vy + h * (ay - by + cy),
        spin + h * (aw - bw + cw),
    )  # fmt: skip
    x += h * (vx + 0.125 * h * (ax + 2.0 * bx + cx))
    y += h * (vy + 0.125 * h * (ay + 2.0 * by + cy))
    heading += h * (spin + 0.125 * h * (aw + 2.0 * bw + cw))
    vx += 0.125 * h * (ax + 3.0 * (bx + cx) + dx)
    vy += 0.125 * h * (ay + 3.0 * (by + cy) + dy)
    spin += 0.125 * h * (aw + 3.0 * (bw + cw) + dw)
    return Motion(x, y, heading, vx, vy, spin)


@jit
def release(table, body, cut, n, start, stop):
    """Return the first phase ``w t`` at which static friction cannot carry the part, by bisection; ``stop`` if none."""
    at, held_until, lost_at = stop, start, stop
    for look in range(44):
        held = static_friction_holds(
            table, body.static_friction, cut.points, cut.phasor_c, cut.phasor_s, n, body.gyration,
            math.cos(at), math.sin(at), body.incline_x, body.incline_y, cut.load,
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
def step_near_rest(table, body, cut, n, phase, h, motion, stuck):
    """Take a substep of ``h`` s from ``phase = w t`` on with small slip or sticking; return ``motion`` and ``stuck``."""
    x, y, heading, vx, vy, spin = motion
    omega = 2.0 * math.pi / table.period
    harshest = table.speed * omega + 2.0 * most_friction(body) * table.gravity + body_incline(body)  # m/s^2, of slip
    shortest = SHORTEST * h
    stop = phase + omega * h
    let_go = -1.0  # phase at which static friction became too weak
    while phase < stop:
        c0, s0 = math.cos(phase), math.sin(phase)
        slip_x, slip_y = -table.speed * s0 - vx, table.speed * c0 - vy
        if stuck or (slip_x == 0.0 and slip_y == 0.0 and spin == 0.0 and phase != let_go):
            let_go = release(table, body, cut, n, phase, stop)
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
            motion = Motion(x, y, heading, vx, vy, spin)
            if body.law.shape[0] > 1:
                x, y, heading, vx, vy, spin = slide_varying(table, body, cut, n, phase, step, motion)
            else:
                x, y, heading, vx, vy, spin = slide(table, body, cut, n, phase, step, motion)
        else:
            friction = body.friction
            if body.law.shape[0] > 1:  # at the slip before the step: friction that falls with speed has no convex power
                friction *= law_factor(body.law, fastest)
            slip_x, slip_y, spin, way_x, way_y, turned = slip_step(
                table, friction, cut.points, cut.phasor_c, cut.phasor_s, n, body.gyration, body.incline_x, body.incline_y,
                cut.load, phase, step, slip_x, slip_y, spin,
            )  # fmt: skip
            x += table.radius * (c3 - c0) - way_x
            y += table.radius * (s3 - s0) - way_y
            heading += turned
            vx, vy = -table.speed * s3 - slip_x, table.speed * c3 - slip_y
            stuck = slip_x == 0.0 and slip_y == 0.0 and spin == 0.0
        phase = after
        if not abs(x + y + heading + vx + vy + spin) < math.inf:
            break
    return Motion(x, y, heading, vx, vy, spin), stuck


@jit
def cuts_needed(table, step, vx, vy, spin):
    """Return the number of cuts in a step: one, and more for a part that rotates or travels far."""
    way = math.sqrt(vx * vx + vy * vy) * step / (MAX_TRAVEL * table.element_size)
    return int(math.ceil(min(max(abs(spin) * step / MAX_TURN, way, 1.0), float(MAX_CUTS))))


@jit
def slide_by_points(table, body, pieces, drive, world, step, cut, phasors, slot, motion, stuck):
    """Take a step of one part, in its substeps or a few more.

    Args:
        pieces: cells per element and direction; 0 or less: by :func:`spin_split`.
        cut, phasors, slot: working arrays.

    Returns:
        Motion, whether the part sticks, and whether it is supported.
    """
    omega = 2.0 * math.pi / table.period
    cuts = cuts_needed(table, step.span, motion.vx, motion.vy, motion.spin)
    substeps = (step.substeps + cuts - 1) // cuts
    h = step.span / (cuts * substeps)
    # Largest change of slip in a substep.
    slow = (table.speed * omega + 2.0 * most_friction(body) * table.gravity + body_incline(body)) * h
    ahead = 0.5 * step.span / cuts
    for k in range(cuts):
        begin = step.phase + omega * h * (k * substeps)
        slip_x, slip_y = -table.speed * math.sin(begin) - motion.vx, table.speed * math.cos(begin) - motion.vy
        split = pieces
        if split <= 0:
            split = spin_split(table, body, math.sqrt(slip_x * slip_x + slip_y * slip_y), motion.spin)
        x, y = motion.x + ahead * motion.vx, motion.y + ahead * motion.vy
        heading = motion.heading + ahead * motion.spin
        n = points_at(table, body, split, drive, world, x, y, heading, cut, phasors, slot)
        if n == 0:
            return motion, stuck, False
        for substep in range(substeps):
            at = begin + omega * h * substep
            slip_x, slip_y = -table.speed * math.sin(at) - motion.vx, table.speed * math.cos(at) - motion.vy
            square = slip_x * slip_x + slip_y * slip_y + body.gyration * motion.spin * motion.spin
            if stuck or square <= slow * slow:
                motion, stuck = step_near_rest(table, body, cut, n, at, h, motion, stuck)
            elif body.law.shape[0] > 1:
                motion = slide_varying(table, body, cut, n, at, h, motion)
            else:
                motion = slide(table, body, cut, n, at, h, motion)
            if not is_finite(motion):
                return motion, stuck, True
    if stuck:  # the table's velocity at the step's last stage, exactly
        end = step.node + step.stride * (step.substeps - 1) + 3
        motion = Motion(
            motion.x, motion.y, motion.heading, -table.speed * step.sine[end], table.speed * step.cosine[end], 0.0
        )
    return motion, stuck, True
