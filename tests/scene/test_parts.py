"""Parts: outlines and holes against shapely and closed forms, symmetry, friction, storage, and bad input."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from shapely.geometry import MultiPoint, Polygon

from vibgym import Part, Simulator, Surface
from vibgym.scene import outlines
from vibgym.scene.hulls import gaps_between
from vibgym.scene.parts import SHIPPED, STEEL_DENSITY, kinds_of, part_from, shipped_part

L_SHAPE = [[0, 0], [0.06, 0], [0.06, 0.03], [0.03, 0.03], [0.03, 0.06], [0, 0.06]]
C_SHAPE = [[0, 0], [80, 0], [80, 20], [20, 20], [20, 60], [80, 60], [80, 80], [0, 80]]


def regular(n, radius=0.03):
    angle = 2 * math.pi * np.arange(n) / n + 0.2
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def star(n, radius=0.03):
    corners = regular(2 * n, radius)
    corners[::2] *= 0.4
    return corners


@st.composite
def polygons(draw):
    """Star-shaped, mostly non-convex outlines; anywhere, in either sense."""
    n = draw(st.integers(3, 12))
    fractions = np.array([draw(st.floats(0.1, 1.0)) for _ in range(n)])
    size = draw(st.sampled_from([1e-3, 0.05, 2.0]))
    angle = draw(st.floats(0, 6)) + np.arange(n) * 2 * math.pi / n
    origin = [draw(st.floats(-1, 1)), draw(st.floats(-1, 1))]
    corners = origin + size * fractions[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return corners[::-1] if draw(st.booleans()) else corners


def polar_moment(polygon):
    """Return the polar second moment about the centroid over the area, by triangles of shapely's coordinates."""
    corners = np.array(polygon.exterior.coords)[:-1] - polygon.centroid.coords[0]
    total = 0.0
    for b, c in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        area = 0.5 * (b[0] * c[1] - b[1] * c[0])
        middles = np.array([b, b + c, c]) / 2  # of the triangle with the centroid: exact for quadratics
        total += area * (middles**2).sum() / 3
    return abs(total) / polygon.area


@given(polygons())
def test_polygon_against_shapely(corners):
    part = Part.polygon(corners, friction=0.5)
    expected = Polygon(corners)
    assert part.area == pytest.approx(expected.area, rel=1e-9)
    size = np.ptp(corners, axis=0).max()
    shift = corners - expected.centroid.coords[0]
    # the outline is the given one, moved so that its centroid is the origin; shapely's own centroid carries 1e-16 of the
    # distance to its origin over the part's relative area
    far = 1e-14 * (1 + np.abs(corners).max() / size) ** 2 * size**2 / expected.area
    assert np.abs(np.sort(part.outline, axis=0) - np.sort(shift, axis=0)).max() < 100 * far * size
    assert outlines.signed_area(part.outline) > 0  # counter-clockwise
    assert np.abs(outlines.centroid(part.outline)).max() < 1e-12 * size
    assert part.gyration == pytest.approx(polar_moment(expected), rel=1e-8)
    assert part.radius == pytest.approx(np.hypot(*part.outline.T).max(), rel=1e-15)
    assert outlines.is_convex(part.outline) == (expected.convex_hull.area - expected.area < 1e-10 * expected.area) or (
        expected.convex_hull.area - expected.area < 1e-6 * expected.area  # so close that either result is accepted
    )


def test_rectangle():
    part = Part.rectangle(0.05, 0.03, friction=0.6)
    assert part.area == pytest.approx(0.0015, rel=1e-14)
    assert part.gyration == pytest.approx((0.05**2 + 0.03**2) / 12, rel=1e-14)
    assert part.radius == pytest.approx(math.hypot(0.025, 0.015), rel=1e-14)
    assert part.symmetry == 2 and part.static_friction == part.friction == 0.6
    assert np.ptp(part.outline, axis=0) == pytest.approx([0.05, 0.03])  # length along its x axis
    assert part.mass == pytest.approx(STEEL_DENSITY * 0.0015 * 0.010)
    assert not part.outline.flags.writeable


def test_disc():
    part = Part.disc(0.02, friction=0.6, static_friction=0.7, name="coin")
    assert part.area == pytest.approx(math.pi * 0.02**2, rel=1e-15) and part.gyration == pytest.approx(
        0.02**2 / 2, rel=1e-15
    )
    assert outlines.signed_area(part.outline) == pytest.approx(part.area, rel=1e-12)
    assert np.abs(np.hypot(*part.outline.T) / 0.02 - 1).max() < 0.001
    middles = (part.outline + np.roll(part.outline, 1, axis=0)) / 2
    assert np.abs(np.hypot(*middles.T) / 0.02 - 1).max() < 0.001
    assert part.symmetry == 0 and part.static_friction == 0.7 and part.name == "coin"


