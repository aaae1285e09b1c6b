"""Where two bodies touch: a point, or the segment along which two faces lie against one another."""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import borrowing
from vibgym.physics.contacts.hulls import hull_gap, wall_direction

LEVEL = 4e-6
"""m; corners that lie as deep as the deepest to within so much touch as well."""


class Span(NamedTuple):
    """A contact between two hulls, or a hull and a wall. The tangent is the normal turned by 90 degrees."""

    gap: float  # m; negative: overlap
    nx: float  # unit vector from the first to the second
    ny: float
    x: float  # m, the middle of the segment
    y: float
    low: float  # m, its ends along the tangent, from there
    high: float


@borrowing
def foremost(hulls, placed, a, nx, ny):
    """How far a hull reaches along ``(nx, ny)``, m, and from where to where along the tangent its foremost corners lie."""
    most, low, high = -math.inf, math.inf, -math.inf
    for k in range(hulls.first[a], hulls.first[a + 1]):
        most = max(most, nx * placed[k, 0] + ny * placed[k, 1])
    for k in range(hulls.first[a], hulls.first[a + 1]):
        if nx * placed[k, 0] + ny * placed[k, 1] >= most - LEVEL:
            along = nx * placed[k, 1] - ny * placed[k, 0]
            low, high = min(low, along), max(high, along)
    return most + hulls.rounding[a], low, high


@borrowing
def span_at(gap, nx, ny, level, low, high):
    """The span on the line ``level`` along the normal, between ``low`` and ``high`` along the tangent."""
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 0.0)
    return Span(gap, nx, ny, level * nx - middle * ny, level * ny + middle * nx, -half, half)


@borrowing
def hull_span(hulls, placed, a, b):
    """Where two placed hulls touch, or would if they came together."""
    gap, nx, ny = hull_gap(hulls, placed, a, b)
    mine, low, high = foremost(hulls, placed, a, nx, ny)
    theirs, right, left = foremost(hulls, placed, b, -nx, -ny)  # seen from the other side the tangent points back
    return span_at(gap, nx, ny, 0.5 * (mine - theirs), max(low, -left), min(high, -right))


@borrowing
def wall_span(table, hulls, placed, a, wall):
    """Where a placed hull and a wall touch, or would if they came together."""
    nx, ny, border = wall_direction(table, wall)
    reach, low, high = foremost(hulls, placed, a, nx, ny)
    return span_at(border - reach, nx, ny, 0.5 * (border + reach), low, high)
