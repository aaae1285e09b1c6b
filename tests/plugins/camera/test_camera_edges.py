"""Sub-pixel edges: centroids and axes from grey levels, also where another object is near."""

import numpy as np
import pytest

from vibgym.plugins.camera.calibration import find_marks
from vibgym.plugins.camera.edges import Grey
from vibgym.plugins.camera.objects import Interest


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
    alone = [centroids(each, reach=3)[0] for each in (left, right)]
    places = places[np.argsort(places[:, 0])]
    assert places == pytest.approx(np.array(alone), abs=0.02)
