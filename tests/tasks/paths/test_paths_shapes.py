"""Paths from settings, and drawn ones: geometry, feasibility, and distances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Surface
from vibgym.tasks import paths as route
from vibgym.tasks.follow import DrawnPaths, GivenPaths
from vibgym.tasks.paths import EFFORT, Reach, rounded

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
STEEL = Part.rectangle(0.050, 0.040, friction=0.64)
APART = math.sqrt(2.0) * SURFACE.element_size
CIRCLE = {"shape": "circle", "centre_mm": [400, 104], "radius_mm": 60}
SQUARE = {"shape": "square", "centre_mm": [400, 104], "side_mm": 120}
LINE = {"shape": "polyline", "points_mm": [[100, 50], [300, 50], [300, 150]]}
EIGHT = {"shape": "figure_eight", "centre_mm": [400, 104], "radius_mm": 35}


def given_paths(*paths, part=BLOCK):
    return GivenPaths(SURFACE, [part] * len(paths), paths, APART)


def followed(*paths, instants=2000):
    made = given_paths(*paths)
    drawn = made.draw(np.full((1, made.draws), 0.5))[0]
    return [route.sample(path, np.linspace(0.0, route.duration(path[0]), instants)) for path in drawn]


def length(path):
    return given_paths(path).draw(np.zeros((1, 1)))[0, 0, 0, route.LENGTH]


def test_lengths_in_closed_form():
    assert length(CIRCLE) == pytest.approx(2 * math.pi * 0.06)
    assert length({**CIRCLE, "laps": 3}) == pytest.approx(6 * math.pi * 0.06)
    assert length({**SQUARE, "corner_mm": 20}) == pytest.approx(4 * 0.08 + 2 * math.pi * 0.02)
    assert length({**SQUARE, "corner_mm": 20, "laps": 2}) == pytest.approx(8 * 0.08 + 4 * math.pi * 0.02)
    assert length({**LINE, "corner_mm": 20}) == pytest.approx(0.3 - 2 * 0.02 + math.pi / 2 * 0.02)
    assert length(EIGHT) == pytest.approx(4 * math.pi * 0.035)


def test_a_square_touches_its_sides_and_leaves_its_corners():
    motion = followed({**SQUARE, "corner_mm": 20})[0]
    x, y = motion[:, 0] - 0.4, motion[:, 1] - 0.104
    assert np.maximum(np.abs(x), np.abs(y)).max() == pytest.approx(0.06, abs=1e-12)
    assert np.maximum(np.abs(x), np.abs(y)).min() > 0.06 - 0.02 * (1 - math.sqrt(0.5)) - 1e-9
    corner = np.hypot(0.06 - np.abs(x), 0.06 - np.abs(y)).min()
    assert corner == pytest.approx(0.02 * (math.sqrt(2) - 1), abs=1e-5)
    assert motion[0, :2] == pytest.approx([0.4, 0.044]) and motion[-1, :2] == pytest.approx([0.4, 0.044])
    turned = followed({**SQUARE, "corner_mm": 20, "turn_deg": 10})[0]
    cos, sin = math.cos(math.radians(10)), math.sin(math.radians(10))
    assert turned[:, 0] - 0.4 == pytest.approx(cos * x - sin * y) and turned[:, 1] - 0.104 == pytest.approx(
        sin * x + cos * y
    )


@pytest.mark.parametrize("path", [CIRCLE, SQUARE, EIGHT], ids=lambda path: path["shape"])
def test_the_other_way_round(path):
    ahead, back = followed(path)[0], followed({**path, "clockwise": True})[0]
    assert ahead[0, :2] == pytest.approx(back[0, :2]) and ahead[-1, :2] == pytest.approx(ahead[0, :2])

    def area(motion):
        x, y = (motion[:, :2] - motion[0, :2]).T
        return 0.5 * (x[:-1] * y[1:] - x[1:] * y[:-1]).sum()

    half = len(ahead) // 2  # of the figure of eight the first circle
    assert area(ahead[:half]) == pytest.approx(-area(back[:half]), abs=2e-5) and area(ahead[:half]) > area(back[:half])


@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=2, max_size=8), st.floats(1e-3, 0.1), st.booleans()
)
def test_rounded_corners_never_leave_the_line_by_more_than_their_sagitta(points, corner, closed):
    """A path or one error; positions follow the points within the rounding of corners."""
    try:
        course = rounded(np.array(points), corner, int(closed), "points")
    except ValueError as error:
        assert str(error).startswith("points")
        return
    header = np.array([[0.0, 0.1, 1.0, 0.05, 0.0, 0.0]])
    path = route.routes(*(np.array([row], dtype=float) for row in course), header)[0]
    motion = route.sample(path, np.linspace(0.0, route.duration(path[0]), 500))
    corners = np.array([*points, points[0]] if closed else points)
    far = np.full(len(motion), np.inf)
    for a, b in zip(corners, corners[1:], strict=False):
        along = np.clip((motion[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        far = np.minimum(far, np.hypot(*(motion[:, :2] - a - along[:, None] * (b - a)).T))
    assert far.max() <= corner * (1 - math.cos(math.radians(85))) + 1e-7  # half of the sharpest turn
    first = 0.5 * (corners[0] + corners[1]) if closed else corners[0]
    last = first if closed else corners[-1]
    assert motion[0, :2] == pytest.approx(first, abs=1e-9) and motion[-1, :2] == pytest.approx(last, abs=1e-7)


def test_a_polyline_ends_at_its_last_point_or_where_it_begins():
    ends = followed(LINE)[0][[0, -1], :2]
    assert ends == pytest.approx(np.array([[0.1, 0.05], [0.3, 0.15]]))
    ends = followed({**LINE, "closed": True})[0][[0, -1], :2]
    assert ends == pytest.approx(np.array([[0.2, 0.05]] * 2))


def test_heading_is_constant_or_along_the_path():
    kept, along = followed(CIRCLE)[0], followed({**CIRCLE, "heading": "along"})[0]
    assert (kept[:, 2] == kept[0, 2]).all() and (kept[:, 5] == 0).all()
    middle = len(along) // 2
    direction = math.atan2(along[middle, 4], along[middle, 3])
    assert math.cos(along[middle, 2] - direction) == pytest.approx(1.0, abs=1e-9)
    speeds = [np.hypot(*motion[:, 3:5].T).max() for motion in (kept, along)]
    top = Reach(SURFACE, BLOCK).top_speed
    assert speeds == pytest.approx([top / 2, top / 3])


@pytest.mark.parametrize("path", [CIRCLE, SQUARE, LINE, EIGHT, {**CIRCLE, "radius_mm": 17}], ids=str)
def test_accepted_paths_are_feasible(path):
    assert Reach(SURFACE, BLOCK).most_effort(followed(path)[0]) <= EFFORT + 1e-3


def test_parts_may_be_as_near_as_an_elements_diagonal():
    radius = BLOCK.radius
    beside = 1e3 * (0.25 + 2 * radius + APART)
    lines = [{"shape": "polyline", "points_mm": [[x, 50], [x, 150]]} for x in (250, beside + 1e-6)]
    assert given_paths(*lines).shape[0] == 2
    lines[1]["points_mm"] = [[beside - 0.1, 50], [beside - 0.1, 150]]
    with pytest.raises(ValueError, match=r"paths\[1\]"):
        given_paths(*lines)
    # Crossing paths are allowed if the parts are apart at all times.
    crossing = {"shape": "polyline", "points_mm": [[250, 160], [250, 40]]}
    late = {"shape": "polyline", "points_mm": [[780, 160], [100, 160]]}
    assert given_paths(crossing, late).lasts > 3.0


CASES = {
    "one": (SURFACE, [BLOCK], {}),
    "three": (SURFACE, [STEEL, BLOCK, STEEL], {}),
    "five": (SURFACE, [BLOCK] * 5, {"shapes": ["circle", "square"]}),
    "tall": (Surface(rows=24, columns=10), [BLOCK] * 4, {}),
    "along": (SURFACE, [BLOCK, BLOCK], {"heading": "along", "speed": 0.08}),
    "fast": (SURFACE, [BLOCK], {"speed": 0.2}),
}


def shape_of(path):
    """Check the properties of a path."""
    straight = np.diff(path[1:, route.START])[path[1:-1, route.CURVATURE] == 0].sum()
    turns = (path[-1, route.DIRECTION] - path[1, route.DIRECTION]) / (2 * math.pi)
    assert abs(turns) == pytest.approx(round(abs(turns)), abs=1e-9)
    return {(0, False): "figure_eight", (1, False): "circle", (1, True): "square"}[round(abs(turns)), straight > 0.005]


@pytest.mark.parametrize("surface, parts, settings", CASES.values(), ids=CASES)
def test_properties_of_drawn_paths(surface, parts, settings):
    drawn = DrawnPaths(surface, parts, settings, 0.0468)
    paths = drawn.draw(np.random.default_rng(0).random((60, drawn.draws)))
    reach = [Reach(surface, part) for part in parts]
    times = np.linspace(0.0, drawn.lasts, 500)
    shapes = set()
    for world in paths:
        motion = np.stack([route.sample(path, times) for path in world])
        for k, part in enumerate(parts):
            place, room = motion[k, :, :2], np.array([surface.width, surface.depth])
            assert (place >= part.radius - 1e-9).all() and (place <= room - part.radius + 1e-9).all()
            assert reach[k].most_effort(motion[k]) <= EFFORT + 2e-3
            assert route.duration(world[k, 0]) <= drawn.lasts + 1e-12
            assert motion[k, -1, :2] == pytest.approx(motion[k, 0, :2], abs=1e-9)  # all of them are closed
            for j in range(k):
                gap = np.hypot(*(place - motion[j, :, :2]).T) - part.radius - parts[j].radius
                assert gap.min() >= 0.0468 - 1e-9
            shapes.add(shape_of(world[k]))
    assert shapes == set(settings.get("shapes", ["circle", "square", "figure_eight"]))


def test_longest_and_shortest_draws_are_within_bounds():
    """Uniform numbers at the ends of their range."""
    drawn = DrawnPaths(SURFACE, [BLOCK], {}, 0.0468)
    for value in (0.0, np.nextafter(1.0, 0.0)):
        path = drawn.draw(np.full((1, drawn.draws), value))[0, 0]
        motion = route.sample(path, np.linspace(0.0, drawn.lasts, 300))
        assert motion[:, 0].min() >= BLOCK.radius - 1e-9 and motion[:, 1].max() <= SURFACE.depth - BLOCK.radius + 1e-9
