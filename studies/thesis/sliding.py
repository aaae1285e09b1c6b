"""Steady sliding on one element (eq. 3.27): numerical solution, and the simulator's own steady velocity."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface, checks

STEPS = 240
"""Runge-Kutta steps of a period; the steady velocity is then right to 1e-6 for ratios up to 0.4 (see the test)."""

MOST_NEWTON = 40
TOLERANCE = 1e-9  # of what friction can change in a period


def velocity(ratio: Any, share: Any, phase: Any, periods: int, start: Any = 0.0, steps: int = STEPS) -> np.ndarray:
    """Velocity over time, in units of the table's speed, (periods * steps + 1, n, 2).

    Args:
        ratio, share, phase: numbers or arrays that broadcast to (n,); see the module.
        periods: to integrate.
        start: velocity at time zero, broadcastable to (n, 2).
        steps: a period.

    Raises:
        ValueError: numbers with which the part may stick.
    """
    ratio, share, phase = _checked(ratio, share, phase)
    now = np.array(np.broadcast_to(start, (len(ratio), 2)), dtype=float)
    result = np.empty((periods * steps + 1, len(ratio), 2))
    result[0] = now
    for k in range(periods * steps):
        now = _step(k % steps, steps, now, ratio, share, phase)
        result[k + 1] = now
    return result


def steady(ratio: Any, share: Any, phase: Any, steps: int = STEPS) -> np.ndarray:
    """Mean velocity in the steady state, in units of the table's speed, (n, 2).

    The steady state is the fixed point of the map from one period's start to the next, found by Newton's method, so that
    slow transients cost nothing.

    Args: as :func:`velocity`.

    Raises:
        ValueError: numbers with which the part may stick.
        ArithmeticError: no fixed point was found.
    """
    ratio, share, phase = _checked(ratio, share, phase)
    # To first order in the ratio, the steady velocity at full amplitude; steps are cut, so that none leaves the disc.
    start = 0.7 * share[:, None] * np.column_stack([-np.sin(phase), -np.cos(phase)])
    nearby = np.array([[0.0, 0.0], [1e-6, 0.0], [0.0, 1e-6]])[:, None]
    ratios, shares, phases = (np.tile(each, 3) for each in (ratio, share, phase))
    for _ in range(MOST_NEWTON):
        ends, means = _period((start + nearby).reshape(-1, 2), ratios, shares, phases, steps)
        images = ends.reshape(3, -1, 2)
        change = images[0] - start
        if (np.abs(change) <= TOLERANCE * ratio[:, None] + 1e-14).all():
            return means[: len(ratio)]
        slope = np.stack([(image - images[0]) / 1e-6 for image in images[1:]], axis=-1) - np.eye(2)
        move = np.linalg.solve(slope, -change[..., None])[..., 0]
        start = start + move * np.minimum(1.0, 0.3 / np.maximum(np.hypot(*move.T), 1e-300))[:, None]
    raise ArithmeticError("no steady state: Newton's method has not converged")


def _period(
    start: np.ndarray, ratio: np.ndarray, share: np.ndarray, phase: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity after a period, and its mean (n, 2) over it; the trapezoidal rule is exact to the integrator's order
    where the velocity is periodic."""
    now, total = start, np.zeros_like(start)
    for k in range(steps):
        after = _step(k, steps, now, ratio, share, phase)
        total += 0.5 * (now + after)
        now = after
    return now, total / steps


def _step(k: int, steps: int, now: np.ndarray, ratio: np.ndarray, share: np.ndarray, phase: np.ndarray) -> np.ndarray:
    h = 2.0 * math.pi / steps
    first = _slope(k * h, now, ratio, share, phase)
    second = _slope((k + 0.5) * h, now + 0.5 * h * first, ratio, share, phase)
    third = _slope((k + 0.5) * h, now + 0.5 * h * second, ratio, share, phase)
    fourth = _slope((k + 1.0) * h, now + h * third, ratio, share, phase)
    return now + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def _slope(angle: float, now: np.ndarray, ratio: np.ndarray, share: np.ndarray, phase: np.ndarray) -> np.ndarray:
    slip_x, slip_y = -math.sin(angle) - now[:, 0], math.cos(angle) - now[:, 1]
    pull = ratio * (1.0 - share * np.cos(angle + phase)) / np.hypot(slip_x, slip_y)
    return np.column_stack([pull * slip_x, pull * slip_y])


def _checked(ratio: Any, share: Any, phase: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    shape = np.broadcast_shapes(np.shape(ratio), np.shape(share), np.shape(phase), (1,))
    ratio = checks.array("ratio", ratio, shape, least=1e-6)
    share = checks.array("share", share, shape, least=0.0, most=1.0)
    worst = float((ratio * (1.0 + share)).max())
    if worst >= 1.0:
        raise checks.refuse("ratio", worst, "ratio (1 + share) below 1, where a part that slides never sticks")
    return ratio, share, checks.array("phase", phase, shape)


DECAY = 12.0
"""Time constants of friction's braking before the velocity is read; exp(-12) is 6e-6."""

LARGE = 1e4
"""m, of the one element: no part leaves it."""


def simulated_velocity(surface: Surface, friction: float, amplitude: Any, phase: Any) -> np.ndarray:
    """Mean velocities (n, 2) m/s in the steady state, from rest, of a block on one large element.

    Args:
        surface: whose horizontal motion and gravity count.
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
