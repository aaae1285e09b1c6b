"""The mean acceleration of a part as a function of the phasors under it, written out for those who invert it."""

from __future__ import annotations

import numpy as np

from vibgym.physics.averaged.averages import first_order, gather_moments, second_order
from vibgym.physics.averaged.contact import cut, make_workspace, mean_acceleration, read_phasors, steady_part
from vibgym.physics.contact_area.outline import POINTS_PER_PIECE
from vibgym.physics.core.jit import jit


@jit
def mean_accelerations(drive, table, body, scheme, pose, velocity, result):
    """Mean acceleration of every world at mean pose and velocity (worlds, 3); NaN where the part has no support."""
    work = make_workspace(table, body)
    moments = np.empty((6, 3))
    for world in range(pose.shape[0]):
        vx, vy, spin = velocity[world, 0], velocity[world, 1], velocity[world, 2]
        n = cut(table, body, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        if n == 0:
            result[world] = np.nan
            continue
        read_phasors(table, drive, world, n, work)
        gather_moments(work.points, work.phasor_c, work.phasor_s, n, moments)
        ax, ay, aw = mean_acceleration(table, body, scheme, n, moments, vx, vy, spin, work)
        result[world, 0], result[world, 1], result[world, 2] = ax, ay, aw


@jit
def mean_states(drive, table, body, scheme, pose, velocity, mean_pose, mean_velocity):
    """Mean pose and velocity (worlds, 3) that belong to those at the start of a period; NaN without support."""
    work = make_workspace(table, body)
    moments, shift = np.empty((6, 3)), np.empty(6)
    size = body.friction * table.period / (2.0 * np.pi)
    reach = size * table.period / (2.0 * np.pi)
    for world in range(pose.shape[0]):
        n = cut(table, body, pose[world, 0], pose[world, 1], pose[world, 2], velocity[world, 2], work)
        if n == 0:
            mean_pose[world], mean_velocity[world] = np.nan, np.nan
            continue
        read_phasors(table, drive, world, n, work)
        gather_moments(work.points, work.phasor_c, work.phasor_s, n, moments)
        vx, vy = steady_part(table, body, scheme, moments, velocity[world, 0], velocity[world, 1], shift, work)
        mean_velocity[world, 0], mean_velocity[world, 1] = vx, vy
        mean_velocity[world, 2] = velocity[world, 2] - size * shift[2]
        for k in range(3):
            mean_pose[world, k] = pose[world, k] - reach * shift[3 + k]


@jit
def elements_under(table, body, pose, velocity, elements):
    """List the elements under every world's part in ``elements`` (worlds, room), -1 behind; returns the largest number."""
    work = make_workspace(table, body)
    most = 0
    for world in range(pose.shape[0]):
        n = cut(table, body, pose[world, 0], pose[world, 1], pose[world, 2], velocity[world, 2], work)
        count = 0
        for piece in range(n // POINTS_PER_PIECE):
            known = work.points[0, POINTS_PER_PIECE * piece] == 0.0  # padding
            for k in range(count):
                known = known or elements[world, k] == work.under[piece]
            if not known:
                elements[world, count] = work.under[piece]
                count += 1
        elements[world, count:] = -1
        most = max(most, count)
    return most


@jit
def acceleration_map(table, body, scheme, pose, velocity, elements, constant, linear, shares, coupling):
    """Write the mean acceleration as ``constant + linear p + m B m`` with ``p = (C_1, ..., S_1, ...)`` and moments ``m``.

    The moments are linear in ``p``: ``m = (G 1, G C, G S)`` with the elements' shares ``G`` of 1, x, y, xx, xy, yy of the load.

    Args:
        pose, velocity: (worlds, 3) mean pose and velocity.
        elements: (worlds, n) from :func:`elements_under`.
        constant: (worlds, 3), linear: (worlds, 3, 2 n), shares G: (worlds, 6, n), coupling B: (worlds, 3, 18, 18);
            overwritten; m/s^2 and rad/s^2. To first order B is zero.
    """
    work = make_workspace(table, body)
    tables, mu = scheme.tables, body.friction
    small = mu * table.period / (2.0 * np.pi)
    unit = np.zeros((6, 3))
    count = elements.shape[1]
    scale = np.array([mu, mu, mu / body.gyration])
    diagonal = np.empty((18, 3))
    for world in range(pose.shape[0]):
        vx, vy, spin = velocity[world, 0], velocity[world, 1], velocity[world, 2]
        n = cut(table, body, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        shares[world], coupling[world], linear[world] = 0.0, 0.0, 0.0
        work.phasor_c[:n], work.phasor_s[:n] = 0.0, 0.0
        force = first_order(
            tables, work.points, work.phasor_c, work.phasor_s, n, table.gravity, table.speed, body.radius,
            vx, vy, spin, work.scratch,
        )  # fmt: skip
        for i in range(3):
            constant[world, i] = scale[i] * force[i]
        for j in range(count):
            element = elements[world, j]
            if element < 0:
                break
            for k in range(n):
                if work.under[k // POINTS_PER_PIECE] == element:
                    weight, x, y = work.points[0, k], work.points[1, k], work.points[2, k]
                    shares[world, 0, j] += weight
                    shares[world, 1, j] += weight * x
                    shares[world, 2, j] += weight * y
                    shares[world, 3, j] += weight * x * x
                    shares[world, 4, j] += weight * x * y
                    shares[world, 5, j] += weight * y * y
            for part in range(2):
                for k in range(n):
                    own = 1.0 if work.under[k // POINTS_PER_PIECE] == element else 0.0
                    work.phasor_c[k], work.phasor_s[k] = own * (1 - part), own * part
                force = first_order(
                    tables, work.points, work.phasor_c, work.phasor_s, n, 0.0, table.speed, body.radius,
                    vx, vy, spin, work.scratch,
                )  # fmt: skip
                for i in range(3):
                    linear[world, i, count * part + j] = scale[i] * force[i]
        if scheme.order == 1:
            continue
        # A quadratic form is known from its values at the unit vectors and at their sums.
        for i in range(18):
            for j in range(i + 1):
                unit[:] = 0.0
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
