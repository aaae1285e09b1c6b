"""Static and sliding friction of an area contact: sticking, slipping and the limit surface."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from tests.simulation.helpers import simulated
from vibgym import Part, Simulator, Surface
from vibgym.physics.core.records import Table
from vibgym.physics.planar.static import implicit_slip, slip_step, uniform_stress_holds

G = 9.81
OMEGA = 2 * math.pi * 25.0
START = [0.4, 0.1, 0.3]
THRESHOLD = 0.6 * G / OMEGA**2  # m: horizontal amplitude at which a_h w^2 = mu g


def played(surface, periods, velocity=None, amplitude=0.0, phase=0.0, **properties):
    part = Part.rectangle(0.05, 0.035, friction=0.6, **properties)
    return simulated(surface, part, START, velocity, amplitude, phase, periods)


def on_the_table(surface):
    """The table's velocity at the start of a period."""
    return [0.0, surface.table_speed, 0.0]


@pytest.mark.parametrize("fraction", [0.2, 0.9, 0.999])
def test_below_the_threshold_it_sticks_and_moves_with_the_table(fraction):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    sim = played(surface, 4, on_the_table(surface))
    assert sim.sticking.all()
    assert np.abs(sim.pose - START).max() < 1e-15 * 100  # round and round with the table, to rounding
    assert np.abs(sim.velocity[0, 0] - on_the_table(surface)).max() < 1e-12


@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.8, 0.9, 0.95])
def test_below_the_threshold_it_is_caught_from_rest(fraction):
    """Slip |u| falls by (1 - fraction) mu g per second at least, from a_h w = fraction mu g / w."""
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    sim = played(surface, math.ceil(fraction / (1 - fraction) / OMEGA / surface.period))
    assert sim.sticking.all()
    assert np.abs(sim.velocity[0, 0] - on_the_table(surface)).max() < 1e-12


@pytest.mark.parametrize("fraction", [1.001, 1.1, 2.0])
def test_above_the_threshold_it_never_sticks(fraction):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    for velocity in (on_the_table(surface), None):
        assert not played(surface, 50, velocity).sticking.any()


def test_static_friction_raises_the_threshold():
    surface = Surface(horizontal_amplitude=1.05 * THRESHOLD)
    for static, sticks in ((0.6, False), (0.62, False), (0.64, True)):
        sim = played(surface, 1, on_the_table(surface), static_friction=static)
        assert sim.sticking[0, 0] == sticks, static


def test_static_friction_does_not_catch_what_slides():
    """Between the thresholds both are possible (thesis eq. 3.23), and the initial state persists."""
    surface = Surface(horizontal_amplitude=1.05 * THRESHOLD)
    for velocity, sticks in ((on_the_table(surface), True), (None, False)):
        assert played(surface, 50, velocity, static_friction=0.7).sticking[0, 0] == sticks


def released(surface, amplitude, phase, static):
    """Return the time of breakaway: a_h w^2 = mu_0 (g + z'')."""
    needed = surface.horizontal_amplitude * OMEGA**2

    def spare(t):
        return static * (G - amplitude * OMEGA**2 * math.cos(OMEGA * t + phase)) - needed

    assert spare(0.0) > 0
    grid = np.linspace(0.0, surface.period, 200)
    first = next(k for k in range(200) if spare(grid[k]) < 0)
    return brentq(spare, grid[first - 1], grid[first], xtol=1e-15)


