"""The image observation's rasteriser against polygon areas, symmetry and a plain point-in-polygon test."""

import numpy as np
import pytest

from vibgym.rendering import Marks, rasterise

ROWS, COLUMNS, ELEMENT, PIXELS = 8, 32, 0.026, 8
PIXEL = ELEMENT / PIXELS
BLOCK = np.array([[-25.0, -17.5], [25.0, -17.5], [25.0, 17.5], [-25.0, 17.5]]) * 1e-3
ELL = np.array([[-20.0, -18.0], [40.0, -18.0], [40.0, 2.0], [0.0, 2.0], [0.0, 32.0], [-20.0, 32.0]]) * 1e-3


def star(points, inner, radius=0.04):
    angle = np.arange(2 * points) * np.pi / points
    length = np.where(np.arange(2 * points) % 2 == 0, radius, inner * radius)
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rasterised(
    pose, outlines, value, present=None, goal=None, goal_value=None, zone=None, zone_value=(), pixels=PIXELS
):
    """Images (worlds, H, W, 3) of parts at ``pose`` (worlds, parts, 3); what was in the image before is noise."""
    shape = (len(pose), ROWS * pixels, COLUMNS * pixels, 3)
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    marks = Marks(
        outline=np.concatenate(list(outlines)),
        first=np.cumsum([0, *(len(outline) for outline in outlines)]).astype(np.int64),
        kind=np.arange(len(outlines))[None],
        value=np.array(value, dtype=np.uint8),
        zone=np.zeros((0, 4)) if zone is None else zone,
        zone_value=np.array(zone_value, dtype=np.uint8),
    )
    rasterise(
        np.ascontiguousarray(pose),
        np.ones(pose.shape[:2], dtype=bool) if present is None else present,
        np.zeros_like(pose) if goal is None else goal,
        np.zeros(pose.shape[:2], dtype=np.uint8) if goal_value is None else goal_value,
        marks,
        ROWS,
        COLUMNS,
        ELEMENT,
        pixels,
        image,
    )
    return image


def draw(pose, outline=BLOCK, goal=None, goal_value=None, pixels=PIXELS):
    """Images of one part with the value 255 at ``pose``, (3,) or (worlds, 3), and of its goal."""
    poses = np.atleast_2d(np.array(pose, dtype=np.float64))[:, None]
    goals = None if goal is None else np.atleast_2d(np.array(goal, dtype=np.float64))[:, None]
    values = None if goal_value is None else np.array(goal_value, dtype=np.uint8)[:, None]
    return rasterised(poses, [outline], [255], goal=goals, goal_value=values, pixels=pixels)


def area_of(outline):
    x, y = outline.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def perimeter_of(outline):
    return float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())


def assert_area(image, outline, pixel):
    """Only pixels on the border may be wrong, with errors of both signs."""
    area = np.count_nonzero(image[..., 0]) * pixel**2
    assert abs(area - area_of(outline)) <= 0.5 * pixel * perimeter_of(outline)
    assert set(np.unique(image[..., 0])) <= {0, 255}


@pytest.mark.parametrize("outline", [BLOCK, BLOCK[::-1], ELL, star(5, 0.4), star(32, 1.0)])
@pytest.mark.parametrize("heading", [0.0, 0.3, np.pi / 2, -2.5])
@pytest.mark.parametrize("pixels", [2, 8, 16])
def test_area_is_that_of_the_polygon(outline, heading, pixels):
    image = draw([0.4, 0.1, heading], np.ascontiguousarray(outline), pixels=pixels)[0]
    assert_area(image, outline, ELEMENT / pixels)


def inside(points, outline):
    """Return whether points (..., 2) are inside, by ray casting with the even-odd rule."""
    x, y = points[..., 0], points[..., 1]
    odd = np.zeros(x.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            right = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        odd ^= ((y0 > y) != (y1 > y)) & right
    return odd


@pytest.mark.parametrize("pose", [(0.2, 0.1, 0.7), (0.208, 0.104, 0.0), (0.1931, 0.0957, -2.2)])
@pytest.mark.parametrize("step", [(1, 0), (0, 1), (-2, 1), (5, -1)])
def test_moving_by_whole_elements_moves_pixels(pose, step):
    moved = (pose[0] + step[0] * ELEMENT, pose[1] + step[1] * ELEMENT, pose[2])
    before, after = draw(pose)[0], draw(moved)[0]
    expected = np.roll(before, (-step[1] * PIXELS, step[0] * PIXELS), axis=(0, 1))
    np.testing.assert_array_equal(after[..., 0], expected[..., 0])
    np.testing.assert_array_equal(after[..., 2] == 255, expected[..., 2] == 255)


def test_row_0_is_the_top_and_the_mark_points_ahead():
    image = draw([0.1, 0.18, np.pi / 2])[0]
    rows, columns = np.nonzero(image[..., 0])
    assert abs(rows.mean() + 0.5 - (0.208 - 0.18) / PIXEL) < 0.5
    assert abs(columns.mean() + 0.5 - 0.1 / PIXEL) < 0.5
    mark_rows, mark_columns = np.nonzero(image[..., 2] == 255)
    assert mark_rows.mean() < rows.mean() - 2.0
    assert abs(mark_columns.mean() - columns.mean()) < 0.5


def test_overhanging_part_is_cut_at_the_border():
    image = draw([0.0, 0.1, 0.0])[0]
    rows, columns = np.nonzero(image[..., 0])
    assert columns.min() == 0
    assert abs(len(rows) * PIXEL**2 - 0.5 * area_of(BLOCK)) < 0.5 * PIXEL * perimeter_of(BLOCK)
