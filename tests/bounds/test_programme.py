"""Dynamic programming against a double integrator with known optimum, and interpolation against polynomials."""

import numpy as np
import pytest

from vibgym.bounds.programme import Moves, best, furthest, interpolated, overshoots

PERIOD, STRONGEST = 0.04, 2.5  # s, m/s^2
IMPULSE = STRONGEST * PERIOD  # m/s


@pytest.fixture(scope="module")
def integrator():
    """A double integrator: speeds in steps of a quarter impulse along the second axis, the same along the first one."""
    speed = np.arange(-8, 41) * IMPULSE / 4.0
    push = np.linspace(-1.0, 1.0, 9) * STRONGEST
    gain = PERIOD * speed[:, None] + 0.5 * PERIOD**2 * push
    after = (speed[:, None] + PERIOD * push - speed[0]) / (IMPULSE / 4.0)
    gain = np.broadcast_to(gain, (5, *gain.shape)).copy()
    reached = np.stack(
        [np.broadcast_to(np.arange(5.0)[:, None, None], gain.shape), np.broadcast_to(after, gain.shape)], -1
    )
    return Moves(gain, np.ascontiguousarray(reached), False)


@pytest.mark.parametrize("impulses", [0, 1, 3, 6])
def test_braking_distance_is_the_known_one(integrator, impulses):
    beyond = overshoots(integrator, 10, 1)
    np.testing.assert_allclose(beyond[:, 8 + 4 * impulses], (impulses * IMPULSE) ** 2 / (2.0 * STRONGEST), atol=1e-12)


def test_only_instants_count(integrator):
    # One sample needs no braking; the second of two, three periods apart, follows three periods of braking.
    fast = 8 + 4 * 8
    assert not overshoots(integrator, 1, 5).any()
    passed = 8 * IMPULSE * 3 * PERIOD - 0.5 * STRONGEST * (3 * PERIOD) ** 2
    np.testing.assert_allclose(overshoots(integrator, 2, 3)[2, fast], passed, atol=1e-12)


@pytest.mark.parametrize("half", [1, 3, 7])
def test_half_the_time_is_braking(integrator, half):
    # At the end the part may have half a velocity step left: it reverses within a period, between the samples.
    # So of 2 n pushes, n are full ones ahead, one is half a push back and n - 1 are full ones back.
    value = furthest(integrator, overshoots(integrator, 12, 1), 0.0, 100.0, 2 * half)
    np.testing.assert_allclose(value[2 * half][:, 8], IMPULSE * PERIOD * (half**2 + half / 2 - 0.25), rtol=1e-9)


def test_overshoot_increases_the_reach_and_prices_relax_the_bound(integrator):
    overshoot = overshoots(integrator, 12, 1)
    strict, cheap, wide = (
        furthest(integrator, overshoot, allowed, price, 8)[8, 2, 8]
        for allowed, price in ((0.004, 100.0), (0.004, 1.0), (0.010, 100.0))
    )
    assert strict <= cheap + 1e-12 and strict < wide


def test_cubics_are_reproduced_and_edges_hold():
    i, j = np.meshgrid(np.arange(6.0), np.arange(7.0), indexing="ij")

    def cubic(a, b):
        return 0.3 * a**3 - a * b**2 + 0.1 * b**3 - 2.0 * a + 1.0

    value = cubic(i, j)
    for a, b in ((0.0, 0.0), (0.3, 5.9), (2.5, 3.5), (4.9, 0.2), (5.0, 6.0)):
        assert interpolated(value, False, a, b) == pytest.approx(cubic(a, b), abs=1e-11)
    assert interpolated(value, False, -3.0, 2.0) == pytest.approx(cubic(0.0, 2.0), abs=1e-11)
    assert interpolated(value, False, 2.0, 9.0) == pytest.approx(cubic(2.0, 6.0), abs=1e-11)


def test_a_cyclic_axis_closes():
    value = np.tile(np.cos(2.0 * np.pi * np.arange(24) / 24)[:, None], (1, 4))
    for at in (-0.5, 0.5, 23.5, 49.25):
        assert interpolated(value, True, at, 1.0) == pytest.approx(np.cos(2.0 * np.pi * at / 24), abs=3e-4)


def test_the_best_control_wins():
    value = np.arange(16.0).reshape(4, 4)
    gain, reached = np.array([0.0, 5.0, -1.0]), np.array([[3.0, 3.0], [0.0, 0.0], [3.0, 3.0]])
    result = np.empty((4, 4))
    best(np.tile(gain, (4, 4, 1)), np.tile(reached, (4, 4, 1, 1)), False, -1.0, value, result)
    np.testing.assert_allclose(result, 16.0)  # -(-1) + 15