@pytest.mark.parametrize("static", [0.6, 0.66])
def test_breakaway_on_one_element(static):
    """Stick until the closed-form instant, then slide as in an integration of eq. 3.26."""
    surface = Surface(rows=1, columns=1, element_size=2.0, horizontal_amplitude=1.1 * THRESHOLD)
    amplitude, phase, friction = 0.5 * surface.lift_off_amplitude, math.pi, 0.6
    part = Part.rectangle(0.05, 0.035, friction=friction, static_friction=static)
    start = released(surface, amplitude, phase, static)
    needed = surface.horizontal_amplitude * OMEGA**2

    # The slip after breakaway, by small implicit steps in closed form: |u| decreases by mu q dt.
    n = 200_000
    dt, t, slip, way = (surface.period - start) / n, start, 0j, 0j
    for _ in range(n):
        t += dt
        free = slip - needed * complex(math.cos(OMEGA * t), math.sin(OMEGA * t)) * dt
        hold = friction * (G - amplitude * OMEGA**2 * math.cos(OMEGA * t + phase)) * dt
        slip = free * max(0.0, 1.0 - hold / abs(free)) if free else 0j
        way += slip * dt

    sim = simulated(
        surface, part, [1.0, 1.0, 0.3], on_the_table(surface), amplitude, phase, steps=1, substeps=40
    )  # fmt: skip
    moved = complex(*(sim.pose[0, 0, :2] - 1.0))
    assert abs(way) > 1e-5  # m: it does slide
    assert abs(moved + way) < 2e-4 * abs(way) + 2.0 * abs(slip) * dt
    assert sim.pose[0, 0, 2] == pytest.approx(0.3, abs=1e-12)  # one element does not turn it


def test_vertical_motion_makes_it_stick_for_part_of_a_period():
    """Between mu (g - A) and mu (g + A) it sticks and slips in every period, with a net displacement."""
    surface = Surface(horizontal_amplitude=1.1 * THRESHOLD)
    assert not surface.slides_permanently(0.6)
    stuck = np.zeros(2, dtype=bool)
    for k, share in enumerate((0.25, 0.8)):  # A / g
        sim = played(surface, 1, on_the_table(surface), share * surface.lift_off_amplitude, math.pi)
        for _ in range(10):
            stuck[k] |= sim.sticking[0, 0]
            sim.advance(share * surface.lift_off_amplitude, math.pi)  # cos(alpha) = -1: g + A at the start
        assert np.hypot(*sim.mean_velocity[0, 0, :2]) > 1e-3
    assert stuck.tolist() == [False, True]


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9, 3.3])
def test_permanent_sliding_never_sticks(friction):
    """With a_h w^2 > mu (g + A) not even a part that starts at the table's velocity sticks."""
    surface, worlds = Surface(), 32
    assert surface.slides_permanently(friction)
    rng = np.random.default_rng(7)
    pose = rng.uniform([0.1, 0.06, -3], [0.7, 0.14, 3], (worlds, 1, 3))
    phase = rng.uniform(-math.pi, math.pi, (worlds, 8, 32))
    part = Part.rectangle(0.05, 0.035, friction=friction)
    sim = simulated(surface, part, pose, on_the_table(surface), surface.max_amplitude, phase, 25)
    assert not sim.sticking.any() and not sim.diverged.any()


def power(load, x, y, sx, sy, spin):
    return float(np.sum(load * np.hypot(sx + spin * y, sy - spin * x)))


points = st.lists(
    st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03), st.floats(0.0, 1.0)), min_size=3, max_size=12, unique=True
)


@settings(max_examples=150, deadline=None)
@given(points, st.floats(-2, 2), st.floats(-2, 2), st.floats(-60, 60))
def test_implicit_slip_is_the_minimum(given_points, rx, ry, rw):
    """No other twist has less energy; the result is exactly zero where zero is the minimum."""
    x, y, load = np.array(given_points).T.copy()
    load, k2 = load / max(load.sum(), 1e-3), 4e-4
    total = float(load.sum())

    def energy(twist):
        sx, sy, spin = twist
        inertia = 0.5 * ((sx - rx) ** 2 + (sy - ry) ** 2 + k2 * (spin - rw) ** 2)
        return inertia + power(load, x, y, sx, sy, spin)

    slip = np.array(implicit_slip(load, total, x, y, len(x), k2, rx, ry, rw, 0.0, 0.0, 0.0))
    scale = np.array([1.0, 1.0, 1.0 / math.sqrt(k2)])
    here, tolerance = energy(slip), 1e-8 * (1.0 + rx * rx + ry * ry + k2 * rw * rw)
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 0.1, 1.0):
        for direction in rng.standard_normal((30, 3)):
            assert energy(slip + size * scale * direction) >= here - tolerance
    assert here <= energy(np.zeros(3)) + tolerance
    best = minimize(lambda z: energy(z * scale), slip / scale, method="Nelder-Mead", options={"maxiter": 400})
    assert best.fun >= here - tolerance


