"""The picture agrees with the view, by sampled pixels: parts, arrows, goals, paths, trails, zones and walls."""

import dataclasses
import pickle
from functools import partial

import numpy as np
import pytest

pygame = pytest.importorskip("pygame")

from vibgym.rendering import Scenery, SurfacePainter, View, Zone, colours  # noqa: E402

ROWS, COLUMNS, ELEMENT = 8, 32, 0.026
BLOCK = np.array([[-25.0, -17.5], [25.0, -17.5], [25.0, 17.5], [-25.0, 17.5]]) * 1e-3
MARGIN, PER_ELEMENT = 20, 30
REST = np.zeros((ROWS, COLUMNS, 2))
EMPTY = View(np.zeros((0, 3)), REST)
WIDTH, HEIGHT = COLUMNS * ELEMENT, ROWS * ELEMENT
ZONES = (Zone((0.0, 0.0), (5 * ELEMENT, HEIGHT), 0, "50 x 40"), Zone((27 * ELEMENT, 0.0), (WIDTH, HEIGHT), 1))
POSES = np.array([[0.2, 0.05, 0.0], [0.3, 0.15, 0.0], [0.45, 0.05, 0.0], [0.6, 0.15, 0.0]])


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


def paint(painter, **changes):
    return painter.paint(dataclasses.replace(EMPTY, **changes)).astype(int)


def test_size_and_freshness(painter):
    first = painter.paint(view_of((0.4, 0.1, 0.0)))
    copy = first.copy()
    second = painter.paint(view_of((0.2, 0.1, 0.0)))
    assert first.shape == (painter.height, painter.width, 3) and painter.width == 1000
    assert first.dtype == np.uint8 and first.flags.writeable and first.flags.c_contiguous
    np.testing.assert_array_equal(first, copy)
    assert (first != second).any()


@pytest.mark.parametrize("heading", [0.6, -2.0])
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


@pytest.mark.parametrize("phase", np.radians([0.0, 90.0, 225.0]).tolist())
def test_arrow_points_where_the_element_pushes(bare, phase):
    phasors = REST.copy()
    phasors[3, 10] = np.cos(phase), np.sin(phase)
    picture = bare.paint(dataclasses.replace(EMPTY, phasors=phasors))
    row, column = pixel(10.5 * ELEMENT, 3.5 * ELEMENT)
    tile = picture[row - 14 : row + 15, column - 14 : column + 15].astype(float)
    darkness = (0.6 * tile.max() - tile.mean(axis=-1)).clip(0.0)
    down, right = np.meshgrid(np.arange(-14, 15), np.arange(-14, 15), indexing="ij")
    arrow = np.array([(darkness * right).sum(), -(darkness * down).sum()]) / darkness.sum()
    push = np.array([-np.sin(phase), -np.cos(phase)])
    assert arrow @ push > 4.0
    assert abs(arrow[0] * push[1] - arrow[1] * push[0]) < 1.0


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


def test_moving_goals_are_drawn_at_their_poses(painter):
    for k in range(40):  # more than are kept
        view = view_of((0.4, 0.1, 0.3), goals=np.array([[0.1 + 0.015 * k, 0.1, 0.1 * k]]))
        fresh = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK]).paint(view)
        for _ in range(2):
            np.testing.assert_array_equal(painter.paint(view), fresh)


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
        assert [np.isfinite(points).sum() for points in view.trails] == [8, 0]
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


@pytest.mark.parametrize(("rows", "columns", "scale"), [(1, 1, None), (40, 8, None), (8, 32, 433.7)])
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
    plain, drawn = (paint(painter, pose=np.full((2, 3), np.nan), paths=shown) for shown in ([], paths))
    for path, kind in zip(paths, (0, 1), strict=True):
        row, column = pixel(*path.mean(axis=0))
        # On a pixel of the line or next to it, since it is thin.
        before, near = (picture[row - 1 : row + 2, column] for picture in (plain, drawn))
        colour = np.array(colours.PARTS[kind])
        assert np.abs(near - colour).sum(axis=-1).min() < 0.7 * np.abs(before - colour).sum(axis=-1).min()
    changed = (plain != drawn).any(axis=-1)
    assert not changed[pixel(0.35, 0.1)] and not changed[pixel(0.2, 0.1)]


def test_parts_have_the_colours_of_their_kinds():
    painter = SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK] * 4, kinds=[1, 0, 3, 1])
    picture = paint(painter, pose=POSES)
    for pose, kind in zip(POSES, (1, 0, 3, 1), strict=True):
        assert looks_like(picture, (pose[0] - 0.01, pose[1]), colours.PARTS[kind])
    lost = POSES.copy()
    lost[1, 2] = np.nan
    changed = (paint(painter, pose=POSES) != paint(painter, pose=lost)).any(axis=-1)
    assert changed[pixel(0.29, 0.15)]
    assert not any(changed[pixel(x, y)] for x, y in POSES[[0, 2, 3], :2])


