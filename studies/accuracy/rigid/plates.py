"""The table of plates: what lies under a point, how high it is and how it moves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

compiled = njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp", "nsz"})
"""Kernels of the reference; infinities keep their meaning."""


class Plates(NamedTuple):
    """Square plates, all on one horizontal circular motion, each with a vertical motion of its own.

    Plate (i, j) covers ``[j L, (j+1) L] x [i L, (i+1) L]``, has the height ``(C cos wt - S sin wt)/w^2``, and moves
    horizontally at ``a_h w (-sin wt, cos wt)``. Borders stay where they are. Within ``ramp`` of one, heights are blended
    (smoothstep), so that a point climbs to the next plate over ``2 ramp``. The contact force stays vertical there.

    Attributes:
        c, s: (rows, columns) m/s^2: ``a_v w^2`` times cosine and sine of the phase.
        size: L, m.  amplitude: a_h, m.  frequency: w, rad/s.  gravity: m/s^2.
        ramp: m, at most L/2; 0 is a step.
    """

    c: np.ndarray
    s: np.ndarray
    size: float = 0.026
    amplitude: float = 2.7e-3
    frequency: float = 2.0 * math.pi * 25.0
    gravity: float = 9.81
    ramp: float = 3e-3

    @property
    def period(self) -> float:
        """s."""
        return 2.0 * math.pi / self.frequency

    @property
    def highest(self) -> float:
        """Largest height of any plate at any time, m."""
        return float(np.hypot(self.c, self.s).max()) / self.frequency**2


def level(rows: int = 8, columns: int = 32, c: float = 0.0, s: float = 0.0, **properties: float) -> Plates:
    """Plates that all move alike; see :class:`Plates`."""
    return Plates(np.full((rows, columns), float(c)), np.full((rows, columns), float(s)), **properties)


@compiled
def blend(place, size, ramp, count):
    """Plate under a place along one axis, the neighbour it is blended with, that one's share and its slope, 1/m."""
    own = min(max(int(math.floor(place / size)), 0), count - 1)
    within = place - own * size
    if within < ramp and own > 0:
        p = 0.5 - 0.5 * within / ramp
        return own, own - 1, p * p * (3.0 - 2.0 * p), -3.0 * p * (1.0 - p) / ramp
    if size - within < ramp and own < count - 1:
        p = 0.5 - 0.5 * (size - within) / ramp
        return own, own + 1, p * p * (3.0 - 2.0 * p), 3.0 * p * (1.0 - p) / ramp
    return own, own, 0.0, 0.0


@compiled
def under(c, s, size, ramp, cosine, sine, w, x, y):
    """Height (m) of the plates at a point, how fast that rises (m/s), and its slope along x and y."""
    i, k, q, dq = blend(y, size, ramp, c.shape[0])
    j, m, p, dp = blend(x, size, ramp, c.shape[1])
    a, b = c[i, j], s[i, j]
    if j == m and i == k:
        return (a * cosine - b * sine) / w**2, (-a * sine - b * cosine) / w, 0.0, 0.0
    ax, bx = c[i, m] - a, s[i, m] - b
    ay, by = c[k, j] - a, s[k, j] - b
    axy, bxy = c[k, m] - a - ax - ay, s[k, m] - b - bx - by
    real, imaginary = a + p * ax + q * ay + p * q * axy, b + p * bx + q * by + p * q * bxy
    height_x = dp * ((ax + q * axy) * cosine - (bx + q * bxy) * sine) / w**2
    height_y = dq * ((ay + p * axy) * cosine - (by + p * bxy) * sine) / w**2
    height = (real * cosine - imaginary * sine) / w**2
    return height, (-real * sine - imaginary * cosine) / w, height_x, height_y
