"""Gaps that parts bridge, against closed forms."""

import math

import numpy as np
import pytest

from vibgym import Part
from vibgym.scene.support import bridged_gap

RESOLUTION = 0.026 / 2**8


def test_a_disc_at_crossings_bridges_less_than_its_radius():
    assert bridged_gap(Part.disc(0.02, friction=0.5), 0.026) == pytest.approx(0.04 / math.sqrt(5.0), abs=RESOLUTION)


@pytest.mark.parametrize(("length", "width"), [(0.05, 0.035), (0.04, 0.01)])
def test_a_rectangle_bridges_half_its_width(length, width):
    part = Part.rectangle(length, width, friction=0.5)
    assert bridged_gap(part, 0.026) == pytest.approx(0.5 * width, abs=RESOLUTION)
    assert bridged_gap(Part.rectangle(4 * length, 6 * width, friction=0.5), 0.026) == 0.026


def test_holes_take_support_away():
    """A frame whose sides are half as wide as a gap stands on its corners, but not on the strip of a side that is left."""
    outer = np.array([[0.0, 0.0], [0.06, 0.0], [0.06, 0.06], [0.0, 0.06]])
    full, frame = (Part.polygon(outer, holes=holes, friction=0.5) for holes in ([], [0.9 * outer + 0.003]))
    assert bridged_gap(frame, 0.026) <= bridged_gap(full, 0.026) == 0.026
    # A triangle is supported as far as its nearest edge.
    triangle = Part.polygon([[0.0, 0.0], [0.06, 0.0], [0.0, 0.06]], friction=0.5)
    assert bridged_gap(triangle, 0.026) == pytest.approx(0.02 / math.sqrt(2.0), abs=2 * RESOLUTION)
