"""Friction wrench of a flat part in sliding contact, in two forms.

The stress at a point is ``mu p n`` along the velocity of the table relative to it (physics of thesis section 3.2, eqs.
3.26 and 3.27 for a single element). :func:`sliding_wrench` sums it over contact points and is bounded whatever the slip.
:func:`expanded_wrench` sums it over the whole contact area at once, as a series in ``omega r / |u|``: with slip ``u`` at the
centre of mass and ``e = i omega / u``, all as complex numbers, slip at ``z`` is ``u (1 - e z)`` and its direction

    n(z) = (u / |u|) (1 - e z)^(1/2) (1 - conj(e z))^(-1/2) = (u / |u|) sum_ab A_a B_b (e z)^a conj(e z)^b

so that force and torque need the pressure's moments only. The motion does not depend on mass: both return accelerations.
"""

from __future__ import annotations

import numpy as np

from vibgym._numba.jit import borrowing, exact_inlined
from vibgym._numba.vector import LANES, inverse_root, load

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


# Taylor coefficients of (1 - x)^(1/2) and (1 - x)^(-1/2).
_A1, _A2, _A3, _A4 = -1 / 2, -1 / 8, -1 / 16, -5 / 128
_B1, _B2, _B3, _B4 = 1 / 2, 3 / 8, 5 / 16, 35 / 128


@exact_inlined
def combined(moments, row, gravity, cosine, sine):
    """A moment of the pressure at an instant."""
    return (
        gravity * load(moments, row * LANES) + cosine * load(moments, (row + 1) * LANES)
        + sine * load(moments, (row + 2) * LANES)
    )  # fmt: skip


@exact_inlined
def expanded_wrench(moments, gravity, cosine, sine, ux, uy, spin):
    """Force and torque of eight parts from the moments of their pressure.

    The series is cut off after the fourth order of ``omega r / |u|`` in force, and the third in torque. Terms are grouped by
    the angle ``k = a - b`` that they turn with: in the frame of slip each is a polynomial in ``omega / |u|`` alone.

    Args:
        moments: flat (row, lane) from :func:`vibgym.physics.planar.pressure_moments.pressure_moments`.
        gravity, cosine, sine: of the pressure, ``g``, ``-cos wt`` and ``sin wt``.
        ux, uy: velocity of the table relative to the centre of mass, m/s.
        spin: angular velocity of the part, rad/s.

    Returns:
        Force x and y per mass and friction (m/s^2), torque likewise (m^2/s^2), ``|u|^2``, and ``(omega / |u|)^2``, from which
        the caller knows whether the series held.
    """
    square = ux * ux + uy * uy + _TINY
    inverse = inverse_root(square)
    nx, ny = ux * inverse, uy * inverse
    rho = spin * inverse
    # Powers of i conj(n) turn the moments into the frame of slip.
    x1, y1 = ny, nx
    x2, y2 = x1 * x1 - y1 * y1, 2.0 * x1 * y1
    x3, y3 = x2 * x1 - y2 * y1, x2 * y1 + y2 * x1
    x4, y4 = x2 * x2 - y2 * y2, 2.0 * x2 * y2
    m00 = combined(moments, 0, gravity, cosine, sine)
    m11 = combined(moments, 3, gravity, cosine, sine)
    m22 = combined(moments, 6, gravity, cosine, sine)
    a10 = combined(moments, 9, gravity, cosine, sine)
    b10 = combined(moments, 12, gravity, cosine, sine)
    a21 = combined(moments, 15, gravity, cosine, sine)
    b21 = combined(moments, 18, gravity, cosine, sine)
    a20 = combined(moments, 21, gravity, cosine, sine)
    b20 = combined(moments, 24, gravity, cosine, sine)
    a31 = combined(moments, 27, gravity, cosine, sine)
    b31 = combined(moments, 30, gravity, cosine, sine)
    a30 = combined(moments, 33, gravity, cosine, sine)
    b30 = combined(moments, 36, gravity, cosine, sine)
    a40 = combined(moments, 39, gravity, cosine, sine)
    b40 = combined(moments, 42, gravity, cosine, sine)
    re10, im10 = x1 * a10 - y1 * b10, x1 * b10 + y1 * a10
    re21, im21 = x1 * a21 - y1 * b21, x1 * b21 + y1 * a21
    re20, im20 = x2 * a20 - y2 * b20, x2 * b20 + y2 * a20
    re31, im31 = x2 * a31 - y2 * b31, x2 * b31 + y2 * a31
    re30, im30 = x3 * a30 - y3 * b30, x3 * b30 + y3 * a30
    re40, im40 = x4 * a40 - y4 * b40, x4 * b40 + y4 * a40
    # Force along and across the slip, and torque: sums over a, b of A_a B_b rho^(a + b), lowest order outermost.
    along = m00 + rho * (
        (_A1 + _B1) * re10
        + rho * (
            _A1 * _B1 * m11 + (_A2 + _B2) * re20
            + rho * (
                (_A2 * _B1 + _A1 * _B2) * re21 + (_A3 + _B3) * re30
                + rho * (_A2 * _B2 * m22 + (_A3 * _B1 + _A1 * _B3) * re31 + (_A4 + _B4) * re40)
            )
        )
    )  # fmt: skip
    across = rho * (
        (_A1 - _B1) * im10
        + rho * (
            (_A2 - _B2) * im20
            + rho * (
                (_A2 * _B1 - _A1 * _B2) * im21 + (_A3 - _B3) * im30
                + rho * ((_A3 * _B1 - _A1 * _B3) * im31 + (_A4 - _B4) * im40)
            )
        )
    )  # fmt: skip
    torque = re10 + rho * (
        _A1 * m11 + _B1 * re20
        + rho * (
            (_A2 + _A1 * _B1) * re21 + _B2 * re30
            + rho * (_A2 * _B1 * m22 + (_A3 + _A1 * _B2) * re31 + _B3 * re40)
        )
    )  # fmt: skip
    return nx * along - ny * across, ny * along + nx * across, torque, square, rho * rho
