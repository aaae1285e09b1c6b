"""Signed distances between outlines: convex hulls, gaps, support points and contact segments.

A part is one convex hull, or several for a non-convex outline. A hull is a convex polygon (corners counter-clockwise) and a
rounding radius; a disc is one corner with a rounding. The gap of two convex hulls is the largest separation along any
direction, which is normal to an edge or joins two corners (separating axis theorem; C. Ericson, Real-Time Collision Detection,
2005, sec. 5.2.1). A negative gap is the penetration depth.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference

LEFT, RIGHT, BOTTOM, TOP = 0, 1, 2, 3
"""Walls along the borders: bits of a set of walls, and sides of :func:`wall_gap`."""

CORNERS, A_FACE, B_FACE = 0, 1, 2
"""Owner of a contact normal, see :func:`hull_contact`."""


class HullTable(NamedTuple):
    """The convex hulls of several outlines, in their own frames."""

    corner: np.ndarray  # (all corners, 4): x, y (m) and the outward normal of the edge to the next corner of its hull
    first: np.ndarray  # (hulls + 1,) of each hull's corners
    rounding: np.ndarray  # (hulls,) m
    owner: np.ndarray  # (outlines + 1,) first hull of each outline
    radius: np.ndarray  # (outlines,) m, of the circumscribed circle about the centre of mass


class Hulls(NamedTuple):
    """The convex hulls of all parts of a world, as :class:`HullTable`, with room for any world's; memory of one thread."""

    corner: np.ndarray
    first: np.ndarray
    rounding: np.ndarray
    owner: np.ndarray
    radius: np.ndarray
    loaded: np.ndarray  # (parts,) kinds of these parts
    kind: np.ndarray  # (worlds, parts) kind of every part, see vibgym.physics.core.records.Bodies
    every: HullTable  # of the kinds


@jit
def load_hulls(hulls, world):
    """Load the hulls of a world's parts; return whether they differ from those before."""
    kind, parts, same = hulls.kind[min(world, hulls.kind.shape[0] - 1)], hulls.loaded.shape[0], True
    for part in range(parts):
        same = same and hulls.loaded[part] == kind[part]
    if same:
        return False
    every, piece, corner = hulls.every, 0, 0
    for part in range(parts):
        which = kind[part]
        hulls.loaded[part], hulls.radius[part] = which, every.radius[which]
        for a in range(every.owner[which], every.owner[which + 1]):
            hulls.rounding[piece] = every.rounding[a]
            for k in range(every.first[a], every.first[a + 1]):
                for axis in range(4):
                    hulls.corner[corner, axis] = every.corner[k, axis]
                corner += 1
            piece += 1
            hulls.first[piece] = corner
        hulls.owner[part + 1] = piece
    return True


@jit
def place_hulls(hulls, part, x, y, heading, placed):
    """Write corners and normals of a part at a pose, in the world frame, into ``placed`` (all corners, 4)."""
    cosine, sine = math.cos(heading), math.sin(heading)
    corner = hulls.corner
    for k in range(hulls.first[hulls.owner[part]], hulls.first[hulls.owner[part + 1]]):
        cx, cy, nx, ny = corner[k, 0], corner[k, 1], corner[k, 2], corner[k, 3]
        placed[k, 0] = x + cosine * cx - sine * cy
        placed[k, 1] = y + sine * cx + cosine * cy
        placed[k, 2] = cosine * nx - sine * ny
        placed[k, 3] = sine * nx + cosine * ny


KEPT_OVERLAP = 2e-4
"""m, overlap up to which a face remains the separating feature of two hulls."""


@jit
def face_along(placed, hull, nx, ny):
    """Return the first corner of the face that is most normal to a vector, of corners ``hull[0]`` to before ``hull[1]``."""
    best, at = -math.inf, hull[0]
    for k in range(hull[0], hull[1]):
        along = nx * placed[k, 2] + ny * placed[k, 3]
        if along > best:
            best, at = along, k
    return at


@jit
def face_gap(placed, hull, i, other):
    """Return the gap between a face and another hull, and whether the nearest corner is opposite the face.

    Then it is the gap between the hulls if they are separated. If they overlap by little, the face is where they touched.

    Args:
        hull, other: first corner of each, and the one after the last.
        i: first corner of the face.
    """
    nx, ny, reach, nearest = placed[i, 2], placed[i, 3], math.inf, other[0]
    for j in range(other[0], other[1]):
        along = nx * (placed[j, 0] - placed[i, 0]) + ny * (placed[j, 1] - placed[i, 1])
        if along < reach:
            reach, nearest = along, j
    after = i + 1 if i + 1 < hull[1] else hull[0]
    at = nx * (placed[nearest, 1] - placed[i, 1]) - ny * (placed[nearest, 0] - placed[i, 0])
    end = nx * (placed[after, 1] - placed[i, 1]) - ny * (placed[after, 0] - placed[i, 0])
    return reach, 0.0 <= at <= end and reach > -KEPT_OVERLAP


