"""Eq. 3.27 solved, against independent integrators, closed forms and a symmetry; and the figures that rest on it."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from studies.thesis import parameter_study, speed_ratio, steady_velocity
from studies.thesis.sliding import steady, velocity
from studies.thesis.transient import FRICTION, transients
from vibgym import Surface

LIFT_OFF = 1.5 * math.pi


def averaged(s):
    """Drive less drag along the mean velocity at lift-off, over mu g, to first order in the ratio (eqs. 5.60 and 5.61)."""
    m = 4.0 * s / (1.0 + s) ** 2
    k, e = ellipk(m), ellipe(m)
    i0, r1 = 2.0 / math.pi * k / (1.0 + s), 2.0 / math.pi * (1.0 + s) * e
    r3 = 2.0 / math.pi * (1.0 + s) ** 3 * (2.0 * (2.0 - m) * e - (1.0 - m) * k) / 3.0
    s1 = (r1 - (1.0 + s * s) * i0) / (2.0 * s)
    s2 = (r3 - 2.0 * (1.0 + s * s) * r1 + (1.0 + s * s) ** 2 * i0) / (4.0 * s * s)
    return (s2 + s * s1) - (s * i0 + s1)


@pytest.mark.parametrize("ratio, share, phase", [(0.088, 1.0, LIFT_OFF), (0.45, 1.0, 0.3), (0.7, 0.3, 2.0)])
def test_the_course_is_scipys(ratio, share, phase):
    def slope(angle, v):
        slip = np.array([-math.sin(angle), math.cos(angle)]) - v
        return ratio * (1.0 - share * math.cos(angle + phase)) * slip / np.hypot(*slip)

    expected = solve_ivp(slope, (0.0, 8.0 * math.pi), [0.1, -0.2], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    errors = [
        np.hypot(*(velocity(ratio, share, phase, 4, (0.1, -0.2), steps)[-1, 0] - expected)) for steps in (60, 120)
    ]
    assert errors[1] < 2e-6 and 11.0 < errors[0] / errors[1] < 26.0  # fourth order


def test_the_steady_state_is_where_the_course_ends():
    course = velocity([0.2, 0.45], 1.0, LIFT_OFF, 40, steps=120)
    last = course[-120:].mean(axis=0)  # the trapezoidal rule, where the course is periodic
    assert steady([0.2, 0.45], 1.0, LIFT_OFF, steps=120) == pytest.approx(last, abs=2e-6)


def test_resting_elements_let_a_part_circle():
    """Eq. 3.30: speed mu g / w, and no mean."""
    start = (0.3 * math.sin(math.acos(0.3)), 0.3 * 0.3)
    assert np.hypot(*velocity(0.3, 0.0, 0.0, 2, start)[:, 0].T) == pytest.approx(0.3, abs=1e-8)
    assert steady(0.3, 0.0, 0.0)[0] == pytest.approx([0.0, 0.0], abs=1e-8)


@pytest.mark.parametrize("turn", [0.4, -2.0])
def test_the_phase_turns_the_steady_velocity_back(turn):
    (ax, ay), (bx, by) = steady(0.3, 0.9, [1.0, 1.0 + turn])
    c, s = math.cos(turn), math.sin(turn)
    assert (bx, by) == pytest.approx((c * ax + s * ay, c * ay - s * ax), abs=1e-8)


def test_where_a_part_may_stick_is_refused():
    with pytest.raises(ValueError, match="ratio"):
        steady([0.1, 0.5], 1.0, 0.0)


def test_the_largest_speed_ratio():
    """Eq. 3.41: the limit of little friction is the root of the averaged equation; the thesis's range and top hold."""
    limit = brentq(averaged, 0.3, 0.99)
    assert speed_ratio.largest_ratio([1e-5])[0] == pytest.approx(limit, rel=1e-6) and round(limit, 2) == 0.72
    values = speed_ratio.ratio_map(np.array([2e-4, 5e-4, 2.7e-3]), np.array([5.0, 25.0, 60.0]), 0.6)
    assert np.isnan(values[0]).all() and np.isnan(values[1, 0])  # they may stick
    assert values[1, 1] == pytest.approx(
        speed_ratio.largest_ratio([0.6 * 9.81 / (5e-4 * (50 * math.pi) ** 2)])[0], abs=1e-4
    )
    assert 0.6 < np.nanmin(values) < 0.70 < values[1, 2] < np.nanmax(values) < limit


def test_the_transient():
    """Fig. 3.8, and the time that the averaged equation takes for it, to half a period."""
    surface, cases = Surface(), transients()
    rises = [case.rise for case in cases]
    assert rises == sorted(rises, reverse=True)
    assert [case.ripple for case in cases] == sorted(case.ripple for case in cases)
    limit = brentq(averaged, 0.3, 0.99)
    grid = np.linspace(1e-4, 0.95 * limit, 4001)
    way = np.trapezoid(1.0 / np.array([averaged(slip) for slip in grid]), grid)
    for friction, one in zip(FRICTION, cases, strict=True):
        assert one.rise == pytest.approx(way * surface.table_speed / (friction * surface.gravity), abs=0.02)
        assert np.hypot(*one.steady) == pytest.approx(0.304, abs=0.001)
        assert one.mean_speed[-1] == pytest.approx(np.hypot(*one.steady), rel=0.02)
        radius = friction * surface.gravity / surface.angular_frequency  # what the part would do on resting elements
        assert 1.0 < one.ripple / radius < 2.0


@pytest.mark.parametrize("parameter, values", [
    ("horizontal_amplitude", [0.5e-3, 5e-3]),
    ("frequency", [11.0, 60.0]),
    ("amplitude", [1e-4]),
    ("phase", [0.0, 1.0]),
])  # fmt: skip
def test_the_simulator_gives_the_equations_velocities(parameter, values):
    """Fig. 3.9."""
    expected = steady_velocity.solved(parameter, values)
    off = np.hypot(*(steady_velocity.simulated(parameter, values) - expected).T)
    assert (off < 1e-3 * np.hypot(*expected.T)).all()


def test_the_parameter_study():
    """Fig. 6.1: closed forms of its borders, and the surface's own rule for sliding."""
    low, high = parameter_study.frequencies(2.7e-3)
    assert low == pytest.approx(math.sqrt(2.0 * 0.6 * 9.81 / 2.7e-3) / (2.0 * math.pi), abs=0.011)
    assert high == pytest.approx(math.sqrt(9.81 / 1e-4) / (2.0 * math.pi), abs=0.011)
    assert math.isnan(parameter_study.frequencies(6e-3)[0])
    for hertz in (low - 0.02, low + 0.02, 25.0):
        expected = Surface(frequency=hertz).slides_permanently(0.6)
        assert bool(parameter_study.CONDITIONS[0].holds(2.7e-3, 2.0 * math.pi * hertz)) == expected
    assert parameter_study.all_hold(2.7e-3, 50.0 * math.pi)
    assert not parameter_study.CONDITIONS[2].holds(2.7e-3, 2.0 * math.pi * 96.0)
    assert not parameter_study.CONDITIONS[1].holds(2.7e-3, 0.99 * 0.1 / (0.7 * 2.7e-3))
