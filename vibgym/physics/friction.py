"""Friction wrench of a flat part: sliding friction summed over its contact points.

The stress at a point is ``mu p n`` along the velocity of the table relative to it (physics of thesis section 3.2, eqs.
3.26 and 3.27 for a single element). Accelerations are returned per unit ``mu``: the motion does not depend on mass.
"""

from __future__ import annotations

import numpy as np

from vibgym.physics._jit import jit

_TINY = 1e-30  # (m/s)^2; keeps 0/0 out of a point at rest relative to the table, where friction has no direction


@jit
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
