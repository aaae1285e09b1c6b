"""Dense point sampling of a flat part in sliding contact: slow, simple, and independent of the kernels of ``vibgym``.

Many weighted points cover the contact area and move with the part. At every stage of a classical Runge-Kutta step each point
adds the friction of the element beneath it. Pressure is the element's vertical acceleration ``g + z''``, forces are
``mu p u/|u|``, without series, clipping or tables. Points are those of :mod:`studies.accuracy.point_sampling`, whose sampler is
the one for comparisons of speed.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from studies.accuracy.point_sampling import strew, strew_disc

__all__ = ["simulate", "strew", "strew_disc"]


@numba.njit(cache=True, nogil=True)
def _acceleration(px, py, weight, gyration, mu, size, normal, table_vx, table_vy, state):
    rows, columns = normal.shape
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    force_x, force_y, torque, carried = 0.0, 0.0, 0.0, 0.0
    for k in range(px.shape[0]):
        rx = cosine * px[k] - sine * py[k]
        ry = sine * px[k] + cosine * py[k]
        column, row = math.floor((state[0] + rx) / size), math.floor((state[1] + ry) / size)
        if row < 0 or column < 0 or row >= rows or column >= columns:
            continue
        carried += weight[k]
        ux = table_vx - state[3] + state[5] * ry
        uy = table_vy - state[4] - state[5] * rx
        speed = math.sqrt(ux * ux + uy * uy)
        if speed == 0.0:
            continue
        stress = mu * weight[k] * normal[int(row), int(column)] / speed
        force_x += stress * ux
        force_y += stress * uy
        torque += rx * stress * uy - ry * stress * ux
    return force_x / carried, force_y / carried, torque / carried / gyration


@numba.njit(cache=True, nogil=True)
def _derivative(t, state, px, py, weight, gyration, mu, size, gravity, radius, omega, amplitude, phase, normal, slope):
    for i in range(normal.shape[0]):
        for j in range(normal.shape[1]):
            normal[i, j] = gravity - amplitude[i, j] * omega * omega * math.cos(omega * t + phase[i, j])
    table_vx, table_vy = -radius * omega * math.sin(omega * t), radius * omega * math.cos(omega * t)
    ax, ay, aw = _acceleration(px, py, weight, gyration, mu, size, normal, table_vx, table_vy, state)
    slope[0], slope[1], slope[2] = state[3], state[4], state[5]
    slope[3], slope[4], slope[5] = ax, ay, aw


@numba.njit(cache=True, nogil=True)
def _integrate(start, periods, steps, px, py, weight, gyration, mu, size, gravity, radius, omega, amplitude, phase):
    state = start.copy()
    normal = np.empty(amplitude.shape)
    k = np.empty((4, 6))
    path = np.empty((periods + 1, 6))
    path[0] = state
    h = 2.0 * math.pi / omega / steps
    for period in range(periods):
        for step in range(steps):
            t = step * h
            for stage in range(4):
                if stage == 0:
                    now, ahead = state, 0.0
                elif stage < 3:
                    now, ahead = state + 0.5 * h * k[stage - 1], 0.5
                else:
                    now, ahead = state + h * k[2], 1.0
                _derivative(
                    t + ahead * h, now, px, py, weight, gyration, mu, size, gravity, radius, omega, amplitude, phase,
                    normal, k[stage],
                )  # fmt: skip
            state = state + h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
        path[period + 1] = state
    return path


def simulate(
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    gyration: float,
    friction: float,
    pose: Any,
    velocity: Any,
    amplitude: np.ndarray,
    phase: np.ndarray,
    periods: int,
    steps: int,
    element_size: float = 0.026,
    gravity: float = 9.81,
    horizontal_amplitude: float = 2.7e-3,
    frequency: float = 25.0,
) -> np.ndarray:
    """Return pose and velocity (periods + 1, 6) of a part at the start and after every period; ``steps``: RK4 steps per period.

    Args:
        points: x, y (m, about the centre of mass) and weights from :func:`strew`.
        gyration: planar inertia over mass, m^2.
        pose, velocity: (3,) each.
        amplitude, phase: (rows, columns) of every element's vertical motion, m and rad.
    """
    start = np.concatenate([np.asarray(pose, dtype=float), np.asarray(velocity, dtype=float)])
    return _integrate(
        start, periods, steps, *points, gyration, friction, element_size, gravity, horizontal_amplitude,
        2.0 * math.pi * frequency, np.ascontiguousarray(amplitude), np.ascontiguousarray(phase),
    )  # fmt: skip
