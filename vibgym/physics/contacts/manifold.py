"""Contact points of overlapping outlines: at most two for each pair of convex hulls, or hull and wall.

The separating axis test yields the normal. The edge of one hull along it is the reference; the opposite edge of the other
hull is clipped to its length (C. Ericson, Real-Time Collision Detection, 2005, sec. 5.2.1 and 8.3; E. Catto, Contact Manifolds,
GDC 2007). Discs are hulls with one corner and touch at one point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import jit
from vibgym.physics.contacts.hulls import CORNERS, face_along, gap_along, hull_contact, wall_direction


class Manifold(NamedTuple):
    """Contact points of two hulls, or of a hull and a wall."""

    count: int  # 0 to 2
    nx: float  # unit normal from the first to the second
    ny: float
    x: float  # m, the first point
    y: float
    gap: float  # m, there; negative: overlap
    other_x: float  # m, the second point
    other_y: float
    other_gap: float


@jit
def no_contact():
    """Return a manifold without points."""
    return Manifold(0, 1.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0, math.inf)


@jit
def edge_ends(hulls, placed, a, nx, ny):
    """Return the ends x, y, x, y of the edge of a hull along ``(nx, ny)``, on its rounded outline."""
    at = face_along(placed, (hulls.first[a], hulls.first[a + 1]), nx, ny)
    after = at + 1 if at + 1 < hulls.first[a + 1] else hulls.first[a]
    dx, dy = hulls.rounding[a] * nx, hulls.rounding[a] * ny
    return placed[at, 0] + dx, placed[at, 1] + dy, placed[after, 0] + dx, placed[after, 1] + dy


@jit
def clipped(nx, ny, level, low, high, ax, ay, bx, by, margin):
    """Return the contact points of an edge from ``a`` to ``b`` with a reference face.

    Args:
        nx, ny: normal of the manifold; the face's outward normal.
        level: m, position of the face along the normal.
        low, high: m, ends of the face along the tangent, which is the normal rotated by 90 degrees.
        margin: m, largest gap of a point.
    """
    along_a, along_b = nx * ay - ny * ax, nx * by - ny * bx
    gap_a, gap_b = nx * ax + ny * ay - level, nx * bx + ny * by - level
    if along_a > along_b:
        along_a, along_b, gap_a, gap_b = along_b, along_a, gap_b, gap_a
    slope = (gap_b - gap_a) / (along_b - along_a) if along_b > along_a else 0.0
    # An edge beside the face, by rounding or at a corner, touches at its nearer end.
    s, t = min(max(along_a, low), along_b), max(min(along_b, high), along_a)
    gap, other = gap_a + slope * (s - along_a), gap_a + slope * (t - along_a)
    if gap > other:
        s, t, gap, other = t, s, other, gap
    count = 0
    if gap <= margin:
        count = 2 if other <= margin and s != t else 1
    # The point is in the middle between both surfaces.
    depth, more = level + 0.5 * gap, level + 0.5 * other
    return Manifold(
        count, nx, ny, depth * nx - s * ny, depth * ny + s * nx, gap, more * nx - t * ny, more * ny + t * nx, other
    )


@jit
def hull_manifold(hulls, placed, a, b, dx, dy, margin):
    """Return the contact points of two placed hulls with gaps of at most ``margin``.

    Args:
        dx, dy: any vector, such as the one from centre to centre, whose direction is tested first.
    """
    rounding, length = hulls.rounding[a] + hulls.rounding[b], math.sqrt(dx * dx + dy * dy)
    if length > 0.0 and gap_along(hulls, placed, a, b, dx / length, dy / length) > margin + rounding:
        return no_contact()
    gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
    if gap > margin:
        return no_contact()
    return hull_points(hulls, placed, a, b, gap, nx, ny, owner, margin)


@jit
def hull_points(hulls, placed, a, b, gap, nx, ny, owner, margin):
    """Return the contact points of two placed hulls, from the result of :func:`vibgym.physics.contacts.hulls.hull_contact`."""
    corners_a, corners_b = hulls.first[a + 1] - hulls.first[a], hulls.first[b + 1] - hulls.first[b]
    if owner == CORNERS or corners_a == 1 or corners_b == 1:
        # Through the disc's centre, or the nearest corners.
        if corners_a == 1:
            k, reach = hulls.first[a], hulls.rounding[a] + 0.5 * gap
        else:
            k, reach = hulls.first[b], -hulls.rounding[b] - 0.5 * gap
            if corners_b > 1:
                for corner in range(hulls.first[b], hulls.first[b + 1]):
                    if nx * (placed[corner, 0] - placed[k, 0]) + ny * (placed[corner, 1] - placed[k, 1]) < 0.0:
                        k = corner
        return Manifold(1, nx, ny, placed[k, 0] + reach * nx, placed[k, 1] + reach * ny, gap, 0.0, 0.0, math.inf)
    ax, ay, bx, by = edge_ends(hulls, placed, a, nx, ny)
    cx, cy, ex, ey = edge_ends(hulls, placed, b, -nx, -ny)
    # The face is the edge that is normal to the vector; the other edge is clipped.
    if abs(nx * (bx - ax) + ny * (by - ay)) <= abs(nx * (ex - cx) + ny * (ey - cy)):
        along, end = nx * ay - ny * ax, nx * by - ny * bx
        return clipped(nx, ny, nx * ax + ny * ay, min(along, end), max(along, end), cx, cy, ex, ey, margin)
    along, end = ny * cx - nx * cy, ny * ex - nx * ey
    clip = clipped(-nx, -ny, -nx * cx - ny * cy, min(along, end), max(along, end), ax, ay, bx, by, margin)
    return Manifold(clip.count, nx, ny, clip.x, clip.y, clip.gap, clip.other_x, clip.other_y, clip.other_gap)


@jit
def wall_manifold(table, hulls, placed, a, wall, margin):
    """Return the contact points of a placed hull and a wall with gaps of at most ``margin``."""
    nx, ny, border = wall_direction(table, wall)
    ax, ay, bx, by = edge_ends(hulls, placed, a, nx, ny)
    # Seen from the wall; its normal points to the part.
    clip = clipped(-nx, -ny, -border, -math.inf, math.inf, ax, ay, bx, by, margin)
    return Manifold(clip.count, nx, ny, clip.x, clip.y, clip.gap, clip.other_x, clip.other_y, clip.other_gap)
