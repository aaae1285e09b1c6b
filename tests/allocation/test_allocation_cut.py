"""Cutting parts by the element grid: against shapely, and sums that must be right."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity, box

from tests.policies.helpers import ALUMINIUM, DISC, STEEL, SURFACE
from vibgym import Part
from vibgym.allocation.cut import cut_parts, new_pieces, outlines_of

ELL = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]], friction=0.5)
FRAME = Part.polygon(
    [[0, 0], [0.09, 0], [0.09, 0.06], [0, 0.06]], friction=0.5,
    holes=[[[0.01, 0.01], [0.05, 0.012], [0.045, 0.05]], [[0.06, 0.02], [0.08, 0.02], [0.08, 0.05], [0.06, 0.04]]],
)  # fmt: skip
PARTS = (STEEL, ALUMINIUM, DISC, ELL, FRAME)


def cut(parts, pose, present=None):
    """Pieces of one world: part, element, share and lever (m), as arrays."""
    pose = np.asarray(pose, dtype=float)
    pieces = new_pieces(SURFACE, parts)
    outlines = outlines_of(SURFACE, parts)
    n = cut_parts(outlines, 0, pose, np.ones(len(parts), dtype=bool) if present is None else present, pieces)
    lever = pieces.lever[:n] * outlines.gyration[outlines.kind[0, pieces.part[:n]], None]
    return pieces.part[:n].copy(), pieces.element[:n].copy(), pieces.share[:n].copy(), lever


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, len(PARTS) - 1),
    st.floats(-0.01, SURFACE.width + 0.01),
    st.floats(-0.01, SURFACE.depth + 0.01),
    st.floats(-math.pi, math.pi),
)
def test_pieces_are_the_intersections_with_the_elements(which, x, y, heading):
    """Convex or not, on the border or not: areas and centroids of every element's piece."""
    part, size = PARTS[which], SURFACE.element_size
    _, element, share, lever = cut((part,), [[x, y, heading]])
    shape = affinity.translate(affinity.rotate(Polygon(part.rim, part.holes), heading, (0, 0), use_radians=True), x, y)
    expected = {}
    for row in range(SURFACE.rows):
        for column in range(SURFACE.columns):
            piece = shape.intersection(box(column * size, row * size, (column + 1) * size, (row + 1) * size))
            if piece.area > 1e-6 * shape.area:
                expected[row * SURFACE.columns + column] = piece.area / shape.area, piece.centroid
    piece_of = {e: k for k, e in enumerate(element.tolist()) if share[k] > 1e-6}
    assert piece_of.keys() == expected.keys() and len(element) == len(set(element.tolist()))
    for e, (area, centroid) in expected.items():
        k = piece_of[e]
        assert share[k] == pytest.approx(area, abs=1e-9)
        assert lever[k] == pytest.approx(area * np.array([centroid.x - x, centroid.y - y]), abs=1e-10)


def test_edges_on_the_grid_make_no_slivers():
    square = Part.rectangle(0.052, 0.026, friction=0.5)
    _, element, share, _ = cut((square,), [[0.104, 0.091, 0.0]])
    assert sorted(element.tolist()) == [3 * 32 + 3, 3 * 32 + 4] and share == pytest.approx(0.5)


def test_absent_parts_and_parts_off_the_surface_have_no_pieces():
    pose = [[0.1, 0.1, 0.3], [0.3, 0.1, 1.0], [-1.0, 0.1, 0.0], [0.7, 9.0, 0.0]]
    part, *_ = cut(PARTS, pose, np.array([False, True, True, True]))
    assert set(part.tolist()) == {1}


def test_there_is_room_for_a_disc_that_just_fills_an_element():
    """The polygon of a disc extends slightly beyond its radius: nine pieces."""
    disc = Part.disc(0.5 * SURFACE.element_size, friction=0.5)
    middle = 4.5 * SURFACE.element_size
    assert disc.radius > 0.5 * SURFACE.element_size
    assert len(cut((disc,), [[middle, middle, 0.01]])[1]) > 4
    assert len(new_pieces(SURFACE, (disc,)).part) >= 9
