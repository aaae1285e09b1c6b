"""Parts as convex hulls, for distances and contacts."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.hulls import Hulls, all_gaps
from vibgym.scene.outlines import is_convex
from vibgym.scene.parts import Part

WALLS = ("left", "right", "bottom", "top")
"""Borders that may have a wall, in the kernels' order (:mod:`vibgym.physics.contacts.hulls`)."""


@functools.lru_cache(maxsize=1024)
def convex_pieces(part: Part) -> list[np.ndarray]:
    """Convex polygons (n, 2), counter-clockwise, that make up a part's outline; one corner, the centre, for a disc."""
    if part.symmetry == 0:
        return [np.zeros((1, 2))]
    if is_convex(part.outline):
        return [np.array(part.outline)]
    from vibgym.scene.convex import convex_decomposition  # imported late: most scenes have no such parts

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
