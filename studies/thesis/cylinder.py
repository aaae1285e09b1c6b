"""A cylinder on its rim (thesis 3.6): releases, and the sizes that fit figs. 3.15 to 3.20."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, STATES, TILT, V_X, V_Y, Motion, Rim, follow
from vibgym import Surface, checks

STILL = Surface(horizontal_amplitude=0.0)
"""Table at rest."""

REVOLUTION = 2.0 * math.pi


class Start(NamedTuple):
    """Start in the thesis's Cardan angles, rad, and rates, rad/s: the orientation is ``R_y(theta) R_x(psi) R_z(phi)``."""

    theta: float
    psi: float = 0.0
    phi_rate: float = 0.0
    theta_rate: float = 0.0
    psi_rate: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """Solid homogeneous cylinder on the rim of its bottom.

    Args:
        radius: m.
        centre_height: of the centre of mass above the bottom, half the height, m; 0: thin disc.
        friction: of the rim; infinite: no slip.
    """

    radius: float
    centre_height: float
    friction: float = math.inf

    @property
    def inertia(self) -> tuple[float, float]:
        """Moments of inertia across and along the axis per unit of mass, j1 and j3, m^2."""
        return 0.25 * self.radius**2 + self.centre_height**2 / 3.0, 0.5 * self.radius**2

    def rim(self, table: Surface = STILL) -> Rim:
        """Return the arguments of the kernels for a table with the horizontal motion of a surface."""
        return Rim(
            self.radius, self.centre_height, *self.inertia, self.friction, table.gravity, table.horizontal_amplitude,
            table.angular_frequency,
        )  # fmt: skip

    def released(
        self, tilt: float, nod: float = 0.0, lean: float = 0.0, spin: float = 0.0, azimuth: float = 0.0
    ) -> np.ndarray:
        """Return a state (10,) without slip, with spins about w, u and k (see :mod:`studies.thesis.rim`).

        Args:
            tilt: of the axis, rad.
            nod, lean, spin: rad/s.
            azimuth: direction of the lean, rad.

        Raises:
            ValueError: ``tilt`` is not in (0, pi/2], so that the rim has no unique lowest point.
        """
        checks.number("tilt", tilt, above=0.0, most=0.5 * math.pi)
        state = np.zeros(STATES)
        state[[TILT, AZIMUTH, SPIN, LEANING, NODDING]] = tilt, azimuth, spin, lean, nod
        forward = nod * (self.radius * math.sin(tilt) + self.centre_height * math.cos(tilt))
        sideways = -(spin * self.radius + lean * self.centre_height)
        state[V_X] = forward * math.cos(azimuth) - sideways * math.sin(azimuth)
        state[V_Y] = forward * math.sin(azimuth) + sideways * math.cos(azimuth)
        return state

    def released_as(self, start: Start) -> np.ndarray:
        """Return the state for the thesis's angles and rates."""
        theta, psi = start.theta, start.psi
        k = np.array([math.sin(theta) * math.cos(psi), -math.sin(psi), math.cos(theta) * math.cos(psi)])
        nodal = np.array([math.cos(theta), 0.0, -math.sin(theta)])  # about which psi turns
        omega = start.theta_rate * np.array([0.0, 1.0, 0.0]) + start.psi_rate * nodal + start.phi_rate * k
        azimuth, tilt = math.atan2(k[1], k[0]), math.atan2(math.hypot(k[0], k[1]), k[2])
        w = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        return self.released(tilt, float(omega @ w), float(omega @ np.cross(w, k)), float(omega @ k), azimuth)

    def idling(self, table: Surface, tilt: float, spin: float = 0.0, azimuth: float = 0.0) -> np.ndarray:
        """Return a state with the centre of mass at rest in the room while the table moves: the rim slides."""
        state = self.released(tilt, spin=spin, azimuth=azimuth)
        state[[V_X, V_Y]] = 0.0, -table.horizontal_amplitude * table.angular_frequency
        return state


def height_of_constant_tilt(
    radius: float, tilt: float, lean: float, spin: float, gravity: float = STILL.gravity
) -> float:
    """Return the centre height (m) for which a cylinder rolls at constant tilt with these spins about u and k (rad/s).

    The acceleration of the tilt is zero for the roots of a quadratic equation.

    Raises:
        ValueError: no root is positive.
    """
    a, n, r, cotangent = lean, spin, radius, 1.0 / math.tan(tilt)
    roots = np.roots([
        -4.0 / 3.0 * a * a * cotangent,
        -a * n * r * cotangent - a * a * r - gravity * math.sin(tilt),
        -0.25 * a * a * r * r * cotangent - 1.5 * a * n * r * r + r * gravity * math.cos(tilt),
    ])  # fmt: skip
    found = [float(each.real) for each in roots if each.imag == 0.0 and each.real > 0.0]
    if not found:
        raise checks.refuse("radius", radius, "a radius with a positive root")
    return min(found)


