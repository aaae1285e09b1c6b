"""Non-convex outlines as few convex pieces: triangles (mapbox_earcut), merged as long as they stay convex.

Merging across diagonals leaves at most four times as many pieces as the fewest possible (S. Hertel, K. Mehlhorn, 1983). The
contact solver's own library has a decomposition, which reads beyond its memory for some outlines.
"""

from __future__ import annotations

import numpy as np
from mapbox_earcut import triangulate_float64

from vibgym.scene.outlines import signed_area

STRAIGHT = 1e-12
"""Turn to the right, over the size squared, that still counts as straight on."""


def convex_decomposition(outline: np.ndarray) -> list[np.ndarray]:
    """Convex polygons (n, 2), counter-clockwise, that together cover a simple polygon (n, 2) and nothing else."""
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
