"""Friction on eight parts at a time, as a series in the moments of the pressure, in steps of Kutta's 3/8 rule.

Even weights suit a periodic drive. :mod:`vibgym.physics.planar.points` takes the same rule on one part and sums over contact
points: the stages stand there a second time, since those here must be one loop over lanes to become vector instructions.
"""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.core.records import body_incline
from vibgym.physics.planar.pressure_moments import LANES
from vibgym.physics.planar.wrench import expanded_wrench

LARGEST_VARIATION = 0.45
"""Of slip across the part, ``omega r / |u|``, up to which the series is used. Measured there: at most 0.14 % of friction in
force and 0.4 % of friction times the radius of gyration in torque, and 0.03 % and 0.12 % at two thirds of it."""

SMALLEST_SLIP = 0.6
"""As a share of what slip can change in a substep, below which a step is taken by points."""


@borrowing
def limits(table, body):
    """What the series is good for: largest ``(omega / |u|)^2``, and slip (m/s) that is too small, per s of a substep."""
    harshest = table.speed * 2.0 * math.pi / table.period + 2.0 * body.friction * table.gravity + body_incline(body)
    return (LARGEST_VARIATION / body.radius) ** 2, SMALLEST_SLIP * harshest


@borrowing
def kutta_lanes(moments, gravity, speed, h, c, s, pose, velocity, own, lanes):
    """One step of Kutta's 3/8 rule for every lane.

    Args:
        moments: flat (row, lane), of the pressure.
        gravity, speed: of the table.  h: s.
        c, s: cos wt and sin wt at the four stages.
        pose, velocity: flat (3, lane), changed in place.
        own: flat (6, lane): largest ``(omega / |u|)^2`` and smallest ``|u|^2`` so far, brought up to date; friction, one over
            the inertia per mass (m^-2), and the incline x and y (m/s^2). In one array, since the compiler gives up vectorising
            where many may overlap.
    """
    third, eighth = h / 3.0, h / 8.0
    c0, c1, c2, c3 = c
    s0, s1, s2, s3 = s
    for j in range(lanes):
        m, t = own[2 * LANES + j], own[3 * LANES + j]
        px, py = own[4 * LANES + j], own[5 * LANES + j]
        g = m * gravity
        vx, vy, spin = velocity[j], velocity[LANES + j], velocity[2 * LANES + j]
        ax, ay, aw, square, varies = expanded_wrench(
            moments, j, g, -m * c0, m * s0, -speed * s0 - vx, speed * c0 - vy, spin
        )
        least, most = square, varies
        ax, ay, aw = ax + px, ay + py, aw * t
        bx, by, bw, square, varies = expanded_wrench(
            moments, j, g, -m * c1, m * s1,
            -speed * s1 - (vx + third * ax), speed * c1 - (vy + third * ay), spin + third * aw,
        )  # fmt: skip
        least, most = min(least, square), max(most, varies)
        bx, by, bw = bx + px, by + py, bw * t
        cx, cy, cw, square, varies = expanded_wrench(
            moments, j, g, -m * c2, m * s2,
            -speed * s2 - (vx + h * bx - third * ax), speed * c2 - (vy + h * by - third * ay),
            spin + h * bw - third * aw,
        )  # fmt: skip
        least, most = min(least, square), max(most, varies)
        cx, cy, cw = cx + px, cy + py, cw * t
        dx, dy, dw, square, varies = expanded_wrench(
            moments, j, g, -m * c3, m * s3,
            -speed * s3 - (vx + h * (ax - bx + cx)), speed * c3 - (vy + h * (ay - by + cy)), spin + h * (aw - bw + cw),
        )  # fmt: skip
        dx, dy, dw = dx + px, dy + py, dw * t
        own[j] = max(own[j], max(most, varies))
        own[LANES + j] = min(own[LANES + j], min(least, square))
        pose[j] += h * (vx + eighth * (ax + 2.0 * bx + cx))
        pose[LANES + j] += h * (vy + eighth * (ay + 2.0 * by + cy))
        pose[2 * LANES + j] += h * (spin + eighth * (aw + 2.0 * bw + cw))
        velocity[j] = vx + eighth * (ax + 3.0 * (bx + cx) + dx)
        velocity[LANES + j] = vy + eighth * (ay + 3.0 * (by + cy) + dy)
        velocity[2 * LANES + j] = spin + eighth * (aw + 3.0 * (bw + cw) + dw)


@borrowing
def slide_by_series(table, step, moments, pose, velocity, own, lanes):
    """All substeps of a step for every lane; see :func:`kutta_lanes`."""
    cosine, sine, node = step.cosine, step.sine, step.node
    for j in range(lanes):
        own[j], own[LANES + j] = 0.0, math.inf
    for _ in range(step.substeps):
        c = cosine[node], cosine[node + 1], cosine[node + 2], cosine[node + 3]
        s = sine[node], sine[node + 1], sine[node + 2], sine[node + 3]
        kutta_lanes(moments, table.gravity, table.speed, step.h, c, s, pose, velocity, own, lanes)
        node += step.stride