def test_zone_tints_its_elements_and_no_others(bare):
    plain, zoned = paint(bare), paint(bare, zones=ZONES)
    for zone in ZONES:
        colour = np.array(colours.PARTS[zone.kind])
        for at in (0.3, 0.5, 0.7):
            inside = pixel(*(np.array(zone.low) + at * (np.array(zone.high) - zone.low) + 0.3 * ELEMENT))
            change = zoned[inside] - plain[inside]
            towards = colour - plain[inside]
            share = change @ towards / (towards @ towards)
            assert 0.15 < share < 0.6, "a tint that leaves the element's own colour visible"
            np.testing.assert_allclose(change, share * towards, atol=3.0)
    changed = np.flatnonzero((plain != zoned).any(axis=(0, 2)))
    left, right = pixel(5 * ELEMENT, 0.1)[1], pixel(27 * ELEMENT, 0.1)[1]
    assert ((changed <= left + 1) | (changed >= right - 1)).all()
    rows = np.flatnonzero((plain != zoned).any(axis=(1, 2)))
    assert rows.min() >= pixel(0.0, HEIGHT)[0] - 1 and rows.max() <= pixel(0.0, 0.0)[0] + 1


@pytest.mark.parametrize("walls", [("left", "top"), ("right", "bottom"), ("top",)])
def test_walls_are_dark_bars_outside_the_surface(bare, walls):
    plain, picture = paint(bare), paint(SurfacePainter(ROWS, COLUMNS, ELEMENT, [], walls=walls))
    out, along = 0.006, (0.01, 0.5, 0.99)
    sides = {
        "left": [(-out, at * HEIGHT) for at in along], "right": [(WIDTH + out, at * HEIGHT) for at in along],
        "bottom": [(at * WIDTH, -out) for at in along], "top": [(at * WIDTH, HEIGHT + out) for at in along],
    }  # fmt: skip
    for side, points in sides.items():
        for point in points:
            assert looks_like(picture, point, colours.INK) == (side in walls)
            assert not looks_like(plain, point, colours.INK)
    (top, left), (bottom, right) = pixel(0.0, HEIGHT), pixel(WIDTH, 0.0)
    inside = np.s_[top + 1 : bottom - 1, left + 1 : right - 1]
    np.testing.assert_array_equal(picture[inside], plain[inside])
    corners = {("left", "top"): (-out, HEIGHT + out), ("right", "bottom"): (WIDTH + out, -out)}
    assert walls not in corners or looks_like(picture, corners[walls], colours.INK), "walls that meet leave no gap"


def seen(colour, matrix):
    """Return CIELAB of sRGB ``colour`` (..., 3), 0 to 255, under the ``matrix`` of a colour deficiency."""
    share = np.asarray(colour) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    linear = (linear @ matrix.T).clip(0.0, 1.0)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    root = np.cbrt(linear @ to_xyz.T / to_xyz.sum(axis=1))
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116.0 * y, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


# Machado, Oliveira and Fernandes 2009, full severity.
SIGHT = {
    "normal": np.eye(3),
    "no red": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
    "no green": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
    "no blue": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]),
}  # fmt: skip


@pytest.mark.parametrize("matrix", SIGHT.values(), ids=SIGHT.keys())
def test_kinds_are_distinguishable_in_every_kind_of_colour_vision(matrix):
    kinds = seen(np.array(colours.PARTS), matrix)
    between = np.linalg.norm(kinds[:, None] - kinds, axis=-1)
    assert between[~np.eye(len(kinds), dtype=bool)].min() > 20.0
    phase = np.radians(np.arange(0.0, 360.0, 3.0))
    unit = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    tints = np.concatenate([colours.element_colours(amplitude * unit) for amplitude in (0.0, 0.3, 0.6, 1.0)])
    # The last kind is lighter than the field and has only its dark outline on resting elements.
    away = np.linalg.norm(kinds[:-1, None] - seen(tints, matrix), axis=-1)
    assert away.min() > 18.0


@pytest.mark.parametrize(("make", "named"), [
    *((partial(SurfacePainter, ROWS, COLUMNS, ELEMENT, [BLOCK, BLOCK], **arguments), named) for arguments, named in (
        ({"kinds": [0]}, "kinds"), ({"kinds": [0, -1]}, r"kinds\[1\]"), ({"kinds": [0, 1.5]}, r"kinds\[1\]"),
        ({"walls": ["left", "middle"]}, r"walls\[1\]"),
    )),
    (partial(Zone, (0.0, 0.0), (0.1, 0.0), 0), "high"), (partial(Zone, (0.0, np.nan), (0.1, 0.1), 0), "low"),
    (partial(Zone, (0.0, 0.0), (0.1, 0.1, 0.1), 0), "high"), (partial(Zone, (0.0, 0.0), (0.1, 0.1), -1), "kind"),
    (partial(SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK]).paint, View(np.zeros((1, 3)), REST, np.zeros((2, 3)))), "goals"),
])  # fmt: skip
def test_bad_arguments_are_refused(make, named):
    with pytest.raises(ValueError, match=named):
        make()
