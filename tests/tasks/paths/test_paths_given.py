"""Paths from settings: geometry, and bad input."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Surface
from vibgym.tasks import paths as route
from vibgym.tasks.follow import GivenPaths
from vibgym.tasks.paths import EFFORT, Reach, rounded

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
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


@pytest.mark.parametrize("path", [CIRCLE, SQUARE, EIGHT], ids=lambda each: each["shape"])
def test_the_other_way_round(path):
    ahead, back = followed(path)[0], followed({**path, "clockwise": True})[0]
    assert ahead[0, :2] == pytest.approx(back[0, :2]) and ahead[-1, :2] == pytest.approx(ahead[0, :2])

    def area(motion):
        x, y = (motion[:, :2] - motion[0, :2]).T
        return 0.5 * (x[:-1] * y[1:] - x[1:] * y[:-1]).sum()

    half = len(ahead) // 2  # of the figure of eight the first circle
    assert area(ahead[:half]) == pytest.approx(-area(back[:half]), abs=2e-5) and area(ahead[:half]) > area(back[:half])


def test_a_polyline_passes_its_points_and_ends_at_the_last():
    motion = followed(LINE)[0]
    assert motion[0, :2] == pytest.approx([0.1, 0.05]) and motion[-1, :2] == pytest.approx([0.3, 0.15])
    assert np.hypot(motion[:, 0] - 0.3, motion[:, 1] - 0.05).min() < 0.01
    closed = followed({**LINE, "closed": True})[0]
    assert closed[0, :2] == pytest.approx([0.2, 0.05]) and closed[-1, :2] == pytest.approx([0.2, 0.05])


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
    path = route.routes(*(np.array([each], dtype=float) for each in course), header)[0]
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


def test_heading_is_constant_or_along_the_path():
    kept, along = followed(CIRCLE)[0], followed({**CIRCLE, "heading": "along"})[0]
    assert (kept[:, 2] == kept[0, 2]).all() and (kept[:, 5] == 0).all()
    middle = len(along) // 2
    direction = math.atan2(along[middle, 4], along[middle, 3])
    assert math.cos(along[middle, 2] - direction) == pytest.approx(1.0, abs=1e-9)
    speeds = [np.hypot(*each[:, 3:5].T).max() for each in (kept, along)]
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


BAD = {
    "no shape": (3, r"paths\[0\]"),
    "unknown shape": ({"shape": "star"}, r"paths\[0\].shape"),
    "too fast": ({**CIRCLE, "speed": 0.3}, r"paths\[0\].speed"),
    "too bent": ({**CIRCLE, "radius_mm": 5}, r"paths\[0\].speed"),
    "too hasty": ({**CIRCLE, "acceleration": 3}, r"paths\[0\].acceleration"),
    "off the surface": ({**CIRCLE, "centre_mm": [60, 104]}, r"paths\[0\].centre"),
    "too large": ({**CIRCLE, "radius_mm": 120}, r"paths\[0\].radius"),
    "back": ({"shape": "polyline", "points_mm": [[100, 50], [300, 50], [100, 50]]}, r"paths\[0\].points"),
    "twice": ({"shape": "polyline", "points_mm": [[100, 50], [100, 50]]}, r"paths\[0\].points"),
    "no room for corners": ({**SQUARE, "side_mm": 30}, r"paths\[0\].side"),
    "laps of a line": ({**LINE, "laps": 2}, r"paths\[0\].laps"),
}  # fmt: skip


@pytest.mark.parametrize("path, message", BAD.values(), ids=BAD)
def test_bad_paths_are_refused_by_name(path, message):
    with pytest.raises(ValueError, match=message):
        given_paths(path)
    with pytest.raises(ValueError, match="paths"):  # each part needs one
        GivenPaths(SURFACE, [BLOCK, BLOCK], [CIRCLE], APART)
