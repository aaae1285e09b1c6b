"""Parts as convex hulls, for distances and contacts; decomposition of outlines, and checks of starting poses.

A non-convex outline becomes few convex pieces: triangles (mapbox_earcut), merged as long as they stay convex. Merging across
diagonals leaves at most four times as many pieces as the fewest possible (S. Hertel, K. Mehlhorn, 1983). The contact solver's
own library has a decomposition, which reads beyond its memory for some outlines.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.hulls import Hulls, all_gaps, place_hulls, wall_gap
from vibgym.scene.outlines import is_convex, signed_area
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

STRAIGHT = 1e-12
"""Turn to the right, over the size squared, that still counts as straight on."""


def convex_decomposition(outline: np.ndarray) -> list[np.ndarray]:
    """Convex polygons (n, 2), counter-clockwise, that together cover a simple polygon (n, 2) and nothing else."""
    from mapbox_earcut import triangulate_float64  # imported late: most scenes have convex parts

    size = float(np.abs(outline).max())
    triangles = triangulate_float64(outline / size, np.array([len(outline)], dtype=np.uint32)).reshape(-1, 3)
    pieces = {k: _counter_clockwise(outline, triangle.tolist()) for k, triangle in enumerate(triangles)}
    owner = {edge: k for k, piece in pieces.items() for edge in zip(piece, piece[1:] + piece[:1], strict=True)}
    diagonals = [edge for edge in owner if edge[0] < edge[1] and edge[::-1] in owner]
    # The longest first: what is left are rather short edges between roundish pieces.
    diagonals.sort(key=lambda edge: -float(np.hypot(*(outline[edge[0]] - outline[edge[1]]))))
    for a, b in diagonals:
        one, other = owner[a, b], owner[b, a]
        if one == other:
            continue
        merged = _merged(pieces[one], pieces[other], a, b)
        at_a, at_b = merged.index(a), merged.index(b)
        if all(_turns_left(outline, merged, at, STRAIGHT * size**2) for at in (at_a, at_b)):
            pieces[one] = merged
            del pieces[other]
            owner.update(dict.fromkeys(zip(merged, merged[1:] + merged[:1], strict=True), one))
    found = [outline[piece] for piece in pieces.values()]
    return [piece for piece in found if signed_area(piece) > STRAIGHT * size**2]


def _counter_clockwise(outline: np.ndarray, corners: list[int]) -> list[int]:
    (ax, ay), (bx, by), (cx, cy) = outline[corners]
    return corners if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0.0 else corners[::-1]


def _merged(one: list[int], other: list[int], a: int, b: int) -> list[int]:
    """Two pieces without the edge between them, which goes from ``a`` to ``b`` in the first one."""
    first, second = one.index(b), other.index(a)
    return one[first:] + one[:first] + (other[second:] + other[:second])[1:-1]


def _turns_left(outline: np.ndarray, piece: list[int], at: int, slack: float) -> bool:
    before, corner, after = outline[[piece[at - 1], piece[at], piece[(at + 1) % len(piece)]]]
    (ux, uy), (vx, vy) = corner - before, after - corner
    return bool(ux * vy - uy * vx >= -slack)


WALLS = ("left", "right", "bottom", "top")
"""Borders that may have a wall, in the kernels' order (:mod:`vibgym.physics.contacts.hulls`)."""


@functools.lru_cache(maxsize=1024)
def convex_pieces(part: Part) -> list[np.ndarray]:
    """Convex polygons (n, 2), counter-clockwise, that make up a part's outline; one corner, the centre, for a disc."""
    if part.symmetry == 0:
        return [np.zeros((1, 2))]
    if is_convex(part.outline):
        return [np.array(part.outline)]
    return convex_decomposition(part.outline)


def rounding(part: Part) -> float:
    """Radius of the circle around each corner of a part's hulls, m: the radius for a disc, 0 for others."""
    return float(np.sqrt(part.area / np.pi)) if part.symmetry == 0 else 0.0


def hulls_of(parts: Sequence[Part]) -> Hulls:
    """The hulls of the parts of a world, as the kernels take them."""
    pieces = [(part, piece) for part in parts for piece in convex_pieces(part)]
    corners = []
    for _, piece in pieces:
        edges = np.roll(piece, -1, axis=0) - piece
        length = np.hypot(edges[:, 0], edges[:, 1])
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.where(length > 0.0, length, 1.0)[:, None]
        corners.append(np.column_stack([piece, normals]))
    return Hulls(
        corner=np.concatenate(corners),
        first=np.cumsum([0, *(len(each) for each in corners)]),
        rounding=np.array([rounding(part) for part, _ in pieces]),
        owner=np.cumsum([0, *(len(convex_pieces(part)) for part in parts)]),
        radius=np.array([rounding(part) or part.radius for part in parts]),
    )


