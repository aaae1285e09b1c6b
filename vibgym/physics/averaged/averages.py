"""Averages over a period of the friction on a part on a circling table, to first and second order.

The small parameter is ``eps = mu g / (a_h w^2)``. The velocity is ``v = vbar + wobble``; the wobble is the zero-mean
antiderivative of the fast part of the rigid part's acceleration, about ``eps`` of the table's speed. To first order the mean
acceleration is that at ``vbar`` (thesis eqs. 5.60 and 5.61); to second order

    <v'> = < f(vbar) > + < Df . wobble >

The first order is summed over points with the slip at each. Wobble and second order use the slip of the centre for the whole
part; the error is of the order ``eps^2 spin r / V``. They then depend on the field under the part only through the zeroth,
first and second moments of its phasors, and on slip through tabulated coefficients.

A table has two sides, slip ``s`` below and above 1, over ``-log(1 - min(s, 1 / s))``, with cubic interpolation. Values are
finite at any slip, but the expansion is meaningless where slip passes near zero (``|s - 1|`` up to ``2 eps``); see
:func:`slip_margin`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit

POLYNOMIAL_END = 0.8
"""Square of slip up to which the first-order coefficients are polynomials; above, they are tabulated."""

WOBBLES = 12
MOMENTS = (6, 3)
"""Shape of the moments: 1, x, y, xx, xy, yy of the load, of C and of S."""


class Scratch(NamedTuple):
    """Working arrays."""

    weights: np.ndarray  # (2, 4)
    values: np.ndarray  # (27)
    turned: np.ndarray  # (6, 3)


class Averages(NamedTuple):
    """Tables of coefficients; their columns are defined in :mod:`vibgym.simulation.averages_tables`."""

    polynomials: np.ndarray  # (3, 12) of s^2, highest power first
    mean_scale: float  # nodes per unit of -log(1 - t)
    mean: np.ndarray  # (2, nodes, 3)
    coupling_scale: float
    coupling: np.ndarray  # (2, nodes, 27)
    wobble_scale: float
    angle_scale: float  # nodes per radian
    wobble: np.ndarray  # (2, nodes, angles, 12)


@jit
def friction_rate(friction, gravity, speed):
    """Return the rate ``mu g / (2 a_h w)`` (1/s) at which friction brakes a part much slower than the table (eq. 5.60)."""
    return 0.5 * friction * gravity / speed


def new_scratch() -> Scratch:
    """Allocate working arrays for one thread."""
    return Scratch(np.zeros((2, 4)), np.zeros(27), np.zeros((6, 3)))


@jit
def cubic_weights(position, nodes, weights):
    """Compute the weights of four neighbouring nodes in cubic interpolation; return the first node."""
    first = min(max(int(position) - 1, 0), nodes - 4)
    a = min(position, nodes - 1.0) - first
    b, c, d = a - 1.0, a - 2.0, a - 3.0
    weights[0] = b * c * d * (-1.0 / 6.0)
    weights[1] = 0.5 * a * c * d
    weights[2] = -0.5 * a * b * d
    weights[3] = a * b * c * (1.0 / 6.0)
    return first


@jit
def place(slip):
    """Return the side of the tables and the coordinate on it."""
    side = 0 if slip <= 1.0 else 1
    t = slip if slip <= 1.0 else 1.0 / slip
    return side, -math.log(max(1.0 - t, 1e-15))


@jit
def interpolate(table, scale, slip, scratch):
    """Interpolate a row of a table into ``scratch.values``."""
    side, y = place(slip)
    weights, values = scratch.weights[0], scratch.values
    first = cubic_weights(y * scale, table.shape[1], weights)
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    for k in range(table.shape[2]):
        values[k] = (
            w0 * table[side, first, k]
            + w1 * table[side, first + 1, k]
            + w2 * table[side, first + 2, k]
            + w3 * table[side, first + 3, k]
        )


@jit
def mean_row(tables, slip, scratch):
    """Interpolate ``d / s``, ``(Q - P) / s^2`` and ``P + Q`` into ``scratch.values``."""
    interpolate(tables.mean, tables.mean_scale, slip, scratch)
    if slip > 1.0:
        scratch.values[0] /= slip
        scratch.values[1] /= slip * slip


@jit
def interpolate_wobble(tables, slip, theta, count, scratch):
    """Interpolate the first ``count`` of twelve antiderivatives at slip and angle in [-pi, pi] into ``scratch.values``."""
    weights, values = scratch.weights, scratch.values
    side, y = place(slip)
    table = tables.wobble
    first = cubic_weights(y * tables.wobble_scale, table.shape[1], weights[0])
    start = cubic_weights(abs(theta) * tables.angle_scale, table.shape[2], weights[1])
    b0, b1, b2, b3 = weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3]
    for k in range(count):
        total = 0.0
        for i in range(4):
            total += weights[0, i] * (
                b0 * table[side, first + i, start, k]
                + b1 * table[side, first + i, start + 1, k]
                + b2 * table[side, first + i, start + 2, k]
                + b3 * table[side, first + i, start + 3, k]
            )
        values[k] = total
    if theta < 0.0:  # functions 0, 1 and 5 are odd, 2, 3 and 4 even; their antiderivatives the reverse
        values[0], values[1], values[5] = -values[0], -values[1], -values[5]
        values[8], values[9], values[10] = -values[8], -values[9], -values[10]


@jit
def gather_moments(points, phasor_c, phasor_s, n, moments):
    """Compute the moments (6, 3) of load, C and S over ``n`` contact points, about the centre of mass."""
    for i in range(6):
        for j in range(3):
            moments[i, j] = 0.0
    for piece in range(n // 4):
        a0, a1, a2, a3, a4, a5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(4 * piece, 4 * piece + 4):
            weight, x, y = points[0, k], points[1, k], points[2, k]
            wx, wy = weight * x, weight * y
            a0 += weight
            a1 += wx
            a2 += wy
            a3 += wx * x
            a4 += wx * y
            a5 += wy * y
        c, s = phasor_c[4 * piece], phasor_s[4 * piece]
        moments[0, 0] += a0
        moments[0, 1] += a0 * c
        moments[0, 2] += a0 * s
        moments[1, 0] += a1
        moments[1, 1] += a1 * c
        moments[1, 2] += a1 * s
        moments[2, 0] += a2
        moments[2, 1] += a2 * c
        moments[2, 2] += a2 * s
        moments[3, 0] += a3
        moments[3, 1] += a3 * c
        moments[3, 2] += a3 * s
        moments[4, 0] += a4
        moments[4, 1] += a4 * c
        moments[4, 2] += a4 * s
        moments[5, 0] += a5
        moments[5, 1] += a5 * c
        moments[5, 2] += a5 * s


@jit
def polynomial(p, i, x):
    """Evaluate polynomial ``i`` at ``x`` by Estrin's scheme, whose latency is less than Horner's."""
    x2 = x * x
    x4 = x2 * x2
    high = (p[i, 0] * x + p[i, 1]) * x2 + (p[i, 2] * x + p[i, 3])
    middle = (p[i, 4] * x + p[i, 5]) * x2 + (p[i, 6] * x + p[i, 7])
    return (high * x4 + middle) * x4 + ((p[i, 8] * x + p[i, 9]) * x2 + (p[i, 10] * x + p[i, 11]))


@jit
def first_order(tables, points, phasor_c, phasor_s, n, gravity, speed, radius, vx, vy, spin, scratch):
    """Compute mean force and torque per unit mass and friction coefficient at the mean velocity ``(vx, vy, spin)``.

    Args:
        points, phasor_c, phasor_s, n: contact points (:func:`vibgym.physics.planar.contact_area.contact_points`) and
            phasors, m/s^2.
        speed: of the table, m/s.
        radius: of a circle about the centre of mass that contains all points, m.

    Returns:
        Force x and y (m/s^2) and torque about the centre of mass (m^2/s^2).
    """
    # At a point: i/2 (zeta u^2 E - conj(zeta) B) - g u D with zeta = C + i S, u = ux + i uy and coefficients D, E, B. Repeated
    # in both loops, since the compiler vectorises the first one only in this form.
    inverse = 1.0 / speed
    weight, px, py, p = points[0], points[1], points[2], tables.polynomials
    force_x, force_y, torque = 0.0, 0.0, 0.0
    fastest = inverse * (math.sqrt(vx * vx + vy * vy) + abs(spin) * radius)
    if fastest * fastest <= POLYNOMIAL_END:
        for k in range(n):
            x, y, c, s = px[k], py[k], phasor_c[k], phasor_s[k]
            ux, uy = inverse * (vx - spin * y), inverse * (vy + spin * x)
            square = ux * ux + uy * uy
            d, e, b = polynomial(p, 0, square), polynomial(p, 1, square), polynomial(p, 2, square)
            re, im = e * (ux * ux - uy * uy), e * (2.0 * ux * uy)
            fx = weight[k] * (-gravity * d * ux - 0.5 * (c * im + s * re + s * b))
            fy = weight[k] * (-gravity * d * uy + 0.5 * (c * re - s * im - c * b))
            force_x += fx
            force_y += fy
            torque += x * fy - y * fx
        return force_x, force_y, torque

    values = scratch.values
    for k in range(n):
        x, y, c, s = px[k], py[k], phasor_c[k], phasor_s[k]
        ux, uy = inverse * (vx - spin * y), inverse * (vy + spin * x)
        square = ux * ux + uy * uy
        if square <= POLYNOMIAL_END:
            d, e, b = polynomial(p, 0, square), polynomial(p, 1, square), polynomial(p, 2, square)
        else:
            mean_row(tables, math.sqrt(square), scratch)
            d, e, b = values[0], values[1], values[2]
        re, im = e * (ux * ux - uy * uy), e * (2.0 * ux * uy)
        fx = weight[k] * (-gravity * d * ux - 0.5 * (c * im + s * re + s * b))
        fy = weight[k] * (-gravity * d * uy + 0.5 * (c * re - s * im - c * b))
        force_x += fx
        force_y += fy
        torque += x * fy - y * fx
    return force_x, force_y, torque


@jit
def turn_phasors(moments, gravity, cosine, sine, turned):
    """Rotate moments 1, x, y to the mean velocity's frame, for the terms 1, cos(theta), sin(theta) of normal acceleration."""
    for i in range(3):
        c, s = moments[i, 1], moments[i, 2]
        turned[i, 0] = gravity * moments[i, 0]
        turned[i, 1] = -(s * cosine + c * sine)
        turned[i, 2] = -(c * cosine - s * sine)
    for a in range(3):
        x, y = turned[1, a], turned[2, a]
        turned[1, a], turned[2, a] = cosine * x + sine * y, cosine * y - sine * x


