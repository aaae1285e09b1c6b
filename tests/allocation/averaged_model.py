"""Mean accelerations and mean states by the averaged model, as a reference for the closed forms of `vibgym.allocation`."""

import math

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.averaged.integrator import AveragedScheme, mean_velocity_of, new_workspace, sample_contact
from vibgym.physics.averaged.integrator import mean_acceleration as acceleration_at
from vibgym.physics.core.drive import clear_phasors, polar_drive
from vibgym.scene.bodies import body_of
from vibgym.simulation.averages_tables import averages


@jit
def mean_accelerations(drive, table, body, scheme, pose, velocity, work, result):
    for world in range(pose.shape[0]):
        clear_phasors(work.phasors, 0)
        vx, vy, spin = velocity[world, 0], velocity[world, 1], velocity[world, 2]
        n = sample_contact(table, body, drive, world, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        ax, ay, aw = math.nan, math.nan, math.nan
        if n > 0:
            ax, ay, aw = acceleration_at(table, body, scheme, n, vx, vy, spin, work)
        result[world, 0], result[world, 1], result[world, 2] = ax, ay, aw


@jit
def mean_states(drive, table, body, scheme, pose, velocity, work, mean_pose, mean_velocity):
    size = body.friction * table.period / (2.0 * math.pi)
    reach = size * table.period / (2.0 * math.pi)
    for world in range(pose.shape[0]):
        clear_phasors(work.phasors, 0)
        spin = velocity[world, 2]
        sample_contact(table, body, drive, world, pose[world, 0], pose[world, 1], pose[world, 2], spin, work)
        vx, vy = mean_velocity_of(table, body, scheme, velocity[world, 0], velocity[world, 1], work)
        mean_velocity[world, 0], mean_velocity[world, 1] = vx, vy
        mean_velocity[world, 2] = spin - size * work.shift[2]
        for k in range(3):
            mean_pose[world, k] = pose[world, k] - reach * work.shift[3 + k]


def _evaluate(kernel, order, surface, part, pose, velocity, amplitude, phase, results):
    pose, velocity = (np.atleast_2d(np.asarray(array, dtype=float)) for array in (pose, velocity))
    worlds = max(len(pose), len(velocity))
    pose, velocity = (np.ascontiguousarray(np.broadcast_to(array, (worlds, 3))) for array in (pose, velocity))
    full = (worlds, surface.rows, surface.columns)
    drive = polar_drive(
        np.ascontiguousarray(np.broadcast_to(amplitude, full), dtype=float),
        np.ascontiguousarray(np.broadcast_to(phase, full), dtype=float),
        surface.angular_frequency,
    )
    table, body = surface.table(), body_of(part)
    outputs = [np.empty((worlds, 3)) for _ in range(results)]
    scheme = AveragedScheme(order, 1, 1, averages())
    kernel(drive, table, body, scheme, pose, velocity, new_workspace(table, body), *outputs)
    assert np.isfinite(outputs).all()
    return outputs


def mean_acceleration(surface, part, pose, velocity, amplitude, phase, *, order=2):
    """Return the mean acceleration (worlds, 3) at a mean pose and velocity, m/s^2 and rad/s^2."""
    return _evaluate(mean_accelerations, order, surface, part, pose, velocity, amplitude, phase, 1)[0]


def mean_state(surface, part, pose, velocity, amplitude, phase):
    """Mean pose and velocity (worlds, 3) of the state at the start of a period."""
    return _evaluate(mean_states, 1, surface, part, pose, velocity, amplitude, phase, 2)
