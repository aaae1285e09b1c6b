"""The mean acceleration of a part as a function of the phasors under it, written out for those who invert it."""

from __future__ import annotations

import math

from vibgym.physics.averaged.averages import first_order, second_order
from vibgym.physics.averaged.contact import cut_at, look_under, mean_acceleration, steady_part
from vibgym.physics.contact_area.outline import POINTS_PER_PIECE
from vibgym.physics.contact_area.phasors import forget_phasors
from vibgym.physics.core.jit import borrowing


@borrowing
def mean_accelerations(drive, table, body, scheme, pose, velocity, work, result):
    """Mean acceleration of every world at mean pose and velocity (worlds, 3); NaN where the part has no support."""
    for world in range(pose.shape[0]):
        forget_phasors(work.phasors, 0)
        vx, vy, spin = velocity[world, 0], velocity[world, 1], velocity[world, 2]
        n = look_under(table, body, drive, world, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        ax, ay, aw = math.nan, math.nan, math.nan
        if n > 0:
            ax, ay, aw = mean_acceleration(table, body, scheme, n, vx, vy, spin, work)
        result[world, 0], result[world, 1], result[world, 2] = ax, ay, aw


@borrowing
def mean_states(drive, table, body, scheme, pose, velocity, work, mean_pose, mean_velocity):
    """Mean pose and velocity (worlds, 3) that belong to those at the start of a period; NaN without support."""
    size = body.friction * table.period / (2.0 * math.pi)
    reach = size * table.period / (2.0 * math.pi)
    for world in range(pose.shape[0]):
        forget_phasors(work.phasors, 0)
        spin = velocity[world, 2]
        n = look_under(table, body, drive, world, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        if n == 0:
            for k in range(3):
                mean_pose[world, k], mean_velocity[world, k] = math.nan, math.nan
            continue
        vx, vy = steady_part(table, body, scheme, velocity[world, 0], velocity[world, 1], work)
        mean_velocity[world, 0], mean_velocity[world, 1] = vx, vy
        mean_velocity[world, 2] = spin - size * work.shift[2]
        for k in range(3):
            mean_pose[world, k] = pose[world, k] - reach * work.shift[3 + k]


@borrowing
def elements_under(table, body, pose, velocity, work, elements):
    """List the elements under every world's part in ``elements`` (worlds, room), -1 behind; returns the largest number."""
    points, under = work.cut.points, work.cut.under
    most = 0
    for world in range(pose.shape[0]):
        n = cut_at(table, body, pose[world, 0], pose[world, 1], pose[world, 2], velocity[world, 2], work)
        count = 0
        for piece in range(n // POINTS_PER_PIECE):
            known = points[0, POINTS_PER_PIECE * piece] == 0.0  # padding
            for k in range(count):
                known = known or elements[world, k] == under[piece]
            if not known:
                elements[world, count] = under[piece]
                count += 1
        for k in range(count, elements.shape[1]):
            elements[world, k] = -1
        most = max(most, count)
    return most


@borrowing
def acceleration_map(table, body, scheme, pose, velocity, elements, work, constant, linear, shares, coupling):
    """Write the mean acceleration as ``constant + linear p + m B m`` with ``p = (C_1, ..., S_1, ...)`` and moments ``m``.

    The moments are linear in ``p``: ``m = (G 1, G C, G S)`` with the elements' shares ``G`` of 1, x, y, xx, xy, yy of the load.

    Args:
        pose, velocity: (worlds, 3) mean pose and velocity.
        elements: (worlds, n) from :func:`elements_under`.
        constant: (worlds, 3), linear: (worlds, 3, 2 n), shares G: (worlds, 6, n), coupling B: (worlds, 3, 18, 18);
            zeros on entry, overwritten; m/s^2 and rad/s^2. To first order B stays zero.
    """
    tables, mu = scheme.tables, body.friction
    small = mu * table.period / (2.0 * math.pi)
    unit, diagonal = work.unit, work.diagonal
    points, under, phasor_c, phasor_s = work.cut.points, work.cut.under, work.cut.phasor_c, work.cut.phasor_s
    count = elements.shape[1]
    scale = mu, mu, mu / body.gyration
    for world in range(pose.shape[0]):
        vx, vy, spin = velocity[world, 0], velocity[world, 1], velocity[world, 2]
        n = cut_at(table, body, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        for k in range(n):
            phasor_c[k], phasor_s[k] = 0.0, 0.0
        force = first_order(
            tables, points, phasor_c, phasor_s, n, table.gravity, table.speed, body.radius,
            vx, vy, spin, work.scratch,
        )  # fmt: skip
        for i in range(3):
            constant[world, i] = scale[i] * force[i]
        for j in range(count):
            element = elements[world, j]
            if element < 0:
                break
            for k in range(n):
                if under[k // POINTS_PER_PIECE] == element:
                    weight, x, y = points[0, k], points[1, k], points[2, k]
                    shares[world, 0, j] += weight
                    shares[world, 1, j] += weight * x
                    shares[world, 2, j] += weight * y
                    shares[world, 3, j] += weight * x * x
                    shares[world, 4, j] += weight * x * y
                    shares[world, 5, j] += weight * y * y
            for part in range(2):
                for k in range(n):
                    own = 1.0 if under[k // POINTS_PER_PIECE] == element else 0.0
                    phasor_c[k], phasor_s[k] = own * (1 - part), own * part
                force = first_order(
                    tables, points, phasor_c, phasor_s, n, 0.0, table.speed, body.radius,
                    vx, vy, spin, work.scratch,
                )  # fmt: skip
                for i in range(3):
                    linear[world, i, count * part + j] = scale[i] * force[i]
        if scheme.order == 1:
            continue
        # A quadratic form is known from its values at the unit vectors and at their sums.
        for i in range(18):
            for j in range(i + 1):
                for k in range(6):
                    unit[k, 0], unit[k, 1], unit[k, 2] = 0.0, 0.0, 0.0
                unit[i % 6, i // 6] += 1.0
                if j < i:
                    unit[j % 6, j // 6] += 1.0
                force = second_order(tables, unit, table.gravity, table.speed, body.gyration, vx, vy, work.scratch)
                for axis in range(3):
                    value = small * scale[axis] * force[axis]
                    if j == i:
                        diagonal[i, axis] = value
                        coupling[world, axis, i, i] = value
                    else:
                        coupling[world, axis, i, j] = value
        for i in range(18):
            for j in range(i):
                for axis in range(3):
                    half = 0.5 * (coupling[world, axis, i, j] - diagonal[i, axis] - diagonal[j, axis])
                    coupling[world, axis, i, j], coupling[world, axis, j, i] = half, half
