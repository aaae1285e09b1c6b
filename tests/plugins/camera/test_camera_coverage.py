"""Coverage of pixels against shapely's intersections."""

import numpy as np
import pytest
import shapely

from vibgym.kernels.jit import jit
from vibgym.plugins.camera.image import add_polygon


@jit
def covered(corners: np.ndarray, left: int, top: int, cover: np.ndarray) -> None:
    add_polygon(corners, corners.shape[0], left, top, cover)


def check(corners, left=0, top=0, size=12):
    cover = np.zeros((size, size))
    covered(np.array(corners, dtype=float), left, top, cover)
    polygon = shapely.Polygon(corners)
    for line in range(size):
        for column in range(size):
            pixel = shapely.box(left + column - 0.5, top + line - 0.5, left + column + 0.5, top + line + 0.5)
            assert cover[line, column] == pytest.approx(polygon.intersection(pixel).area, abs=1e-12)
    return cover


def test_random_polygons_of_either_sense():
    random = np.random.default_rng(3)
    for k in range(12):
        angle = np.sort(random.uniform(0, 2 * np.pi, 3 + k)) * (1 if k % 2 else -1)
        radius = random.uniform(1.0, 4.0, 3 + k)
        check(np.column_stack([5.3 + radius * np.cos(angle), 5.1 + radius * np.sin(angle)]))


def test_polygons_that_are_not_convex_and_elsewhere():
    notched = [[103.2, 54.1], [108.9, 54.3], [108.7, 60.2], [106.1, 56.0], [103.4, 60.4]]
    cover = check(notched, 100, 50)
    assert cover.sum() == pytest.approx(shapely.Polygon(notched).area)


@pytest.mark.parametrize("corners", [
    [[2.5, 2.5], [5.5, 2.5], [5.5, 6.5], [2.5, 6.5]],  # on borders of pixels
    [[2.0, 2.0], [6.0, 2.0], [6.0, 2.0], [6.0, 5.0], [2.0, 5.0]],  # through centres, with a corner twice
    [[2.5, 2.5], [6.5, 6.5], [2.5, 6.5]],
    [[3.1, 3.1], [3.2, 3.1], [3.15, 3.2]],  # within one pixel
    [[1.0, 4.999999999], [9.0, 5.0], [9.0, 5.000000001]],  # a sliver
])  # fmt: skip
def test_borders_and_slivers(corners):
    check(corners)
