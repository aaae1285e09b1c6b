"""Readers of the drives: phasor (C, S) = a_v w^2 (cos alpha, sin alpha)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym.physics.core.drive import (
    all_phasors,
    element_drive,
    element_phasor,
    field_drive,
    patch_drive,
    phasor_drive,
    polar_drive,
)

OMEGA = 2 * math.pi * 25.0
FULL = 9.81
WORLDS, ROWS, COLUMNS = 3, 4, 5


def read(drive):
    phasors = np.full((WORLDS, ROWS, COLUMNS, 2), np.nan)
    all_phasors(drive, phasors)
    return phasors


def actions(seed=0, scale=1.6):
    """Actions, many of them outside [-1, 1]."""
    return np.random.default_rng(seed).uniform(-scale, scale, (WORLDS, ROWS, COLUMNS, 2)).astype(np.float32)


def flat(action):
    return action.reshape(len(action), -1)


def shortened(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1.0)


def test_polar():
    rng = np.random.default_rng(1)
    amplitude = rng.uniform(0, 4e-4, (WORLDS, ROWS, COLUMNS))
    phase = rng.uniform(-9, 9, (WORLDS, ROWS, COLUMNS))
    expected = amplitude[..., None] * OMEGA**2 * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    assert np.allclose(read(polar_drive(amplitude, phase, OMEGA)), expected, rtol=0, atol=1e-13)


def test_polar_is_the_normal_acceleration():
    """g - C cos wt + S sin wt is g + z'' for z = a_v cos(wt + alpha), z'' by differences."""
    amplitude, phase = np.full((1, 1, 1), 3e-4), np.full((1, 1, 1), 0.7)
    c, s = element_phasor(polar_drive(amplitude, phase, OMEGA), 0, 0, 0)
    for t in np.linspace(0, 0.04, 9):
        z = [3e-4 * math.cos(OMEGA * (t + d) + 0.7) for d in (-1e-5, 0, 1e-5)]
        second = (z[0] - 2 * z[1] + z[2]) / 1e-10
        # error of the difference quotient: w^2 d^2 / 12 = 2e-7 of 7.4 m/s^2, and rounding of 1e-16 * 3e-4 / 1e-10
        assert FULL - c * math.cos(OMEGA * t) + s * math.sin(OMEGA * t) == pytest.approx(FULL + second, abs=5e-6)


def test_element():
    action = actions()
    clipped = np.clip(action.astype(float), -1, 1)
    amplitude, phase = 0.5 * (1 + clipped[..., 0]) * FULL, math.pi * clipped[..., 1]
    expected = amplitude[..., None] * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    assert np.allclose(read(element_drive(flat(action), COLUMNS, FULL)), expected, rtol=0, atol=1e-13)


def test_phasor_clipped_then_shortened_to_the_disc():
    action = actions()
    got = read(phasor_drive(flat(action), COLUMNS, FULL))
    assert np.allclose(got, FULL * shortened(np.clip(action.astype(float), -1, 1)), rtol=0, atol=1e-13)
    assert np.linalg.norm(got, axis=-1).max() <= FULL * (1 + 1e-15)
    inner = np.linalg.norm(action, axis=-1) < 1
    assert inner.any() and np.allclose(got[inner], FULL * action[inner].astype(float), rtol=0, atol=1e-13)


SIZE, REACH = 0.026, 0.04
CENTRE = np.array([0.060, 0.050])


def pushes(strengths):
    """Return the push of each element on a resting part, (rows, columns, 2): -(S, C) / full scale."""
    action = np.broadcast_to(np.array(strengths, dtype=np.float32), (WORLDS, 1, 6))
    phasors = read(field_drive(flat(action), np.broadcast_to(CENTRE, (WORLDS, 1, 2)), SIZE, REACH, FULL))[0]
    return -phasors[..., ::-1] / FULL


def offsets():
    """Element centres from the field's centre, in units of the reach, x and y."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * SIZE, (np.arange(ROWS) + 0.5) * SIZE)
    return (x - CENTRE[0]) / REACH, (y - CENTRE[1]) / REACH


def central(x, y):
    """Return the offset within reach, its direction beyond."""
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


# -- several parts -----------------------------------------------------------------------------------------------------

PARTS = 3
CENTRES = st.lists(
    st.tuples(st.floats(0, COLUMNS * SIZE), st.floats(0, ROWS * SIZE)), min_size=WORLDS * PARTS, max_size=WORLDS * PARTS
)


