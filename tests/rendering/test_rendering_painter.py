"""The picture agrees with the view, by sampled pixels."""

import dataclasses
import pickle

import numpy as np
import pytest

pygame = pytest.importorskip("pygame")

from vibgym.rendering import Scenery, SurfacePainter, View, Zone, colours  # noqa: E402

ROWS, COLUMNS, ELEMENT = 8, 32, 0.026
BLOCK = np.array([[-25.0, -17.5], [25.0, -17.5], [25.0, 17.5], [-25.0, 17.5]]) * 1e-3
MARGIN, PER_ELEMENT = 20, 30
REST = np.zeros((ROWS, COLUMNS, 2))
EMPTY = View(np.zeros((0, 3)), REST)


@pytest.fixture(scope="module")
def painter():
    return SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK])


@pytest.fixture(scope="module")
def bare():
    return SurfacePainter(ROWS, COLUMNS, ELEMENT, [])


def pixel(x, y):
    """Return row and column of a point of the table."""
    scale = PER_ELEMENT / ELEMENT
    return round(MARGIN + ROWS * PER_ELEMENT - y * scale - 0.5), round(MARGIN + x * scale - 0.5)


def looks_like(picture, at, colour, tolerance=14):
    return bool((np.abs(picture[pixel(*at)].astype(int) - colour) <= tolerance).all())


def view_of(pose, **changes):
    return dataclasses.replace(EMPTY, pose=np.array([pose]), **changes)


def test_size_and_freshness(painter):
    first = painter.paint(view_of((0.4, 0.1, 0.0)))
    copy = first.copy()
    second = painter.paint(view_of((0.2, 0.1, 0.0)))
    assert first.shape == (painter.height, painter.width, 3)
    assert first.dtype == np.uint8
    assert first.flags.writeable and first.flags.c_contiguous
    assert painter.width == 1000
    np.testing.assert_array_equal(first, copy)
    assert (first != second).any()
    np.testing.assert_array_equal(first, painter.paint(view_of((0.4, 0.1, 0.0))))


@pytest.mark.parametrize("heading", [0.0, 0.6, np.pi / 2, -2.0])
def test_part_is_drawn_at_its_pose(painter, heading):
    x, y = 0.403, 0.107
    picture = painter.paint(view_of((x, y, heading)))
    ahead, aside = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    for along in (-0.9, -0.5, 0.0, 0.9):
        for across in (-0.8, 0.8):
            point = np.array([x, y]) + along * 0.025 * ahead + across * 0.0175 * aside
            assert looks_like(picture, tuple(point), colours.PARTS[0])
    for along, across in ((1.15, 0.0), (-1.15, 0.0), (0.0, 1.2), (0.0, -1.25)):
        point = np.array([x, y]) + along * 0.025 * ahead + across * 0.0175 * aside
        assert not looks_like(picture, tuple(point), colours.PARTS[0], 60)
    mark = np.array([x, y]) + 0.35 * 0.025 * ahead
    assert looks_like(picture, tuple(mark), colours.PAPER)


@pytest.mark.parametrize("phase", np.radians([0.0, 45.0, 90.0, 180.0, 225.0, 270.0]).tolist())
def test_arrow_points_where_the_element_pushes(bare, phase):
    phasors = REST.copy()
    phasors[3, 10] = np.cos(phase), np.sin(phase)
    picture = bare.paint(dataclasses.replace(EMPTY, phasors=phasors))
    row, column = pixel(10.5 * ELEMENT, 3.5 * ELEMENT)
    tile = picture[row - 14 : row + 15, column - 14 : column + 15].astype(float)
    darkness = (0.6 * tile.max() - tile.mean(axis=-1)).clip(0.0)
    down, right = np.meshgrid(np.arange(-14, 15), np.arange(-14, 15), indexing="ij")
    found = np.array([(darkness * right).sum(), -(darkness * down).sum()]) / darkness.sum()
    push = np.array([-np.sin(phase), -np.cos(phase)])
    assert found @ push > 4.0
    assert abs(found[0] * push[1] - found[1] * push[0]) < 1.0


def dark_at(picture, reference, at):
    """Return whether there is a dark pixel within a pixel of a point."""
    row, column = pixel(*at)
    window = slice(row - 1, row + 2), slice(column - 1, column + 2)
    return bool((reference[window].astype(int) - picture[window]).max() > 60)


def test_every_part_has_a_goal_with_its_own_outline():
    painter = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK, 0.5 * BLOCK])
    pose, goals = np.array([[0.1, 0.1, 0.0], [0.2, 0.1, 0.0]]), np.array([[0.4, 0.1, 0.0], [0.6, 0.1, 0.0]])
    nothing = painter.paint(dataclasses.replace(EMPTY, pose=pose))
    for lost in (None, 0, 1):
        shown = goals.copy()
        if lost is not None:
            shown[lost] = np.nan
        picture = painter.paint(dataclasses.replace(EMPTY, pose=pose, goals=shown))
        for part, half in enumerate((0.0175, 0.00875)):
            along = np.linspace(-0.8, 0.8, 81) * half
            edge = [dark_at(picture, nothing, (goals[part, 0] + dx, 0.1 + half)) for dx in along]
            assert any(edge) == (part != lost)
    with pytest.raises(ValueError, match="goals"):
        painter.paint(dataclasses.replace(EMPTY, pose=pose, goals=goals[:1]))


