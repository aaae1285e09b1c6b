"""A cylinder that stands on its rim (thesis 3.6): releases, closed forms, and the sizes that figs. 3.15 to 3.20 ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, STATES, TILT, V_X, V_Y, Course, Rim, follow
from vibgym import Surface, checks

STILL = Surface(horizontal_amplitude=0.0)
"""A table at rest."""

REVOLUTION = 2.0 * math.pi


class Start(NamedTuple):
    """The thesis's cardanic angles, rad, and their rates, rad/s: the body stands as ``R_y(theta) R_x(psi) R_z(phi)``."""

    theta: float
    psi: float = 0.0
    phi_rate: float = 0.0
    theta_rate: float = 0.0
    psi_rate: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """A solid cylinder of even density on the rim of its bottom.

    Args:
        radius: m.
        centre_height: of the centre of mass above the bottom, half its height, m; 0 is a thin disc.
        friction: of the rim when it slides; infinite where it never does.

    Raises:
        ValueError: a value out of its range.
    """

    radius: float
    centre_height: float
    friction: float = math.inf

    def __post_init__(self) -> None:
        checks.number("radius", self.radius, above=0.0, most=1e3)
        checks.number("centre_height", self.centre_height, least=0.0, most=1e3)
        if self.friction != math.inf:
            checks.number("friction", self.friction, least=0.0, most=1e3)

    @property
    def inertia(self) -> tuple[float, float]:
        """Moments of inertia across and along the axis for a unit of mass, j1 and j3, m^2."""
        return 0.25 * self.radius**2 + self.centre_height**2 / 3.0, 0.5 * self.radius**2

    def rim(self, table: Surface = STILL, amplitude: float = 0.0, phase: float = 0.0) -> Rim:
        """What the kernel takes; the table moves vertically by ``amplitude cos(wt + phase)``, m and rad."""
        return Rim(
            self.radius, self.centre_height, *self.inertia, self.friction, table.gravity, table.horizontal_amplitude,
            table.angular_frequency, amplitude, phase,
        )  # fmt: skip

    def released(
        self, tilt: float, nod: float = 0.0, lean: float = 0.0, spin: float = 0.0, azimuth: float = 0.0
    ) -> np.ndarray:
        """A state (10,) in which the rim does not slip, with spins about w, u and k (see :mod:`studies.thesis.rim`).

        Args:
            tilt: of the axis, rad.
            nod, lean, spin: rad/s.
            azimuth: towards which it leans, rad.

        Raises:
            ValueError: ``tilt`` is not above 0 and at most a quarter of a turn, so that the rim has no single lowest point.
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
        """The same from the thesis's angles and their rates."""
        theta, psi = start.theta, start.psi
        k = np.array([math.sin(theta) * math.cos(psi), -math.sin(psi), math.cos(theta) * math.cos(psi)])
        nodal = np.array([math.cos(theta), 0.0, -math.sin(theta)])  # about which psi turns
        omega = start.theta_rate * np.array([0.0, 1.0, 0.0]) + start.psi_rate * nodal + start.phi_rate * k
        azimuth, tilt = math.atan2(k[1], k[0]), math.atan2(math.hypot(k[0], k[1]), k[2])
        w = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        return self.released(tilt, float(omega @ w), float(omega @ np.cross(w, k)), float(omega @ k), azimuth)

    def idling(self, table: Surface, tilt: float, spin: float = 0.0, azimuth: float = 0.0) -> np.ndarray:
        """A state whose centre of mass rests in the room while the table moves under it: the rim slides."""
        state = self.released(tilt, spin=spin, azimuth=azimuth)
        state[[V_X, V_Y]] = 0.0, -table.horizontal_amplitude * table.angular_frequency
        return state

    def precession(self, tilt: float, gravity: float = STILL.gravity) -> float:
        """Rate of the steady precession about a resting centre of mass, rad/s.

        ``r g rho / (sin nu (j1 rho - (j3 - j1) h sin nu))``, ``rho = r cos nu - h sin nu``, is its square; ``4 g / (r sin nu)``
        for the thin disc.

        Raises:
            ValueError: at this tilt there is none.
        """
        r, h, (j1, j3) = self.radius, self.centre_height, self.inertia
        sine = math.sin(tilt)
        lever = r * math.cos(tilt) - h * sine
        below = sine * (j1 * lever - (j3 - j1) * h * sine)
        if not lever * below > 0.0:
            raise checks.refuse("tilt", tilt, "one at which precession holds the cylinder")
        return math.sqrt(r * gravity * lever / below)

    def precessing(self, tilt: float, gravity: float = STILL.gravity) -> np.ndarray:
        """The state (10,) of :meth:`precession`."""
        lean = -self.precession(tilt, gravity) * math.sin(tilt)
        return self.released(tilt, lean=lean, spin=-lean * self.centre_height / self.radius)