def test_shipped_parts():
    for name, values in SHIPPED.items():
        part = shipped_part(name)
        assert part.name == name and np.ptp(part.outline, axis=0) == pytest.approx([values["length"], values["width"]])
    assert (shipped_part("steel_block").friction, shipped_part("aluminium_block").friction) == (0.64, 0.58)
    with pytest.raises(ValueError, match="part"):
        shipped_part("brick")


@pytest.mark.parametrize("corners, order", [
    ([[0, 0], [1, 0], [1, 1], [0, 1]], 4),
    ([[0, 0], [2, 0], [2, 1], [0, 1]], 2),
    ([[0, 0], [3, 0], [0, 1]], 1),
    (L_SHAPE, 1),
    (C_SHAPE, 1),
    (regular(3), 3),
    (regular(5), 5),
    (regular(7), 7),
    (star(5), 5),
    (star(6), 6),
    ([[0, 0], [1, 0], [2, 0], [2, 2], [0, 2]], 4),  # a square with one more corner on an edge is a square
    ([[0, 0], [0.5, 0], [2, 0], [2, 1], [1, 1], [0.3, 1], [0, 1]], 2),
    ([[0, 0], [3, 0], [4, 1], [1, 1]], 2),  # parallelogram
    ([[0, 0], [1, 0], [1, 1.0001], [0, 1.0001]], 2),  # nearly a square
])  # fmt: skip
def test_symmetry(corners, order):
    part = Part.polygon(corners, friction=0.5)
    assert part.symmetry == order
    shape, angle = Polygon(part.outline), 2 * math.pi / order
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    assert shape.symmetric_difference(Polygon(part.outline @ turn)).area < 1e-9 * shape.area


NOT_SIMPLE = {
    "bow tie": [[0, 0], [1, 1], [1, 0], [0, 1]],
    "pentagram": regular(5)[[0, 2, 4, 1, 3]],
    "first corner repeated at the end": [[0, 0], [1, 0], [1, 1], [0, 0]],
    "two corners": [[0, 0], [1, 1]],
    "three columns": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
    "nan": [[0, 0], [1, 0], [math.nan, 1]],
    "huge": [[0, 0], [1e200, 0], [0, 1e200]],
    "tiny": [[0, 0], [1e-200, 0], [0, 1e-200]],
    "text": "square",
    "ragged": [[0, 0], [1], [1, 1]],
    "complex": [[0, 1j], [1, 0], [1, 1]],
}


@pytest.mark.parametrize("name", NOT_SIMPLE)
@pytest.mark.filterwarnings("error")
def test_bad_outlines_are_refused(name):
    with pytest.raises(ValueError, match="vertices"):
        Part.polygon(NOT_SIMPLE[name], friction=0.5)


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), min_size=3, max_size=8))
@example([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)])  # a corner on another edge
@example([(0, 0), (3, 0), (3, 1), (2, 1), (2, 0), (1, 0), (1, 1), (0, 1)])  # overlapping edges
@example([(0, 0), (1, 1), (2, 0), (2, 2), (1, 1), (0, 2)])  # a shared corner
def test_simple_or_refused_as_shapely_says(corners):
    """Random closed walks on a small lattice: many cross, touch or fold. Coordinates are exact, so is the answer."""
    closed = [*corners, corners[0]]
    assume(all(a != b for a, b in zip(closed[:-1], closed[1:], strict=True)))
    # multiples of n keep the centring exact
    scaled = np.array(corners, dtype=float) * len(corners)
    polygon = Polygon(scaled)
    if polygon.is_valid and polygon.area > 0:
        assert Part.polygon(scaled, friction=0.5).area == pytest.approx(polygon.area, rel=1e-12)
    else:
        with pytest.raises(ValueError, match="^vertices"):
            Part.polygon(scaled, friction=0.5)


@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.01, 0.3), st.integers(2, 40))
def test_edges_on_one_line_do_not_cross(turn, height, pieces):
    """Of edges on one line, rounding decides on which sides of one another they lie."""
    share = np.arange(pieces)[:, None] / pieces
    corners = np.array([[-0.5, -height], [0.5, -height], [0.5, height], [-0.5, height]])
    split = np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    turned = split @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    assert Part.polygon(turned, friction=0.5, mass=1.0).area == pytest.approx(2.0 * height, rel=1e-12)


