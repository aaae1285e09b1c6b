"""Sticking is outside the planar model: where it would start the model says so, and never where it cannot."""

import math

import numpy as np
import pytest

from vibgym import Part, Simulator, Surface
from vibgym.physics.planar import would_stick

G = 9.81
OMEGA = 2 * math.pi * 25.0
SUBSTEP = 0.04 / 18
THRESHOLD = 0.6 * G / OMEGA**2  # m: horizontal amplitude at which a_h w^2 = mu g


def simulator(surface, worlds=1, velocity=None, **properties):
    sim = Simulator(surface, Part.rectangle(0.05, 0.035, friction=0.6, **properties), worlds=worlds)
    sim.reset([0.4, 0.1, 0.3], velocity)
    return sim


def on_the_table(surface):
    """The table's velocity at the start of a period."""
    return [0.0, surface.table_speed, 0.0]


@pytest.mark.parametrize("fraction", [0.2, 0.9, 0.999])
def test_below_the_threshold_it_sticks_and_moves_with_the_table(fraction):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    sim = simulator(surface, velocity=on_the_table(surface))
    start = sim.pose
    sim.advance(0.0, 0.0, 4)
    assert sim.sticking.all()
    assert np.abs(sim.pose - start).max() < 1e-15 * 100  # round and round with the table, to rounding
    assert np.abs(sim.velocity[0, 0] - on_the_table(surface)).max() < 1e-12


@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.8, 0.9, 0.95])
def test_below_the_threshold_it_is_caught_from_rest(fraction):
    """Slip |u| falls by (1 - fraction) mu g per second at least, from a_h w = fraction mu g / w."""
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    sim = simulator(surface)
    sim.advance(0.0, 0.0, math.ceil(fraction / (1 - fraction) / OMEGA / surface.period))
    assert sim.sticking.all()
    assert np.abs(sim.velocity[0, 0] - on_the_table(surface)).max() < 1e-12


@pytest.mark.parametrize("fraction", [1.001, 1.1, 2.0])
def test_above_the_threshold_it_never_sticks(fraction):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    for velocity in (on_the_table(surface), None):
        sim = simulator(surface, velocity=velocity)
        sim.advance(0.0, 0.0, 50)
        assert not sim.sticking.any()


def test_static_friction_raises_the_threshold():
    surface = Surface(horizontal_amplitude=1.05 * THRESHOLD)
    for static, sticks in ((0.6, False), (0.62, False), (0.64, True)):
        sim = simulator(surface, velocity=on_the_table(surface), static_friction=static)
        sim.advance(0.0, 0.0)
        assert sim.sticking[0, 0] == sticks, static


def test_vertical_motion_makes_it_stick_for_part_of_a_period():
    """Between mu (g - A) and mu (g + A) friction can carry the table's acceleration while the element pushes up."""
    surface = Surface(horizontal_amplitude=1.3 * THRESHOLD)
    assert not surface.slides_permanently(0.6)
    for share, sticks in ((0.25, False), (0.35, True)):  # A / g
        sim = simulator(surface, velocity=on_the_table(surface))
        sim.advance(share * surface.lift_off_amplitude, math.pi)  # cos(alpha) = -1: g + A at the start
        assert sim.sticking[0, 0] == sticks, share
        assert surface.horizontal_amplitude * OMEGA**2 < 0.6 * G * (1 + share) or not sticks


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9, 3.3])
def test_permanent_sliding_never_reports(friction):
    """a_h w^2 > mu (g + A) whatever the elements do: not even a part that starts on the table's velocity sticks."""
    surface, worlds = Surface(), 32
    assert surface.slides_permanently(friction)
    rng = np.random.default_rng(7)
    sim = Simulator(surface, Part.rectangle(0.05, 0.035, friction=friction), worlds=worlds)
    pose = rng.uniform([0.1, 0.06, -3], [0.7, 0.14, 3], (worlds, 3))
    amplitude = np.full((worlds, 8, 32), surface.max_amplitude)
    phase = rng.uniform(-math.pi, math.pi, (worlds, 8, 32))
    sim.reset(pose[:, None], on_the_table(surface))
    sim.advance(amplitude, phase, 25)
    assert not sim.sticking.any() and not sim.diverged.any()


def test_report_is_kept_until_the_reset():
    surface = Surface(horizontal_amplitude=0.5 * THRESHOLD)
    sim = simulator(surface, velocity=on_the_table(surface))
    sim.advance(0.0, 0.0)
    assert sim.sticking.all()
    sim.reset([0.4, 0.1, 0.3], on_the_table(surface))
    assert not sim.sticking.any()


@pytest.mark.parametrize("velocity", [[0.4, 0.0, 0.0], [0.0, 0.0, 40.0], [0.3, -0.3, 20.0]])
def test_stop_on_a_still_table_reports(velocity):
    sim = simulator(Surface(horizontal_amplitude=0.0), velocity=velocity)
    sim.advance(0.0, 0.0)
    assert not sim.sticking.any() and np.abs(sim.velocity).max() > 0  # friction takes mu g T = 0.24 m/s in a period
    sim.advance(0.0, 0.0, 5)
    assert sim.sticking.all() and (sim.velocity == 0).all()


@pytest.mark.parametrize(
    "fraction, along, slip, spin, sticks",
    [
        # Slip in units of mu g h, which friction takes in a substep. The table's own acceleration, ``fraction`` of mu g,
        # takes slip along (cos wt, sin wt) away besides; slip the other way is not counted against sticking.
        (0.9, 1, 0.0, 0.0, True),
        (0.9, 1, 1.8, 0.0, True),
        (0.9, 1, 2.0, 0.0, False),
        (0.9, -1, 0.99, 0.0, True),
        (0.9, -1, 1.01, 0.0, False),
        (0.4, 1, 1.3, 0.0, True),
        (0.4, 1, 1.5, 0.0, False),
        (1.1, 1, 0.0, 0.0, True),  # held by static friction, 1.2 times as large
        (1.1, -1, 0.5, 0.0, False),  # sliding friction cannot stop this one
        (1.25, 1, 0.0, 0.0, False),  # nothing can hold it
        # Spin in units of what friction on lever arms takes in a substep.
        (0.9, 1, 0.0, 0.99, True),
        (0.9, 1, 0.0, -1.01, False),
    ],
)
def test_the_criterion(fraction, along, slip, spin, sticks):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    body = Part.rectangle(0.05, 0.035, friction=0.6, static_friction=0.72).body()
    h, angle = SUBSTEP, 0.8
    points = np.array([[0.25] * 4, [0.012, -0.012, 0.012, -0.012], [0.01, 0.01, -0.01, -0.01]])
    still = np.zeros(4)
    brake = 0.6 * G * h
    arm = math.hypot(0.012, 0.010)
    c, s = math.cos(angle), math.sin(angle)
    speed = along * slip * brake
    got = would_stick(
        surface.table(),
        body,
        h,
        points,
        still,
        still,
        4,
        c,
        s,
        speed * c,
        speed * s,
        spin * brake * arm / body.gyration,
    )
    assert got == sticks
