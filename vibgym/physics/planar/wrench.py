"""Friction wrench of a flat part in sliding contact, in two forms, and steps of a register of parts with the second form.

The stress at a point is ``mu p n`` along the velocity of the table relative to it (thesis section 3.2, eqs. 3.26 and 3.27 for
a single element). :func:`sliding_wrench` sums it over contact points and is bounded for every slip. :func:`expanded_wrench`
integrates it over the whole contact area as a series in ``omega r / |u|``. With slip ``u`` at the centre of mass and ``e = i
omega / u`` as complex numbers, slip at ``z`` is ``u (1 - e z)`` and its direction is

    n(z) = (u / |u|) (1 - e z)^(1/2) (1 - conj(e z))^(-1/2) = (u / |u|) sum_ab A_a B_b (e z)^a conj(e z)^b

so force and torque need only the moments of the pressure. The motion does not depend on mass: both return accelerations.
:func:`slide_by_series` takes steps of Kutta's 3/8 rule, whose even stages suit a periodic drive.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import exact, jit
from vibgym.kernels.vector import LANES, broadcast_register, load_like, load_register, maximum, minimum, sqrt, store
from vibgym.physics.core.records import body_incline, law_factor, most_friction

_TINY = 1e-30  # (m/s)^2; avoids 0/0 at a point without slip, where friction has no direction


@jit
def sliding_wrench(weight, x, y, phasor_c, phasor_s, n, gravity, cosine, sine, slip_x, slip_y, spin):
    """Sum force and torque per unit mass and friction coefficient over contact points.

    Args:
        weight, x, y: contact points: share of the load area, offset from the centre of mass (m).
        phasor_c, phasor_s: phasors of the element under each point, m/s^2.
        n: number of points.
        cosine, sine: of ``w t``.
        slip_x, slip_y: velocity of the table relative to the centre of mass, m/s.
        spin: angular velocity of the part, rad/s.

    Returns:
        Force x and y (m/s^2) and torque about the centre of mass (m^2/s^2).
    """
    force_x, force_y, torque = 0.0, 0.0, 0.0
    for k in range(n):
        ux = slip_x + spin * y[k]
        uy = slip_y - spin * x[k]
        normal = gravity - phasor_c[k] * cosine + phasor_s[k] * sine
        # 1 / |u|: a single-precision estimate and one Newton step give 1e-14, without the loop's slowest instructions, square
        # root and division in double precision.
        square = ux * ux + uy * uy + _TINY
        inverse = np.float64(np.float32(1.0) / np.sqrt(np.float32(square)))
        inverse *= 1.5 - 0.5 * square * inverse * inverse
        stress = weight[k] * normal * inverse
        ux *= stress
        uy *= stress
        force_x += ux
        force_y += uy
        torque += x[k] * uy - y[k] * ux
    return force_x, force_y, torque


@jit
def varying_wrench(weight, x, y, phasor_c, phasor_s, n, gravity, cosine, sine, slip_x, slip_y, spin, law):
    """Sum force and torque as :func:`sliding_wrench`, with a coefficient of friction that depends on speed.

    ``law``: factors by slip speed, see :class:`vibgym.physics.core.records.Body`. A function of its own, since a branch in
    :func:`sliding_wrench` would round its results differently.
    """
    force_x, force_y, torque = 0.0, 0.0, 0.0
    for k in range(n):
        ux, uy = slip_x + spin * y[k], slip_y - spin * x[k]
        speed = math.sqrt(ux * ux + uy * uy + _TINY)
        stress = weight[k] * (gravity - phasor_c[k] * cosine + phasor_s[k] * sine) * law_factor(law, speed) / speed
        force_x += stress * ux
        force_y += stress * uy
        torque += stress * (x[k] * uy - y[k] * ux)
    return force_x, force_y, torque


@exact(inline=True)
def combined(moments, row, cosine, sine, slip):
    """Return a moment of the pressure at an instant, of as many parts as ``slip`` has lanes."""
    return (
        load_like(slip, moments, row * LANES) + cosine * load_like(slip, moments, (row + 1) * LANES)
        + sine * load_like(slip, moments, (row + 2) * LANES)
    )  # fmt: skip


@exact(inline=True)
def rotated_moment(moments, row, cosine, sine, x, y):
    """Return a complex moment of the pressure at an instant, times ``x + i y``."""
    re, im = combined(moments, row, cosine, sine, x), combined(moments, row + 3, cosine, sine, x)
    return x * re - y * im, x * im + y * re


@exact(inline=True)
def expanded_wrench(moments, cosine, sine, ux, uy, spin):
    """Compute force and torque of a register of parts, or of eight, from the moments of their pressure.

    The series is truncated after the fourth order of ``rho = omega r / |u|`` in force, and the third in torque. Terms are
    grouped by their angular order ``k = a - b``: powers of ``i conj(u)`` rotate the moments into the frame of slip, where each
    is a polynomial in ``omega / |u|``, with the Taylor coefficients ``A = 1, -1/2, -1/8, -1/16, -5/128`` of
    ``(1 - x)^(1/2)`` and ``B = 1, 1/2, 3/8, 5/16, 35/128`` of ``(1 - x)^(-1/2)``. Powers of ``1 / |u|`` multiply the
    polynomials, not the moments, so that only the last operations need the square root of ``|u|^2``.

    Args:
        moments: flat (row, lane) from :func:`vibgym.physics.planar.pressure_moments.pressure_moments`.
        cosine, sine: of the pressure, ``-cos wt`` and ``sin wt``.
        ux, uy: velocity of the table relative to the centre of mass, m/s.
        spin: angular velocity of the part, rad/s.

    Returns:
        Force x and y (m/s^2) and torque (m^2/s^2) per mass and friction, ``|u|^2``, and ``(omega / |u|)^2``, which decides
        whether the series is accurate.
    """
    square = ux * ux + _TINY + uy * uy
    w = 1.0 / square
    inverse = sqrt(w)
    x2, y2 = uy * uy - ux * ux, 2.0 * (ux * uy)
    x3, y3 = x2 * uy - y2 * ux, x2 * ux + y2 * uy
    x4, y4 = x2 * x2 - y2 * y2, 2.0 * (x2 * y2)
    m00, m11, m22 = (
        combined(moments, 0, cosine, sine, ux), combined(moments, 3, cosine, sine, ux),
        combined(moments, 6, cosine, sine, ux),
    )  # fmt: skip
    re10, im10 = rotated_moment(moments, 9, cosine, sine, uy, ux)
    re21, im21 = rotated_moment(moments, 15, cosine, sine, uy, ux)
    re20, im20 = rotated_moment(moments, 21, cosine, sine, x2, y2)
    re31, im31 = rotated_moment(moments, 27, cosine, sine, x2, y2)
    re30, im30 = rotated_moment(moments, 33, cosine, sine, x3, y3)
    re40, im40 = rotated_moment(moments, 39, cosine, sine, x4, y4)
    # Sums over a, b of A_a B_b rho^(a + b). Force along the slip has 1/4 of the first two and 3/16 of the last; torque 1/2, 3/8
    # and 1/16.
    sigma = spin * w
    rho2, sigma2 = spin * sigma, sigma * sigma
    second = w * re20 - m11
    third = sigma * (w * re30 - re21)
    fourth = rho2 * (w * (w * (5.0 * re40) - 4.0 * re31) - m22)
    along = m00 + 0.25 * rho2 * (second + (third + 0.1875 * fourth))
    torque = inverse * (re10 + 0.5 * spin * (second + (0.75 * third + 0.125 * fourth)))
    across = sigma * (
        im10 + 0.5 * sigma * im20 + 0.125 * (3.0 * sigma2 * im30 - rho2 * im21)
        + 0.0625 * sigma * (5.0 * sigma2 * im40 - 2.0 * rho2 * im31)
    )  # fmt: skip
    return inverse * (ux * along + uy * across), inverse * (uy * along - ux * across), torque, square, rho2


LARGEST_VARIATION = 0.45
"""Largest ``omega r / |u|`` for the series. Its error there is at most 0.14 % of friction in force and 0.4 % of friction times
the radius of gyration in torque; at two thirds of it 0.03 % and 0.12 %."""

SMALLEST_SLIP = 0.6
"""Slip over its largest change in a substep, below which a step is taken by points."""


@jit
def limits(table, body):
    """Return the limits of the series: largest ``(omega / |u|)^2`` (m^-2), smallest slip per length of a substep (m/s^2)."""
    harshest = (
        table.speed * 2.0 * math.pi / table.period + 2.0 * most_friction(body) * table.gravity + body_incline(body)
    )
    return (LARGEST_VARIATION / body.radius) ** 2, SMALLEST_SLIP * harshest


@exact
def slide_by_series(table, step, moments, pose, velocity, own):
    """Take all substeps of a step for the lanes of a register; arrays start at its first lane.

    Args:
        moments: flat (row, lane), of the pressure.
        pose, velocity: flat (3, lane), changed in place.
        own: flat (6, lane): largest ``(omega / |u|)^2`` and smallest ``|u|^2`` in the step, overwritten; friction, friction
            over inertia per mass (m^-2), incline x and y (m/s^2).
    """
    h, speed = step.h, table.speed
    eighth = 0.125 * h
    friction, turn = load_register(own, 2 * LANES), load_register(own, 3 * LANES)
    px, py = load_register(own, 4 * LANES), load_register(own, 5 * LANES)
    x, y, heading = load_register(pose, 0), load_register(pose, LANES), load_register(pose, 2 * LANES)
    vx, vy, spin = load_register(velocity, 0), load_register(velocity, LANES), load_register(velocity, 2 * LANES)
    least, most, node = broadcast_register(math.inf), broadcast_register(0.0), step.node
    for _ in range(step.substeps):
        # Increments of velocity of the last stage (d) and of the one before (e).
        dx, dy, dw = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
        ex, ey, ew = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
        # Sums of the stages' accelerations: a + 2 b + c, and a + 3 b + 3 c + d.
        way_x, way_y, way_w = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
        gain_x, gain_y, gain_w = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
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
            # Stages start at h / 3 a, h b - h / 3 a, and h (a - b + c) from the step's start.
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
