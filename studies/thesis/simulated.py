"""The simulator's own steady velocities on a single element, beside the solutions of eq. 3.27."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface

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
    told = np.asarray(amplitude, dtype=float)[:, None, None]
    one = replace(surface, rows=1, columns=1, element_size=LARGE, max_amplitude=None)
    part = Part.rectangle(0.050, 0.035, friction=friction)
    simulator = Simulator(one, part, worlds=len(told))
    simulator.reset([0.5 * LARGE, 0.5 * LARGE, 0.0])
    rate = friction * one.gravity / (2.0 * one.table_speed)
    simulator.advance(told, np.asarray(phase, dtype=float)[:, None, None], math.ceil(DECAY / (rate * one.period)))
    return simulator.mean_velocity[:, 0, :2]
