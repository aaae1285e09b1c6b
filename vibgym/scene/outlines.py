"""Geometry of outlines: area, centroid, inertia, convexity, symmetry, self-intersection."""

from __future__ import annotations

import math

import numpy as np

from vibgym import checks

DISC_CORNERS = 64
"""Corners of the regular polygon that represents a disc. Its area is exact, its border deviates by up to 0.08 % of the radius.
The inertia is that of the disc. For sliding there are fewer corners, see :func:`sliding_corners`."""

SAGITTA = 1.0 / 300.0
"""Largest deviation of the border of a disc's contact area for sliding, as a share of an element. It adds at most about a
quarter of the planar model's error (discs of 10 to 160 mm on random fields, one second)."""

FEWEST_CORNERS = 16
"""Fewest corners of a disc."""

LEAST_SIZE, MOST_PLACE = 1e-5, 1e3
"""m: least size of an outline, and largest coordinate of a corner."""

MOST_CORNERS = 1000
"""Most corners of an outline; the cost of checks is quadratic."""


def signed_area(outline: np.ndarray) -> float:
    """Return the area enclosed by ``outline`` (n, 2), positive if counter-clockwise."""
    x, y = outline.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def centroid(outline: np.ndarray) -> np.ndarray:
    """Return the centre of the enclosed area (2,)."""
    origin = outline.mean(axis=0)  # keeps digits if the outline is far from the origin
    here = outline - origin
    there = np.roll(here, -1, axis=0)
    cross = here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]
    return origin + (cross[:, None] * (here + there)).sum(axis=0) / (3.0 * cross.sum())


def gyration(outline: np.ndarray) -> float:
    """Return planar inertia over mass about the origin, which must be the centroid, m^2."""
    there = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * there[:, 1] - outline[:, 1] * there[:, 0]
    squares = (outline * outline + outline * there + there * there).sum(axis=1)
    return float((cross * squares).sum() / (6.0 * cross.sum()))


def rotation(x: float, y: float, z: float) -> np.ndarray:
    """Return the (3, 3) matrix of a rotation vector, rad (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return np.eye(3)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k


def inertia(outline: np.ndarray) -> np.ndarray:
    """Return (3,) m^2, xx, yy and xy of a thin plate's inertia over mass about the origin, which must be the centroid."""
    there = np.roll(outline, -1, axis=0)
    (x, y), (u, v) = outline.T, there.T
    cross = x * v - u * y
    moments = [(y * y + y * v + v * v), (x * x + x * u + u * u), -(x * v + 2.0 * x * y + 2.0 * u * v + u * y) / 2.0]
    return np.array([float((cross * each).sum()) for each in moments]) / (6.0 * float(cross.sum()))


def inner_distance(outline: np.ndarray) -> float:
    """Return the distance from the origin to the nearest edge line of a convex outline, m; 0 if the origin is outside."""
    edges = np.roll(outline, -1, axis=0) - outline
    distance = (outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]) / np.hypot(edges[:, 0], edges[:, 1])
    return max(float(distance.min()), 0.0)


def is_convex(outline: np.ndarray) -> bool:
    """Return whether a counter-clockwise outline never turns right."""
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    turn = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    scale = np.abs(outline).max() ** 2
    return bool((turn >= -1e-12 * scale).all())


def narrowest_width(outline: np.ndarray) -> float:
    """Return the smallest extent of an outline over all directions, m; it is normal to an edge of the convex hull."""
    corners = convex_hull(outline)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    reach = normals @ outline.T
    return float((reach.max(axis=1) - reach.min(axis=1)).min())


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull, counter-clockwise (A. M. Andrew's monotone chain, 1979)."""
    ordered = sorted(map(tuple, points.tolist()))
    hull: list[tuple[float, ...]] = []
    for way in (ordered, ordered[::-1]):
        chain: list[tuple[float, ...]] = []
        for x, y in way:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - by) - (by - ay) * (x - bx) > 0.0:
                    break
                chain.pop()
            chain.append((x, y))
        hull += chain[:-1]
    return np.array(hull)


def symmetry_order(outline: np.ndarray) -> int:
    """Return the largest n for which a turn by 2 pi / n about the origin maps the outline onto itself."""
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


