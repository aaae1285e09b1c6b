"""Static friction of an area contact, and an implicit step in which a part may stick or start to slip.

Let ``eta = (u_x, u_y, omega)`` be the slip of the table relative to the part's centre of mass and the part's spin, and
``H(eta) = mu * integral of p |u - omega z^ x r|`` the power of friction. It is convex, and friction is its subgradient:

    M d(eta)/dt = (a_table - incline, 0) - dH(eta),        M = diag(1, 1, k^2)

At zero slip the subgradient is a set bounded by the limit surface: every wrench of a stress of at most ``mu p``. An implicit
Euler step of length ``h`` is the minimum of a strictly convex function and therefore has exactly one solution,

    eta_new = argmin 1/2 |eta - eta_free|_M^2 + h H(eta)

which is zero if and only if friction can carry the load: sticking needs neither a threshold nor regularisation, and a part that
breaks away starts along the normal of the limit surface. This is the step of Moreau's and Jean's sweeping process;
:func:`slip_step` takes it twice for second order (the L-stable SDIRK2 scheme).
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit

GAMMA = 1.0 - math.sqrt(0.5)
"""Coefficient of SDIRK2, which is stiffly accurate: the last stage is the result, so sticking is exact."""

# Newton's method smooths |u| near zero, relative to the slip that friction can stop in the step: coarsely first, to converge
# along kinks (a contact point at rest under a part that rotates about it), then negligibly.
_COARSEST, _FINER, _FINEST = 1e-1, 1e-2, 1e-9
_STOPPED = 1e-6  # relative slip below which the solution is zero
_DIRECT, _ITERATIONS = 8, 100


@jit
def set_loads(weight, phasor_c, phasor_s, n, gravity, cosine, sine, scale, load):
    """Compute ``load = scale * pressure share`` of every contact point; return the sum."""
    total = 0.0
    for k in range(n):
        load[k] = scale * weight[k] * max(gravity - phasor_c[k] * cosine + phasor_s[k] * sine, 0.0)
        total += load[k]
    return total


@jit
def uniform_stress_holds(load, total, x, y, n, gyration, rx, ry, rw):
    """Return whether a stress, uniform plus a rotation about the centre of pressure, balances the load ``(rx, ry, k^2 rw)``.

    This is sufficient for sticking and cheap, and exact if the pressure is centred and the torque zero.
    """
    px, py = 0.0, 0.0
    for k in range(n):
        px += load[k] * x[k]
        py += load[k] * y[k]
    px, py = px / total, py / total
    polar = 0.0
    for k in range(n):
        polar += load[k] * ((x[k] - px) ** 2 + (y[k] - py) ** 2)
    torque = gyration * rw - (py * rx - px * ry)
    if polar <= 1e-9 * gyration * total:  # all load at one point, without torque
        return torque == 0.0 and rx * rx + ry * ry <= total * total
    turn = torque * total / polar
    largest = 0.0
    for k in range(n):
        if load[k] > 0.0:
            fx, fy = rx + turn * (y[k] - py), ry - turn * (x[k] - px)
            largest = max(largest, fx * fx + fy * fy)
    return largest <= total * total


@jit
def _energy(load, x, y, n, gyration, rx, ry, rw, smooth, sx, sy, spin):
    value = 0.5 * ((sx - rx) ** 2 + (sy - ry) ** 2 + gyration * (spin - rw) ** 2)
    for k in range(n):
        ux, uy = sx + spin * y[k], sy - spin * x[k]
        value += load[k] * math.sqrt(ux * ux + uy * uy + smooth)
    return value


@jit
def implicit_slip(load, total, x, y, n, gyration, rx, ry, rw, guess_x, guess_y, guess_w):
    """Minimise ``1/2 |eta - r|_M^2 + sum load |u - spin z^ x r|``: slip and spin at the end of an implicit step.

    Args:
        load, total: from :func:`set_loads`, scaled by step and friction coefficient: the slip that each point can stop, m/s.
        x, y, n: contact points about the centre of mass, m.
        gyration: planar inertia over mass, m^2.
        rx, ry, rw: slip (m/s) and spin (rad/s) that the step would reach without friction.
        guess_x, guess_y, guess_w: initial guess; zeros for none.

    Returns:
        Slip x, y and spin; exactly (0, 0, 0) where friction holds.
    """
    if total <= 0.0:
        return rx, ry, rw
    size = math.sqrt(rx * rx + ry * ry)
    if size <= total and uniform_stress_holds(load, total, x, y, n, gyration, rx, ry, rw):
        return 0.0, 0.0, 0.0
    shorter = max(1.0 - total / max(size, 1e-300), 0.01)
    sx, sy, spin = guess_x, guess_y, guess_w
    if sx == 0.0 and sy == 0.0 and spin == 0.0:
        # Exact for a centred pressure without torque: slip is shortened along its direction.
        sx, sy, spin = shorter * rx, shorter * ry, shorter * rw
    # From a good guess the finest smoothing converges in a few iterations; otherwise it restarts with the coarsest.
    level = _FINEST
    smooth = (level * total) ** 2
    value = _energy(load, x, y, n, gyration, rx, ry, rw, smooth, sx, sy, spin)
    for iteration in range(_ITERATIONS):
        gx, gy, gw = sx - rx, sy - ry, gyration * (spin - rw)
        hxx, hyy, hxy, hxw, hyw, hww = 1.0, 1.0, 0.0, 0.0, 0.0, gyration
        for k in range(n):
            ux, uy = sx + spin * y[k], sy - spin * x[k]
            inverse = 1.0 / math.sqrt(ux * ux + uy * uy + smooth)
            ux, uy = ux * inverse, uy * inverse
            gx += load[k] * ux
            gy += load[k] * uy
            gw += load[k] * (y[k] * ux - x[k] * uy)
            stiff = load[k] * inverse
            xx, xy, yy = stiff * (1.0 - ux * ux), -stiff * ux * uy, stiff * (1.0 - uy * uy)
            hxx += xx
            hxy += xy
            hyy += yy
            hxw += y[k] * xx - x[k] * xy
            hyw += y[k] * xy - x[k] * yy
            hww += y[k] * y[k] * xx - 2.0 * x[k] * y[k] * xy + x[k] * x[k] * yy
        # Cholesky of the 3 x 3 Hessian, which is at least M.
        l11 = math.sqrt(hxx)
        l21, l31 = hxy / l11, hxw / l11
        l22 = math.sqrt(max(hyy - l21 * l21, 1e-12 * hyy))
        l32 = (hyw - l31 * l21) / l22
        l33 = math.sqrt(max(hww - l31 * l31 - l32 * l32, 1e-12 * hww))
        z1 = -gx / l11
        z2 = (-gy - l21 * z1) / l22
        z3 = (-gw - l31 * z1 - l32 * z2) / l33
        dw = z3 / l33
        dy = (z2 - l32 * dw) / l22
        dx = (z1 - l21 * dy - l31 * dw) / l11
        slope = gx * dx + gy * dy + gw * dw  # negative: the Hessian is positive definite
        done = -slope <= 1e-20 * total * total
        if iteration == _DIRECT and not done:
            sx, sy, spin = shorter * rx, shorter * ry, shorter * rw
            level = _COARSEST
            smooth = (level * total) ** 2
            value = _energy(load, x, y, n, gyration, rx, ry, rw, smooth, sx, sy, spin)
            continue
        length, step = 1.0, 0
        while step < 40:
            trial = _energy(
                load, x, y, n, gyration, rx, ry, rw, smooth, sx + length * dx, sy + length * dy, spin + length * dw
            )
            if trial <= value + 1e-4 * length * slope:
                break
            length *= 0.5
            step += 1
        if step < 40:  # else converged to rounding
            sx, sy, spin, value = sx + length * dx, sy + length * dy, spin + length * dw, trial
        # Coarser levels only need approximate solutions.
        if done or step == 40 or (level > _FINEST and -slope <= 1e-6 * level * total * total):
            if level <= _FINEST:
                break
            level = max(level * _FINER, _FINEST)
            smooth = (level * total) ** 2
            value = _energy(load, x, y, n, gyration, rx, ry, rw, smooth, sx, sy, spin)
    if sx * sx + sy * sy + gyration * spin * spin <= (_STOPPED * total) ** 2:
        return 0.0, 0.0, 0.0
    return sx, sy, spin


@jit
def static_friction_holds(
    table, friction, points, phasor_c, phasor_s, n, gyration, cosine, sine, incline_x, incline_y, load
):
    """Return whether friction can carry the part with the table (thesis eq. 3.2) against the incline's acceleration (m/s^2)."""
    drive = table.speed * 2.0 * math.pi / table.period
    # | -drive (cos, sin) - incline |, written so that it is exactly ``drive`` on a level table.
    square = (
        drive * drive
        + 2.0 * drive * (cosine * incline_x + sine * incline_y)
        + (incline_x * incline_x + incline_y * incline_y)
    )
    needed = math.sqrt(max(square, 0.0))
    total = set_loads(points[0], phasor_c, phasor_s, n, table.gravity, cosine, sine, friction, load)
    if needed == 0.0:
        return True
    if needed > total * (1.0 + 1e-12):  # with the margin a part sticks at exactly mu_0 g, despite rounding
        return False
    sx, sy, spin = implicit_slip(
        load, total, points[1], points[2], n, gyration,
        -drive * cosine - incline_x, -drive * sine - incline_y, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return sx == 0.0 and sy == 0.0 and spin == 0.0


@jit
def slip_step(
    table, friction, points, phasor_c, phasor_s, n, gyration, incline_x, incline_y, load, phase, h, slip_x, slip_y, spin
):
    """Take an SDIRK2 step of slip and spin from ``phase = w t`` on; the incline (m/s^2) reduces the slip.

    Returns:
        Slip x, y and spin at the end, and the integrals of slip x, y and spin over the step.
    """
    omega = 2.0 * math.pi / table.period
    needed = table.speed * omega
    part = GAMMA * h
    way_x, way_y, turned = 0.0, 0.0, 0.0
    from_x, from_y, from_spin = slip_x, slip_y, spin  # start of a stage, before its implicit part
    sx, sy, sw = slip_x, slip_y, spin
    for stage in range(2):
        at = phase + omega * (part if stage == 0 else h)
        c, s = math.cos(at), math.sin(at)
        total = set_loads(points[0], phasor_c, phasor_s, n, table.gravity, c, s, part * friction, load)
        if (
            incline_x != 0.0 or incline_y != 0.0
        ):  # without the test, results on a level table would be rounded differently
            from_x, from_y = from_x - part * incline_x, from_y - part * incline_y
        sx, sy, sw = implicit_slip(
            load, total, points[1], points[2], n, gyration,
            from_x - part * needed * c, from_y - part * needed * s, from_spin, sx, sy, sw,
        )  # fmt: skip
        share = h - part if stage == 0 else part
        way_x, way_y, turned = way_x + share * sx, way_y + share * sy, turned + share * sw
        carry = (1.0 - GAMMA) / GAMMA
        from_x, from_y, from_spin = (
            slip_x + carry * (sx - slip_x), slip_y + carry * (sy - slip_y), spin + carry * (sw - spin)
        )  # fmt: skip
    return sx, sy, sw, way_x, way_y, turned