@jit
def turn_moments(moments, gravity, cosine, sine, turned):
    """Rotate all moments, see :func:`turn_phasors`."""
    turn_phasors(moments, gravity, cosine, sine, turned)
    for i in range(3, 6):
        c, s = moments[i, 1], moments[i, 2]
        turned[i, 0] = gravity * moments[i, 0]
        turned[i, 1] = -(s * cosine + c * sine)
        turned[i, 2] = -(c * cosine - s * sine)
    cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
    for a in range(3):
        xx, xy, yy = turned[3, a], turned[4, a], turned[5, a]
        turned[3, a] = cc * xx + 2.0 * cs * xy + ss * yy
        turned[4, a] = cs * (yy - xx) + (cc - ss) * xy
        turned[5, a] = ss * xx - 2.0 * cs * xy + cc * yy


@jit
def direction(vx, vy):
    """Return length and unit vector; along x for zero velocity, for which the direction has no effect."""
    length = math.sqrt(vx * vx + vy * vy)
    if length < 1e-150:
        return 0.0, 1.0, 0.0
    return length, vx / length, vy / length


@jit
def second_order(tables, moments, gravity, speed, gyration, vx, vy, scratch):
    """Compute ``< Df . wobble >`` times ``w / mu^2``: the second order of mean force and torque per unit mass.

    Args:
        moments: from :func:`gather_moments`.

    Returns:
        Force x and y (m/s^3) and torque (m^2/s^3).
    """
    length, cosine, sine = direction(vx, vy)
    interpolate(tables.coupling, tables.coupling_scale, length / speed, scratch)
    return coupled(scratch.values, moments, gravity, speed, gyration, cosine, sine, scratch.turned)