def test_outlines_with_very_many_corners_are_refused():
    def ragged(corners):  # no direction repeats
        turn = np.linspace(0.0, 2.0 * math.pi, corners, endpoint=False)
        reach = 0.03 * (1.0 + 0.2 * np.random.default_rng(0).random(corners))
        return np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])

    assert len(Part.polygon(ragged(1000), friction=0.5).outline) == 1000
    with pytest.raises(ValueError, match="vertices"):
        Part.polygon(ragged(1500), friction=0.5)


def test_narrowest_width():
    """The narrowest width is normal to an edge of the convex hull."""
    triangle = Part.polygon([[0, 0], [0.04, 0], [0, 0.03]], friction=0.5)
    assert outlines.narrowest_width(triangle.outline) == pytest.approx(0.024)  # height on the longest side
    angle = Part.polygon([[0, 0], [0.02, 0], [0.02, 0.004], [0.004, 0.004], [0.004, 0.02], [0, 0.02]], friction=0.5)
    assert outlines.narrowest_width(angle.outline) == pytest.approx(0.024 / math.sqrt(2.0))
    rng, turns = np.random.default_rng(1), np.linspace(0.0, math.pi, 2000)
    for _ in range(20):
        hull = np.array(MultiPoint(rng.uniform(-0.02, 0.02, (8, 2))).convex_hull.exterior.coords)
        reach = hull @ np.stack([np.cos(turns), np.sin(turns)])
        narrow = (reach.max(axis=0) - reach.min(axis=0)).min()
        assert outlines.narrowest_width(hull[:-1]) == pytest.approx(narrow, rel=2e-3)


def angle(bend, x, y, **properties):
    """A part with a bend and a hole at a place."""
    corners = [[0, 0], [0.06, 0], [0.06, 0.02], [bend, 0.02], [bend, 0.06], [0, 0.06]]
    hole = [[0.001, 0.001], [0.004, 0.001], [0.004, 0.019]]
    holes = [np.array(hole) + [x, y]]
    return Part.polygon(np.array(corners) + [x, y], holes=holes, **properties)


LENGTHS, SHARES = st.floats(1e-3, 1.0), st.floats(0.0, 1.0)
SHAPES = st.one_of(
    st.builds(lambda a, b, **more: Part.rectangle(a, b, **more), LENGTHS, LENGTHS, friction=SHARES),
    st.builds(lambda radius, **more: Part.disc(radius, **more), LENGTHS, friction=SHARES, mass=st.floats(0.1, 2)),
    st.builds(
        angle, st.floats(0.005, 0.05), st.floats(-3, 3), st.floats(-3, 3),
        friction=SHARES, name=st.text("abc", min_size=1), restitution=SHARES,
    ),
)  # fmt: skip


@given(SHAPES)
def test_parts_survive_serialisation(part):
    again = part_from(json.loads(json.dumps(part.to_dict())))
    for field in dataclasses.fields(Part):
        if field.name != "holes":
            assert np.array_equal(getattr(part, field.name), getattr(again, field.name)), field.name
    assert all(np.array_equal(a, b) for a, b in zip(again.holes, part.holes, strict=True))
    assert again.same_as(part) and again.to_dict() == part.to_dict()


def test_height_distinguishes_kinds_where_it_matters():
    low, high = (Part.rectangle(0.05, 0.03, friction=0.5, mass=0.1, height=height) for height in (0.004, 0.040))
    assert low.slides_as(high) and not low.same_as(high) and low.same_as(low)
    for same, kind in ((Part.slides_as, [0, 0, 0]), (Part.same_as, [0, 1, 0])):
        kinds, numbers = kinds_of((low, high, low), same)
        assert numbers.tolist() == kind and len(kinds) == max(kind) + 1
    assert kinds_of((low, high))[1].tolist() == [0, 0]
    heavier = Part.rectangle(0.05, 0.03, friction=0.5, mass=0.2, height=0.004)
    assert not low.slides_as(heavier) and not low.same_as(heavier)


# -- holes ---------------------------------------------------------------------------------------------------------------

OUTER = np.array([[0, 0], [80, 0], [80, 50], [0, 50]]) * 1e-3
INNER = np.array([[10, 10], [40, 10], [40, 45], [10, 45]]) * 1e-3


