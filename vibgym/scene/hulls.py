"""Parts as convex hulls, for distances and contacts; decomposition of outlines.

A non-convex outline is cut into triangles (mapbox_earcut), which are merged across diagonals while they stay convex: at most
four times as many pieces as the fewest possible (S. Hertel, K. Mehlhorn, 1983).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.hulls import Hulls, HullTable, all_gaps
from vibgym.scene.kinds import Kinds
from vibgym.scene.outlines import is_convex, signed_area
from vibgym.scene.parts import Part

STRAIGHT = 1e-12
"""Turn to the right, over the size squared, that counts as straight."""

MIN_TURN = 1e-10
"""Turn to the left, over the size squared, below which a corner is left out of a hull: contact points need whole edges."""


def convex_decomposition(outline: np.ndarray) -> list[np.ndarray]:
    """Return convex polygons (n, 2), counter-clockwise, into which a simple polygon (n, 2) is cut."""
    from mapbox_earcut import triangulate_float64  # imported late: most scenes have convex parts

    size = float(np.abs(outline).max())
    triangles = triangulate_float64(outline / size, np.array([len(outline)], dtype=np.uint32)).reshape(-1, 3)
    pieces = {k: _counter_clockwise(outline, triangle.tolist()) for k, triangle in enumerate(triangles)}
    owner = {edge: k for k, piece in pieces.items() for edge in zip(piece, piece[1:] + piece[:1], strict=True)}
    diagonals = [edge for edge in owner if edge[0] < edge[1] and edge[::-1] in owner]
    # The longest first, for compact pieces.
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
    convex = [outline[piece] for piece in pieces.values()]
    return [piece for piece in convex if signed_area(piece) > STRAIGHT * size**2]


def _counter_clockwise(outline: np.ndarray, corners: list[int]) -> list[int]:
    (ax, ay), (bx, by), (cx, cy) = outline[corners]
    return corners if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0.0 else corners[::-1]


def _merged(one: list[int], other: list[int], a: int, b: int) -> list[int]:
    """Return the union of two pieces that share an edge, from ``a`` to ``b`` in the first one."""
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
    """Return the convex polygons (n, 2), counter-clockwise, of a part's rim; one corner, the centre, for a disc."""
    if part.symmetry == 0:
        return [np.zeros((1, 2))]
    if is_convex(part.rim):
        return [_without_straight_corners(part.rim)]
    return [_without_straight_corners(piece) for piece in convex_decomposition(part.rim)]


def _without_straight_corners(piece: np.ndarray) -> np.ndarray:
    """Return a convex polygon (n, 2) without corners at which it does not turn."""
    least, kept = MIN_TURN * float(np.abs(piece).max()) ** 2, list(range(len(piece)))
    at = 0
    while at < len(kept) and len(kept) > 3:
        if _turns_left(piece, kept, at, -least):
            at += 1
        else:
            del kept[at]
            at = max(at - 1, 0)
    return piece[kept]


def rounding(part: Part) -> float:
    """Return the radius of the circle around each corner of a part's hulls, m: the radius of a disc, 0 for others."""
    return float(np.sqrt(part.area / np.pi)) if part.symmetry == 0 else 0.0


def hulls_of(parts: Sequence[Part]) -> Hulls:
    """Return the hulls of the parts of a world for kernels, those of the first one; in memory of their own."""
    kinds = Kinds.of(parts)
    every, first = _table(kinds.every), _table(tuple(kinds.every[kind] for kind in kinds.kind[0]))
    room = first
    if kinds.vary:  # for the largest kind
        pieces, corners = len(parts) * int(np.diff(every.owner).max()), len(parts) * _most_corners(every)
        room = HullTable(
            corner=np.zeros((corners, 4)), first=np.zeros(pieces + 1, dtype=np.int64), rounding=np.zeros(pieces),
            owner=first.owner.copy(), radius=first.radius.copy(),
        )  # fmt: skip
        for whole, own in zip(room, first, strict=True):
            whole[: len(own)] = own
    return Hulls(*room, kinds.kind[0].copy(), kinds.kind, every)


def _most_corners(table: HullTable) -> int:
    """Return the largest number of corners of an outline's hulls."""
    return int(np.diff(table.first[table.owner]).max())


@functools.lru_cache(maxsize=256)
def _table(parts: tuple[Part, ...]) -> HullTable:
    """Return the hulls of parts; the arrays are shared, and not changed."""
    pieces = [(part, piece) for part in parts for piece in convex_pieces(part)]
    corners = []
    for _, piece in pieces:
        edges = np.roll(piece, -1, axis=0) - piece
        length = np.hypot(edges[:, 0], edges[:, 1])
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.where(length > 0.0, length, 1.0)[:, None]
        corners.append(np.column_stack([piece, normals]))
    return HullTable(
        corner=np.concatenate(corners),
        first=np.cumsum([0, *(len(rows) for rows in corners)]),
        rounding=np.array([rounding(part) for part, _ in pieces]),
        owner=np.cumsum([0, *(len(convex_pieces(part)) for part in parts)]),
        radius=np.array([rounding(part) or part.radius for part in parts]),
    )


def gaps_between(parts: Sequence[Part], pose: np.ndarray) -> np.ndarray:
    """Return distances between all outlines, (worlds, parts, parts) m; negative: overlap; infinite on the diagonal.

    Args:
        parts: of a world.
        pose: (worlds, parts, 3) x, y (m), heading (rad).
    """
    pose = checks.array("pose", pose, (len(pose), len(parts), 3))
    gaps = np.empty((len(pose), len(parts), len(parts)))
    all_gaps(hulls_of(parts), np.ascontiguousarray(pose), gaps)
    return gaps
