"""Coefficients of the averaged model as functions of slip, tabulated for its kernels.

``s`` is the part's mean speed over the table's. In the frame of the mean velocity (first axis along it) and with
``theta = w t + pi / 2 - direction`` the sliding direction is ``n = (exp(i theta) - s) / |exp(i theta) - s|``. The model needs
averages over ``theta`` of ``n``, of its derivative and of its antiderivatives. At ``s = 1`` slip passes through zero once a
period, and the averages of the derivative diverge logarithmically. The tables run over ``-log(1 - t)`` with
``t = min(s, 1 / s)``, in which all averages are smooth, for parts slower and faster than the table.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from vibgym.physics.averaged.averages import POLYNOMIAL_END, Averages

MEAN_STEP, MEAN_NODES = 0.05, 277  # up to 1 - t = 1e-6
COUPLING_STEP, COUPLING_NODES = 0.05, 93  # up to 1 - t = 0.01; beyond, the logarithm is meaningless
WOBBLE_STEP, WOBBLE_NODES, ANGLES = 0.1, 47, 49  # likewise
DEGREE = 11
_TERMS = 40


def mean_coefficients(s: np.ndarray) -> np.ndarray:
    """Return ``d / s``, ``(Q - P) / s^2`` and ``P + Q`` of the first-order averages, (..., 3), for any ``s >= 0``.

    With the components of ``n``: ``d = -<n_1>``, ``Q = <cos(theta) n_1>``, ``P = <sin(theta) n_2>`` (the thesis's eqs. 5.60
    and 5.61 in closed form: complete elliptic integrals), power series where those lose digits.
    """
    s = np.asarray(s, dtype=np.float64)
    result = np.empty((*s.shape, 3))
    slow, fast = s < 0.5, s > 2.0
    middle = ~(slow | fast)
    result[slow] = _slow_series(s[slow])
    result[fast] = _fast_series(1.0 / s[fast])
    result[middle] = _closed_forms(s[middle])
    return result


def first_order(s: np.ndarray) -> np.ndarray:
    """Return ``d``, ``P``, ``Q`` and ``P + Q`` of :func:`mean_coefficients`, (4, ...).

    Over the friction, elements push a part with ``Q`` along and ``P`` across its velocity, and gravity brakes it with ``d``.
    """
    ratio, difference, total = np.moveaxis(mean_coefficients(s), -1, 0)
    across = 0.5 * (total - difference * s * s)
    return np.stack([ratio * s, across, total - across, total])


def _binomials() -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients of (1 - z)^(1/2) and (1 - z)^(-1/2), whose products are the harmonics of n."""
    root, inverse = np.ones(_TERMS + 2), np.ones(_TERMS + 2)
    for j in range(1, _TERMS + 2):
        root[j] = root[j - 1] * (j - 1.5) / j
        inverse[j] = inverse[j - 1] * (j - 0.5) / j
    return root, inverse


def _slow_series(s: np.ndarray) -> np.ndarray:
    root, inverse = _binomials()
    powers = (s * s)[..., None] ** np.arange(_TERMS)
    first, second, third = (powers @ (root[k : k + _TERMS] * inverse[:_TERMS]) for k in (1, 2, 0))
    return np.stack([-first, second, third], axis=-1)


def _fast_series(t: np.ndarray) -> np.ndarray:
    # n(theta; 1 / t) = -exp(i theta) conj(n(theta; t)): harmonic k becomes harmonic 1 - k
    root, inverse = _binomials()
    powers = (t * t)[..., None] ** np.arange(_TERMS)
    rising = powers @ (root[:_TERMS] * inverse[1 : _TERMS + 1])
    slow = _slow_series(t)
    return np.stack([t * slow[..., 2], -(t**3) * rising, t * slow[..., 0]], axis=-1)


