"""A motion of a cylinder on its rim: integrated, and what can be read from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, STATES, TILT, V_X, V_Y, WORK, Rim, march, slip
from vibgym import checks

STEP, ARC = 2e-5, 0.03
"""s and rad: RK4's steps are at most so long, and so short that P runs at most this far along the rim in one."""


@dataclass(frozen=True)
class Course:
    """Times (t,) s, states (t, 10) and forces (t, 3) of the table per unit of mass (towards the lean, across it, up), m/s^2."""

    rim: Rim
    times: np.ndarray
    states: np.ndarray
    forces: np.ndarray

    @property
    def tilt(self) -> np.ndarray:
        """(t,) rad."""
        return self.states[:, TILT]

    @property
    def normal(self) -> np.ndarray:
        """(t,) m/s^2, of the table; negative where it would have to pull."""
        return self.forces[:, 2]

    @property
    def needed_friction(self) -> np.ndarray:
        """(t,) |F_R| / |F_N|."""
        return np.hypot(self.forces[:, 0], self.forces[:, 1]) / np.abs(self.normal)

    @property
    def phi_rate(self) -> np.ndarray:
        """(t,) rad/s, of the thesis's third angle."""
        nu, alpha, spin, a, b = self.states[:, [TILT, AZIMUTH, SPIN, LEANING, NODDING]].T
        k = np.array([np.sin(nu) * np.cos(alpha), np.sin(nu) * np.sin(alpha), np.cos(nu)])
        u = np.array([np.cos(nu) * np.cos(alpha), np.cos(nu) * np.sin(alpha), -np.sin(nu)])
        k_rate = b * u - a * np.array([-np.sin(alpha), np.cos(alpha), np.zeros_like(nu)])
        theta_rate = (k_rate[0] * k[2] - k[0] * k_rate[2]) / (k[0] ** 2 + k[2] ** 2)
        return spin - theta_rate * k[1]  # sin(psi) = -k_y

    @property
    def slip(self) -> np.ndarray:
        """(t,) m/s, of the rim over the table."""
        return np.array([math.hypot(*slip(self.rim, state)) for state in self.states])

    @property
    def tilt_energy(self) -> np.ndarray:
        """(t,) J/kg, of the lifted centre of mass alone."""
        rim, nu = self.rim, self.tilt
        return rim.gravity * (rim.height * (np.cos(nu) - 1.0) + rim.radius * np.sin(nu))

    @property
    def energy(self) -> np.ndarray:
        """(t,) J/kg, seen from the table, above standing still, less the work of friction and of the table's motion."""
        rim, nu, b = self.rim, self.tilt, self.states[:, NODDING]
        v_z = b * (rim.radius * np.cos(nu) - rim.height * np.sin(nu))
        turning = rim.along * self.states[:, SPIN] ** 2 + rim.across * (self.states[:, LEANING] ** 2 + b**2)
        moving = self.states[:, V_X] ** 2 + self.states[:, V_Y] ** 2 + v_z**2
        return 0.5 * (turning + moving) + self.tilt_energy - self.states[:, WORK]

    @property
    def energy_error(self) -> float:
        """How far that comes from what it was, over the tilt's own at the start."""
        return float(np.ptp(self.energy) / self.tilt_energy[0])

    @property
    def frequency(self) -> float:
        """How often the tilt rises and falls, Hz, from one largest tilt to the last; NaN with fewer than two of them."""
        b, t = self.states[:, NODDING], self.times
        at = np.nonzero((b[:-1] > 0.0) & (b[1:] <= 0.0))[0]
        tops = t[at] + (t[at + 1] - t[at]) * b[at] / (b[at] - b[at + 1])
        if abs(b[0]) < 1e-9 and b[1] < 0.0:  # let go at rest
            tops = np.append(t[:1], tops)
        return (len(tops) - 1) / float(tops[-1] - tops[0]) if len(tops) > 1 else math.nan


def follow(
    rim: Rim, state: np.ndarray, duration: float, *, sampled: float = 1e-4, step: float = STEP, arc: float = ARC
) -> Course:
    """The motion from a state (10,), told every ``sampled`` seconds, until it ends or the cylinder lies on its side.

    Sliding equations alone where ``rim.friction`` is finite: that an edge sticks where its slip comes to 0 is not simulated.

    Raises:
        ValueError: an edge with friction that starts without slip, so that friction has no direction; a course that runs
            into an upright axis, where the rim has no lowest point.
    """
    if 0.0 < rim.friction < math.inf and math.hypot(*slip(rim, state)) < 1e-9:
        raise checks.refuse("state", state.tolist(), "one in which the rim slides, as friction is finite")
    times = np.linspace(0.0, duration, round(duration / sampled) + 1)
    states, forces = np.empty((len(times), STATES)), np.empty((len(times), 3))
    states[0] = state
    reached = march(rim, times, step, arc, states, forces)
    if not np.isfinite(states[:reached]).all() or states[:reached, TILT].min() <= 0.0:
        raise checks.refuse("state", state.tolist(), "one from which the axis does not come upright")
    return Course(rim, times[:reached], states[:reached], forces[:reached])
