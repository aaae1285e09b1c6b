"""Eight doubles as one value: each lane has the bits that Python computes from that lane's numbers."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym.kernels.jit import exact
from vibgym.kernels.vector import (
    LANES,
    WIDTH,
    absolute,
    bits,
    broadcast,
    copysign,
    floor,
    lane_maximum,
    lane_minimum,
    lane_sum,
    load,
    load_mask,
    load_register,
    logical_not,
    mask_of,
    maximum,
    minimum,
    select,
    sqrt,
    store,
    store_mask,
)
from vibgym.physics.planar.stepper import sincos

numbers = st.lists(st.floats(-1e6, 1e6), min_size=LANES, max_size=LANES).map(np.array)


@exact
def arithmetic(a, b, out):
    x, y = load(a, 0), load(b, 0)
    for k, value in enumerate((x + y, x - y, x * y, x / y, -x, x + 1, 2.0 - y)):
        store(out, k * LANES, value)
    chosen = (minimum(x, y), maximum(x, y), floor(x), absolute(x), copysign(x, y), sqrt(absolute(x)), broadcast(a[0]))
    for k, value in enumerate(chosen):
        store(out, (7 + k) * LANES, value)
    return lane_minimum(x), lane_maximum(x), lane_sum(x)


@given(numbers, numbers)
def test_operators_are_those_of_python(a, b):
    out = np.empty(14 * LANES)
    with np.errstate(all="ignore"):
        ends = arithmetic(a, b, out)
        expected = [
            a + b, a - b, a * b, a / b, -a, a + 1.0, 2.0 - b, np.where(a < b, a, b), np.where(a > b, a, b), np.floor(a),
            np.abs(a), np.copysign(a, b), np.sqrt(np.abs(a)), np.full(LANES, a[0]),
        ]  # fmt: skip
    assert np.array_equal(out.reshape(14, LANES), expected, equal_nan=True)
    total = a
    while len(total) > 1:  # halves are added, so that bits do not depend on the processor
        total = total[: len(total) // 2] + total[len(total) // 2 :]
    assert ends == (a.min(), a.max(), total[0])


@exact
def masks(a, b, flags, out):
    x, y = load(a, 0), load(b, 0)
    both, either, opposite = (x < y) & (x >= 0.0), (x <= y) | (y > 0.0), logical_not(x > y)
    store_mask(flags, 0, both)
    store_mask(flags, LANES, either)
    store_mask(flags, 2 * LANES, opposite)
    store(out, 0, select(both, x, 7.0))
    store(out, LANES, select(load_mask(flags, LANES), x, y))
    store(out, 2 * LANES, select(mask_of(bits(opposite)), x, y))
    return bits(both)


@given(numbers, numbers)
def test_masks(a, b):
    flags, out = np.zeros(3 * LANES, bool), np.empty(3 * LANES)
    number = masks(a, b, flags, out)
    both, either, opposite = (a < b) & (a >= 0.0), (a <= b) | (b > 0.0), ~(a > b)
    assert np.array_equal(flags.reshape(3, LANES), [both, either, opposite])
    assert number == sum(1 << k for k in range(LANES) if both[k])
    assert np.array_equal(out[:LANES], np.where(both, a, 7.0))
    assert np.array_equal(out[LANES:].reshape(2, LANES), [np.where(either, a, b), np.where(opposite, a, b)])


@exact
def fused(a, b, c, out):
    store(out, 0, load(a, 0) * load(b, 0) + load(c, 0))
    store(out, LANES, load(c, 0) - load(a, 0) * load(b, 0))
    for at in range(0, LANES, WIDTH):  # as many as a register holds: the same bits
        store(out, 2 * LANES + at, load_register(a, at) * load_register(b, at) + load_register(c, at))


def test_a_product_is_rounded_with_the_sum():
    """The square of 1 + 2^-30 minus its rounded value is the bit lost by rounding."""
    one = 1.0 + 2.0**-30
    a, out = np.full(LANES, one), np.empty(3 * LANES)
    fused(a, a, np.full(LANES, -(1.0 + 2.0**-29)), out)
    assert (out[:LANES] == 2.0**-60).all() and (out[LANES : 2 * LANES] == -2.0 - 2.0**-28 - 2.0**-60).all()
    assert np.array_equal(out[2 * LANES :], out[:LANES])


@exact
def angles(a, out):
    s, c = sincos(load(a, 0))
    store(out, 0, s)
    store(out, LANES, c)


@given(st.lists(st.floats(-1e6, 1e6), min_size=LANES, max_size=LANES).map(np.array))
def test_sine_and_cosine(a):
    out = np.empty(2 * LANES)
    angles(a, out)
    expected = np.array([[math.sin(x) for x in a], [math.cos(x) for x in a]])
    assert np.abs(out.reshape(2, LANES) - expected).max() < 3e-16


@pytest.mark.parametrize("angle", [1e9, 1e17, 1e300, -1e300])
def test_of_huge_angles_a_rotation_is_left(angle):
    out = np.empty(2 * LANES)
    angles(np.full(LANES, angle), out)
    assert np.abs(out[:LANES] ** 2 + out[LANES:] ** 2 - 1.0).max() < 1e-10


SCENE = """
import hashlib, numpy as np
from vibgym import Part, Simulator, Surface

surface, rng = Surface(), np.random.default_rng(0)
shape = (24, surface.rows, surface.columns)
amplitude, phase = rng.uniform(0, surface.max_amplitude, shape), rng.uniform(-3, 3, shape)
pose = rng.uniform([0.05, 0.05, -3], [0.7, 0.16, 3], (24, 3))
simulator = Simulator(surface, Part.rectangle(0.05, 0.035, friction=0.6), worlds=24, threads=1)
simulator.reset(pose[:, None])
simulator.advance(amplitude, phase, 3)
print(hashlib.sha256(simulator.pose.tobytes() + simulator.velocity.tobytes()).hexdigest())
"""


def test_bits_do_not_depend_on_the_width_of_registers():
    """As far as one processor can show: what is written for AVX-512 is split for others, in the same order."""
    results = {
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", SCENE], env={**os.environ, "VIBGYM_VECTOR": width},
            capture_output=True, text=True, check=True,
        ).stdout
        for width in ("4", "8")
    }  # fmt: skip
    assert len(results) == 1
    assert LANES == 8 and WIDTH in (4, 8)
