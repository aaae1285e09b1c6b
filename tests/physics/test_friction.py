"""The wrench of single points in closed form."""

import math

import numpy as np
import pytest

from vibgym.physics.planar.wrench import sliding_wrench


def wrench(x, y, c, s, gravity, phase, slip, spin):
    """Return force and torque of one point, padded like the kernel's arguments."""
    rows = np.zeros((5, 8))
    rows[:, 0] = 1.0, x, y, c, s
    return sliding_wrench(*rows, 8, gravity, math.cos(phase), math.sin(phase), *slip, spin)


@pytest.mark.parametrize("decade", range(-12, 16))
def test_stress_has_unit_direction_at_any_speed(decade):
    # Single-precision estimate 6e-8 and one Newton step, 1.5 (6e-8)^2, and rounding.
    for angle in np.linspace(0.0, 2.0 * math.pi, 40):
        slip = 10.0**decade * math.cos(angle), 10.0**decade * math.sin(angle)
        fx, fy, torque = wrench(0.0, 0.0, 0.0, 0.0, 9.81, 0.3, slip, 0.0)
        # Below 1e-11 m/s the floor that avoids 0/0 becomes visible.
        size = 1.0 / math.sqrt(1.0 + 1e-30 / 10.0 ** (2 * decade))
        assert math.hypot(fx - 9.81 * size * math.cos(angle), fy - 9.81 * size * math.sin(angle)) < 1e-12
        assert torque == 0.0


def test_a_point_at_rest_on_the_table_has_no_direction():
    assert wrench(0.01, 0.02, 0.0, 0.0, 9.81, 0.3, (0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)


def test_normal_load_and_lever():
    x, y, c, s, phase, slip, spin = 0.012, -0.007, 3.0, -2.0, 0.8, (0.3, -0.1), 5.0
    normal = 9.81 - c * math.cos(phase) + s * math.sin(phase)
    u = np.array([slip[0] + spin * y, slip[1] - spin * x])
    force = normal * u / np.hypot(*u)
    expected = (*force, x * force[1] - y * force[0])
    assert wrench(x, y, c, s, 9.81, phase, slip, spin) == pytest.approx(expected, rel=1e-13)