def nearest(centre, candidates, row, column):
    """Return the candidate with the nearest centre (x, y), ties to the lowest index; None without candidates."""
    at = ((column + 0.5) * SIZE, (row + 0.5) * SIZE)
    return min(candidates, key=lambda part: math.dist(centre[part], at), default=None)


def clear_cut(centre, row, column):
    """Return whether the nearest centre is unique within rounding."""
    at = ((column + 0.5) * SIZE, (row + 0.5) * SIZE)
    ways = sorted(math.dist(other, at) for other in centre)
    return all(far - near > 1e-9 for near, far in zip(ways, ways[1:], strict=False))


@given(centres=CENTRES, gone=st.lists(st.booleans(), min_size=PARTS, max_size=PARTS))
def test_an_element_follows_the_nearest_field(centres, gone):
    centre = np.array(centres).reshape(WORLDS, PARTS, 2)
    action = np.random.default_rng(6).uniform(-1.5, 1.5, (WORLDS, PARTS, 6)).astype(np.float32)
    alone = [read(field_drive(action[:, k], centre[:, k : k + 1], SIZE, REACH, FULL)) for k in range(PARTS)]
    given_centre = centre.copy()
    given_centre[:, gone] = np.inf
    together = read(field_drive(flat(action), given_centre, SIZE, REACH, FULL))
    left = [k for k in range(PARTS) if not gone[k]]
    for world, row, column in np.ndindex(WORLDS, ROWS, COLUMNS):
        if not clear_cut(centre[world], row, column):
            continue
        part = nearest(centre[world], left, row, column)
        expected = np.zeros(2) if part is None else alone[part][world, row, column]
        assert together[world, row, column] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("size", [1, 2, 3])
@given(centres=CENTRES, gone=st.lists(st.booleans(), min_size=PARTS, max_size=PARTS))
def test_an_element_follows_the_nearest_patch_that_contains_it(size, centres, gone):
    centre = np.array(centres).reshape(WORLDS, PARTS, 2)
    action = np.random.default_rng(7).uniform(-1.5, 1.5, (WORLDS, PARTS, size, size, 2)).astype(np.float32)
    vectors = FULL * shortened(np.clip(action.astype(float), -1, 1))
    lines = centre[..., ::-1] / SIZE
    origin = np.floor(lines + 0.5 - 0.5 * size).astype(np.int64)
    given_lines = lines.copy()
    given_lines[:, gone] = np.inf
    got = read(patch_drive(flat(action), origin, given_lines, size, FULL))
    for world, row, column in np.ndindex(WORLDS, ROWS, COLUMNS):
        inside = (row - origin[world, :, 0], column - origin[world, :, 1])
        holders = [k for k in range(PARTS) if 0 <= inside[0][k] < size and 0 <= inside[1][k] < size and not gone[k]]
        if not clear_cut(centre[world], row, column):
            continue
        part = nearest(centre[world], holders, row, column)
        expected = np.zeros(2) if part is None else vectors[world, part, inside[0][part], inside[1][part]]
        assert got[world, row, column] == pytest.approx(expected, abs=1e-13)


def test_ties_go_to_the_first_part():
    """Centres at equal distances left and right of an element's centre, in exact numbers."""
    action = np.zeros((WORLDS, 2, 6), dtype=np.float32)
    action[:, 0, 0], action[:, 1, 1] = 1.0, 1.0
    centre = np.array([[[2.25, 1.5], [2.75, 1.5]]] * WORLDS)  # elements of 1 m; that in column 2 has its centre at 2.5
    push = -read(field_drive(flat(action), centre, 1.0, 1.0, FULL))[0, 1, :, ::-1] / FULL
    assert push == pytest.approx(np.array([[1, 0], [1, 0], [1, 0], [0, 1], [0, 1]]))
    patches = np.zeros((WORLDS, 2, 3, 3, 2), dtype=np.float32)
    patches[:, 0, :, :, 0], patches[:, 1, :, :, 1] = 1.0, 1.0
    lines = centre[..., ::-1].copy()
    origin = np.array([[[0, 1], [0, 2]]] * WORLDS)
    got = read(patch_drive(flat(patches), origin, lines, 3, FULL))[0, 1] / FULL
    assert got == pytest.approx(np.array([[0, 0], [1, 0], [1, 0], [0, 1], [0, 1]]))
