"""Steady sliding on one element (eq. 3.27): numerical solution, and steady velocity of the simulator.

Parameters are dimensionless: ``ratio`` is mu g over the table's acceleration a_h w^2, ``share`` the vertical amplitude over the
lift-off amplitude, ``phase`` its phase, rad.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface, checks

STEPS = 240
"""Runge-Kutta steps per period; the error of the steady velocity is below 1e-6 for ratios up to 0.4 (see the test)."""

MAX_NEWTON = 40
TOLERANCE = 1e-9  # relative to the change by friction in a period


def velocity(ratio: Any, share: Any, phase: Any, periods: int, start: Any = 0.0, steps: int = STEPS) -> np.ndarray:
    """Return the velocity over time, in units of the table's speed, (periods * steps + 1, n, 2).

    Args:
        ratio, share, phase: scalars or arrays that broadcast to (n,), see the module.
        periods: number of periods.
        start: velocity at time zero, broadcastable to (n, 2).
        steps: per period.

    Raises:
        ValueError: values for which the part may stick.
    """
    ratio, share, phase = np.broadcast_arrays(*map(np.atleast_1d, (ratio, share, phase)))
    worst = float((ratio * (1.0 + share)).max())
    if worst >= 1.0:
        raise checks.refuse("ratio", worst, "ratio (1 + share) below 1: a sliding part never sticks")
    h = 2.0 * math.pi / steps

    def slope(angle: float, now: np.ndarray) -> np.ndarray:
        slip_x, slip_y = -math.sin(angle) - now[:, 0], math.cos(angle) - now[:, 1]
        pull = ratio * (1.0 - share * np.cos(angle + phase)) / np.hypot(slip_x, slip_y)
        return np.column_stack([pull * slip_x, pull * slip_y])

    now = np.array(np.broadcast_to(start, (len(ratio), 2)), dtype=float)
    path = [now]
    for k in range(periods * steps):
        first = slope(k % steps * h, now)
        second = slope((k % steps + 0.5) * h, now + 0.5 * h * first)
        third = slope((k % steps + 0.5) * h, now + 0.5 * h * second)
        fourth = slope((k % steps + 1.0) * h, now + h * third)
        now = now + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        path.append(now)
    return np.array(path)


def steady(ratio: Any, share: Any, phase: Any, steps: int = STEPS) -> np.ndarray:
    """Return the mean velocity in the steady state, in units of the table's speed, (n, 2).

    The steady state is the fixed point of the map from the start of a period to its end, found by Newton's method. Its mean is
    taken by the trapezoidal rule, which has the order of the integrator for a periodic velocity.

    Args:
        ratio, share, phase, steps: see :func:`velocity`.

    Raises:
        ValueError: values for which the part may stick.
        ArithmeticError: Newton's method does not converge.
    """
    ratio, share, phase = np.broadcast_arrays(*map(np.atleast_1d, (ratio, share, phase)))
    # First guess: steady velocity at full amplitude, to first order in the ratio. Newton steps are limited to 0.3.
    start = 0.7 * share[:, None] * np.column_stack([-np.sin(phase), -np.cos(phase)])
    nearby = np.array([[0.0, 0.0], [1e-6, 0.0], [0.0, 1e-6]])[:, None]
    ratios, shares, phases = (np.tile(values, 3) for values in (ratio, share, phase))
    for _ in range(MAX_NEWTON):
        path = velocity(ratios, shares, phases, 1, (start + nearby).reshape(-1, 2), steps)
        images = path[-1].reshape(3, -1, 2)
        change = images[0] - start
        if (np.abs(change) <= TOLERANCE * ratio[:, None] + 1e-14).all():
            return ((0.5 * (path[:-1] + path[1:])).sum(axis=0) / steps)[: len(ratio)]
        slope = np.stack([(image - images[0]) / 1e-6 for image in images[1:]], axis=-1) - np.eye(2)
        move = np.linalg.solve(slope, -change[..., None])[..., 0]
        start = start + move * np.minimum(1.0, 0.3 / np.maximum(np.hypot(*move.T), 1e-300))[:, None]
    raise ArithmeticError("no steady state: Newton's method did not converge")


DECAY = 12.0
"""Simulated time before the velocity is read, in time constants of the friction; exp(-12) is 6e-6."""

LARGE = 1e4
"""m, size of the element; no part leaves it."""


def simulated_velocity(surface: Surface, friction: float, amplitude: Any, phase: Any) -> np.ndarray:
    """Return mean velocities (n, 2) m/s of a block on one large element in the steady state, simulated from rest.

    Args:
        surface: defines horizontal motion and gravity.
        friction: of the part.
        amplitude, phase: (n,) m and rad, of the element's vertical motion.
    """
    commanded = np.asarray(amplitude, dtype=float)[:, None, None]
    one = replace(surface, rows=1, columns=1, element_size=LARGE, max_amplitude=None)
    part = Part.rectangle(0.050, 0.035, friction=friction)
    simulator = Simulator(one, part, worlds=len(commanded))
    simulator.reset([0.5 * LARGE, 0.5 * LARGE, 0.0])
    rate = friction * one.gravity / (2.0 * one.table_speed)
    simulator.advance(commanded, np.asarray(phase, dtype=float)[:, None, None], math.ceil(DECAY / (rate * one.period)))
    return simulator.mean_velocity[:, 0, :2]
