"""Geometry of outlines: area, centroid, inertia, convexity, symmetry, self-intersection."""

from __future__ import annotations

import math
from collections.abc import Sequence

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

MIN_SIZE, MAX_PLACE = 1e-5, 1e3
"""m: least size of an outline, and largest coordinate of a corner."""

MAX_CORNERS = 1000
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
    return np.array([float((cross * moment).sum()) for moment in moments]) / (6.0 * float(cross.sum()))


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


def symmetry_order(outline: np.ndarray, holes: Sequence[np.ndarray] = ()) -> int:
    """Return the largest n for which a turn by 2 pi / n about the origin maps an outline and its holes onto themselves."""
    return max(len(turns_onto([outline, *holes], [outline, *holes])), 1)


def turns_onto(one: Sequence[np.ndarray], other: Sequence[np.ndarray], tolerance: float = 1e-6) -> np.ndarray:
    """Return the turns about the origin that map an outline with its holes onto another one, rad.

    Args:
        one, other: rings (n, 2), the outline first; with the same sense.
        tolerance: over the size; of corners, and of the moments of holes.
    """
    size = float(np.abs(one[0]).max())
    a, b = (_real_corners(rings[0]) @ np.array([1.0, 1j]) / size for rings in (one, other))
    if len(a) != len(b) or len(one) != len(other):
        return np.zeros(0)
    # Of corner k to corner k + s the best turn for each s: the phase of the circular cross-correlation.
    phase = np.angle(np.fft.ifft(np.fft.fft(b) * np.fft.fft(a).conj()))
    after = (np.arange(len(a)) + np.arange(len(a))[:, None]) % len(a)
    phase = phase[np.abs(a * np.exp(1j * phase)[:, None] - b[after]).max(axis=1) < tolerance]
    if len(one) == 1:
        return phase
    traits, wanted = (np.array([_traits(hole, size) for hole in rings[1:]]) for rings in (one, other))
    turned = traits * np.exp(1j * phase[:, None, None] * np.array([0, 1, *range(2, HOLE_ORDER + 1)]))
    away = np.abs(turned[:, :, None] - wanted).max(axis=3)
    return phase[(away.min(axis=2) < tolerance).all(axis=1)]


HOLE_ORDER = 6
"""Largest order of the moments by which holes are compared: corners of flattened circles do not map onto one another."""


def _traits(hole: np.ndarray, size: float) -> np.ndarray:
    """Return area, centre and complex moments of orders 2 to :data:`HOLE_ORDER` about it, over powers of ``size``."""
    centre = centroid(hole)
    z = (hole - centre) @ np.array([1.0, 1j]) / size
    along = np.roll(z, -1)
    cross = (z.conj() * along).imag
    # Over the triangle of the centre and an edge from a to b: the integral of z^k is cross sum_j a^j b^(k-j) / (k+1)(k+2).
    moments = [
        (cross * sum(z**j * along ** (k - j) for j in range(k + 1))).sum() / ((k + 1) * (k + 2))
        for k in range(2, HOLE_ORDER + 1)
    ]
    return np.array([cross.sum() / 2.0, centre @ np.array([1.0, 1j]) / size, *moments])