def _closed_forms(s: np.ndarray) -> np.ndarray:
    s = np.where(s == 1.0, 1.0 - 1e-15, s)  # I0 is infinite at 1, the results are not
    a, b = 1.0 + s, np.abs(1.0 - s)
    total, weight = 2.0 * s, 1.0
    for _ in range(12):  # arithmetic-geometric mean: K(m) and E(m) with m = 4 s / (1 + s)^2
        a, b, difference = 0.5 * (a + b), np.sqrt(a * b), 0.5 * (a - b)
        total = total + weight * difference * difference
        weight *= 2.0
    m = 4.0 * s / (1.0 + s) ** 2
    i0 = 1.0 / a  # averages of powers -1, 1 and 3 of |exp(i theta) - s|
    r1 = i0 * ((1.0 + s) ** 2 - total)
    r3 = (1.0 + s) ** 2 * (2.0 * (2.0 - m) * r1 - (1.0 - m) * (1.0 + s) ** 2 * i0) / 3.0
    s1 = (r1 - (1.0 + s * s) * i0) / (2.0 * s)
    s2 = (r3 - 2.0 * (1.0 + s * s) * r1 + (1.0 + s * s) ** 2 * i0) / (4.0 * s * s)
    d, p, q = s * i0 + s1, i0 - s2, s2 + s * s1
    return np.stack([d / s, (q - p) / (s * s), p + q], axis=-1)