@jit
def hull_contact(hulls, placed, a, b):
    """Return the gap between two placed hulls (m, negative: overlap), the unit normal from ``a`` to ``b``, and its owner.

    The owner is ``A_FACE`` or ``B_FACE`` if an edge of ``a`` or ``b`` is normal to the vector, and ``CORNERS`` otherwise.
    """
    a0, a1, b0, b1 = hulls.first[a], hulls.first[a + 1], hulls.first[b], hulls.first[b + 1]
    best, nx, ny, owner = -math.inf, 1.0, 0.0, CORNERS
    if a1 - a0 > 1:
        for i in range(a0, a1):
            ex, ey = placed[i, 2], placed[i, 3]
            reach = math.inf
            for j in range(b0, b1):
                reach = min(reach, ex * (placed[j, 0] - placed[i, 0]) + ey * (placed[j, 1] - placed[i, 1]))
                if reach <= best:
                    break
            if reach > best:
                best, nx, ny, owner = reach, ex, ey, A_FACE
    if b1 - b0 > 1:
        for j in range(b0, b1):
            ex, ey = placed[j, 2], placed[j, 3]
            reach = math.inf
            for i in range(a0, a1):
                reach = min(reach, ex * (placed[i, 0] - placed[j, 0]) + ey * (placed[i, 1] - placed[j, 1]))
                if reach <= best:
                    break
            if reach > best:
                best, nx, ny, owner = reach, -ex, -ey, B_FACE
    if best > 0.0 or a1 - a0 == 1 or b1 - b0 == 1:  # corner to corner, where no edge faces the other hull
        nearest, cx, cy = math.inf, 1.0, 0.0
        for i in range(a0, a1):
            for j in range(b0, b1):
                dx, dy = placed[j, 0] - placed[i, 0], placed[j, 1] - placed[i, 1]
                square = dx * dx + dy * dy
                if square < nearest:
                    nearest, cx, cy = square, dx, dy
        length = math.sqrt(nearest)
        if length > 0.0:
            cx, cy = cx / length, cy / length
            along = gap_along(hulls, placed, a, b, cx, cy)
            if along > best:
                best, nx, ny, owner = along, cx, cy, CORNERS
        elif a1 - a0 == 1 and b1 - b0 == 1:
            best = 0.0
    return best - hulls.rounding[a] - hulls.rounding[b], nx, ny, owner


@jit
def kept_contact(hulls, placed, a, b, feature):
    """Return :func:`hull_contact`, if possible from the face that separated the hulls before.

    Args:
        feature: (2,) first corner of the face of ``a`` and of that of ``b`` towards the other hull, -1: none; updated.
    """
    one, other = (hulls.first[a], hulls.first[a + 1]), (hulls.first[b], hulls.first[b + 1])
    rounding, i, j = hulls.rounding[a] + hulls.rounding[b], feature[0], feature[1]
    if i >= 0:
        gap, opposite = face_gap(placed, one, i, other)
        if opposite:
            return gap - rounding, placed[i, 2], placed[i, 3], A_FACE
    if j >= 0:
        gap, opposite = face_gap(placed, other, j, one)
        if opposite:
            return gap - rounding, -placed[j, 2], -placed[j, 3], B_FACE
    gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
    feature[0] = feature[1] = -1
    if owner != CORNERS:
        if one[1] - one[0] > 1:
            feature[0] = face_along(placed, one, nx, ny)
        if other[1] - other[0] > 1:
            feature[1] = face_along(placed, other, -nx, -ny)
    return gap, nx, ny, owner


@jit
def hull_gap(hulls, placed, a, b):
    """Return the gap between two placed hulls (m, negative: overlap) and the unit normal from ``a`` to ``b``."""
    gap, nx, ny, _ = hull_contact(hulls, placed, a, b)
    return gap, nx, ny


@jit
def gap_along(hulls, placed, a, b, nx, ny):
    """Return the gap between two placed hulls along a unit vector from ``a`` to ``b``, without rounding radii, m."""
    low, high = math.inf, -math.inf
    for j in range(hulls.first[b], hulls.first[b + 1]):
        low = min(low, nx * placed[j, 0] + ny * placed[j, 1])
    for i in range(hulls.first[a], hulls.first[a + 1]):
        high = max(high, nx * placed[i, 0] + ny * placed[i, 1])
    return low - high


@jit
def part_gap(hulls, placed, i, j):
    """Return the smallest gap between the placed hulls of two parts, m; negative: overlap."""
    gap, _, _ = part_contact(hulls, placed, i, j)
    return gap


@jit
def part_contact(hulls, placed, i, j):
    """Return the smallest gap between the placed hulls of two parts (m, negative: overlap) and the unit normal from i to j."""
    smallest, nx, ny = math.inf, 1.0, 0.0
    for a in range(hulls.owner[i], hulls.owner[i + 1]):
        for b in range(hulls.owner[j], hulls.owner[j + 1]):
            gap, x, y = hull_gap(hulls, placed, a, b)
            if gap < smallest:
                smallest, nx, ny = gap, x, y
    return smallest, nx, ny


