"""Planar contact, averaged over the period: one part per world in permanent sliding on the vibrating elements.

The state is that of the planar model, pose and velocity at one instant. Every call goes over to the slow variables, pose
and velocity without their wobble (:mod:`vibgym.physics.averaged.averages`), advances those, and goes back under the same
drive: the wobble depends on the drive, so that without this a drive that changes would cost an error of first order each
time. Both orders do so and differ in the mean acceleration alone: with a drive that changes every period it takes 2.6 times
the error off first order, too.

A step spans one or several periods or a part of one. Both its ends cut the outline; between them the acceleration less
``-mu g / (2 a_h w) v``, the linear part of friction, is taken as linear in time and the rest is solved exactly (exponential
Runge-Kutta, second order). So steps of several periods stay sound: what friction damps within them is no error.

Where slip may have passed through zero within a period the world is marked in ``state.doubtful``, and the result is not
certified from there on: the wobble may then carry the part to the speed of the table.
"""

from __future__ import annotations

import math

from vibgym.physics.averaged.averages import slip_margin, wobble
from vibgym.physics.averaged.contact import look_under, mean_acceleration, steady_part
from vibgym.physics.contact_area.phasors import forget_phasors
from vibgym.physics.core.jit import borrowing


@borrowing
def exponential(z):
    """(1 - exp(-z)) / z and the next two of its kind, each the integral of the one before: 1, 1/2 and 1/6 at z = 0."""
    if z < 0.5:
        third = 1.0
        for k in range(15, 3, -1):
            third = 1.0 - z * third * (1.0 / k)
        third *= 1.0 / 6.0
        second = 0.5 - z * third
        return 1.0 - z * second, second, third
    first = (1.0 - math.exp(-z)) / z
    second = (1.0 - first) / z
    return first, second, (0.5 - second) / z


@borrowing
def advance_worlds(start, stop, drive, table, body, scheme, state, periods, work):
    """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""
    mu = body.friction
    frequency = 2.0 * math.pi / table.period
    size = mu / frequency  # of the wobble of velocity
    reach = size / frequency  # and of position
    damping = 0.5 * mu * table.gravity / table.speed  # rate of the linear part of friction
    before, moments, shift = work.before, work.moments, work.shift
    spans = (periods + scheme.stride - 1) // scheme.stride

    for world in range(start, stop):
        x, y, heading = state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2]
        vx, vy, spin = state.velocity[world, 0, 0], state.velocity[world, 0, 1], state.velocity[world, 0, 2]
        x0, y0, heading0 = x, y, heading  # pose one period before the end
        if state.fallen[world, 0] or state.diverged[world]:
            for k in range(3):
                state.mean_velocity[world, 0, k] = 0.0
            continue
        margin = math.inf
        sound = abs(x + y + heading + vx + vy + spin) < math.inf
        n, ax, ay, aw = 0, 0.0, 0.0, 0.0
        if sound:
            forget_phasors(work.phasors, 0)
            n = look_under(table, body, drive, world, x, y, heading, spin, work)
        if n > 0:
            vx, vy = steady_part(table, body, scheme, vx, vy, work)
            x, y, heading = x - reach * shift[3], y - reach * shift[4], heading - reach * shift[5]
            spin -= size * shift[2]
            margin = slip_margin(moments, table.gravity, table.speed, mu, frequency, vx, vy)
            ax, ay, aw = mean_acceleration(table, body, scheme, n, vx, vy, spin, work)

        for span in range(spans):
            if n == 0 or not sound:
                break
            length = min(scheme.stride, periods - span * scheme.stride)
            h = length * table.period / scheme.steps
            # The faster a part is than the table, the less its friction depends on its speed.
            rate = damping * min(1.0, table.speed * table.speed / max(vx * vx + vy * vy, 1e-300))
            phi1, phi2, phi3 = exponential(rate * h)
            # The last period begins in this step, at this part of it.
            last, part = -1, 0.0
            if span == spans - 1 and periods > 1:
                last = (length - 1) * scheme.steps // length
                part = ((length - 1) * scheme.steps - last * length) / length
            for step in range(scheme.steps):
                ux, uy, turn = vx + h * phi1 * ax, vy + h * phi1 * ay, spin + h * phi1 * aw
                sx, sy = x + h * (vx + h * phi2 * ax), y + h * (vy + h * phi2 * ay)
                turned = heading + h * (spin + h * phi2 * aw)
                sound = abs(sx + sy + turned + ux + uy + turn) < math.inf
                if not sound:
                    break
                for i in range(6):
                    for j in range(3):
                        before[i, j] = moments[i, j]
                n = look_under(table, body, drive, world, sx, sy, turned, turn, work)
                if n == 0:
                    break
                cx, cy, cw = mean_acceleration(table, body, scheme, n, ux, uy, turn, work)
                # by how much the acceleration without the linear part of friction has changed
                bx, by = cx - ax + rate * (ux - vx), cy - ay + rate * (uy - vy)
                bw = cw - aw + rate * (turn - spin)
                if step == last:
                    t = part * h
                    psi1, psi2, psi3 = exponential(rate * t)
                    for i in range(6):
                        for j in range(3):
                            before[i, j] += part * (moments[i, j] - before[i, j])
                    wobble(
                        scheme.tables, before, table.gravity, table.speed, body.gyration,
                        vx + t * (psi1 * ax + part * psi2 * bx), vy + t * (psi1 * ay + part * psi2 * by),
                        shift, work.scratch,
                    )  # fmt: skip
                    x0 = x + t * (vx + t * (psi2 * ax + part * psi3 * bx)) + reach * shift[3]
                    y0 = y + t * (vy + t * (psi2 * ay + part * psi3 * by)) + reach * shift[4]
                    heading0 = heading + t * (spin + t * (psi2 * aw + part * psi3 * bw)) + reach * shift[5]
                x, y, heading = sx + h * h * phi3 * bx, sy + h * h * phi3 * by, turned + h * h * phi3 * bw
                vx, vy, spin = ux + h * phi2 * bx, uy + h * phi2 * by, turn + h * phi2 * bw
                # The next step's acceleration, at the corrected velocity: the linear part is enough for second order.
                ax, ay, aw = cx - rate * h * phi2 * bx, cy - rate * h * phi2 * by, cw - rate * h * phi2 * bw
                margin = min(margin, slip_margin(moments, table.gravity, table.speed, mu, frequency, vx, vy))

        if sound and n > 0:
            wobble(scheme.tables, moments, table.gravity, table.speed, body.gyration, vx, vy, shift, work.scratch)
            x, y, heading = x + reach * shift[3], y + reach * shift[4], heading + reach * shift[5]
            vx, vy, spin = vx + size * shift[0], vy + size * shift[1], spin + size * shift[2]
            sound = abs(x + y + heading + vx + vy + spin) < math.inf
        if margin < 0.0:
            state.doubtful[world, 0] = True
        if not sound:
            # Keep the last state that made sense; nobody gets to see the other one.
            state.diverged[world] = True
            for k in range(3):
                state.mean_velocity[world, 0, k] = 0.0
            continue
        if n == 0:
            state.fallen[world, 0] = True
            vx, vy, spin, x0, y0, heading0 = 0.0, 0.0, 0.0, x, y, heading
        state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2] = x, y, heading
        state.velocity[world, 0, 0], state.velocity[world, 0, 1], state.velocity[world, 0, 2] = vx, vy, spin
        state.mean_velocity[world, 0, 0] = (x - x0) / table.period
        state.mean_velocity[world, 0, 1] = (y - y0) / table.period
        state.mean_velocity[world, 0, 2] = (heading - heading0) / table.period