def _real_corners(outline: np.ndarray) -> np.ndarray:
    """Return the corners at which an outline turns."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    turn = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    return outline[turn > 1e-9 * float(np.abs(outline).max()) ** 2]


def faulty_edges(rings: Sequence[np.ndarray]) -> tuple[int, int, str] | None:
    """Return two edges that cross or touch, or fold back onto one another, and which; None for simple, disjoint polygons.

    Args:
        rings: (n, 2) each; edges are numbered through all of them, edge k begins at corner k.
    """
    begin = np.concatenate(list(rings))
    size, n = float(np.abs(begin).max()), len(begin)
    last = np.cumsum([len(ring) for ring in rings]) - 1
    after = np.arange(n) + 1
    after[last] = np.concatenate([[0], last[:-1] + 1])
    end = begin[after]
    along = end - begin

    def side(point: np.ndarray) -> np.ndarray:
        """Return the side of each edge (rows) on which each point (columns) lies: twice the area of the triangle."""
        off = point[None, :, :] - begin[:, None, :]
        return along[:, None, 0] * off[..., 1] - along[:, None, 1] * off[..., 0]

    low, high = np.minimum(begin, end)[:, None, :], np.maximum(begin, end)[:, None, :]

    def within(point: np.ndarray) -> np.ndarray:
        """Return whether each point (columns) is in the bounding box of each edge (rows)."""
        return np.all((low <= point[None]) & (point[None] <= high), axis=2)

    from_begin, from_end = side(begin), side(end)  # of the line of edge i, for both ends of edge j
    apart = (from_begin != 0.0) & (from_end != 0.0) & ((from_begin > 0.0) != (from_end > 0.0))
    on = ((from_begin == 0.0) & within(begin)) | ((from_end == 0.0) & within(end))
    # Of separate edges on one line, rounding alone decides the sides: their boxes are apart.
    meeting = np.all((low <= high[:, 0]) & (low[:, 0] <= high), axis=2)
    crossing = (apart & apart.T & meeting) | on | on.T
    # Neighbours share a corner; they may not fold back onto each other.
    following = along[after]
    cross = along[:, 0] * following[:, 1] - along[:, 1] * following[:, 0]
    folded = (np.abs(cross) <= 1e-12 * size**2) & ((along * following).sum(axis=1) < 0.0)
    if folded.any():
        first = int(folded.argmax())
        return first, int(after[first]), "fold onto each other"
    crossing[np.arange(n), np.arange(n)] = crossing[np.arange(n), after] = crossing[after, np.arange(n)] = False
    if crossing.any():
        i, j = sorted(int(k) for k in np.unravel_index(int(crossing.argmax()), crossing.shape))
        return i, j, "cross"
    return None


def contains(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return whether each point (n, 2) is inside a closed outline, by the number of edges to its right."""
    ends = np.roll(outline, -1, axis=0)
    (x, y), (u, v) = outline.T, ends.T
    rises = (y > points[:, 1:]) != (v > points[:, 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x + (points[:, 1:] - y) / (v - y) * (u - x)
    return (rises & (points[:, :1] < crossing)).sum(axis=1) % 2 == 1


def bridged(rim: np.ndarray, holes: Sequence[np.ndarray]) -> np.ndarray:
    """Return one closed outline (n, 2) around an area with holes: each is joined to the rest by a cut that is passed twice.

    Both passages cancel in integrals along the outline, so that area, moments and contact areas are those of the area with
    its holes (Green's theorem). The cut goes from the hole's rightmost corner to the right (D. Eberly, "Triangulation by ear
    clipping", 2002).
    """
    outline = rim
    for hole in sorted(holes, key=lambda corners: -float(corners[:, 0].max())):
        ring = hole if signed_area(hole) < 0.0 else hole[::-1]
        ring = np.roll(ring, -int(ring[:, 0].argmax()), axis=0)
        x, y = ring[0]
        ends = np.roll(outline, -1, axis=0)
        rises = (outline[:, 1] > y) != (ends[:, 1] > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = outline[:, 0] + (y - outline[:, 1]) / (ends[:, 1] - outline[:, 1]) * (ends[:, 0] - outline[:, 0])
        edge = int(np.where(rises & (at > x), at, np.inf).argmin())
        foot = np.array([at[edge], y])
        parts = [outline[: edge + 1], [foot], ring, ring[:1], [foot], outline[edge + 1 :]]
        joined = np.concatenate([np.asarray(section).reshape(-1, 2) for section in parts])
        outline = joined[np.any(joined != np.roll(joined, 1, axis=0), axis=1)]  # a foot may be a corner
    return outline


def area_and_centre(rings: Sequence[np.ndarray]) -> tuple[float, np.ndarray]:
    """Return area and centroid (2,) of an outline, counter-clockwise, with holes, clockwise."""
    areas = np.array([signed_area(ring) for ring in rings])
    return float(areas.sum()), (areas[:, None] * [centroid(ring) for ring in rings]).sum(axis=0) / areas.sum()


def outline_with_holes(vertices: object, holes: Sequence[object]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Check an outline and its holes, and return them about the centre of the area between them.

    Returns:
        The outer outline, counter-clockwise, and the holes, clockwise.

    Raises:
        ValueError: an invalid ring, or a hole that is not inside the outline and apart from the other ones.
    """
    rings = [simple_outline(vertices), *(simple_outline(hole) for hole in holes)]
    # simple_outline centres each ring.
    corners = [np.array(ring, dtype=np.float64) for ring in (vertices, *holes)]
    placed = [ring + (own.mean(axis=0) - ring.mean(axis=0)) for ring, own in zip(rings, corners, strict=True)]
    if any(not contains(placed[0], hole).all() for hole in placed[1:]) or faulty_edges(placed) is not None:
        raise checks.refuse(
            "holes", "a hole that crosses another outline or is outside", "inside the outline, apart from each other"
        )
    if any(contains(one, other[:1])[0] for one in placed[1:] for other in placed[1:] if one is not other):
        raise checks.refuse("holes", "a hole inside another one", "inside the outline, apart from each other")
    if sum(map(len, placed)) > MAX_CORNERS:
        raise checks.refuse(
            "holes", f"{sum(map(len, placed))} corners", f"at most {MAX_CORNERS} with the outline's: simplify"
        )
    corners = [ring[::-1] if (signed_area(ring) < 0.0) == (k == 0) else ring for k, ring in enumerate(corners)]
    for _ in range(3):  # far from the origin, the first centre has an error of rounding
        centre = area_and_centre(corners)[1]
        if np.abs(centre).max() <= 1e-14 * float(np.abs(corners[0]).max()):  # a stored outline is restored exactly
            break
        corners = [ring - centre for ring in corners]
    return corners[0], corners[1:]


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
    if len(outline) > MAX_CORNERS:
        raise checks.refuse("vertices", f"{len(outline)} corners", f"at most {MAX_CORNERS}: simplify the outline")
    if not np.isfinite(outline).all():
        bad = outline[~np.isfinite(outline).all(axis=1)][0]
        raise checks.refuse("vertices", bad.tolist(), "finite numbers")
    if np.abs(outline).max() > MAX_PLACE:
        raise checks.refuse("vertices", vertices, f"numbers in [-{MAX_PLACE:g}, {MAX_PLACE:g}], m")
    outline = outline - outline.mean(axis=0)
    size = float(np.abs(outline).max())
    edges = np.roll(outline, -1, axis=0) - outline
    if 2.0 * size < MIN_SIZE or np.hypot(*edges.T).min() <= 1e-9 * size:
        allowed = f"corners that differ from their neighbours, a size of at least {MIN_SIZE:g} m"
        raise checks.refuse("vertices", vertices, allowed)
    fault = faulty_edges([outline])
    if fault:
        raise checks.refuse("vertices", "edges {} and {} that {}".format(*fault), "a simple polygon, no crossing edges")
    area = signed_area(outline)
    if abs(area) <= 1e-9 * size**2:
        raise checks.refuse("vertices", f"an area of {abs(area):g} m^2", "a polygon that encloses an area")
    corners = np.array(vertices, dtype=np.float64)
    if area < 0.0:
        outline, corners = outline[::-1], corners[::-1]
    # Corners about the centroid keep every bit: a stored outline is restored exactly.
    centred = np.abs(centroid(corners)).max() <= 1e-14 * size
    return np.ascontiguousarray(corners if centred else outline - centroid(outline))


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