@jit
def moved_support(hulls, placed, a, nx, ny, x, y, vx, vy, spin, h):
    """Return the support of hull ``a`` along ``(nx, ny)`` after moving for ``h`` on straight lines, with rounding, m.

    Args:
        x, y: m, the point about which ``spin`` (rad/s) turns.  vx, vy: its velocity, m/s.  h: s.
    """
    drift = (nx * vx + ny * vy) * h
    most = -math.inf
    for k in range(hulls.first[a], hulls.first[a + 1]):
        rx, ry = placed[k, 0] - x, placed[k, 1] - y
        most = max(most, nx * placed[k, 0] + ny * placed[k, 1] + h * spin * (ny * rx - nx * ry))
    return most + drift + hulls.rounding[a]


@jit
def border_normal(wall, width, depth):
    """Return the unit vector towards the wall along a border, and the wall's position along it, m."""
    if wall == LEFT:
        return -1.0, 0.0, 0.0
    if wall == RIGHT:
        return 1.0, 0.0, width
    if wall == BOTTOM:
        return 0.0, -1.0, 0.0
    return 0.0, 1.0, depth


@jit
def wall_direction(table, wall):
    """Return :func:`border_normal` of a table."""
    return border_normal(wall, table.columns * table.element_size, table.rows * table.element_size)


@jit
def wall_gap(hulls, placed, part, wall, width, depth):
    """Return the gap between a placed part and the wall along a border, m; negative: overlap."""
    nx, ny, border = border_normal(wall, width, depth)
    smallest = math.inf
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        for k in range(hulls.first[a], hulls.first[a + 1]):
            smallest = min(smallest, border - (nx * placed[k, 0] + ny * placed[k, 1]) - hulls.rounding[a])
    return smallest


@jit(allocates=True)
def all_gaps(hulls, pose, gaps):
    """Compute the gaps between all parts of every world.

    Args:
        pose: (worlds, parts, 3) m, m, rad.
        gaps: (worlds, parts, parts) m, overwritten; infinite on the diagonal.
    """
    hulls, parts = reference(hulls), pose.shape[1]
    placed = np.empty_like(hulls.corner)
    for world in range(pose.shape[0]):
        load_hulls(hulls, world)
        for i in range(parts):
            place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
            gaps[world, i, i] = math.inf
        for i in range(parts):
            for j in range(i):
                gap = part_gap(hulls, placed, i, j)
                gaps[world, i, j], gaps[world, j, i] = gap, gap


LEVEL = 4e-6
"""Difference in depth (m) from the deepest corner up to which corners touch as well."""


class Span(NamedTuple):
    """Contact segment between two hulls, or a hull and a wall. The tangent is the normal rotated by 90 degrees."""

    gap: float  # m; negative: overlap
    nx: float  # unit vector from the first to the second
    ny: float
    x: float  # m, the middle of the segment
    y: float
    low: float  # m, ends of the segment along the tangent, from the middle
    high: float


@jit
def support_segment(hulls, placed, a, nx, ny):
    """Return a hull's support along ``(nx, ny)`` and the interval of its supporting corners along the tangent, m."""
    most, low, high = -math.inf, math.inf, -math.inf
    for k in range(hulls.first[a], hulls.first[a + 1]):
        most = max(most, nx * placed[k, 0] + ny * placed[k, 1])
    for k in range(hulls.first[a], hulls.first[a + 1]):
        if nx * placed[k, 0] + ny * placed[k, 1] >= most - LEVEL:
            along = nx * placed[k, 1] - ny * placed[k, 0]
            low, high = min(low, along), max(high, along)
    return most + hulls.rounding[a], low, high


@jit
def span_at(gap, nx, ny, level, low, high):
    """Return the span at ``level`` along the normal, between ``low`` and ``high`` along the tangent, m."""
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 0.0)
    return Span(gap, nx, ny, level * nx - middle * ny, level * ny + middle * nx, -half, half)


@jit
def hull_span(hulls, placed, a, b):
    """Return the contact segment of two placed hulls; of separated hulls, that on which they would meet."""
    gap, nx, ny = hull_gap(hulls, placed, a, b)
    mine, low, high = support_segment(hulls, placed, a, nx, ny)
    theirs, right, left = support_segment(hulls, placed, b, -nx, -ny)  # seen from b the tangent is reversed
    return span_at(gap, nx, ny, 0.5 * (mine - theirs), max(low, -left), min(high, -right))


@jit
def wall_span(table, hulls, placed, a, wall):
    """Return the contact segment of a placed hull and a wall; of separated ones, that on which they would meet."""
    nx, ny, border = wall_direction(table, wall)
    reach, low, high = support_segment(hulls, placed, a, nx, ny)
    return span_at(border - reach, nx, ny, 0.5 * (border + reach), low, high)