def gaps_between(parts: Sequence[Part], pose: np.ndarray) -> np.ndarray:
    """Distances between the outlines of all parts, (worlds, parts, parts) m; negative: overlap; infinite on the diagonal.

    Args:
        parts: of a world.
        pose: (worlds, parts, 3) x, y (m), heading (rad).
    """
    pose = checks.array("pose", pose, (len(pose), len(parts), 3))
    gaps = np.empty((len(pose), len(parts), len(parts)))
    all_gaps(hulls_of(parts), np.ascontiguousarray(pose), gaps)
    return gaps


AT_REST = 1e-4
"""m of overlap that a start may have: what contacts leave between parts at rest."""

IN_MOTION = 1e-3
"""m of overlap beyond which a state did not come from a simulation with contacts."""


def apart(surface: Surface, parts: Sequence[Part]) -> np.ndarray:
    """Poses (parts, 3) before the first reset: a single part in the middle, several in a row or a grid about it."""
    columns = int(np.ceil(np.sqrt(len(parts) * surface.width / surface.depth)))
    rows = -(-len(parts) // columns)
    index = np.arange(len(parts))
    x = (index % columns + 0.5) * surface.width / columns
    y = (index // columns + 0.5) * surface.depth / rows
    if len(parts) == 1:
        x, y = np.array([0.5 * surface.width]), np.array([0.5 * surface.depth])
    return np.column_stack([x, y, np.zeros(len(parts))])


def check_centres(name: str, pose: np.ndarray, surface: Surface) -> None:
    """Refuse poses (..., 3) whose centres are beside the surface.

    Raises:
        ValueError: names the first of them.
    """
    off = (pose[..., 0] < 0) | (pose[..., 0] > surface.width) | (pose[..., 1] < 0) | (pose[..., 1] > surface.depth)
    if off.any():
        allowed = f"centres on the surface, x in [0, {surface.width:g}] and y in [0, {surface.depth:g}]"
        raise checks.refuse(name, pose[off][0].tolist(), allowed)


def check(
    name: str,
    hulls: Hulls,
    surface: Surface,
    parts: Sequence[Part],
    walls: Sequence[str],
    pose: np.ndarray,
    away: np.ndarray,
    allowed: float,
) -> None:
    """Refuse poses at which parts overlap.

    Args:
        name: of the argument.
        pose: (worlds, parts, 3).
        away: (worlds, parts) bool, parts that take no part.
        allowed: m of overlap; of small parts at most a quarter of their radius, half of it in motion.

    Raises:
        ValueError: the deepest overlap is too deep; names world, parts and amount.
    """
    worlds, n = pose.shape[:2]
    share = (0.25 if allowed <= AT_REST else 0.5) * hulls.radius
    if n > 1:
        gaps = np.empty((worlds, n, n))
        all_gaps(hulls, np.ascontiguousarray(pose), gaps)
        gaps[away] = np.inf
        gaps.transpose(0, 2, 1)[away] = np.inf
        excess = gaps + np.minimum(allowed, np.minimum.outer(share, share))
        if excess.min() < 0.0:
            world, i, j = (int(k) for k in np.unravel_index(int(excess.argmin()), excess.shape))
            raise _refuse(name, world, parts, i, f"part {j} ({parts[j].name!r})", -gaps[world, i, j])
    placed = np.empty_like(hulls.corner)
    for wall in walls:
        for world, part in np.argwhere(~away).tolist():
            place_hulls(hulls, part, *pose[world, part], placed)
            gap = wall_gap(hulls, placed, part, WALLS.index(wall), surface.width, surface.depth)
            if gap < -min(allowed, share[part]):
                raise _refuse(name, world, parts, part, f"the {wall} wall", -gap)


def _refuse(name: str, world: int, parts: Sequence[Part], i: int, other: str, amount: float) -> checks.Refused:
    got = f"part {i} ({parts[i].name!r}) and {other} overlapping by {1e3 * amount:.3g} mm in world {world}"
    return checks.Refused(f"{name}: got {got}; allowed: parts that do not overlap (touching is allowed)")