def height_of_constant_tilt(
    radius: float, tilt: float, lean: float, spin: float, gravity: float = STILL.gravity
) -> float:
    """Centre height (m) of the solid cylinder that rolls on at a constant tilt with these spins about u and k (rad/s).

    Where the tilt's acceleration is 0, the height solves a quadratic equation.

    Raises:
        ValueError: no height above zero does so.
    """
    a, n, r, cotangent = lean, spin, radius, 1.0 / math.tan(tilt)
    roots = np.roots([
        -4.0 / 3.0 * a * a * cotangent,
        -a * n * r * cotangent - a * a * r - gravity * math.sin(tilt),
        -0.25 * a * a * r * r * cotangent - 1.5 * a * n * r * r + r * gravity * math.cos(tilt),
    ])  # fmt: skip
    found = [float(each.real) for each in roots if each.imag == 0.0 and each.real > 0.0]
    if not found:
        raise checks.refuse("radius", radius, "one for which some height keeps this tilt")
    return min(found)


FREQUENCY = 10.64
"""Hz, of the tilt in fig. 3.15."""

START_SPIN = -2.5 * REVOLUTION
"""rad/s, of most starts."""

START_TILT = math.radians(5.0)
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
        return undriven_frequency(Cylinder(radius, height), START_TILT) - FREQUENCY

    return Candidate(Cylinder(radius, root(off, 0.01, 2.0 * radius + 0.01)), START_TILT)


def of_constant_tilt(radius: float) -> Candidate:
    """Of this radius (m), with the height for which fig. 3.19's last start keeps its tilt."""
    cylinder = Cylinder(radius, height_of_constant_tilt(radius, START_TILT, KNOCKS[-1][1], START_SPIN))

    def off(tilt: float) -> float:
        return undriven_frequency(cylinder, tilt) - FREQUENCY

    return Candidate(cylinder, root(off, math.radians(8.0), math.radians(30.0)))


def root(off: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes its sign between two places."""
    found = root_scalar(off, bracket=(low, high), method="brentq", xtol=1e-8)
    return float(found.root)


def undriven_frequency(cylinder: Cylinder, tilt: float, spin: float = START_SPIN) -> float:
    """Of the tilt, Hz, after a release at rest on a table at rest."""
    return let_go(cylinder, tilt, spin, duration=2.0 * SHOWN).frequency


def let_go(
    cylinder: Cylinder, tilt: float, spin: float = START_SPIN, azimuth: float = 0.0, radius: float = 0.0,
    amplitude: float = 0.0, duration: float = SHOWN,
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
    cylinder: Cylinder, tilt: float, radius: float, amplitude: float = 0.0, spin: float = START_SPIN
) -> list[Course]:
    """The same for :data:`DIRECTIONS` first leans."""
    angles = np.linspace(0.0, REVOLUTION, DIRECTIONS, endpoint=False)
    return [let_go(cylinder, tilt, spin, float(each), radius, amplitude) for each in angles]


def knocked(cylinder: Cylinder, rates: tuple[float, float]) -> Course:
    """A start of fig. 3.19 on a table at rest."""
    start = cylinder.released_as(Start(START_TILT, 0.0, START_SPIN, *rates))
    return follow(cylinder.rim(), start, SHOWN, **COARSE)


def phi_change(course: Course) -> float:
    """Largest change of phi' from its start, revolutions a second."""
    rate = course.phi_rate
    return float(np.abs(rate - rate[0]).max()) / REVOLUTION
