"""Objects, runs and moments against scikit-image."""

import numpy as np
import pytest
from skimage.measure import label, regionprops

from vibgym.plugins.camera.objects import (
    Interest,
    area_of_interest,
    find,
    new_found,
)

SHAPE = (90, 120)


def whole(step=1, least=1, shape=SHAPE):
    return Interest(np.zeros(shape[0], int), np.full(shape[0], shape[1] - 1), 100.0, step, step, least)


def blobs(seed, share=0.5, scale=6):
    """Random smooth dark patches."""
    random = np.random.default_rng(seed)
    rough = random.random((SHAPE[0] // scale + 2, SHAPE[1] // scale + 2))
    grown = np.kron(rough, np.ones((scale, scale)))[: SHAPE[0], : SHAPE[1]]
    dark = grown + 0.3 * random.random(SHAPE) < share
    return np.where(dark, 30, 220).astype(np.uint8)


def found_in(grey, interest=None, most=400):
    found = new_found(grey.shape, most)
    find(grey, whole() if interest is None else interest, found)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_labels_are_those_of_scikit_image(seed):
    grey = blobs(seed)
    found, expected = found_in(grey), label(grey < 100, connectivity=1)
    assert found.count[0] == expected.max() > 10
    pairs = set(zip(found.label.ravel().tolist(), expected.ravel().tolist()))
    assert len(pairs) == expected.max() + 1 and (0, 0) in pairs  # one to one


@pytest.mark.parametrize("seed", range(4))
def test_moments_are_those_of_scikit_image(seed):
    grey = blobs(seed)
    found = found_in(grey)
    for region in regionprops(label(grey < 100, connectivity=1)):
        line, column = region.coords[0]
        number = found.label[line, column] - 1
        m00, m10, m01, m20, m11, m02 = found.moment[number]
        assert m00 == region.area and (m01 / m00, m10 / m00) == pytest.approx(region.centroid)
        u, v = m10 / m00, m01 / m00
        central = region.moments_central  # [line order, column order]
        scale = max(central[0, 2], central[2, 0], 1.0)
        assert m20 - u * m10 == pytest.approx(central[0, 2], abs=1e-7 * scale)
        assert m11 - u * m01 == pytest.approx(central[1, 1], abs=1e-7 * scale)
        assert m02 - v * m01 == pytest.approx(central[2, 0], abs=1e-7 * scale)
        top, left, bottom, right = region.bbox
        assert found.box[number].tolist() == [top, bottom, left, right]
        assert found.clipped[number] == (top == 0 or left == 0 or bottom == SHAPE[0] or right == SHAPE[1])


def test_a_coarse_grid_finds_every_large_enough_object():
    random = np.random.default_rng(2)
    lines, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    for _ in range(40):
        middle = random.uniform(10, 80, 2)
        grey = np.where(np.hypot(lines - middle[0], columns - middle[1]) < 5.0, 20, 200).astype(np.uint8)
        fine, coarse = found_in(grey), found_in(grey, whole(step=6))  # a square of 6 has a diagonal of 8.5
        assert fine.count[0] == coarse.count[0] == 1 and (fine.moment[0] == coarse.moment[0]).all()


def test_the_area_of_interest_cuts():
    places = np.array([[20.0, 10.0], [100.0, 12.0], [90.0, 70.0], [30.0, 65.0]])
    first, last = area_of_interest(places, SHAPE)
    from skimage.draw import polygon2mask

    inside = (np.arange(SHAPE[1]) >= first[:, None]) & (np.arange(SHAPE[1]) <= last[:, None])
    assert (inside != polygon2mask(SHAPE, places[:, ::-1])).sum() <= 4  # centres on the border
    grey = np.full(SHAPE, 200, np.uint8)
    grey[30:40, 50:60] = grey[40:50, :40] = grey[2:5, 2:5] = 20
    found = found_in(grey, whole()._replace(first=first, last=last))
    assert found.count[0] == 2 and sorted(found.clipped[:2].tolist()) == [False, True]
