"""Geometry of outlines: area, centroid, inertia, convexity, symmetry, and whether they cross themselves."""

from __future__ import annotations

import math

import numpy as np

from vibgym import checks

DISC_CORNERS = 64
"""A disc's contact area is a regular polygon of this many corners with the disc's exact area: its border deviates by at
most 0.06 % of the radius. Its inertia is the disc's own."""


def signed_area(outline: np.ndarray) -> float:
    """Area enclosed by ``outline`` (n, 2), positive if counter-clockwise."""
    x, y = outline.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def centroid(outline: np.ndarray) -> np.ndarray:
    """Centre of the enclosed area (2,)."""
    origin = outline.mean(axis=0)  # keeps digits when the outline lies far from its origin
    here = outline - origin
    there = np.roll(here, -1, axis=0)
    cross = here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]
    return origin + (cross[:, None] * (here + there)).sum(axis=0) / (3.0 * cross.sum())


def gyration(outline: np.ndarray) -> float:
    """Planar inertia over mass about the origin, which must be the centroid, m^2."""
    there = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * there[:, 1] - outline[:, 1] * there[:, 0]
    squares = (outline * outline + outline * there + there * there).sum(axis=1)
    return float((cross * squares).sum() / (6.0 * cross.sum()))


def is_convex(outline: np.ndarray) -> bool:
    """Whether a counter-clockwise outline never turns right."""
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    turn = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    scale = np.abs(outline).max() ** 2
    return bool((turn >= -1e-12 * scale).all())


def symmetry_order(outline: np.ndarray) -> int:
    """Largest n for which a turn by 2 pi / n about the origin maps the outline onto itself."""
    size = float(np.abs(outline).max())
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    outline = outline[np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > 1e-9 * size**2]  # real corners
    corners = len(outline)
    tolerance = 1e-6 * size
    for order in range(corners, 1, -1):
        if corners % order:
            continue
        angle = 2.0 * math.pi / order
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        if np.abs(outline @ turn - np.roll(outline, -(corners // order), axis=0)).max() < tolerance:
            return order
    return 1


def _crosses(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Whether segments ab and cd share a point."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    def within(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> bool:
        return bool((np.minimum(p, q) <= r).all() and (r <= np.maximum(p, q)).all())

    abc, abd, cda, cdb = side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b)
    if (abc > 0) != (abd > 0) and (cda > 0) != (cdb > 0) and 0.0 not in (abc, abd, cda, cdb):
        return True
    return (
        (abc == 0.0 and within(a, b, c))
        or (abd == 0.0 and within(a, b, d))
        or (cda == 0.0 and within(c, d, a))
        or (cdb == 0.0 and within(c, d, b))
    )


def simple_outline(vertices: object) -> np.ndarray:
    """Check ``vertices`` (n, 2) and return them counter-clockwise about their centroid.

    Raises:
        ValueError: fewer than three corners, not finite, repeated corners, no area, or crossing edges.
    """
    allowed = "an (n, 2) array of at least three corners of a simple polygon, m"
    try:
        if np.asarray(vertices).dtype.kind not in "biuf":  # texts would be read as numbers
            raise TypeError
        outline = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError, RecursionError):
        raise checks.refuse("vertices", vertices, allowed) from None
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise checks.refuse("vertices", f"array of shape {outline.shape}", allowed)
    if not np.isfinite(outline).all():
        bad = outline[~np.isfinite(outline).all(axis=1)][0]
        raise checks.refuse("vertices", bad.tolist(), "finite numbers")
    if np.abs(outline).max() > 1e9:
        raise checks.refuse("vertices", vertices, "numbers in [-1e9, 1e9]")
    outline = outline - outline.mean(axis=0)
    size = float(np.abs(outline).max())
    edges = np.roll(outline, -1, axis=0) - outline
    if size < 1e-9 or np.hypot(*edges.T).min() <= 1e-9 * size:
        raise checks.refuse("vertices", vertices, "corners that differ from their neighbours, a size of at least 1e-9")
    n = len(outline)
    for i in range(n):
        for j in range(i + 1, n):
            a, b, c, d = outline[i], outline[(i + 1) % n], outline[j], outline[(j + 1) % n]
            if j == i + 1 or (j + 1) % n == i:
                # Neighbours share a corner; they may not fold back onto each other.
                first, second = (b - a, d - c) if j == i + 1 else (d - c, b - a)
                cross = first[0] * second[1] - first[1] * second[0]
                if abs(cross) <= 1e-12 * size**2 and float(first @ second) < 0.0:
                    raise checks.refuse("vertices", f"edges {i} and {j} fold onto each other", "a simple polygon")
            elif _crosses(a, b, c, d):
                raise checks.refuse("vertices", f"edges {i} and {j} cross", "a simple polygon, no crossing edges")
    area = signed_area(outline)
    if abs(area) <= 1e-9 * size**2:
        raise checks.refuse("vertices", f"an area of {abs(area):g} m^2", "a polygon that encloses an area")
    given = np.array(vertices, dtype=np.float64)
    if area < 0.0:
        outline, given = outline[::-1], given[::-1]
    # Corners that are given about the centroid keep every bit: an outline that is written down and read again is the same.
    centred = np.abs(centroid(given)).max() <= 1e-14 * size
    return np.ascontiguousarray(given if centred else outline - centroid(outline))


def disc_outline(radius: float) -> np.ndarray:
    """Regular polygon with the area of a disc, about its centre."""
    angle = 2.0 * math.pi / DISC_CORNERS
    corner = radius * math.sqrt(angle / math.sin(angle))
    k = np.arange(DISC_CORNERS) * angle
    return corner * np.stack([np.cos(k), np.sin(k)], axis=1)
