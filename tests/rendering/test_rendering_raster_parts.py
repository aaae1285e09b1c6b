"""The rasteriser with several parts, goals and zones against a point-in-polygon test of every pixel centre."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rendering.test_rendering_raster import BLOCK, COLUMNS, ELEMENT, ELL, PIXEL, PIXELS, ROWS, inside, star
from tests.rendering.test_rendering_raster import rasterised as draw

HEIGHT, WIDTH = ROWS * PIXELS, COLUMNS * PIXELS
OUTLINES = [BLOCK, ELL, 1.2 * BLOCK[::-1], star(5, 0.4)]
ZONES = np.array([[0.0, 0.0, 5 * ELEMENT, ROWS * ELEMENT], [27 * ELEMENT, 0.0, COLUMNS * ELEMENT, ROWS * ELEMENT]])


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


@settings(deadline=None, max_examples=60)
@given(st.lists(POSE, min_size=len(OUTLINES), max_size=len(OUTLINES)))
def test_pixels_are_those_with_their_centre_inside(poses):
    value = [40, 90, 40, 255]
    image = draw(np.array([poses]), OUTLINES, value)[0]
    assert_as_expected(image, np.array(poses), OUTLINES, value)
    assert not image[..., 1].any()


@pytest.mark.parametrize("depth", [0.3e-3, 0.01, 0.05])
def test_overlap_leaves_no_holes_and_the_later_part_is_on_top(depth):
    # The first part's wedge points into the second, which must cover it.
    pose = np.array([[0.4, 0.1, 0.0], [0.45 - depth, 0.103, 0.2]])
    together = draw(pose[None], [BLOCK, BLOCK], [60, 200])[0]
    alone = [draw(pose[None, k : k + 1], [BLOCK], [value])[0] for k, value in enumerate((60, 200))]
    np.testing.assert_array_equal(together[..., 0] > 0, (alone[0][..., 0] > 0) | (alone[1][..., 0] > 0))
    second = alone[1][..., 0] > 0
    assert (alone[0][..., 0] > 0)[second].any()
    np.testing.assert_array_equal(together[second], alone[1][second])
    np.testing.assert_array_equal(together[~second], alone[0][~second])


def test_marks_stay_on_their_own_part():
    # The second part is where a longer wedge of the first one would be.
    pose = np.array([[0.4, 0.1, 0.0], [0.426, 0.1, np.pi]])
    image = draw(pose[None], [0.3 * BLOCK, BLOCK], [60, 200])[0]
    rows, columns = np.nonzero(image[..., 2] == 255)
    ahead = (columns + 0.5) * PIXEL < 0.426
    assert ahead.all()
    assert_as_expected(image, pose, [0.3 * BLOCK, BLOCK], [60, 200])


def test_absent_and_lost_parts_are_not_drawn():
    rng = np.random.default_rng(3)
    pose = rng.uniform([0.1, 0.05, -3.0], [0.7, 0.15, 3.0], (16, 4, 3))
    value = [10, 20, 30, 40]
    present = rng.random((16, 4)) < 0.5
    image = draw(pose, OUTLINES, value, present=present)
    lost = pose.copy()
    lost[~present] = rng.choice([np.nan, np.inf, 1e300, -5.0], ((~present).sum(), 1))
    np.testing.assert_array_equal(draw(lost, OUTLINES, value), image)
    for world in range(16):
        there = np.flatnonzero(present[world])
        assert set(np.unique(image[world, ..., 0])) <= {0, *(value[part] for part in there)}
        assert_as_expected(image[world], pose[world, there], [OUTLINES[k] for k in there], [value[k] for k in there])
    assert not draw(pose, OUTLINES, value, present=np.zeros((16, 4), dtype=bool))[..., 0].any()


def test_zones_fill_their_elements_and_only_channel_1():
    pose = np.array([[[0.05, 0.1, 0.3]], [[0.4, 0.1, 0.3]]])
    image = draw(pose, [BLOCK], [255], zone=ZONES, zone_value=[100, 200])
    plain = draw(pose, [BLOCK], [255])
    np.testing.assert_array_equal(image[..., [0, 2]], plain[..., [0, 2]])
    wanted = np.zeros((HEIGHT, WIDTH))
    wanted[:, : 5 * PIXELS] = 100
    wanted[:, 27 * PIXELS :] = 200
    np.testing.assert_array_equal(image[..., 1], np.broadcast_to(wanted, image.shape[:3]))


def test_worlds_do_not_depend_on_each_other():
    pose = np.random.default_rng(5).uniform([0.0, 0.0, -3.0], [0.8, 0.2, 3.0], (8, 4, 3))
    value = [10, 20, 30, 40]
    together = draw(pose, OUTLINES, value, zone=ZONES, zone_value=[1, 2])
    for world in range(8):
        alone = draw(pose[world : world + 1], OUTLINES, value, zone=ZONES, zone_value=[1, 2])
        np.testing.assert_array_equal(together[world], alone[0])
