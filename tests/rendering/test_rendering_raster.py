"""The image observation's rasteriser against a point-in-polygon test of every pixel centre, and polygon areas."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibgym.rendering import Marks, rasterise

ROWS, COLUMNS, ELEMENT, PIXELS = 8, 32, 0.026, 8
PIXEL = ELEMENT / PIXELS
BLOCK = np.array([[-25.0, -17.5], [25.0, -17.5], [25.0, 17.5], [-25.0, 17.5]]) * 1e-3
ELL = np.array([[-20.0, -18.0], [40.0, -18.0], [40.0, 2.0], [0.0, 2.0], [0.0, 32.0], [-20.0, 32.0]]) * 1e-3
HEIGHT, WIDTH = ROWS * PIXELS, COLUMNS * PIXELS
ZONES = np.array([[0.0, 0.0, 5 * ELEMENT, ROWS * ELEMENT], [27 * ELEMENT, 0.0, COLUMNS * ELEMENT, ROWS * ELEMENT]])


def star(points, inner, radius=0.04):
    angle = np.arange(2 * points) * np.pi / points
    length = np.where(np.arange(2 * points) % 2 == 0, radius, inner * radius)
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


OUTLINES = [BLOCK, ELL, 1.2 * BLOCK[::-1], star(5, 0.4)]
VALUES = [40, 90, 40, 255]


def draw(pose, outlines=OUTLINES, value=VALUES, present=None, zones=ZONES[:0], zone_value=(), pixels=PIXELS):
    """Images (worlds, H, W, 3) of parts at ``pose`` (worlds, parts, 3); what was in the image before is noise."""
    pose = np.ascontiguousarray(pose, dtype=float)
    shape = (len(pose), ROWS * pixels, COLUMNS * pixels, 3)
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    marks = Marks(
        outline=np.concatenate(list(outlines)),
        first=np.cumsum([0, *(len(outline) for outline in outlines)]).astype(np.int64),
        kind=np.arange(len(outlines))[None],
        value=np.array(value, dtype=np.uint8),
        zone=zones,
        zone_value=np.array(zone_value, dtype=np.uint8),
    )
    present = np.ones(pose.shape[:2], dtype=bool) if present is None else present
    goal, goal_value = np.zeros_like(pose), np.zeros(pose.shape[:2], dtype=np.uint8)
    rasterise(pose, present, goal, goal_value, marks, ROWS, COLUMNS, ELEMENT, pixels, image)
    return image


@pytest.mark.parametrize("outline", [BLOCK, ELL, star(5, 0.4), star(32, 1.0)], ids=["block", "ell", "star", "disc"])
@pytest.mark.parametrize("pixels, heading", [(2, 0.3), (8, np.pi / 2), (16, -2.5)])
def test_area_is_that_of_the_polygon(outline, heading, pixels):
    """Only pixels on the border may be wrong, with errors of both signs."""
    image = draw([[[0.4, 0.1, heading]]], [outline], [255], pixels=pixels)[0]
    x, y = outline.T
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    perimeter = np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum()
    pixel = ELEMENT / pixels
    assert abs(np.count_nonzero(image[..., 0]) * pixel**2 - area) <= 0.5 * pixel * perimeter
    assert set(np.unique(image[..., 0])) <= {0, 255}


def inside(points, outline):
    """Return whether points (..., 2) are inside, by ray casting with the even-odd rule."""
    x, y = points[..., 0], points[..., 1]
    odd = np.zeros(x.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            right = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        odd ^= ((y0 > y) != (y1 > y)) & right
    return odd


def centres():
    """Return x and y of every pixel's centre, (H, W), m."""
    return np.meshgrid((np.arange(WIDTH) + 0.5) * PIXEL, (HEIGHT - np.arange(HEIGHT) - 0.5) * PIXEL)


