"""Readers of the drives: phasor (C, S) = a_v w^2 (cos alpha, sin alpha)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym.physics.drive import (
    ElementDrive,
    FieldDrive,
    PatchDrive,
    PhasorDrive,
    PolarDrive,
    all_phasors,
    element_phasor,
)

OMEGA = 2 * math.pi * 25.0
FULL = 9.81
WORLDS, ROWS, COLUMNS = 3, 4, 5


def read(drive):
    phasors = np.full((WORLDS, ROWS, COLUMNS, 2), np.nan)
    all_phasors(drive, phasors)
    return phasors


def actions(seed=0, scale=1.6):
    """Actions of which many lie outside [-1, 1]."""
    return np.random.default_rng(seed).uniform(-scale, scale, (WORLDS, ROWS, COLUMNS, 2)).astype(np.float32)


def shortened(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1.0)


def test_polar():
    rng = np.random.default_rng(1)
    amplitude = rng.uniform(0, 4e-4, (WORLDS, ROWS, COLUMNS))
    phase = rng.uniform(-9, 9, (WORLDS, ROWS, COLUMNS))
    expected = amplitude[..., None] * OMEGA**2 * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    assert np.allclose(read(PolarDrive(amplitude, phase, OMEGA)), expected, rtol=0, atol=1e-13)


def test_polar_is_the_normal_acceleration():
    """g - C cos wt + S sin wt is g + z'' for z = a_v cos(wt + alpha), z'' by differences."""
    amplitude, phase = np.full((1, 1, 1), 3e-4), np.full((1, 1, 1), 0.7)
    c, s = element_phasor(PolarDrive(amplitude, phase, OMEGA), 0, 0, 0)
    for t in np.linspace(0, 0.04, 9):
        z = [3e-4 * math.cos(OMEGA * (t + d) + 0.7) for d in (-1e-5, 0, 1e-5)]
        second = (z[0] - 2 * z[1] + z[2]) / 1e-10
        # the difference quotient itself errs by w^2 d^2 / 12 = 2e-7 of 7.4 m/s^2, and by rounding of 1e-16 * 3e-4 / 1e-10
        assert FULL - c * math.cos(OMEGA * t) + s * math.sin(OMEGA * t) == pytest.approx(FULL + second, abs=5e-6)


def test_element():
    action = actions()
    clipped = np.clip(action.astype(float), -1, 1)
    amplitude, phase = 0.5 * (1 + clipped[..., 0]) * FULL, math.pi * clipped[..., 1]
    expected = amplitude[..., None] * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    assert np.allclose(read(ElementDrive(action, FULL)), expected, rtol=0, atol=1e-13)


def test_phasor_clipped_then_shortened_to_the_disc():
    action = actions()
    got = read(PhasorDrive(action, FULL))
    assert np.allclose(got, FULL * shortened(np.clip(action.astype(float), -1, 1)), rtol=0, atol=1e-13)
    assert np.linalg.norm(got, axis=-1).max() <= FULL * (1 + 1e-15)
    inner = np.linalg.norm(action, axis=-1) < 1
    assert inner.any() and np.allclose(got[inner], FULL * action[inner].astype(float), rtol=0, atol=1e-13)


@pytest.mark.parametrize("drive", [ElementDrive, PhasorDrive])
def test_outside_is_the_same_as_clipped(drive):
    action = actions(2, 5.0)
    assert np.array_equal(read(drive(action, FULL)), read(drive(np.clip(action, -1, 1), FULL)))


def test_patch():
    action = np.random.default_rng(3).uniform(-1.5, 1.5, (WORLDS, 1, 3, 3, 2)).astype(np.float32)
    origin = np.array([[0, 0], [-1, 3], [2, -2]])  # inside, and over three borders
    expected = np.zeros((WORLDS, ROWS, COLUMNS, 2))
    vectors = FULL * shortened(np.clip(action[:, 0].astype(float), -1, 1))
    for world, (row, column) in enumerate(origin):
        for i in range(3):
            for j in range(3):
                if 0 <= row + i < ROWS and 0 <= column + j < COLUMNS:
                    expected[world, row + i, column + j] = vectors[world, i, j]
    assert np.allclose(read(PatchDrive(action, origin, FULL)), expected, rtol=0, atol=1e-13)


SIZE, REACH = 0.026, 0.04
CENTRE = np.array([0.060, 0.050])


def pushes(strengths):
    """Direction and strength in which each element pushes a resting part, (rows, columns, 2): -(S, C) / full scale."""
    action = np.broadcast_to(np.array(strengths, dtype=np.float32), (WORLDS, 1, 6))
    phasors = read(FieldDrive(action, np.broadcast_to(CENTRE, (WORLDS, 2)), SIZE, REACH, FULL))[0]
    return -phasors[..., ::-1] / FULL


def offsets():
    """Element centres from the field's centre, in units of the reach, x and y."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * SIZE, (np.arange(ROWS) + 0.5) * SIZE)
    return (x - CENTRE[0]) / REACH, (y - CENTRE[1]) / REACH


def central(x, y):
    """The offset itself within reach, its direction beyond."""
    distance = np.hypot(x, y)
    return np.where(distance < 1, x, x / distance), np.where(distance < 1, y, y / distance)


BASIC = {
    "uniform x": ([1, 0, 0, 0, 0, 0], lambda x, y: (1 + 0 * x, 0 * y)),
    "uniform y": ([0, 1, 0, 0, 0, 0], lambda x, y: (0 * x, 1 + 0 * y)),
    "squeeze x": ([0, 0, 1, 0, 0, 0], lambda x, y: (-np.clip(x, -1, 1), 0 * y)),
    "squeeze y": ([0, 0, 0, 1, 0, 0], lambda x, y: (0 * x, -np.clip(y, -1, 1))),
    "radial": ([0, 0, 0, 0, 1, 0], lambda x, y: (-central(x, y)[0], -central(x, y)[1])),
    "tangential": ([0, 0, 0, 0, 0, 1], lambda x, y: (-central(x, y)[1], central(x, y)[0])),
}


@pytest.mark.parametrize("name", BASIC)
@pytest.mark.parametrize("strength", [1.0, -1.0, 0.5, 3.0])
def test_basic_fields(name, strength):
    row, field = BASIC[name]
    x, y = offsets()
    expected = shortened(np.clip(strength, -1, 1) * np.stack(field(x, y), axis=-1))
    assert np.allclose(pushes(strength * np.array(row)), expected, rtol=0, atol=1e-14)


@given(st.lists(st.floats(-2, 2, width=32), min_size=6, max_size=6))
def test_fields_add_up(strengths):
    x, y = offsets()
    clipped = np.clip(np.array(strengths, dtype=np.float32).astype(float), -1, 1)
    total = sum(k * np.stack(field(x, y), axis=-1) for k, (_, field) in zip(clipped, BASIC.values(), strict=True))
    assert np.allclose(pushes(strengths), shortened(total), rtol=0, atol=1e-14)


def test_readers_agree_with_the_python_side():
    drive = PhasorDrive(actions(5), FULL)
    one_by_one = [
        [[element_phasor(drive, w, i, j) for j in range(COLUMNS)] for i in range(ROWS)] for w in range(WORLDS)
    ]
    assert np.allclose(read(drive), one_by_one, rtol=0, atol=1e-14)