FREQUENCY = 10.64
"""Hz, frequency of the tilt in fig. 3.15."""

START_SPIN = -2.5 * REVOLUTION
"""rad/s, of most starts."""

START_TILT = math.radians(5.0)
"""rad, of figs. 3.17 and 3.19."""

FRICTION = 0.6
"""Of a sliding rim."""

SHOWN = 0.2
"""s, time axis of the figures."""

DIRECTIONS = 8
"""Number of initial directions of the lean on a moving table."""

DISTURBANCES = tuple(
    (along, 0.0) if first else (0.0, along)
    for along in (math.radians(100.0), math.radians(-100.0), math.radians(270.0), math.radians(-270.0))
    for first in (True, False)
)
"""Rates of theta and psi at the eight starts of fig. 3.19, rad/s; in the thesis the tilt of the last is constant."""

DRIVE = Surface()
"""Drive of the prototype: 2.7 mm, 25 Hz."""

COARSE = {"step": 5e-5, "arc": 0.05}
"""Step limits with which the energy error of these motions is below 1e-6."""


@dataclass(frozen=True)
class Candidate:
    """Cylinder whose tilt has the frequency :data:`FREQUENCY` after a release at rest from ``tilt`` (rad)."""

    cylinder: Cylinder
    tilt: float

    @property
    def size(self) -> str:
        """Radius and centre height as text."""
        return f"{1e3 * self.cylinder.radius:.0f} mm, {1e3 * self.cylinder.centre_height:.2f} mm"


def from_five_degrees(radius: float) -> Candidate:
    """Return the candidate of this radius (m) whose tilt at the release is 5 deg."""

    def off(height: float) -> float:
        return undriven_frequency(Cylinder(radius, height), START_TILT) - FREQUENCY

    return Candidate(Cylinder(radius, root(off, 0.01, 2.0 * radius + 0.01)), START_TILT)


def of_constant_tilt(radius: float) -> Candidate:
    """Return the candidate of this radius (m) with a constant tilt in the last start of fig. 3.19."""
    cylinder = Cylinder(radius, height_of_constant_tilt(radius, START_TILT, DISTURBANCES[-1][1], START_SPIN))

    def off(tilt: float) -> float:
        return undriven_frequency(cylinder, tilt) - FREQUENCY

    return Candidate(cylinder, root(off, math.radians(8.0), math.radians(30.0)))


def root(off: Callable[[float], float], low: float, high: float) -> float:
    """Return a root of a function between two arguments."""
    found = root_scalar(off, bracket=(low, high), method="brentq", xtol=1e-8)
    return float(found.root)


def undriven_frequency(cylinder: Cylinder, tilt: float, spin: float = START_SPIN) -> float:
    """Return the frequency of the tilt, Hz, after a release at rest on a table at rest."""
    return release(cylinder, tilt, spin, duration=2.0 * SHOWN).frequency


def release(
    cylinder: Cylinder, tilt: float, spin: float = START_SPIN, azimuth: float = 0.0, radius: float = 0.0,
    duration: float = SHOWN,
) -> Motion:  # fmt: skip
    """Release a cylinder at rest except for its spin; the table moves on a circle of ``radius`` m.

    With finite friction, the centre of mass is at rest in the room at the start, otherwise at rest relative to the table.
    """
    table = replace(STILL, horizontal_amplitude=radius)
    if math.isinf(cylinder.friction):
        start = cylinder.released(tilt, spin=spin, azimuth=azimuth)
    else:
        start = cylinder.idling(table, tilt, spin, azimuth)
    return follow(cylinder.rim(table), start, duration, **COARSE)


def slippery(cylinder: Cylinder) -> Cylinder:
    """Return the cylinder with a sliding rim."""
    return replace(cylinder, friction=FRICTION)


def all_directions(cylinder: Cylinder, tilt: float, radius: float, spin: float = START_SPIN) -> list[Motion]:
    """Release a cylinder in :data:`DIRECTIONS` directions of the lean, see :func:`release`."""
    angles = np.linspace(0.0, REVOLUTION, DIRECTIONS, endpoint=False)
    return [release(cylinder, tilt, spin, float(each), radius) for each in angles]


def disturbed(cylinder: Cylinder, rates: tuple[float, float]) -> Motion:
    """Compute a motion of fig. 3.19, on a table at rest."""
    start = cylinder.released_as(Start(START_TILT, 0.0, START_SPIN, *rates))
    return follow(cylinder.rim(), start, SHOWN, **COARSE)


def phi_change(motion: Motion) -> float:
    """Return the largest change of phi' from its initial value, revolutions per second."""
    rate = motion.phi_rate
    return float(np.abs(rate - rate[0]).max()) / REVOLUTION
