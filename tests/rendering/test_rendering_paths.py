"""Paths in pictures: sampled pixels, not whole images."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("pygame")

from tests.rendering.test_rendering_painter import BLOCK, COLUMNS, ELEMENT, EMPTY, ROWS, pixel
from vibgym.rendering import SurfacePainter, colours

PATHS = [np.array([[0.1, 0.05], [0.3, 0.05]]), np.array([[0.4, 0.15], [0.6, 0.15]])]
LOST = np.full((2, 3), np.nan)


@pytest.fixture(scope="module")
def painter():
    return SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK] * 2, kinds=[0, 1])


def test_each_part_has_a_line_in_its_colour(painter):
    plain = painter.paint(dataclasses.replace(EMPTY, pose=LOST)).astype(int)
    drawn = painter.paint(dataclasses.replace(EMPTY, pose=LOST, paths=PATHS)).astype(int)
    changed = (plain != drawn).any(axis=-1)
    for path, kind in zip(PATHS, (0, 1), strict=True):
        middle = pixel(*path.mean(axis=0))
        colour = np.array(colours.PARTS[kind])
        # On a pixel of the line or beside it, since it is thin.
        near = drawn[middle[0] - 1 : middle[0] + 2, middle[1]]
        before = plain[middle[0] - 1 : middle[0] + 2, middle[1]]
        assert np.abs(near - colour).sum(axis=-1).min() < 0.7 * np.abs(before - colour).sum(axis=-1).min()
    assert not changed[pixel(0.35, 0.1)] and not changed[pixel(0.2, 0.1)]
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows.min() >= pixel(0.5, 0.15)[0] - 4 and rows.max() <= pixel(0.2, 0.05)[0] + 4