class Waves:
    """Sliding direction, its derivative and its antiderivatives over one period at slip ``s``, on a graded grid.

    ``exp(i theta) = (z + b) / (1 + b z)`` with ``|z| = 1`` evenly spaced and ``s = 2 b / (1 + b^2)`` keeps the zero of slip as
    far from the grid as can be, so that sums and Fourier transforms converge fast even close to ``s = 1``.
    """

    def __init__(self, s: float) -> None:
        t = s if s <= 1.0 else 1.0 / s
        b = t / (1.0 + math.sqrt(1.0 - t * t))
        count = 1 << math.ceil(math.log2(max(512.0, 40.0 / (1.0 - b))))
        z = np.exp(2j * np.pi * np.arange(count) / count)
        turn = (z + b) / (1.0 + b * z)
        self.theta = np.angle(turn) % (2.0 * np.pi)
        self._grade = (1.0 - b * b) / np.abs(1.0 + b * z) ** 2
        wave_numbers = np.fft.fftfreq(count, 1.0 / count)
        self._integrate = np.zeros(count, dtype=complex)  # neither the mean nor the one harmonic without a partner
        used = (wave_numbers != 0.0) & (np.arange(count) != count // 2)
        self._integrate[used] = 1.0 / (1j * wave_numbers[used])
        slip = (1.0 - b * b) / (1.0 + b * b) * (z - b) / (1.0 + b * z)
        n, length = slip / np.abs(slip), np.abs(slip)
        if s > 1.0:
            n, length = -turn * np.conj(n), length * s
        shapes = np.stack([np.ones(count), turn.real, turn.imag])
        self.shapes = shapes
        self.direction = np.stack([n.real, n.imag])
        # xx, xy, yy; to be taken negative.
        self.derivative = np.stack([n.imag**2, -n.real * n.imag, n.real**2]) / length
        fast = np.concatenate([shapes * n.real, shapes * n.imag])
        self.velocity = self.antiderivative(fast)  # (6, count): component 1 for the three shapes, then component 2
        self.position = self.antiderivative(self.velocity)

    def average(self, values: np.ndarray) -> np.ndarray:
        """Return the mean over theta along the last axis."""
        return np.mean(values * self._grade, axis=-1)

    def antiderivative(self, values: np.ndarray) -> np.ndarray:
        """Return the antiderivative of ``values - average`` with zero mean."""
        rate = np.fft.fft((values - self.average(values)[..., None]) * self._grade)
        result = np.fft.ifft(rate * self._integrate).real
        return result - self.average(result)[..., None]


EVEN, ODD = (2, 3, 4), (0, 1, 5)
"""Rows of :attr:`Waves.velocity` that are even and odd in theta."""


def coupling_coefficients(s: float) -> np.ndarray:
    """Return averages of shape x derivative of n x antiderivative, those that do not vanish by symmetry, (27,).

    Index ``9 * derivative + 3 * shape + k``: derivatives xx, xy, yy; shapes 1, cos(theta), sin(theta); k counts the
    antiderivatives of equal parity: of (sin n_1, n_2, cos n_2), or of (n_1, cos n_1, sin n_2).
    """
    waves = Waves(s)
    result = np.empty((3, 3, 3))
    for j in range(3):
        for a in range(3):
            rows = EVEN if (j == 1) == (a == 2) else ODD
            result[j, a] = waves.average(waves.derivative[j] * waves.shapes[a] * waves.velocity[list(rows)])
    return result.ravel()


def wobble_values(s: float, theta: np.ndarray) -> np.ndarray:
    """Return first and second antiderivatives (velocity and position) at angles ``theta`` in [0, 2 pi], (len(theta), 12)."""
    waves = Waves(s)
    # The graded grid is fine where the curves bend; between its points a Hermite cubic uses the known slopes.
    grid = np.append(waves.theta, 2.0 * np.pi)
    fast = np.concatenate([waves.shapes * waves.direction[0], waves.shapes * waves.direction[1]])
    fast -= waves.average(fast)[:, None]
    values = np.concatenate([waves.velocity, waves.position])
    slopes = np.concatenate([fast, waves.velocity])
    values, slopes = (np.concatenate([table, table[:, :1]], axis=1) for table in (values, slopes))
    k = np.clip(np.searchsorted(grid, theta, side="right") - 1, 0, len(grid) - 2)
    h = grid[k + 1] - grid[k]
    u = (theta - grid[k]) / h
    return (
        values[:, k] * (1 + 2 * u) * (1 - u) ** 2
        + slopes[:, k] * h * u * (1 - u) ** 2
        + values[:, k + 1] * u * u * (3 - 2 * u)
        + slopes[:, k + 1] * h * u * u * (u - 1)
    ).T


def slips(step: float, nodes: int) -> np.ndarray:
    """Return slip at the nodes, (2, nodes), of parts slower and faster than the table; infinity is replaced by 1e12."""
    t = -np.expm1(-step * np.arange(nodes))
    return np.stack([t, 1.0 / np.maximum(t, 1e-12)])


@lru_cache(maxsize=1)
def averages() -> Averages:
    """Return the tables, built once a process in a fraction of a second."""
    theta = np.linspace(0.0, np.pi, ANGLES)
    slip = slips(MEAN_STEP, MEAN_NODES)
    mean = mean_coefficients(slip)
    mean[1] *= np.stack([slip[1], slip[1] ** 2, np.ones(MEAN_NODES)], axis=-1)  # d and Q - P are finite
    coupling = np.array([[coupling_coefficients(s) for s in side] for side in slips(COUPLING_STEP, COUPLING_NODES)])
    wobble = np.array([[wobble_values(s, theta) for s in side] for side in slips(WOBBLE_STEP, WOBBLE_NODES)])
    # Chebyshev points, then powers of s^2 for Horner's rule
    x = 0.5 * POLYNOMIAL_END * (1.0 - np.cos(np.pi * (np.arange(64) + 0.5) / 64))
    fits = [
        np.polynomial.Chebyshev.fit(x, column, DEGREE, domain=[0.0, POLYNOMIAL_END]).convert(
            kind=np.polynomial.Polynomial
        )
        for column in mean_coefficients(np.sqrt(x)).T
    ]
    polynomials = np.array([fit.coef[::-1] for fit in fits])
    return Averages(
        polynomials, 1.0 / MEAN_STEP, mean, 1.0 / COUPLING_STEP, coupling,
        1.0 / WOBBLE_STEP, (ANGLES - 1) / np.pi, wobble,
    )  # fmt: skip
