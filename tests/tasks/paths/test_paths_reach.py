"""Limits of a part's motion, against closed forms with elliptic integrals and the averaged model."""

import math

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from tests.allocation.averaged_model import mean_acceleration
from vibgym import Part, Surface
from vibgym.simulation.plant import means
from vibgym.tasks.paths import EFFORT, Reach

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
REACH = Reach(SURFACE, BLOCK)


def test_means_are_the_elliptic_integrals():
    s, drag, across, along = (each[10:900] for each in means())
    m = 4 * s / (1 + s) ** 2
    k, e = ellipk(m), ellipe(m)
    i0, r1 = 2 / np.pi * k / (1 + s), 2 / np.pi * (1 + s) * e
    r3 = 2 / np.pi * (1 + s) ** 3 * (2 * (2 - m) * e - (1 - m) * k) / 3
    s1 = (r1 - (1 + s**2) * i0) / (2 * s)
    s2 = (r3 - 2 * (1 + s**2) * r1 + (1 + s**2) ** 2 * i0) / (4 * s**2)
    assert drag == pytest.approx(s * i0 + s1, abs=1e-9)
    assert across == pytest.approx(i0 - s2, abs=1e-9)
    assert along == pytest.approx(s2 + s * s1, abs=1e-9)


def test_top_speed_is_that_of_the_thesis():
    """Thesis eq. 3.41: 0.70 to 0.72 of the table's speed at any friction."""
    assert REACH.top_speed / SURFACE.table_speed == pytest.approx(0.71917, abs=2e-5)
    assert Reach(SURFACE, Part.disc(0.02, friction=0.3)).top_speed == pytest.approx(REACH.top_speed)
    half = Surface(max_amplitude=0.5 * SURFACE.max_amplitude)
    assert Reach(half, BLOCK).top_speed < 0.7 * REACH.top_speed
    assert REACH.effort(REACH.fastest) == pytest.approx(EFFORT, abs=1e-6)


@pytest.mark.parametrize("speed, along, across", [
    (0.0, 1.5, 0.0), (0.0, 0.0, -2.0), (0.15, 0.6, 0.0), (0.15, -1.0, 1.2), (0.25, 0.0, 0.5), (0.1, 0.3, -2.0)
])  # fmt: skip
def test_an_effort_gives_its_acceleration(speed, along, across):
    """Elements in unison, with that share of the amplitude and the best phase, give this acceleration in the averaged model."""
    effort = float(REACH.effort(speed, along, across))
    assert 0.0 < effort < 1.0
    phase = np.linspace(-np.pi, np.pi, 721)
    pose, velocity = np.tile([0.4, 0.104, 0.3], (len(phase), 1)), [speed, 0.0, 0.0]

    def missed(share):
        amplitude = share * effort * SURFACE.max_amplitude
        got = mean_acceleration(SURFACE, BLOCK, pose, velocity, amplitude, phase[:, None, None], order=1)
        return np.hypot(got[:, 0] - along, got[:, 1] - across).min()

    assert missed(1.0) < 0.02  # the phases are 0.5 deg apart
    assert missed(0.9) > 3 * missed(1.0)


def test_rotation_and_displacement_share_the_effort():
    assert REACH.effort(0.1, turning=5.0) > REACH.effort(0.1)
    assert REACH.effort(0.1, spin=-2.0) == REACH.effort(0.1, spin=2.0) > REACH.effort(0.1)


def test_corners_leave_amplitude_and_are_larger_where_the_part_turns():
    radii = [REACH.corner(share * REACH.top_speed) for share in (0.2, 0.4, 0.6, 0.8)]
    assert radii == sorted(radii)
    for share, radius in zip((0.2, 0.4, 0.6, 0.8), radii, strict=True):
        speed = share * REACH.top_speed
        effort = REACH.effort(speed, across=speed**2 / radius)
        assert effort == pytest.approx(0.5 * (REACH.effort(speed) + EFFORT), abs=1e-5)
        assert REACH.corner(speed, 2 * BLOCK.radius) > radius
    assert math.isfinite(REACH.corner(REACH.fastest))


@pytest.mark.parametrize("surface, part", [
    (Surface(horizontal_amplitude=0.0), BLOCK), (Surface(max_amplitude=0.0), BLOCK), (SURFACE, Part.disc(0.02, friction=0.0)),
])  # fmt: skip
def test_parts_that_cannot_be_moved_are_refused(surface, part):
    with pytest.raises(ValueError, match="parts"):
        Reach(surface, part)
