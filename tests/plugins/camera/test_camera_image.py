"""Images: coverage of pixels against shapely, position, blur and noise."""

import numpy as np
import pytest
import shapely

from tests.plugins.camera.helpers import QUIET, camera, setup, state_of
from vibgym import Part
from vibgym.kernels.jit import jit
from vibgym.plugins.camera.image import add_polygon, blur_weights, normal_quantiles, weights_variance
from vibgym.plugins.camera.optics import projected
from vibgym.scene.parts import shipped_part

BLOCK = shipped_part("aluminium_block")
POSE = [[[0.31, 0.09, 0.4]]]


def picture(pose=POSE, parts=(BLOCK,), **settings):
    return camera(list(parts), pose, **settings).image()[0]


def seen_polygon(setup, part, pose, points=40):
    """Return the outline of the part's top in pixels, with finely divided edges."""
    t = np.linspace(0.0, 1.0, points, endpoint=False)[:, None]
    sides = [a + t * (b - a) for a, b in zip(part.outline, np.roll(part.outline, -1, axis=0))]
    outline = np.concatenate(sides)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    place = outline @ np.array([[c, s], [-s, c]]) + pose[:2]
    return projected(setup.optics, np.column_stack([place, np.full(len(place), part.height)]))


@pytest.mark.parametrize("lines", ["all", "half"])
def test_pixels_show_their_coverage(lines):
    """Through perspective and a barrel distortion of 5 %, against shapely's intersections with a finely cut outline."""
    settings = QUIET | {"distortion": -0.05, "lines": lines}
    image, known = picture([[[0.75, 0.06, 0.4]]], **settings), setup([BLOCK], **settings)
    polygon = shapely.Polygon(seen_polygon(known, BLOCK, [0.75, 0.06, 0.4]))
    left, top, right, bottom = (int(side) for side in polygon.bounds)
    worst = 0.0
    for line in range(top - 1, bottom + 2):
        for column in range(left - 1, right + 2):
            pixel = shapely.box(column - 0.5, line - 0.5, column + 0.5, line + 0.5)
            expected = 200.0 - 160.0 * polygon.intersection(pixel).area
            worst = max(worst, abs(image[line, column] - expected))
    assert worst < 0.5 + 160 * 0.005  # rounding to whole grey levels, and pieces that are straight


def test_noise_has_its_deviation_and_is_independent():
    image = picture(noise=3.0, light=0.0, lines="all").astype(float)
    patch = image[240:330, 400:700]  # bare surface
    assert patch.std() == pytest.approx(np.sqrt(9.0 + 1.0 / 12.0), rel=0.02)
    patch = patch - patch.mean()
    for shifted in (patch[1:] * patch[:-1], patch[:, 1:] * patch[:, :-1]):
        assert abs(shifted.mean()) < 0.02 * patch.var()
    assert normal_quantiles().std() == pytest.approx(1.0, abs=1e-3) and abs(normal_quantiles().mean()) < 1e-6


def test_blur_conserves_light():
    sharp, blurred = (picture(**QUIET | {"blur": blur}, lines="all").astype(float) for blur in (0.0, 1.5))
    inside = np.s_[255:345, 200:360]  # around the part
    assert (200 - blurred[inside]).sum() == pytest.approx((200 - sharp[inside]).sum(), rel=2e-3)
    assert np.abs(blurred - sharp).max() > 20
    assert blur_weights(0.0).tolist() == [1.0] and blur_weights(1.5).sum() == pytest.approx(1.0)
    assert weights_variance(blur_weights(1.5)) == pytest.approx(1.5**2 + 1 / 12, rel=0.06)  # cut off at three sigma


def test_half_the_lines_are_two_and_two_together():
    full, half = (picture(**QUIET, lines=lines).astype(float) for lines in ("all", "half"))
    assert half.shape == (285, 752)
    middle = np.s_[105:180, 20:730]  # well within the surface
    assert half[middle].min() == 40 and np.abs(half - 0.5 * (full[::2] + full[1::2]))[middle].max() <= 1.0


def test_odd_lines_of_an_interlaced_image_are_from_half_a_period_before():
    sensor = camera([BLOCK], POSE, **QUIET, lines="interlaced")
    velocity = np.array([[[0.25, -0.1, 0.5]]])
    sensor.sample(state_of(POSE, velocity))
    image = sensor.image()[0]
    now = picture(**QUIET, lines="all")
    before = picture(np.array(POSE) - 0.02 * velocity, **QUIET, lines="all")
    assert (image[::2] == now[::2]).all() and (image[1::2] == before[1::2]).all() and (now != before).any()


def test_parts_of_different_height_are_drawn_at_their_heights():
    low, high = (Part.rectangle(0.05, 0.03, friction=0.5, mass=0.1, height=height) for height in (0.004, 0.040))
    at, absent = [0.15, 0.05, 0.4], [-1.0, -1.0, 0.0]
    for part, order in ((low, (high, low)), (high, (low, high))):
        alone = picture([[at]], (part,), **QUIET)
        assert (picture([[absent, at]], order, **QUIET) == alone).all()
    assert (picture([[at]], (low,), **QUIET) != picture([[at]], (high,), **QUIET)).any()


# -- coverage ------------------------------------------------------------------------------------------------------------


@jit
def covered(corners: np.ndarray, left: int, top: int, cover: np.ndarray) -> None:
    add_polygon(corners, corners.shape[0], left, top, cover)


def check(corners, left=0, top=0, size=12):
    cover = np.zeros((size, size))
    covered(np.array(corners, dtype=float), left, top, cover)
    polygon = shapely.Polygon(corners)
    for line, column in np.ndindex(size, size):
        pixel = shapely.box(left + column - 0.5, top + line - 0.5, left + column + 0.5, top + line + 0.5)
        assert cover[line, column] == pytest.approx(polygon.intersection(pixel).area, abs=1e-12)


def test_random_polygons_of_either_sense():
    random = np.random.default_rng(3)
    for k in range(12):
        angle = np.sort(random.uniform(0, 2 * np.pi, 3 + k)) * (1 if k % 2 else -1)
        radius = random.uniform(1.0, 4.0, 3 + k)
        check(np.column_stack([5.3 + radius * np.cos(angle), 5.1 + radius * np.sin(angle)]))


def test_polygons_that_are_not_convex_and_elsewhere():
    notched = [[103.2, 54.1], [108.9, 54.3], [108.7, 60.2], [106.1, 56.0], [103.4, 60.4]]
    check(notched, 100, 50)


@pytest.mark.parametrize("corners", [
    [[2.5, 2.5], [5.5, 2.5], [5.5, 6.5], [2.5, 6.5]],  # on borders of pixels
    [[2.0, 2.0], [6.0, 2.0], [6.0, 2.0], [6.0, 5.0], [2.0, 5.0]],  # through centres, with a corner twice
    [[2.5, 2.5], [6.5, 6.5], [2.5, 6.5]],
    [[3.1, 3.1], [3.2, 3.1], [3.15, 3.2]],  # within one pixel
    [[1.0, 4.999999999], [9.0, 5.0], [9.0, 5.000000001]],  # a sliver
])  # fmt: skip
def test_borders_and_slivers(corners):
    check(corners)
