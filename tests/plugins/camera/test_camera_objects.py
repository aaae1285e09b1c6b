"""Objects, runs and moments against scikit-image; sub-pixel edges: centroids from grey levels."""

import numpy as np
import pytest
from skimage.draw import polygon2mask
from skimage.measure import label, regionprops

from vibgym.plugins.camera.calibration import find_marks
from vibgym.plugins.camera.edges import Grey
from vibgym.plugins.camera.objects import Interest, area_of_interest, find, new_found

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
    objects = new_found(grey.shape, most)
    find(grey, whole() if interest is None else interest, objects)
    return objects


@pytest.mark.parametrize("seed", range(4))
def test_labels_and_moments_are_those_of_scikit_image(seed):
    grey = blobs(seed)
    objects, expected = found_in(grey), label(grey < 100, connectivity=1)
    assert objects.count[0] == expected.max() > 10
    pairs = set(zip(objects.label.ravel().tolist(), expected.ravel().tolist()))
    assert len(pairs) == expected.max() + 1 and (0, 0) in pairs  # one to one
    for region in regionprops(expected):
        line, column = region.coords[0]
        number = objects.label[line, column] - 1
        m00, m10, m01, m20, m11, m02 = objects.moment[number]
        assert m00 == region.area and (m01 / m00, m10 / m00) == pytest.approx(region.centroid)
        u, v = m10 / m00, m01 / m00
        central = region.moments_central  # [line order, column order]
        scale = max(central[0, 2], central[2, 0], 1.0)
        assert m20 - u * m10 == pytest.approx(central[0, 2], abs=1e-7 * scale)
        assert m11 - u * m01 == pytest.approx(central[1, 1], abs=1e-7 * scale)
        assert m02 - v * m01 == pytest.approx(central[2, 0], abs=1e-7 * scale)
        top, left, bottom, right = region.bbox
        assert objects.box[number].tolist() == [top, bottom, left, right]
        assert objects.clipped[number] == (top == 0 or left == 0 or bottom == SHAPE[0] or right == SHAPE[1])


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
    inside = (np.arange(SHAPE[1]) >= first[:, None]) & (np.arange(SHAPE[1]) <= last[:, None])
    assert (inside != polygon2mask(SHAPE, places[:, ::-1])).sum() <= 4  # centres on the border
    grey = np.full(SHAPE, 200, np.uint8)
    grey[30:40, 50:60] = grey[40:50, :40] = grey[2:5, 2:5] = 20
    objects = found_in(grey, whole()._replace(first=first, last=last))
    assert objects.count[0] == 2 and sorted(objects.clipped[:2].tolist()) == [False, True]


# -- sub-pixel edges -----------------------------------------------------------------------------------------------------


def coverage(lines, columns, centre, angle, size, fine=32):
    """Share of every pixel within a rectangle, by many points in each."""
    step = (np.arange(fine) + 0.5) / fine - 0.5
    y = (np.arange(lines)[:, None] + step).ravel()
    x = (np.arange(columns)[:, None] + step).ravel()
    dx, dy = x - centre[0], y[:, None] - centre[1]
    along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
    inside = (np.abs(along) < size[0] / 2) & (np.abs(across) < size[1] / 2)
    return inside.reshape(lines, fine, columns, fine).mean(axis=(1, 3))


def centroids(share, level=200.0, fine=True, reach=2):
    grey = np.floor(level * (1.0 - 0.8 * share) + 0.5).astype(np.uint8)
    lines, columns = grey.shape
    interest = Interest(np.zeros(lines, int), np.full(lines, columns - 1), 0.6 * 200.0, 1, 1, 4)
    meaning = Grey(np.broadcast_to(np.float32(level), grey.shape).astype(np.float32), 0.8, reach, reach, fine)
    return find_marks(grey, interest, meaning, 10)


def test_grey_levels_are_far_more_accurate_than_whole_pixels():
    random, errors = np.random.default_rng(1), {True: [], False: []}
    for _ in range(25):
        centre, angle = 20.0 + random.random(2), random.uniform(-np.pi, np.pi)
        share = coverage(42, 42, centre, angle, (20.0, 12.0))
        for fine, kept in errors.items():
            kept.append(centroids(share, fine=fine)[0] - centre)
    assert np.std(errors[True]) < 0.005 and 0.02 < np.std(errors[False]) < 0.08


@pytest.mark.parametrize("gap", [2.0, 3.0, 5.0])
def test_a_neighbour_does_not_count(gap):
    """Two adjacent rectangles with overlapping bands."""
    left = coverage(30, 60, (15.3, 14.7), 0.0, (20.0, 12.0))
    right = coverage(30, 60, (15.3 + 20.0 + gap, 14.7), 0.0, (20.0, 12.0))
    places = centroids(left + right, reach=3)
    alone = [centroids(share, reach=3)[0] for share in (left, right)]
    places = places[np.argsort(places[:, 0])]
    assert places == pytest.approx(np.array(alone), abs=0.02)
