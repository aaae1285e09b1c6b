"""Gains from poles and from weights, for the linear blocks: Ackermann's formula and the Riccati equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks

DOUBLE_INTEGRATOR = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
"""A and B of the thesis's reduced plant, one axis (eqs. 5.52 and 5.53): position and velocity, driven by acceleration."""

CONJUGATE = 1e-9
"""Largest imaginary part, over the coefficient, that rounding may leave of a polynomial with real coefficients."""


def polynomial(name: str, poles: Any, count: int) -> np.ndarray:
    """Coefficients (count + 1,) of the monic polynomial with these roots, highest power first.

    Args:
        name: of the argument, for errors.
        poles: ``count`` poles of a continuous system, rad/s: real numbers, complex ones, or pairs [real, imaginary].
        count: number of poles.

    Raises:
        ValueError: another number of poles, a real part that is not negative, or complex poles without their conjugates.
    """
    allowed = f"{count} poles with negative real parts, complex ones in conjugate pairs"
    try:
        given = [complex(*each) if checks.listed(each) else complex(each) for each in poles]
    except (TypeError, ValueError, OverflowError):
        raise checks.refuse(name, poles, allowed) from None
    roots = np.array(given, dtype=np.complex128)
    if len(roots) != count or not np.isfinite(roots).all() or not (roots.real < 0.0).all():
        raise checks.refuse(name, poles, allowed)
    coefficients = np.atleast_1d(np.poly(roots))
    if np.abs(coefficients.imag).max() > CONJUGATE * np.abs(coefficients).max():
        raise checks.refuse(name, poles, allowed)
    return coefficients.real


def ackermann(a: np.ndarray, b: np.ndarray, poles: Any, name: str = "poles") -> np.ndarray:
    """Gains (n,) of the feedback ``u = -gains x`` that gives ``x' = A x + B u`` these poles (Ackermann's formula).

    Args:
        a, b: (n, n) and (n, 1), controllable.
        poles, name: see :func:`polynomial`.

    Raises:
        ValueError: as there.
    """
    order = len(a)
    wanted = polynomial(name, poles, order)
    reach = np.hstack([np.linalg.matrix_power(a, k) @ b for k in range(order)])
    value = sum(c * np.linalg.matrix_power(a, order - k) for k, c in enumerate(wanted))
    return np.linalg.solve(reach.T, np.eye(order)[-1]) @ value


def weights(name: str, values: Any, count: int) -> np.ndarray:
    """Weights (count,) of a quadratic cost.

    Raises:
        ValueError: another number of them, or one that is not positive.
    """
    if not checks.listed(values) or len(values) != count:
        raise checks.refuse(name, values, f"{count} weights > 0")
    return np.array([checks.number(f"{name}[{k}]", each, above=0.0) for k, each in enumerate(values)])


def riccati(a: np.ndarray, b: np.ndarray, state: Sequence[float], control: float) -> np.ndarray:
    """Gains (n,) of the feedback ``u = -gains x`` that makes the integral of ``x' Q x + S u^2`` least (eqs. 5.86, 5.87).

    Args:
        a, b: (n, n) and (n, 1) of ``x' = A x + B u``.
        state, control: diagonal of Q (n,), and S; all > 0.

    Raises:
        ValueError: weights that are not positive.
    """
    from scipy import linalg  # of the extra "policies"

    q, s = np.diag(weights("state_weights", state, len(a))), checks.number("control_weight", control, above=0.0)
    return (b.T @ linalg.solve_continuous_are(a, b, q, np.array([[s]])) / s)[0]


def sampled_riccati(
    f: np.ndarray, g: np.ndarray, state: Sequence[float], control: float, name: str = "state_weights"
) -> np.ndarray:
    """Gains (n,) of the feedback ``u_k = -gains x_k`` that makes the sum of ``x' Q x + S u^2`` least; see :func:`riccati`.

    Args:
        f, g: (n, n) and (n, 1) of ``x_k+1 = F x_k + G u_k``, see :func:`sampled`.
        name: of the argument ``state``, for errors.

    Raises:
        ValueError: weights that are not positive.
    """
    from scipy import linalg  # of the extra "policies"

    q, s = np.diag(weights(name, state, len(f))), checks.number("control_weight", control, above=0.0)
    p = linalg.solve_discrete_are(f, g, q, np.array([[s]]))
    return np.linalg.solve(s + g.T @ p @ g, g.T @ p @ f)[0]


def sampled(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """F and G of ``x_k+1 = F x_k + G u_k`` for ``x' = A x + B u`` with u held for ``period`` s (eqs. 5.69 to 5.72).

    Eq. 5.72 needs the inverse of A, which an integrator does not have; the exponential of both together does not.
    """
    from scipy import linalg  # of the extra "policies"

    order, inputs = b.shape
    both = np.zeros((order + inputs, order + inputs))
    both[:order, :order], both[:order, order:] = a, b
    result = linalg.expm(period * both)
    return result[:order, :order], result[:order, order:]
