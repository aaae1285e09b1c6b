"""Properties of the surface, gaps that parts bridge, and bad input."""

import dataclasses
import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.scene.support import bridged_gap

OMEGA = 2 * math.pi * 25.0


def test_prototype():
    surface = Surface()
    assert (surface.rows, surface.columns) == (8, 32)
    assert (surface.width, surface.depth) == pytest.approx((0.832, 0.208))
    assert surface.period == pytest.approx(0.04)
    assert surface.angular_frequency == pytest.approx(OMEGA)
    assert surface.lift_off_amplitude == pytest.approx(9.81 / OMEGA**2) == surface.max_amplitude
    assert surface.max_amplitude == pytest.approx(0.398e-3, abs=5e-7)
    assert surface.table_speed == pytest.approx(2.7e-3 * OMEGA)
    assert surface.full_scale == pytest.approx(9.81)
    x, y = surface.element_centres()
    assert x.shape == y.shape == (8, 32)
    assert (x[0, 0], y[0, 0], x[7, 31], y[7, 31]) == pytest.approx((0.013, 0.013, 0.819, 0.195))


def test_slides_permanently():
    """a_h w^2 > mu (g + A): 66.6 m/s^2 on the prototype, so up to mu = 3.395 at full amplitude."""
    limit = 2.7e-3 * OMEGA**2 / (2 * 9.81)
    assert limit == pytest.approx(3.3956, abs=1e-4)
    assert Surface().slides_permanently(limit * 0.999) and not Surface().slides_permanently(limit * 1.001)
    half = Surface(max_amplitude=0.5 * 9.81 / OMEGA**2)
    assert half.slides_permanently(limit / 0.75 * 0.999) and not half.slides_permanently(limit / 0.75 * 1.001)
    assert not Surface(horizontal_amplitude=0.0).slides_permanently(0.1)


@pytest.mark.parametrize("friction", [-1.0, math.nan, "0.6", None])
def test_friction_is_checked(friction):
    for method in (Surface().slides_permanently, Surface().idle_velocity):
        with pytest.raises(ValueError, match="friction"):
            method(friction)


def test_values_at_the_limits_are_allowed():
    assert Surface(horizontal_amplitude=0.0).table_speed == 0.0
    assert Surface(max_amplitude=0.0).full_scale == 0.0
    assert Surface(max_amplitude=2e-4).max_amplitude == 2e-4
    for settings in ({"max_amplitude": 3.98e-4}, {"rows": 2000, "columns": 2000}):
        with pytest.raises(ValueError, match="max_amplitude|columns"):
            Surface(**settings)
    assert Surface(rows=np.int64(3), frequency=np.float32(20.0)).rows == 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        Surface().rows = 3


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