@jit
def coupled(coupling, moments, gravity, speed, gyration, cosine, sine, turned):
    """Compute :func:`second_order` from its coefficients (27,), for a mean velocity along ``(cosine, sine)``."""
    turn_moments(moments, gravity, cosine, sine, turned)
    q0, q1, q2 = turned[0, 0], turned[0, 1], turned[0, 2]
    inverse = 1.0 / gyration
    # angular wobble = sum over shapes of (first moment x) antiderivative of n_2 - (first moment y) antiderivative of n_1
    x0, x1, x2 = -turned[2, 0] * inverse, -turned[2, 1] * inverse, -turned[2, 2] * inverse
    y0, y1, y2 = turned[1, 0] * inverse, turned[1, 1] * inverse, turned[1, 2] * inverse
    fx, fy, torque = 0.0, 0.0, 0.0
    for a in range(3):
        vx_xx, w_xx, vx_xy, vy_xy, w_xy, vy_yy, w_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(3):
            k0, k1, k2 = coupling[9 * j + 3 * a], coupling[9 * j + 3 * a + 1], coupling[9 * j + 3 * a + 2]
            if (j == 1) == (a == 2):
                along, across, turn = k0 * q2, k1 * q0 + k2 * q1, k0 * x2 + k1 * y0 + k2 * y1
            else:
                along, across, turn = k0 * q0 + k1 * q1, k2 * q2, k0 * x0 + k1 * x1 + k2 * y2
            if j == 0:
                vx_xx, _, w_xx = along, across, turn
            elif j == 1:
                vx_xy, vy_xy, w_xy = along, across, turn
            else:
                _, vy_yy, w_yy = along, across, turn
        push_x, push_y = vx_xx + vy_xy, vx_xy + vy_yy
        q, mx, my = turned[0, a], turned[1, a], turned[2, a]
        fx -= q * push_x - my * w_xx + mx * w_xy
        fy -= q * push_y - my * w_xy + mx * w_yy
        torque -= mx * push_y - my * push_x + turned[3, a] * w_yy - 2.0 * turned[4, a] * w_xy + turned[5, a] * w_xx
    inverse = 1.0 / speed
    return inverse * (cosine * fx - sine * fy), inverse * (sine * fx + cosine * fy), inverse * torque


