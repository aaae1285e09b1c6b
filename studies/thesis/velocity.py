"""Fig. 7.3: how fast a part goes in a uniform field, by the elements' amplitude, and what a dead zone makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import PrototypeActuators
from vibgym.physics.core.drive import polar_drive

DEAD_ZONE = 1e-4
"""m, below which the prototype did not realise amplitudes (thesis 7.2, 7.3)."""

PHASE = 1.5 * math.pi  # pushes along +x
SETTLE, MEAN = 30, 5
"""Periods until the velocity is steady (friction brakes at 6.9 per second: to 0.03 %), and over which it is averaged."""


def steady_velocity(
    part: Part, amplitude: Sequence[float] | np.ndarray, *, dead_zone: float = 0.0, form: str = "hard"
) -> np.ndarray:
    """Mean speeds (n,) m/s of a part on elements that are all told one of ``amplitude`` (n,) m, through a dead zone.

    Args:
        part: on the prototype's surface.
        amplitude: commanded.
        dead_zone: m.
        form: among :data:`vibgym.physics.core.hardware.FORMS`.
    """
    surface, told = Surface(), np.asarray(amplitude, dtype=np.float64)
    shape = (len(told), surface.rows, surface.columns)
    command = polar_drive(np.broadcast_to(told[:, None, None], shape), np.full(shape, PHASE), surface.angular_frequency)
    actuators = PrototypeActuators(
        surface, len(told), 1, dead_zone=dead_zone, dead_zone_form=form, latency=0, gain_spread=0.0, phase_spread=0.0,
        seed=0,
    )  # fmt: skip
    actuators.prepare(command)
    actuators.reset(np.arange(len(told)), np.zeros((len(told), 0)))
    simulator = Simulator(surface, part, worlds=len(told))
    simulator.reset([0.1, 0.5 * surface.depth, 0.0], [*surface.idle_velocity(part.friction), 0.0])
    places = []
    for periods in (SETTLE, MEAN):
        ((drive, _),) = actuators.apply(command)
        simulator.run(drive, periods)
        places.append(simulator.pose[:, 0, :2])
    return np.hypot(*(places[1] - places[0]).T) / (MEAN * surface.period)
