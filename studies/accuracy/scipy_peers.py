"""Peer: the sliding equations in ``scipy.integrate.solve_ivp``, vectorised.

shapely cuts the contact area in one vectorised call at every evaluation; NumPy then sums friction over all pieces at
once, with a rule of seven points on each of their triangles. One call of the integrator covers all periods; ``rtol`` is
the knob. Sliding only: no events, no static friction.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.integrate import solve_ivp

METHODS = ("LSODA", "DOP853")

_TINY = 1e-30  # (m/s)^2; without slip friction has no direction

# Radon's rule on a triangle, exact to fifth degree: barycentric coordinates and weights.
_A, _B = (6.0 - math.sqrt(15.0)) / 21.0, (6.0 + math.sqrt(15.0)) / 21.0
_CORNERS = np.array(
    [[1 / 3] * 3]
    + [[a if k != j else 1.0 - 2.0 * a for k in range(3)] for a in (_A, _B) for j in range(3)]
)  # fmt: skip
_WEIGHTS = np.array([9 / 40] + [(155.0 - math.sqrt(15.0)) / 1200.0] * 3 + [(155.0 + math.sqrt(15.0)) / 1200.0] * 3)


class Run(NamedTuple):
    """Result: ``pose`` and ``velocity`` (periods + 1, 3) at the boundaries of the periods, and its wall time."""

    pose: np.ndarray
    velocity: np.ndarray
    seconds: float
    evaluations: int


def integrate(
    surface: Any,
    part: Any,
    pose: Any,
    velocity: Any,
    amplitude: Any,
    phase: Any,
    periods: int,
    *,
    method: str = "DOP853",
    rtol: float = 1e-6,
) -> Run:
    """Integrate one sliding part over whole periods under a held drive; arguments as for the reference.

    Args:
        method: ``"LSODA"`` or ``"DOP853"``.
        rtol: relative tolerance; the absolute one is ``rtol`` times ``a_h`` for lengths and ``a_h w`` for velocities.

    Raises:
        RuntimeError: the integrator failed.
    """
    shape = (surface.rows, surface.columns)
    slope = _slope(surface, part, np.broadcast_to(amplitude, shape), np.broadcast_to(phase, shape))
    start = np.concatenate([pose, velocity])
    length = surface.horizontal_amplitude or 1e-3
    speed = surface.table_speed or 0.1
    absolute = rtol * np.array([length, length, length / part.radius, speed, speed, speed / part.radius])
    times = np.arange(periods + 1) * surface.period
    began = time.perf_counter()
    solution = solve_ivp(slope, (0.0, times[-1]), start, method, t_eval=times, rtol=rtol, atol=absolute)
    seconds = time.perf_counter() - began
    if not solution.success:
        raise RuntimeError(f"{method} at rtol={rtol:g} failed after {solution.t[-1]:g} s: {solution.message}")
    return Run(solution.y[:3].T, solution.y[3:].T, seconds, solution.nfev)


def _slope(
    surface: Any, part: Any, amplitude: np.ndarray, phase: np.ndarray
) -> Callable[[float, np.ndarray], list[float]]:
    """Return the rate of pose and velocity (6,) as a function of time and state."""
    w, radius, size = surface.angular_frequency, surface.horizontal_amplitude, surface.element_size
    rows, columns = surface.rows, surface.columns
    lift_c, lift_s = (amplitude * np.cos(phase) * w**2).ravel(), (amplitude * np.sin(phase) * w**2).ravel()
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    cells = shapely.box(column * size, row * size, (column + 1) * size, (row + 1) * size)
    number = np.arange(rows * columns).reshape(rows, columns)
    outline, turns, mu, gyration = np.array(part.outline), part.symmetry != 0, part.friction, part.gyration

    def slope(t: float, y: np.ndarray) -> list[float]:
        x0, y0, heading, vx, vy, spin = y.tolist()
        placed = outline
        if turns:
            c, s = math.cos(heading), math.sin(heading)
            placed = outline @ np.array([[c, s], [-s, c]])
        placed = placed + (x0, y0)
        j0, i0 = np.maximum((placed.min(axis=0) / size).astype(int), 0).tolist()
        j1, i1 = (np.floor(placed.max(axis=0) / size).astype(int) + 1).tolist()
        below = number[i0 : max(i1, 0), j0 : max(j1, 0)].ravel()
        if not below.size:
            return [vx, vy, spin, 0.0, 0.0, 0.0]
        pieces, cell = shapely.get_parts(
            shapely.intersection(shapely.polygons(placed), cells[i0:i1, j0:j1].ravel()), return_index=True
        )
        corner, owner = shapely.get_coordinates(pieces, return_index=True)
        if not len(corner):
            return [vx, vy, spin, 0.0, 0.0, 0.0]
        corner -= (x0, y0)
        # A fan of signed triangles over every closed ring, from its first corner; valid for any simple ring.
        same = owner[:-1] == owner[1:]
        here, there = corner[:-1][same], corner[1:][same]
        first, owner = corner[np.searchsorted(owner, owner)][:-1][same], owner[:-1][same]
        a, b = here - first, there - first
        area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        area *= np.sign(np.bincount(owner, area))[owner]
        points = np.stack([first, here, there], axis=-1) @ _CORNERS.T  # (triangles, 2, 7)
        px, py = points[:, 0], points[:, 1]
        cosine, sine = math.cos(w * t), math.sin(w * t)
        element = below[cell[owner]]
        normal = surface.gravity - lift_c[element] * cosine + lift_s[element] * sine
        ux = -radius * w * sine - vx + spin * py
        uy = radius * w * cosine - vy - spin * px
        stress = (mu / area.sum()) * (area * normal)[:, None] * _WEIGHTS / np.sqrt(ux * ux + uy * uy + _TINY)
        ux *= stress
        uy *= stress
        return [vx, vy, spin, ux.sum(), uy.sum(), float((px * uy - py * ux).sum()) / gyration]

    return slope