def _first_fault(outline: np.ndarray) -> str | None:
    """Return two edges that cross, touch or fold back onto one another, as text; None for a simple polygon."""
    n = len(outline)
    size = float(np.abs(outline).max())
    begin, end = outline, np.roll(outline, -1, axis=0)
    along = end - begin

    def side(point: np.ndarray) -> np.ndarray:
        """Return the side of each edge (rows) on which each point (columns) lies: twice the area of the triangle."""
        off = point[None, :, :] - begin[:, None, :]
        return along[:, None, 0] * off[..., 1] - along[:, None, 1] * off[..., 0]

    def within(point: np.ndarray) -> np.ndarray:
        """Return whether each point (columns) is in the bounding box of each edge (rows)."""
        low, high = np.minimum(begin, end)[:, None, :], np.maximum(begin, end)[:, None, :]
        return np.all((low <= point[None]) & (point[None] <= high), axis=2)

    from_begin, from_end = side(begin), side(end)  # of the line of edge i, for both ends of edge j
    apart = (from_begin != 0.0) & (from_end != 0.0) & ((from_begin > 0.0) != (from_end > 0.0))
    on = ((from_begin == 0.0) & within(begin)) | ((from_end == 0.0) & within(end))
    crossing = (apart & apart.T) | on | on.T
    index = np.arange(n)
    gap = (index[None, :] - index[:, None]) % n
    neighbours = (gap <= 1) | (gap == n - 1)
    # Neighbours share a corner; they may not fold back onto each other.
    following = np.roll(along, -1, axis=0)
    cross = along[:, 0] * following[:, 1] - along[:, 1] * following[:, 0]
    folded = (np.abs(cross) <= 1e-12 * size**2) & ((along * following).sum(axis=1) < 0.0)
    if folded.any():
        first = int(folded.argmax())
        return f"edges {first} and {(first + 1) % n} fold onto each other"
    crossing = np.triu(crossing & ~neighbours)
    if crossing.any():
        i, j = np.unravel_index(int(crossing.argmax()), crossing.shape)
        return f"edges {i} and {j} cross"
    return None


def simple_outline(vertices: object) -> np.ndarray:
    """Check ``vertices`` (n, 2) and return them counter-clockwise about their centroid.

    Raises:
        ValueError: fewer than three corners, not finite, repeated corners, no area, crossing edges, or too many corners.
    """
    allowed = "an (n, 2) array of at least three corners of a simple polygon, m"
    try:
        if np.asarray(vertices).dtype.kind not in "biuf":  # strings would be parsed as numbers
            raise TypeError
        outline = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError, RecursionError):
        raise checks.refuse("vertices", vertices, allowed) from None
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise checks.refuse("vertices", f"array of shape {outline.shape}", allowed)
    if len(outline) > MOST_CORNERS:
        raise checks.refuse("vertices", f"{len(outline)} corners", f"at most {MOST_CORNERS}: simplify the outline")
    if not np.isfinite(outline).all():
        bad = outline[~np.isfinite(outline).all(axis=1)][0]
        raise checks.refuse("vertices", bad.tolist(), "finite numbers")
    if np.abs(outline).max() > MOST_PLACE:
        raise checks.refuse("vertices", vertices, f"numbers in [-{MOST_PLACE:g}, {MOST_PLACE:g}], m")
    outline = outline - outline.mean(axis=0)
    size = float(np.abs(outline).max())
    edges = np.roll(outline, -1, axis=0) - outline
    if 2.0 * size < LEAST_SIZE or np.hypot(*edges.T).min() <= 1e-9 * size:
        allowed = f"corners that differ from their neighbours, a size of at least {LEAST_SIZE:g} m"
        raise checks.refuse("vertices", vertices, allowed)
    fault = _first_fault(outline)
    if fault:
        raise checks.refuse("vertices", fault, "a simple polygon, no crossing edges")
    area = signed_area(outline)
    if abs(area) <= 1e-9 * size**2:
        raise checks.refuse("vertices", f"an area of {abs(area):g} m^2", "a polygon that encloses an area")
    given = np.array(vertices, dtype=np.float64)
    if area < 0.0:
        outline, given = outline[::-1], given[::-1]
    # Corners about the centroid keep every bit: a stored outline is restored exactly.
    centred = np.abs(centroid(given)).max() <= 1e-14 * size
    return np.ascontiguousarray(given if centred else outline - centroid(outline))


def sliding_corners(radius: float, element_size: float) -> int:
    """Return the fewest corners of a disc's contact area, a multiple of four, with a border within :data:`SAGITTA`."""
    corners = 2.0 * math.pi * math.sqrt(radius / (8.0 * SAGITTA * element_size))
    return min(max(4 * math.ceil(0.25 * corners), FEWEST_CORNERS), DISC_CORNERS)


def disc_outline(radius: float, corners: int = DISC_CORNERS) -> np.ndarray:
    """Return a regular polygon with the area of a disc, about its centre."""
    angle = 2.0 * math.pi / corners
    corner = radius * math.sqrt(angle / math.sin(angle))
    k = np.arange(corners) * angle
    return corner * np.stack([np.cos(k), np.sin(k)], axis=1)
