"""Friction on eight parts at a time, as a series in the moments of the pressure, in steps of Kutta's 3/8 rule.

Even weights suit a periodic drive. :mod:`vibgym.physics.planar.points` takes the same rule on one part and sums over contact
points.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing, exact
from vibgym.kernels.vector import LANES, broadcast, load, maximum, minimum, store
from vibgym.physics.core.records import body_incline, most_friction
from vibgym.physics.planar.wrench import expanded_wrench

LARGEST_VARIATION = 0.45
"""Of slip across the part, ``omega r / |u|``, up to which the series is used. Measured there: at most 0.14 % of friction in
force and 0.4 % of friction times the radius of gyration in torque, and 0.03 % and 0.12 % at two thirds of it."""

SMALLEST_SLIP = 0.6
"""As a share of what slip can change in a substep, below which a step is taken by points."""


@borrowing
def limits(table, body):
    """What the series is good for: largest ``(omega / |u|)^2``, and slip (m/s) that is too small, per s of a substep."""
    harshest = (
        table.speed * 2.0 * math.pi / table.period + 2.0 * most_friction(body) * table.gravity + body_incline(body)
    )
    return (LARGEST_VARIATION / body.radius) ** 2, SMALLEST_SLIP * harshest


@exact
def slide_by_series(table, step, moments, pose, velocity, own):
    """All substeps of a step for every lane.

    Args:
        moments: flat (row, lane), of the pressure.
        pose, velocity: flat (3, lane), changed in place.
        own: flat (6, lane): largest ``(omega / |u|)^2`` and smallest ``|u|^2`` in the step, overwritten; friction, friction
            over the inertia per mass (m^-2), and the incline x and y (m/s^2).
    """
    h, speed = step.h, table.speed
    eighth = 0.125 * h
    friction, turn = load(own, 2 * LANES), load(own, 3 * LANES)
    px, py = load(own, 4 * LANES), load(own, 5 * LANES)
    x, y, heading = load(pose, 0), load(pose, LANES), load(pose, 2 * LANES)
    vx, vy, spin = load(velocity, 0), load(velocity, LANES), load(velocity, 2 * LANES)
    least, most, node = broadcast(math.inf), broadcast(0.0), step.node
    for _ in range(step.substeps):
        # What the last stages add to velocity, and those before them: the next adds ``h a``, less the first, and so on.
        dx, dy, dw = broadcast(0.0), broadcast(0.0), broadcast(0.0)
        ex, ey, ew = broadcast(0.0), broadcast(0.0), broadcast(0.0)
        way_x, way_y, way_w = (
            broadcast(0.0),
            broadcast(0.0),
            broadcast(0.0),
        )  # a + 2 b + c of the accelerations at the stages
        gain_x, gain_y, gain_w = broadcast(0.0), broadcast(0.0), broadcast(0.0)  # a + 3 b + 3 c + d
        for stage in range(4):
            c, s = step.cosine[node + stage], step.sine[node + stage]
            fx, fy, fw, square, varies = expanded_wrench(
                moments, -c, s, -speed * s - vx - dx, speed * c - vy - dy, spin + dw
            )
            least, most = minimum(least, square), maximum(most, varies)
            ax, ay, aw = friction * fx + px, friction * fy + py, turn * fw
            inner = 3.0 if stage == 1 or stage == 2 else 1.0
            gain_x, gain_y, gain_w = gain_x + inner * ax, gain_y + inner * ay, gain_w + inner * aw
            if stage == 3:
                break
            twice = 2.0 if stage == 1 else 1.0
            way_x, way_y, way_w = way_x + twice * ax, way_y + twice * ay, way_w + twice * aw
            # Stages begin with h / 3 a, with h b - h / 3 a, and with h (a - b + c) more than the step.
            share, before = h / 3.0 if stage == 0 else h, 2.0 if stage == 2 else 0.0
            grip = share * friction
            dx, ex = grip * fx + (share * px + (before * ex - dx)), dx
            dy, ey = grip * fy + (share * py + (before * ey - dy)), dy
            dw, ew = share * turn * fw + (before * ew - dw), dw
        x, y, heading = (
            x + h * (vx + eighth * way_x),
            y + h * (vy + eighth * way_y),
            heading + h * (spin + eighth * way_w),
        )
        vx, vy, spin = vx + eighth * gain_x, vy + eighth * gain_y, spin + eighth * gain_w
        node += step.stride
    store(pose, 0, x)
    store(pose, LANES, y)
    store(pose, 2 * LANES, heading)
    store(velocity, 0, vx)
    store(velocity, LANES, vy)
    store(velocity, 2 * LANES, spin)
    store(own, 0, most)
    store(own, LANES, least)