def test_moving_goals_are_drawn_at_their_poses():
    painter = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK])
    goals = [np.array([[0.1 + 0.015 * k, 0.1, 0.1 * k]]) for k in range(40)]
    first = [painter.paint(view_of((0.4, 0.1, 0.3), goals=goal)) for goal in goals]
    for goal, picture in zip(goals, first, strict=True):
        other = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK]).paint(view_of((0.4, 0.1, 0.3), goals=goal))
        np.testing.assert_array_equal(painter.paint(view_of((0.4, 0.1, 0.3), goals=goal)), other)
        np.testing.assert_array_equal(picture, other)


def test_scenery_determines_the_content_of_views():
    zones = (Zone((0.0, 0.0), (0.2, 0.2), 1, "there"),)
    outlines = (BLOCK, BLOCK)
    pose, goal = np.arange(6.0).reshape(2, 3), np.arange(6.0, 12.0).reshape(2, 3)
    trail, present = np.zeros((9, 2, 2)), np.array([True, False])
    for size in (0, 2, 3):
        scenery = Scenery(ROWS, COLUMNS, ELEMENT, outlines, (1, 0), ("left",), zones, size, 0.002, trail=4)
        assert vars(pickle.loads(pickle.dumps(scenery)))["zones"] == zones
        view = scenery.view(pose, present, goal, REST, trail, "said")
        np.testing.assert_array_equal(view.pose, [pose[0], [np.nan] * 3])
        assert (view.zones, view.tolerance, view.caption) == (zones, 0.002, "said")
        assert [np.isfinite(each).sum() for each in view.trails] == [8, 0]
        if size:
            np.testing.assert_array_equal(view.goals, [goal[0, :size], [np.nan] * size])
        else:
            assert view.goals is None
        trail[-2, 0] = -1.0  # it arrived later
        came = scenery.view(pose, present, goal, REST, trail, "said").trails[0]
        assert np.isfinite(came).sum() == 2 and np.isfinite(came[-1]).all()
        trail[-2, 0] = 0.0
        by_hand = SurfacePainter(ROWS, COLUMNS, ELEMENT, outlines, kinds=[1, 0], walls=["left"])
        np.testing.assert_array_equal(scenery.painter().paint(view), by_hand.paint(view))


def test_trail_fades_with_age(painter):
    trail = np.stack([np.linspace(0.1, 0.7, 100), np.full(100, 0.117)], axis=1)
    plain = painter.paint(view_of((0.1, 0.04, 0.0))).astype(int)
    drawn = painter.paint(view_of((0.1, 0.04, 0.0), trails=[trail])).astype(int)
    depth = [(plain - drawn)[pixel(x, 0.117)].mean() for x in (0.15, 0.4, 0.65)]
    assert 0.0 < depth[0] < depth[1] < depth[2]


def test_extreme_states_can_be_drawn(painter):
    nothing = painter.paint(view_of((np.nan, 0.1, 0.0)))
    for pose in ((np.inf, 0.0, 0.0), (1e12, 0.0, 0.0), (-3.0, 0.1, 0.0)):
        np.testing.assert_array_equal(painter.paint(view_of(pose)), nothing)
    trail = np.array([[0.1, 0.1], [np.nan, 0.1], [1e9, 0.1], [0.2, 0.1]])
    far = painter.paint(view_of((0.83, 0.2, 1.0), trails=[trail], goals=np.full((1, 3), np.nan), phasors=REST + np.nan))
    assert far.shape == nothing.shape


@pytest.mark.parametrize(("rows", "columns", "scale"), [(1, 1, None), (3, 4, 700.0), (40, 8, None), (8, 32, 433.7)])
def test_any_table_has_a_picture(rows, columns, scale):
    painter = SurfacePainter(rows, columns, ELEMENT, [BLOCK], pixels_per_metre=scale)
    phasors = np.full((rows, columns, 2), 0.6)
    pose = np.array([[0.5 * columns * ELEMENT, 0.5 * rows * ELEMENT, 0.3]])
    picture = painter.paint(View(pose, phasors, pose, 0.002, [np.zeros((1, 2))], caption="caption"))
    assert picture.shape == (painter.height, painter.width, 3)
    assert painter.width % 2 == 0 and painter.height % 2 == 0


def test_each_part_has_a_line_in_its_colour():
    painter = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK] * 2, kinds=[0, 1])
    paths = [np.array([[0.1, 0.05], [0.3, 0.05]]), np.array([[0.4, 0.15], [0.6, 0.15]])]
    lost = np.full((2, 3), np.nan)
    plain = painter.paint(dataclasses.replace(EMPTY, pose=lost)).astype(int)
    drawn = painter.paint(dataclasses.replace(EMPTY, pose=lost, paths=paths)).astype(int)
    changed = (plain != drawn).any(axis=-1)
    for path, kind in zip(paths, (0, 1), strict=True):
        middle = pixel(*path.mean(axis=0))
        colour = np.array(colours.PARTS[kind])
        # On a pixel of the line or next to it, since it is thin.
        near = drawn[middle[0] - 1 : middle[0] + 2, middle[1]]
        before = plain[middle[0] - 1 : middle[0] + 2, middle[1]]
        assert np.abs(near - colour).sum(axis=-1).min() < 0.7 * np.abs(before - colour).sum(axis=-1).min()
    assert not changed[pixel(0.35, 0.1)] and not changed[pixel(0.2, 0.1)]
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows.min() >= pixel(0.5, 0.15)[0] - 4 and rows.max() <= pixel(0.2, 0.05)[0] + 4