def test_limit_surface_of_a_ring_pair():
    """Two points of equal load at +-r on x: pure torque holds up to 2 c r, a force along y up to 2 c, both at once less."""
    x, y, load, r, k2 = np.array([0.02, -0.02]), np.zeros(2), np.full(2, 0.5), 0.02, 4e-4

    def holds(force_y, torque):
        return implicit_slip(load, 1.0, x, y, 2, k2, 0.0, force_y, torque / k2, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)

    assert holds(0.999, 0.0) and not holds(1.001, 0.0)
    assert holds(0.0, 0.999 * r) and not holds(0.0, 1.001 * r)
    # along y the two points carry F/2 +- T/(2 r): the limit is |F| + |T| / r = 1
    assert holds(0.5, 0.499 * r) and not holds(0.5, 0.501 * r)
    # along x the stresses are perpendicular: F^2 + (T / r)^2 = 1
    assert implicit_slip(load, 1.0, x, y, 2, k2, 0.6, 0.0, 0.799 * r / k2, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)
    assert implicit_slip(load, 1.0, x, y, 2, k2, 0.6, 0.0, 0.801 * r / k2, 0.0, 0.0, 0.0) != (0.0, 0.0, 0.0)


@settings(max_examples=300, deadline=None)
@given(points, st.floats(-1, 1), st.floats(-1, 1), st.floats(-40, 40))
def test_a_uniform_stress_that_holds_exceeds_the_load_in_every_direction(given_points, rx, ry, rw):
    """Friction's power is at least the load's for every twist, so that the part sticks; sufficient, not necessary."""
    x, y, load = np.array(given_points).T.copy()
    load, k2 = load / max(load.sum(), 1e-3), 4e-4
    if uniform_stress_holds(load, float(load.sum()), x, y, len(x), k2, rx, ry, rw):
        for sx, sy, spin in np.random.default_rng(0).standard_normal((200, 3)) * [1.0, 1.0, 50.0]:
            assert power(load, x, y, sx, sy, spin) >= rx * sx + ry * sy + k2 * rw * spin - 1e-9


def test_a_frictionless_part_slides_down_and_keeps_its_spin():
    """On a table at rest the slip of a part is minus its velocity: both integrals of a step are closed forms."""
    surface, h = Surface(horizontal_amplitude=0.0), 0.003
    table: Table = surface.table()
    point, still = np.array([[1.0, 0.0], [0.01, 0.0], [0.0, 0.02]]), np.zeros(2)
    incline, slip, spin = np.array([0.4, -0.3]), np.array([0.02, 0.05]), 1.7
    result = slip_step(table, 0.0, point, still, still, 2, 4e-4, *incline, np.zeros(2), 0.0, h, *slip, spin)
    expected = [*(slip - incline * h), spin, *(slip * h - incline * h**2 / 2), spin * h]
    assert result == pytest.approx(expected, rel=1e-12)


def transitions(steps, substeps, worlds=16, periods=10):
    """Stick and slip in every period on many elements, with breakaway and capture at other times in every world."""
    surface = Surface(horizontal_amplitude=1.2 * THRESHOLD)
    rng = np.random.default_rng(5)
    pose = rng.uniform([0.1, 0.06, -3], [0.7, 0.14, 3], (worlds, 3))[:, None]
    amplitude = rng.uniform(0.0, 0.9, (worlds, 8, 32)) * surface.lift_off_amplitude
    phase = rng.uniform(-math.pi, math.pi, (worlds, 8, 32))
    part = Part.rectangle(0.05, 0.035, friction=0.6, static_friction=0.63)
    sim = Simulator(surface, part, worlds=worlds, steps=steps, substeps=substeps)
    sim.reset(pose, on_the_table(surface))
    stuck = 0
    for _ in range(periods):
        sim.advance(amplitude, phase)
        stuck += sim.sticking.sum()
    return sim.pose[:, 0], stuck


def test_order_through_transitions():
    exact, _ = transitions(384, 2)
    steps = np.array([24, 48, 96, 192])
    error = [np.median(np.hypot(*(transitions(int(n), 1)[0] - exact)[:, :2].T)) for n in steps]
    order = -np.polyfit(np.log(steps), np.log(error), 1)[0]
    assert order > 1.8, error
    assert error[0] < 5e-6  # m
