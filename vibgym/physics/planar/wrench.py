"""Friction wrench of a flat part in sliding contact, in two forms.

The stress at a point is ``mu p n`` along the velocity of the table relative to it (physics of thesis section 3.2, eqs.
3.26 and 3.27 for a single element). :func:`sliding_wrench` sums it over contact points and is bounded for every slip.
:func:`expanded_wrench` sums it over the whole contact area at once, as a series in ``omega r / |u|``: with slip ``u`` at the
centre of mass and ``e = i omega / u``, all as complex numbers, slip at ``z`` is ``u (1 - e z)`` and its direction

    n(z) = (u / |u|) (1 - e z)^(1/2) (1 - conj(e z))^(-1/2) = (u / |u|) sum_ab A_a B_b (e z)^a conj(e z)^b

so that force and torque need the pressure's moments only. The motion does not depend on mass: both return accelerations.
"""

from __future__ import annotations

import numpy as np

from vibgym.kernels.jit import borrowing, exact_inlined
from vibgym.kernels.vector import LANES, load, sqrt

_TINY = 1e-30  # (m/s)^2; keeps 0/0 out of a point at rest relative to the table, where friction has no direction


@borrowing
def sliding_wrench(weight, x, y, phasor_c, phasor_s, n, gravity, cosine, sine, slip_x, slip_y, spin):
    """Force and torque per unit mass and friction coefficient.

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
        # 1 / |u|: the processor's single-precision estimate and one Newton step give 1e-14, and spare the slowest part of
        # the loop, a square root and a division in double precision.
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


@exact_inlined
def combined(moments, row, cosine, sine):
    """A moment of the pressure at an instant."""
    return (
        load(moments, row * LANES) + cosine * load(moments, (row + 1) * LANES) + sine * load(moments, (row + 2) * LANES)
    )  # fmt: skip


@exact_inlined
def turned(moments, row, cosine, sine, x, y):
    """A complex moment of the pressure at an instant, times ``x + i y``."""
    re, im = combined(moments, row, cosine, sine), combined(moments, row + 3, cosine, sine)
    return x * re - y * im, x * im + y * re


@exact_inlined
def expanded_wrench(moments, cosine, sine, ux, uy, spin):
    """Force and torque of eight parts from the moments of their pressure.

    The series is cut off after the fourth order of ``rho = omega r / |u|`` in force, and the third in torque. Terms are grouped
    by the angle ``k = a - b`` that they turn with: powers of ``i conj(u)`` turn the moments into the frame of slip, where each
    is a polynomial in ``omega / |u|`` alone, with the Taylor coefficients ``A = 1, -1/2, -1/8, -1/16, -5/128`` of
    ``(1 - x)^(1/2)`` and ``B = 1, 1/2, 3/8, 5/16, 35/128`` of ``(1 - x)^(-1/2)``. They are not divided by powers of ``|u|``,
    but what they are multiplied with, so that the root of ``|u|^2`` is waited for at the very end only.

    Args:
        moments: flat (row, lane) from :func:`vibgym.physics.planar.pressure_moments.pressure_moments`.
        cosine, sine: of the pressure, ``-cos wt`` and ``sin wt``.
        ux, uy: velocity of the table relative to the centre of mass, m/s.
        spin: angular velocity of the part, rad/s.

    Returns:
        Force x and y per mass and friction (m/s^2), torque likewise (m^2/s^2), ``|u|^2``, and ``(omega / |u|)^2``, from which
        the caller knows whether the series held.
    """
    square = ux * ux + _TINY + uy * uy
    w = 1.0 / square
    inverse = sqrt(w)
    x2, y2 = uy * uy - ux * ux, 2.0 * (ux * uy)
    x3, y3 = x2 * uy - y2 * ux, x2 * ux + y2 * uy
    x4, y4 = x2 * x2 - y2 * y2, 2.0 * (x2 * y2)
    m00, m11, m22 = (
        combined(moments, 0, cosine, sine), combined(moments, 3, cosine, sine), combined(moments, 6, cosine, sine),
    )  # fmt: skip
    re10, im10 = turned(moments, 9, cosine, sine, uy, ux)
    re21, im21 = turned(moments, 15, cosine, sine, uy, ux)
    re20, im20 = turned(moments, 21, cosine, sine, x2, y2)
    re31, im31 = turned(moments, 27, cosine, sine, x2, y2)
    re30, im30 = turned(moments, 33, cosine, sine, x3, y3)
    re40, im40 = turned(moments, 39, cosine, sine, x4, y4)
    # Sums over a, b of A_a B_b rho^(a + b). Force along the slip has a quarter of the first two of these, and 3 / 16 of the
    # last; the torque a half, three eighths and a sixteenth.
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