def expected(pose, outlines, value):
    """Return channels 0 and 2 (H, W, 2) of one world, and which pixels are certain (H, W)."""
    x, y = centres()
    even = (np.floor(x / ELEMENT) + np.floor(y / ELEMENT)) % 2 == 0
    picture = np.stack([np.zeros((HEIGHT, WIDTH)), np.where(even, 64, 128)], axis=-1)
    sure = np.ones((HEIGHT, WIDTH), dtype=bool)
    grid = picture[..., 1].copy()
    for (at_x, at_y, heading), outline, shade in zip(pose, outlines, value, strict=True):
        cosine, sine = np.cos(heading), np.sin(heading)
        local = np.stack([cosine * (x - at_x) + sine * (y - at_y), cosine * (y - at_y) - sine * (x - at_x)], axis=-1)
        own = inside(local, outline)
        # Corners are rounded to 1/1024 pixel; leave out centres that close to a border.
        sure &= inside(1.002 * local, outline) == inside(0.998 * local, outline)
        half = 0.15 * np.hypot(*outline.T).max()
        sure &= ~own | (np.minimum(np.abs(local[..., 0]), np.abs(np.abs(local[..., 1]) - half)) > 1e-6)
        mark = (local[..., 0] > 0.0) & (np.abs(local[..., 1]) < half)
        picture[own, 0] = shade
        picture[own, 1] = np.where(mark, 255, grid)[own]
    return picture, sure


def assert_as_expected(image, pose, outlines, value):
    picture, sure = expected(pose, outlines, value)
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(image[sure][:, [0, 2]], picture[sure])


POSE = st.tuples(st.floats(-0.05, 0.9), st.floats(-0.05, 0.25), st.floats(-4.0, 4.0))
FAR = (0.7, 0.1, 0.0)


@settings(deadline=None, max_examples=60)
@given(st.lists(POSE, min_size=len(OUTLINES), max_size=len(OUTLINES)))
@example([(0.4, 0.1, 0.0), FAR, (0.43, 0.103, 0.2), FAR])  # overlap: the later part is on top
@example([(0.4, 0.1, 0.0), (0.4, 0.1, np.pi), (0.42, 0.1, np.pi), FAR])  # the wedge of the first points into the others
@example([(0.0, 0.1, 0.0), (0.82, 0.2, 1.0), FAR, FAR])  # over the border
def test_pixels_are_those_with_their_centre_inside(poses):
    image = draw([poses])[0]
    assert_as_expected(image, np.array(poses), OUTLINES, VALUES)
    assert not image[..., 1].any()


def test_absent_and_lost_parts_are_not_drawn():
    rng = np.random.default_rng(3)
    pose = rng.uniform([0.1, 0.05, -3.0], [0.7, 0.15, 3.0], (16, 4, 3))
    present = rng.random((16, 4)) < 0.5
    image = draw(pose, present=present)
    lost = pose.copy()
    lost[~present] = rng.choice([np.nan, np.inf, 1e300, -5.0], ((~present).sum(), 1))
    np.testing.assert_array_equal(draw(lost), image)
    for world in range(16):
        there = np.flatnonzero(present[world])
        assert set(np.unique(image[world, ..., 0])) <= {0, *(VALUES[part] for part in there)}
        assert_as_expected(image[world], pose[world, there], [OUTLINES[k] for k in there], [VALUES[k] for k in there])
    assert not draw(pose, present=np.zeros((16, 4), dtype=bool))[..., 0].any()


def test_zones_fill_their_elements_and_only_channel_1():
    pose = np.array([[[0.05, 0.1, 0.3]], [[0.4, 0.1, 0.3]]])
    image = draw(pose, [BLOCK], [255], zones=ZONES, zone_value=[100, 200])
    plain = draw(pose, [BLOCK], [255])
    np.testing.assert_array_equal(image[..., [0, 2]], plain[..., [0, 2]])
    wanted = np.zeros((HEIGHT, WIDTH))
    wanted[:, : 5 * PIXELS] = 100
    wanted[:, 27 * PIXELS :] = 200
    np.testing.assert_array_equal(image[..., 1], np.broadcast_to(wanted, image.shape[:3]))
