"""A cylinder that stands on its rim (thesis 3.6): how it is let go, and the two motions that have closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, STATES, TILT, V_X, V_Y, Rim
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
