"""A part's outline cut by the element grid, against shapely."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon, box
from shapely.geometry.polygon import orient

from vibgym.physics.planar.contact_area import (
    MOMENTS,
    NEGLIGIBLE_PIECE,
    contact_points,
    cut_outline,
    most_angles,
    support_holds,
)

PITCH = 0.026
L_SHAPE = [(0, 0), (60, 0), (60, 30), (30, 30), (30, 60), (0, 60)]
C_SHAPE = [(0, 0), (80, 0), (80, 20), (20, 20), (20, 60), (80, 60), (80, 80), (0, 80)]
SHAPES = {
    "rectangle": [(0, 0), (50, 0), (50, 35), (0, 35)],
    "triangle": [(0, 0), (70, 10), (20, 55)],
    "L": L_SHAPE,
    "C": C_SHAPE,
    "star": [
        ((40 if k % 2 else 12) * math.cos(k * math.pi / 5), (40 if k % 2 else 12) * math.sin(k * math.pi / 5))
        for k in range(10)
    ],
}


def moments_of(geometry, x, y):
    """Area and raw first and second moments of shapely geometry about (x, y): area, x, y, xx, xy, yy."""
    total = np.zeros(6)
    for polygon in getattr(geometry, "geoms", [geometry]):
        if polygon.geom_type != "Polygon" or polygon.is_empty:
            continue
        corners = np.array(orient(polygon).exterior.coords)[:-1] - (x, y)
        assert not polygon.interiors
        a = corners[0]
        for b, c in zip(corners[1:-1], corners[2:], strict=True):  # a fan of signed triangles
            area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
            px, py = (np.array([a + b, b + c, c + a]) / 2).T  # the edges' middles: exact for quadratics
            total += area * np.mean([np.ones(3), px, py, px * px, px * py, py * py], axis=1)
    return total


def cut(outline, rows=8, columns=32, split=1, centre=None):
    """Points of all pieces: weight, x, y (about ``centre``), element; and the centre, the centroid if not given."""
    outline = np.asarray(outline, dtype=float)
    centre = np.array(Polygon(outline).centroid.coords[0]) if centre is None else np.asarray(centre, dtype=float)
    pitch = PITCH / split
    extent = np.ptp(outline, axis=0).max() / pitch
    cells = np.full(((int(extent) + 3) ** 2, MOMENTS), np.nan)  # detects entries that are not overwritten
    points = np.full((3, 4 * len(cells) + 8), np.nan)
    under = np.full(4 * len(cells) + 8, -1)
    bounds = np.empty(4, np.int64)
    x, y = (outline / pitch).T
    cut_outline(np.ascontiguousarray(x), np.ascontiguousarray(y), cells, bounds)
    smallest = NEGLIGIBLE_PIECE * Polygon(outline).area / pitch**2
    n = contact_points(cells, bounds, rows, columns, split, pitch, *centre, smallest, points, under)
    assert n % 8 == 0
    element = np.repeat(under[: n // 4], 4)
    return points[0, :n], points[1, :n], points[2, :n], element, centre


def check_against_shapely(outline, rows=8, columns=32, split=1):
    polygon = Polygon(outline)
    weight, x, y, element, (cx, cy) = cut(outline, rows, columns, split)
    supported = polygon.intersection(box(0, 0, columns * PITCH, rows * PITCH)).area
    if supported < 1e-9 * polygon.area:
        assert supported > 0.0 or len(weight) == 0
        return
    assert weight.sum() == pytest.approx(1.0, abs=1e-14)
    assert (weight >= 0).all()
    size = max(np.ptp(np.asarray(outline, dtype=float), axis=0))
    # Shares are compared in units of the part: 1 for area, its size for lengths. Rounding of a dozen additions on numbers
    # of order one, magnified where the supported share is small; 1e-11 is the share below which pieces are left out.
    scale = np.array([1, size, size, size**2, size**2, size**2])
    bound = 2e-11 * max(1.0, polygon.area / supported) * max(1.0, PITCH / size) ** 2
    seen = set(element[weight > 0].tolist())
    for i in range(rows):
        for j in range(columns):
            square = box(j * PITCH, i * PITCH, (j + 1) * PITCH, (i + 1) * PITCH)
            expected = moments_of(polygon.intersection(square), cx, cy) / supported
            here = element == i * columns + j
            w, px, py = weight[here], x[here], y[here]
            got = np.array([w.sum(), w @ px, w @ py, w @ (px * px), w @ (px * py), w @ (py * py)])
            assert np.abs((got - expected) / scale).max() < bound, (i, j)
            if expected[0] > 1e-9:
                assert i * columns + j in seen


def place(shape, x, y, turn):
    corners = np.array(SHAPES[shape], dtype=float) * 1e-3
    corners -= corners.mean(axis=0)
    c, s = math.cos(turn), math.sin(turn)
    return corners @ np.array([[c, s], [-s, c]]) + (x, y)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("split", [1, 3])
@pytest.mark.parametrize("turn", [0.0, 0.3, math.pi / 4, 2.0])
def test_pieces_of_shapes(shape, split, turn):
    check_against_shapely(place(shape, 0.0937, 0.0713, turn), rows=6, columns=8, split=split)


@st.composite
def stars(draw):
    """Star-shaped, mostly non-convex outlines from 2 mm to 140 mm across, anywhere on or off the surface."""
    n = draw(st.integers(3, 10))
    fractions = [draw(st.floats(0.15, 1.0)) for _ in range(n)]
    size = draw(st.sampled_from([0.001, 0.01, 0.03, 0.07]))
    turn = draw(st.floats(0.0, 2.0))
    angle = turn + np.arange(n) * 2 * math.pi / n
    centre = [draw(st.floats(-0.02, 0.18)), draw(st.floats(-0.02, 0.12))]
    return centre + size * np.array(fractions)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@given(stars(), st.sampled_from([1, 2, 5]))
@example(np.array([(-0.1, -0.1), (-0.05, -0.1), (-0.05, -0.05)]), 1)  # nothing is supported
def test_pieces_of_random_stars(outline, split):
    check_against_shapely(outline, rows=4, columns=6, split=split)


@given(st.lists(st.tuples(st.integers(-3, 20), st.integers(-3, 14)), min_size=3, max_size=9, unique=True))
@example([(4, 4), (8, 4), (8, 8), (4, 8)])  # one whole element
@example([(0, 0), (4, 4), (0, 8)])  # corners on grid corners, an edge on the border
@example([(4, 0), (8, 4), (4, 8), (0, 4)])
def test_corners_and_edges_on_grid_lines(corners):
    """Corners on a lattice four times as fine as the grid: many edges lie on grid lines, many corners on its corners."""
    middle = np.mean(corners, axis=0) + (0.01, 0.013)
    outline = np.array(sorted(corners, key=lambda c: math.atan2(c[1] - middle[1], c[0] - middle[0])), dtype=float)
    polygon = Polygon(outline)
    assume(polygon.is_valid and polygon.area > 0.1)
    if not polygon.exterior.is_ccw:
        outline = outline[::-1]
    check_against_shapely(outline * (PITCH / 4), rows=3, columns=4)


@pytest.mark.parametrize("split", [1, 4])
def test_part_that_covers_the_surface(split):
    weight, x, y, element, _ = cut([(-1, -1), (2, -1), (2, 3), (-1, 3)], rows=2, columns=3, split=split, centre=(0, 0))
    for row in range(6):
        here = element == row
        j, i = row % 3, row // 3
        w, px, py = weight[here], x[here], y[here]
        assert w.sum() == pytest.approx(1 / 6, rel=1e-12)
        assert w @ px / w.sum() == pytest.approx((j + 0.5) * PITCH, rel=1e-12)
        assert w @ py / w.sum() == pytest.approx((i + 0.5) * PITCH, rel=1e-12)
        assert w @ (px - (j + 0.5) * PITCH) ** 2 / w.sum() == pytest.approx(PITCH**2 / 12, rel=1e-10)
        assert w @ (py - (i + 0.5) * PITCH) ** 2 / w.sum() == pytest.approx(PITCH**2 / 12, rel=1e-10)


@given(st.floats(0.0005, 0.018), st.floats(0.1, 1.0), st.floats(0.0, 6.3))
def test_four_points_carry_a_single_piece(length, ratio, turn):
    """Inside one element a rectangle's four points have its area, centroid and second moments (closed forms)."""
    width = ratio * length
    c, s = math.cos(turn), math.sin(turn)
    frame = np.array([[c, s], [-s, c]])
    corners = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2 @ frame
    weight, x, y, element, _ = cut(corners + (4.5 * PITCH, 2.5 * PITCH))
    assert (weight > 0).sum() == 4 and set(element) == {2 * 32 + 4}
    expected = frame.T @ np.diag([length**2, width**2]) @ frame / 12
    assert weight.sum() == pytest.approx(1.0, abs=1e-15)
    assert abs(weight @ x) < 1e-13 * PITCH and abs(weight @ y) < 1e-13 * PITCH
    got = np.array([[weight @ (x * x), weight @ (x * y)], [weight @ (x * y), weight @ (y * y)]])
    # Cells sum edges of this length, in elements, with rounding 2.2e-16, and divide by the area; twice that for four edges.
    assert np.abs(got - expected).max() < 4.4e-16 * PITCH**2 * (length / PITCH) / (length * width / PITCH**2)


def holds(outline, width, height, x, y):
    angles = np.zeros(most_angles(len(outline)))
    return support_holds(*np.ascontiguousarray(outline.T), 0.0, width, 0.0, height, x, y, angles)


@given(stars(), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_support_polygon(outline, dx, dy):
    width, height = 6 * PITCH, 4 * PITCH
    polygon = Polygon(outline)
    x, y = polygon.centroid.x + dx, polygon.centroid.y + dy
    hull = polygon.intersection(box(0, 0, width, height)).convex_hull
    inside = not hull.is_empty and hull.area > 0 and hull.covers(Point(x, y))
    assume(hull.is_empty or hull.boundary.distance(Point(x, y)) > 1e-9)  # on the border either result is accepted
    assert holds(outline, width, height, x, y) == inside


def test_support_polygon_of_a_part_that_covers_a_corner():
    outline = np.array([(-0.1, -0.1), (0.05, -0.1), (0.05, 0.05), (-0.1, 0.05)])  # surface corner (0, 0) inside
    assert holds(outline, 1.0, 1.0, 0.01, 0.01)
    assert not holds(outline, 1.0, 1.0, -0.01, 0.01)
    assert not holds(outline, 1.0, 1.0, 0.06, 0.01)
