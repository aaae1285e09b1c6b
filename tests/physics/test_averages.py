"""Coefficients of the averaged model: closed forms against quadrature, tables against both."""

import math
import warnings

import numpy as np
import pytest
from scipy.integrate import IntegrationWarning, quad

from vibgym.physics.averaged.averages import (
    POLYNOMIAL_END,
    first_order,
    gather_moments,
    interpolate,
    interpolate_wobble,
    mean_row,
    new_scratch,
    second_order,
    wobble,
)
from vibgym.simulation.averages_tables import (
    COUPLING_NODES,
    COUPLING_STEP,
    EVEN,
    ODD,
    averages,
    coupling_coefficients,
    mean_coefficients,
    wobble_values,
)

SLIPS = [
    1e-9, 1e-3, 0.01, 0.1, 0.3, 0.4999, 0.5, 0.7, 0.9, 0.99, 0.9999, 1.0, 1.0001, 1.01, 1.5, 2.0, 2.0001, 5.0, 100.0,
]  # fmt: skip
CLAMP = COUPLING_STEP * (COUPLING_NODES - 1)


def slip_direction(theta, s):
    n = np.exp(1j * theta) - s
    return n / np.abs(n)


@pytest.mark.parametrize("s", SLIPS)
def test_closed_forms_against_quadrature(s):
    """d, P and Q to 1e-12: an adaptive rule on the half period, refined where slip is smallest."""

    def average(f):
        bends = sorted({min(abs(1 - s) * k + 1e-9, 3.0) for k in (1, 4, 16, 64)})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IntegrationWarning)  # warns at the limit of rounding
            return quad(f, 0.0, math.pi, points=bends, epsabs=1e-14, epsrel=1e-13, limit=400)[0] / math.pi

    d = -average(lambda a: slip_direction(a, s).real)
    q = average(lambda a: math.cos(a) * slip_direction(a, s).real)
    p = average(lambda a: math.sin(a) * slip_direction(a, s).imag)
    first, second, third = mean_coefficients(np.array(s))
    assert s * first == pytest.approx(d, abs=1e-12)
    assert 0.5 * (third + s * s * second) == pytest.approx(q, abs=1e-12)
    assert 0.5 * (third - s * s * second) == pytest.approx(p, abs=1e-12)


def test_closed_forms_at_the_ends():
    assert mean_coefficients(np.array(0.0)) == pytest.approx([0.5, -0.125, 1.0], abs=1e-15)  # d = s / 2, P = Q = 1 / 2
    far = 1e6  # friction opposes the velocity: d = 1
    assert far * mean_coefficients(np.array(far))[0] == pytest.approx(1.0, abs=1e-11)
    # series and closed forms meet
    for s in (0.5, 2.0):
        below, above = mean_coefficients(np.array([s * (1 - 1e-12), s * (1 + 1e-12)]))
        assert np.abs(below - above).max() < 1e-11


def plain_waves(s, count=1 << 17):
    """Antiderivatives by evenly spaced angles and cumulative sums."""
    theta = (np.arange(count) + 0.5) * (2 * math.pi / count)
    n = slip_direction(theta, s)
    shapes = np.stack([np.ones(count), np.cos(theta), np.sin(theta)])
    fast = np.concatenate([shapes * n.real, shapes * n.imag])
    fast -= fast.mean(axis=1, keepdims=True)
    step = 2 * math.pi / count

    def antiderivative(f):
        w = np.cumsum(f, axis=1) * step - 0.5 * step * f
        return w - w.mean(axis=1, keepdims=True)

    velocity = antiderivative(fast)
    length = np.abs(np.exp(1j * theta) - s)
    derivative = np.stack([n.imag**2, -n.real * n.imag, n.real**2]) / length
    return theta, shapes, derivative, velocity, antiderivative(velocity)


