"""Limit surface of a contact area: load of static friction, and direction of motion at breakaway.

Wrenches are per unit mass. ``grip(xi)`` is the friction wrench for slip along the twist ``xi``; its product with ``xi``
is the support function ``H(xi) = mu int p |xi_v + xi_w z^ x r|`` of the set of all wrenches that friction can carry.
Twists and wrenches are scaled by the radius of gyration, ``(u_x, u_y, k s)`` and ``(F_x, F_y, T/k)``, so that the mass
matrix is the identity. Both problems below are then smooth optimisations over two variables, the direction of a twist.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

Grip = Callable[[np.ndarray], np.ndarray]

_SETTLED = 1e-11  # slope at which a search stops; values at the end are right to the square of that


def load(grip: Grip, needed: np.ndarray, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """Return the load of a needed wrench relative to the limit surface: 1 is on it, less can be held.

    It is the largest ``needed.xi / H(xi)`` over all twists, computed as the least ``H(xi)`` with ``needed.xi = |needed|``, a
    convex problem.

    Args:
        grip: friction wrench (3,) by twist (3,).
        needed: (3,), m/s^2.
        start: initial guess of the twist, such as that of the previous instant.

    Returns:
        The load, and the twist (3,) of breakaway, of unit length.
    """
    size = float(np.linalg.norm(needed))
    if size == 0.0:
        return 0.0, np.array([1.0, 0.0, 0.0])
    along = needed / size
    first, second = _across(along)
    guess = np.zeros(2)
    if start is not None and start @ along > 0.1:
        guess = np.array([start @ first, start @ second]) / (start @ along)

    def support(offset: np.ndarray) -> tuple[float, np.ndarray]:
        xi = along + offset[0] * first + offset[1] * second
        wrench = grip(xi)
        return float(wrench @ xi), np.array([wrench @ first, wrench @ second])

    scale = max(float(np.linalg.norm(grip(along))), 1e-300)
    offset, least = _search(lambda b: tuple(moment / scale for moment in support(b)), guess)
    least *= scale
    xi = along + offset[0] * first + offset[1] * second
    return (size / least if least > 0.0 else math.inf), xi / np.linalg.norm(xi)


def escape(grip: Grip, needed: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the slip acceleration (3,) with which a part at zero slip starts to slide; zero where friction holds it.

    It is the unique minimum of ``|eta|^2 / 2 + H(eta) - needed.eta``: ``eta`` is the needed wrench minus the friction that
    opposes ``eta``. Its length is the largest ``needed.xi - H(xi)`` over unit twists, its direction that ``xi``.

    Args:
        grip, needed: as for :func:`load`.
        start: initial guess, the unit twist that :func:`load` returns.
    """
    first, second = _across(start)
    size = max(float(np.linalg.norm(needed)), 1e-300)

    def deficit(offset: np.ndarray) -> tuple[float, np.ndarray]:
        xi = start + offset[0] * first + offset[1] * second
        length = float(np.linalg.norm(xi))
        left = grip(xi) - needed
        value = float(left @ xi) / length
        slope = (left - value * xi / length) / length
        return value / size, np.array([slope @ first, slope @ second]) / size

    offset, least = _search(deficit, np.zeros(2))
    if least >= 0.0:
        return np.zeros(3)
    xi = start + offset[0] * first + offset[1] * second
    return -least * size * xi / np.linalg.norm(xi)


def _across(along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors perpendicular to a unit vector and to each other."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(along))] = 1.0
    first = np.cross(along, axis)
    first /= np.linalg.norm(first)
    return first, np.cross(along, first)


def _search(function, guess: np.ndarray) -> tuple[np.ndarray, float]:
    if np.abs(function(guess)[1]).max() <= _SETTLED:
        return guess, function(guess)[0]
    minimum = minimize(function, guess, jac=True, method="BFGS", options={"gtol": _SETTLED, "maxiter": 200})
    return minimum.x, float(minimum.fun)