@jit
def velocity_wobble(tables, moments, gravity, speed, vx, vy, scratch):
    """Return the wobble of the centre's velocity x, y at the start of a period, for ``mu = w = 1``."""
    length, cosine, sine = direction(vx, vy)
    values = scratch.values
    interpolate_wobble(tables, length / speed, math.atan2(cosine, sine), WOBBLES // 2, scratch)
    c, s = moments[0, 1], moments[0, 2]
    q0, q1, q2 = gravity * moments[0, 0], -(s * cosine + c * sine), -(c * cosine - s * sine)
    x = q0 * values[0] + q1 * values[1] + q2 * values[2]
    y = q0 * values[3] + q1 * values[4] + q2 * values[5]
    return cosine * x - sine * y, sine * x + cosine * y


@jit
def wobble(tables, moments, gravity, speed, gyration, vx, vy, result, scratch):
    """Compute the wobble of velocity and position at the start of a period, for ``mu = w = 1``.

    Args:
        result: (6) overwritten: velocity x, y and spin, to be multiplied by ``mu / w``; position x, y and heading, by
            ``mu / w^2``.
    """
    length, cosine, sine = direction(vx, vy)
    values, turned = scratch.values, scratch.turned
    interpolate_wobble(tables, length / speed, math.atan2(cosine, sine), WOBBLES, scratch)
    turn_phasors(moments, gravity, cosine, sine, turned)
    inverse = 1.0 / gyration
    for k in range(2):
        x, y, turn = 0.0, 0.0, 0.0
        for a in range(3):
            first, second = values[6 * k + a], values[6 * k + 3 + a]
            x += turned[0, a] * first
            y += turned[0, a] * second
            turn += turned[1, a] * second - turned[2, a] * first
        result[3 * k] = cosine * x - sine * y
        result[3 * k + 1] = sine * x + cosine * y
        result[3 * k + 2] = inverse * turn


@jit
def slip_margin(moments, gravity, speed, friction, frequency, vx, vy):
    """Return a bound on the distance of slip from zero, over the table's speed; below zero, slip may vanish.

    Args:
        frequency: angular, rad/s.
    """
    load = gravity + math.sqrt(moments[0, 1] * moments[0, 1] + moments[0, 2] * moments[0, 2])
    return abs(math.sqrt(vx * vx + vy * vy) / speed - 1.0) - friction * load / (frequency * speed)
