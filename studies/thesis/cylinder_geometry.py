"""Which cylinders the numbers of figs. 3.15 to 3.20 ask for, and what they do there: the text has lost its size."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import root_scalar

from studies.thesis.cylinder import REVOLUTION, STILL, Cylinder, Start, height_of_constant_tilt
from studies.thesis.rim_course import Course, follow
from vibgym import Surface

FREQUENCY = 10.64
"""Hz, of the tilt in fig. 3.15."""

SPIN = -2.5 * REVOLUTION
"""rad/s, of most starts."""

TILT = math.radians(5.0)
"""Of the starts of figs. 3.17 and 3.19."""

FRICTION = 0.6
"""Of a rim that slides."""

SHOWN = 0.2
"""s, the figures' axis."""

DIRECTIONS = 8
"""Of the first lean over the table's motion, where the table moves."""

KNOCKS = tuple(
    (along, 0.0) if first else (0.0, along)
    for along in (math.radians(100.0), math.radians(-100.0), math.radians(270.0), math.radians(-270.0))
    for first in (True, False)
)
"""Rates of theta and psi at the eight starts of fig. 3.19, rad/s; the last keeps its tilt in the thesis."""

DRIVE = Surface()
"""The prototype's: 2.7 mm, 25 Hz."""

COARSE = {"step": 5e-5, "arc": 0.05}
"""Steps of RK4 that keep the energy of these motions to 1e-6."""


@dataclass(frozen=True)
class Candidate:
    """A cylinder whose tilt changes :data:`FREQUENCY` times a second when it is let go at rest from ``tilt`` (rad)."""

    cylinder: Cylinder
    tilt: float

    @property
    def size(self) -> str:
        """Radius and centre height in words."""
        return f"{1e3 * self.cylinder.radius:.0f} mm, {1e3 * self.cylinder.centre_height:.2f} mm"


def from_five_degrees(radius: float) -> Candidate:
    """Of this radius (m), with the height for which that tilt is 5 deg."""

    def off(height: float) -> float:
        return undriven_frequency(Cylinder(radius, height), TILT) - FREQUENCY

    return Candidate(Cylinder(radius, root(off, 0.01, 2.0 * radius + 0.01)), TILT)


def of_constant_tilt(radius: float) -> Candidate:
    """Of this radius (m), with the height for which fig. 3.19's last start keeps its tilt."""
    cylinder = Cylinder(radius, height_of_constant_tilt(radius, TILT, KNOCKS[-1][1], SPIN))

    def off(tilt: float) -> float:
        return undriven_frequency(cylinder, tilt) - FREQUENCY

    return Candidate(cylinder, root(off, math.radians(8.0), math.radians(30.0)))


def root(off: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes its sign between two places."""
    found = root_scalar(off, bracket=(low, high), method="brentq", xtol=1e-8)
    return float(found.root)


def undriven_frequency(cylinder: Cylinder, tilt: float, spin: float = SPIN) -> float:
    """Of the tilt, Hz, after a release at rest on a table at rest."""
    return let_go(cylinder, tilt, spin, duration=2.0 * SHOWN).frequency


def let_go(
    cylinder: Cylinder, tilt: float, spin: float = SPIN, azimuth: float = 0.0, radius: float = 0.0, amplitude: float = 0.0,
    duration: float = SHOWN,
) -> Course:  # fmt: skip
    """From a tilt at rest, apart from the spin; the table moves on a circle of ``radius`` m, and by ``amplitude`` vertically.

    An edge that slides (finite friction) starts with its centre of mass at rest in the room, any other at rest over the table.
    """
    table = replace(STILL, horizontal_amplitude=radius)
    if math.isinf(cylinder.friction):
        start = cylinder.released(tilt, spin=spin, azimuth=azimuth)
    else:
        start = cylinder.idling(table, tilt, spin, azimuth)
    return follow(cylinder.rim(table, amplitude), start, duration, **COARSE)


def slippery(cylinder: Cylinder) -> Cylinder:
    """The same with a rim that slides."""
    return replace(cylinder, friction=FRICTION)


def all_directions(
    cylinder: Cylinder, tilt: float, radius: float, amplitude: float = 0.0, spin: float = SPIN
) -> list[Course]:
    """The same for :data:`DIRECTIONS` first leans."""
    angles = np.linspace(0.0, REVOLUTION, DIRECTIONS, endpoint=False)
    return [let_go(cylinder, tilt, spin, float(each), radius, amplitude) for each in angles]


def knocked(cylinder: Cylinder, rates: tuple[float, float]) -> Course:
    """A start of fig. 3.19 on a table at rest."""
    start = cylinder.released_as(Start(TILT, 0.0, SPIN, *rates))
    return follow(cylinder.rim(), start, SHOWN, **COARSE)


def phi_change(course: Course) -> float:
    """Largest change of phi' from its start, revolutions a second."""
    rate = course.phi_rate
    return float(np.abs(rate - rate[0]).max()) / REVOLUTION
