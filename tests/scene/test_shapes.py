"""The library of shapes, and convex pieces of outlines against shapely: convex, disjoint, with the outline as union."""

import hashlib
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import unary_union
from shapely.geometry import Polygon

from vibgym import Part
from vibgym.scene.hulls import convex_decomposition
from vibgym.scene.library import SPLITS, shapes
from vibgym.scene.outlines import is_convex

EVERY = {split: shapes(split) for split in SPLITS}


def test_the_library_does_not_change():
    """Published scores refer to these parts."""
    digest = hashlib.sha256()
    for split, parts in EVERY.items():
        for part in parts:
            digest.update(f"{split} {part.name} {part.friction}".encode())
            digest.update(np.round(1e9 * part.outline).astype("<i8").tobytes())
    assert digest.hexdigest() == "66e6fb037d5654e98313c86a130b1eb6f5e68da5362be4148364d2e72fbd583b"


def check(outline):
    pieces = [Polygon(piece) for piece in convex_decomposition(outline)]
    whole = Polygon(outline)
    for piece, corners in zip(pieces, convex_decomposition(outline)):
        assert is_convex(corners) and piece.exterior.is_ccw
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area, rel=1e-9)
    assert (
        unary_union([piece.buffer(1e-9 * math.sqrt(whole.area)) for piece in pieces]).symmetric_difference(whole).area
        < 1e-6 * whole.area
    )
    return len(pieces)


def star(points, size, inner):
    turn, reach = np.arange(2 * points) * math.pi / points, np.tile([1.0, inner], points)
    return Part.polygon(size * np.column_stack([reach * np.cos(turn), reach * np.sin(turn)]), friction=0.5).outline


@pytest.mark.parametrize("name, outline, most", [
    ("angle", [[0, 0], [2, 0], [2, 0.4], [0.4, 0.4], [0.4, 2], [0, 2]], 2),
    ("channel", [[0, 0], [8, 0], [8, 2], [2, 2], [2, 6], [8, 6], [8, 8], [0, 8]], 3),
    ("cross", [[1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2], [0, 1], [1, 1]], 4),
    ("arrow", [[0, 0], [2, 1], [0, 2], [0.5, 1]], 2),
    ("square with a corner on each side", [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], 1),
])  # fmt: skip
def test_few_pieces(name, outline, most):
    assert check(np.array(outline, dtype=float)) <= most


@pytest.mark.parametrize("size", [1e-5, 1.5e-3, 0.03, 100.0])
def test_stars_of_any_size(size):
    """The solver's decomposition crashed on a star of nine points of 1.5 mm."""
    for points in (3, 5, 9, 40):
        assert check(star(points, size, 0.5)) <= points + 1


@given(st.integers(5, 40), st.integers(0, 2**32 - 1))
def test_any_outline(corners, seed):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.uniform(0.2, 1.0, corners)) * 2.0 * math.pi
    turn, reach = turn / corners, rng.uniform(0.2, 1.0, corners)
    assume(turn[-1] - turn[0] < 2.0 * math.pi)
    outline = np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])
    assume(Polygon(outline).is_valid and Polygon(outline).area > 1e-3)
    check(Part.polygon(outline, friction=0.5).outline)
