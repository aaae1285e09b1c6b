"""Mean acceleration of parts under given elements, and the way between the states of one instant and mean ones, in batches."""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.averaged.averages import wobble
from vibgym.physics.averaged.contact import look_under, mean_acceleration, steady_part
from vibgym.physics.planar.phasors import forget_phasors


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
def instant_states(drive, table, body, scheme, mean_pose, mean_velocity, work, pose, velocity):
    """Pose and velocity (worlds, 3) at the start of a period that belong to mean ones; NaN without support."""
    size = body.friction * table.period / (2.0 * math.pi)
    reach = size * table.period / (2.0 * math.pi)
    tables, shift = scheme.tables, work.shift
    for world in range(pose.shape[0]):
        forget_phasors(work.phasors, 0)
        x, y, heading = mean_pose[world, 0], mean_pose[world, 1], mean_pose[world, 2]
        vx, vy, spin = mean_velocity[world, 0], mean_velocity[world, 1], mean_velocity[world, 2]
        n = look_under(table, body, drive, world, x, y, heading, spin, work)
        for k in range(6):
            shift[k] = math.nan
        if n > 0:
            wobble(tables, work.moments, table.gravity, table.speed, body.gyration, vx, vy, shift, work.scratch)
        for k in range(3):
            pose[world, k] = mean_pose[world, k] + reach * shift[3 + k]
            velocity[world, k] = mean_velocity[world, k] + size * shift[k]