@pytest.mark.parametrize("s", [0.0, 0.2, 0.72, 0.95, 1.05, 1.7, 8.0])
def test_second_order_coefficients_against_plain_sums(s):
    _, shapes, derivative, velocity, _ = plain_waves(s)
    full = np.einsum("jt,at,lt->jal", derivative, shapes, velocity) / shapes.shape[1]
    kept = coupling_coefficients(s).reshape(3, 3, 3)
    for j in range(3):
        for a in range(3):
            rows, others = (EVEN, ODD) if (j == 1) == (a == 2) else (ODD, EVEN)
            assert kept[j, a] == pytest.approx(full[j, a, list(rows)], abs=2e-9)  # (2 pi / 2^17)^2 = 2e-9
            assert np.abs(full[j, a, list(others)]).max() < 1e-12  # vanish by symmetry


@pytest.mark.parametrize("s", [0.0, 0.3, 0.72, 0.95, 1.05, 3.0])
def test_wobble_against_plain_sums(s):
    theta, _, _, velocity, position = plain_waves(s)
    pick = np.arange(0, len(theta), 997)
    got = wobble_values(s, theta[pick]).T
    # Hermite cubics on the graded grid: (2 pi / 512)^4 / 384 times a fourth derivative, large only near s = 1
    assert np.abs(got - np.concatenate([velocity, position])[:, pick]).max() < 2e-6


def test_known_error_of_the_tables():
    """Check the errors stated in the documentation."""
    tables, scratch = averages(), new_scratch()
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, POLYNOMIAL_END, 2001)
    powers = np.stack([np.polyval(p, x) for p in tables.polynomials], axis=-1)
    assert np.abs(powers - mean_coefficients(np.sqrt(x))).max() < 2e-8

    worst = {"mean": 0.0, "coupling": 0.0, "coupling near 1": 0.0}
    gaps = np.concatenate([rng.uniform(1e-5, 1.0, 60), 10.0 ** rng.uniform(-5, 0, 60)])  # 1 - t
    for gap in gaps:
        for s in (1.0 - gap, 1.0 / (1.0 - gap) if gap < 1 else 50.0):
            mean_row(tables, s, scratch)
            worst["mean"] = max(worst["mean"], np.abs(scratch.values[:3] - mean_coefficients(np.array(s))).max())
            if -math.log(gap) < CLAMP:
                interpolate(tables.coupling, tables.coupling_scale, s, scratch)
                error = np.abs(scratch.values[:27] - coupling_coefficients(s)).max()
                name = "coupling" if gap > 0.1 else "coupling near 1"
                worst[name] = max(worst[name], error)
    assert worst["mean"] < 2e-6 and worst["coupling"] < 5e-6 and worst["coupling near 1"] < 1e-7, worst

    for s, bound in ((0.05, 5e-5), (0.4, 5e-5), (0.72, 1e-4), (0.85, 5e-4), (1.3, 5e-4), (4.0, 5e-5)):
        theta = rng.uniform(-math.pi, math.pi, 200)
        exact = wobble_values(s, theta % (2 * math.pi))
        got = np.empty_like(exact)
        for k, angle in enumerate(theta):
            interpolate_wobble(tables, s, angle, 12, scratch)
            got[k] = scratch.values[:12]
        assert np.abs(got - exact).max() < bound, (s, np.abs(got - exact).max())


@pytest.mark.parametrize("s", [0.0, 1e-200, 0.99, 0.999999, 1.0, 1.0000001, 1.01, 1e3, 1e9])
def test_finite_at_every_slip(s):
    """Slip through zero has a logarithm in second order: it is held at 1 - t = 0.01, and first order is continuous."""
    tables, scratch = averages(), new_scratch()
    points = np.array([[0.25] * 4, [0.01, -0.01, 0.0, 0.0], [0.0, 0.0, 0.02, -0.02]])
    c, n = np.full(4, 5.0), 4
    moments, result = np.empty((6, 3)), np.empty(6)
    gather_moments(points, c, -c, n, moments)
    speed = 0.42
    force = first_order(tables, points, c, -c, n, 9.81, speed, 0.02, s * speed, 0.0, 0.0, scratch)
    wobble(tables, moments, 9.81, speed, 1e-4, s * speed, 0.0, result, scratch)
    more = second_order(tables, moments, 9.81, speed, 1e-4, s * speed, 0.0, scratch)
    assert np.isfinite(force).all() and np.isfinite(result).all() and np.isfinite(more).all()
    assert np.abs(force).max() < 2 * 9.81 and np.abs(result).max() < 3 * 9.81
    if s < 1e3:
        near = first_order(tables, points, c, -c, n, 9.81, speed, 0.02, s * speed * (1 + 1e-7), 0.0, 0.0, scratch)
        assert near == pytest.approx(force, abs=5e-4)  # 9.81 m/s^2 x 1e-6 x log(1e-6) and more