def ring(radius, corners, x=0.0, y=0.0):
    angle = 2.0 * math.pi * np.arange(corners) / corners
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def test_mass_properties():
    """A rectangle less a rectangle, by the parallel-axis theorem."""
    part = Part.polygon(OUTER + 3.0, holes=[INNER + 3.0], friction=0.5, height=0.01)
    whole, gone = 0.08 * 0.05, 0.03 * 0.035
    area = whole - gone
    middle, hole = np.array([0.04, 0.025]), np.array([0.025, 0.0275])
    centre = (whole * middle - gone * hole) / area
    turn = whole * ((0.08**2 + 0.05**2) / 12 + ((middle - centre) ** 2).sum())
    turn -= gone * ((0.03**2 + 0.035**2) / 12 + ((hole - centre) ** 2).sum())
    assert part.area == pytest.approx(area, rel=1e-12)
    mm = {"vertices_mm": (1e3 * OUTER).tolist(), "holes_mm": [(1e3 * INNER).tolist()]}
    assert part_from({"shape": "polygon", "friction": 0.5, **mm}).area == pytest.approx(area)
    assert part.mass == pytest.approx(7850.0 * area * 0.01, rel=1e-12)
    assert part.gyration == pytest.approx(turn / area, rel=1e-9)
    assert part.rim == pytest.approx(OUTER - centre, abs=1e-12)
    assert part.holes[0][::-1] == pytest.approx(INNER - centre, abs=1e-12)
    assert part.inertia[:2].sum() - 2 * 0.01**2 / 12 == pytest.approx(part.gyration)


def test_friction_acts_between_the_holes_only():
    """A part that spins on a still table slows down by ``mu g <r> / <r^2>``, the means over its area."""
    part = Part.polygon(OUTER, holes=[INNER, ring(0.008, 24, 0.06, 0.02)], friction=0.1)
    surface = Surface(horizontal_amplitude=0.0)
    simulator = Simulator(surface, part)
    simulator.reset([[[0.4, 0.1, 0.3]]], [[[0.0, 0.0, 6.0]]])
    simulator.advance(0.0, 0.0, 1)
    grid = np.stack(np.meshgrid(*(np.arange(-0.06, 0.06, 1e-4) + 5e-5,) * 2), axis=-1).reshape(-1, 2)
    inside = outlines.contains(part.rim, grid) & ~np.any([outlines.contains(hole, grid) for hole in part.holes], axis=0)
    radius = np.hypot(*grid[inside].T)
    slower = 0.1 * 9.81 * radius.mean() / (radius**2).mean() * surface.period
    assert simulator.velocity[0, 0, 2] == pytest.approx(6.0 - slower, rel=1e-3)


@pytest.mark.parametrize(("bolts", "order"), [(2, 2), (3, 3), (5, 1), (6, 6)])
def test_symmetry_of_a_flange(bolts, order):
    """The outer outline of 48 corners has order 48; five bolts do not divide it. Corners of the holes do not match."""
    holes = [ring(0.003, 17, *point) for point in ring(0.02, bolts)]
    assert Part.polygon(ring(0.03, 48), holes=[ring(0.01, 31), *holes], friction=0.5).symmetry == order


def test_a_turned_hole_breaks_the_symmetry():
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.03
    triangle = ring(0.01, 3)
    assert Part.polygon(square, holes=[ring(0.01, 4)], friction=0.5).symmetry == 4
    assert Part.polygon(square, holes=[triangle], friction=0.5).symmetry == 1
    assert Part.polygon(ring(0.03, 6), holes=[triangle], friction=0.5).symmetry == 3


def test_parts_touch_the_rim():
    part = Part.polygon(OUTER, holes=[INNER], friction=0.5)
    centre = OUTER[0] - part.rim[0]
    solid = Part.polygon(OUTER, friction=0.5)
    disc = Part.disc(0.01, friction=0.5)
    for x in (0.0, 0.02, 0.06):  # beside, and in the hole
        pose = np.array([[[0.1, 0.1, 0.0], [0.1 + x, 0.1, 0.0]]])
        moved = pose - [[[*(np.array([0.04, 0.025]) - centre), 0.0], [0.0, 0.0, 0.0]]]
        assert gaps_between([part, disc], moved) == pytest.approx(gaps_between([solid, disc], pose), abs=1e-12)


@pytest.mark.parametrize("holes", [
    [INNER + 0.02], [INNER + 0.5], [INNER, INNER + 0.001], [INNER, ring(0.002, 9, 0.02, 0.02)], [OUTER],
    [ring(0.02, 1001, 0.03, 0.025)], [[[0.01, 0.01], [0.02, 0.02], [0.02, 0.01], [0.01, 0.02]]],
])  # fmt: skip
def test_bad_holes_are_refused(holes):
    with pytest.raises(ValueError, match="holes|vertices"):
        Part.polygon(OUTER, holes=holes, friction=0.5)
    with pytest.raises(ValueError, match="holes"):
        part_from({"shape": "disc", "radius": 0.02, "friction": 0.5, "holes": [ring(0.002, 9).tolist()]})