# -- the whole part against brute force --------------------------------------------------------------------------------


def brute_force(points, c, s, gravity, speed, gyration, velocity, count=4096):
    """Time series of (force, torque / inertia) per mu at a fixed velocity, and its derivative by velocity and spin."""
    tau = (np.arange(count) + 0.5) * (2 * math.pi / count)

    def fast(v):
        ux = -speed * np.sin(tau)[:, None] - (v[0] - v[2] * points[2])
        uy = speed * np.cos(tau)[:, None] - (v[1] + v[2] * points[1])
        stress = points[0] * (gravity - c * np.cos(tau)[:, None] + s * np.sin(tau)[:, None]) / np.hypot(ux, uy)
        fx, fy = stress * ux, stress * uy
        return np.stack([fx.sum(1), fy.sum(1), (points[1] * fy - points[2] * fx).sum(1) / gyration])

    f = fast(velocity)
    h = 1e-6
    derivative = np.stack([(fast(velocity + h * e) - fast(velocity - h * e)) / (2 * h) for e in np.eye(3)], axis=1)
    step = 2 * math.pi / count
    w = np.cumsum(f - f.mean(1, keepdims=True), axis=1) * step
    w -= 0.5 * step * (f - f.mean(1, keepdims=True))
    w -= w.mean(1, keepdims=True)
    return f.mean(1), np.einsum("ijt,jt->i", derivative, w) / count, w


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.1, 0.05), (-0.2, 0.2), (0.02, -0.31), (0.6, 0.3)])
def test_both_orders_and_wobble_of_a_part_against_brute_force(velocity):
    rng = np.random.default_rng(3)
    pieces, speed, gyration = 6, 0.42, 3e-4
    offset, half = rng.uniform(-0.03, 0.03, (2, pieces)), rng.uniform(0.002, 0.01, (2, pieces))
    x = (offset[0][:, None] + half[0][:, None] * [1, -1, 0, 0]).ravel()
    y = (offset[1][:, None] + half[1][:, None] * [0, 0, 1, -1]).ravel()
    share = rng.uniform(0.2, 1.0, pieces)
    points = np.stack([np.repeat(share / share.sum() / 4, 4), x, y])
    size, alpha = rng.uniform(0, 9.81, pieces), rng.uniform(-3, 3, pieces)
    c, s = np.repeat(size * np.cos(alpha), 4), np.repeat(size * np.sin(alpha), 4)
    tables, scratch, moments, result = averages(), new_scratch(), np.empty((6, 3)), np.empty(6)
    gather_moments(points, c, s, 24, moments)
    vx, vy = velocity
    first, second, w = brute_force(points, c, s, 9.81, speed, gyration, np.array([vx, vy, 0.0]))
    got = np.array(second_order(tables, moments, 9.81, speed, gyration, vx, vy, scratch)) * [1, 1, 1 / gyration]
    assert got == pytest.approx(second, rel=1e-4, abs=1e-4 * np.abs(second[:2]).max())
    wobble(tables, moments, 9.81, speed, gyration, vx, vy, result, scratch)
    at_zero = 0.5 * (w[:, 0] + w[:, -1])
    assert result[:3] == pytest.approx(at_zero, rel=1e-4, abs=1e-3)
    for spin in (0.0, 4.0, -15.0):
        mean, _, _ = brute_force(points, c, s, 9.81, speed, gyration, np.array([vx, vy, spin]))
        force = first_order(tables, points, c, s, 24, 9.81, speed, 0.045, vx, vy, spin, scratch)
        error = np.abs(np.array(force) * [1, 1, 1 / gyration] - mean)
        assert error[:2].max() < 2e-6 * 2 * 9.81 and error[2] < 2e-6 * 2 * 9.81 * 0.045 / gyration  # the table's 2e-6
