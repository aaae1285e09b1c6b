"""The forces on one part in planar contact: drive, pressure and friction, as plain functions of time and state.

The state ``y`` is pose and velocity, (6,): x, y (m), heading (rad), their rates. Wrenches are per unit mass. Twists and
wrenches are scaled by the radius of gyration, as in :mod:`studies.accuracy.limit_surface`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from studies.accuracy.contact import Contact, Cubature, Cutter
from studies.accuracy.limit_surface import Grip, escape, load

ROUNDING = 1e-11  # of the load: a wrench exactly on the limit surface is held


class Forces:
    """One part, one surface, one held drive.

    Args:
        surface, part: of ``vibgym.scene``; only their plain attributes are read.
        amplitude, phase: (rows, columns), m and rad.
        cubature: of the contact area.
        incline: (2,) m/s^2, constant acceleration of the part.
        patches: (rows, columns) factor of every element on both coefficients of friction.
    """

    def __init__(
        self,
        surface: Any,
        part: Any,
        amplitude: np.ndarray,
        phase: np.ndarray,
        cubature: Cubature,
        incline: np.ndarray,
        patches: np.ndarray,
    ) -> None:
        self.incline, self.patches = incline, patches
        self.w = w = 2.0 * math.pi * surface.frequency
        self.period = 1.0 / surface.frequency
        self.radius = surface.horizontal_amplitude
        self.gravity = surface.gravity
        self.lift_c = amplitude * np.cos(phase) * w**2  # z'' = -lift_c cos wt + lift_s sin wt
        self.lift_s = amplitude * np.sin(phase) * w**2
        self.friction, self.static = part.friction, part.static_friction
        self.gyration = math.sqrt(part.gyration)
        self.cutter = Cutter(surface, part, cubature)
        self.evaluations = 0  # how often the contact area was cut

    def table(self, t: float) -> np.ndarray:
        """Displacement and velocity of the table."""
        c, s = self.radius * math.cos(self.w * t), self.radius * math.sin(self.w * t)
        return np.array([c, s, -self.w * s, self.w * c])

    def contact(self, y: np.ndarray) -> Contact | None:
        """The contact area at a state; None beside the surface."""
        self.evaluations += 1
        return self.cutter.cut(y[0], y[1], y[2])

    def pressure(self, contact: Contact, t: float) -> np.ndarray:
        """Per unit mass and area, on every piece: the supported area carries the load."""
        i, j = contact.element.T
        normal = self.gravity - self.lift_c[i, j] * math.cos(self.w * t) + self.lift_s[i, j] * math.sin(self.w * t)
        return normal / contact.area.sum()

    def grip(self, contact: Contact, t: float, friction: float) -> Grip:
        """Scaled friction wrench by scaled slip twist."""
        i, j = contact.element.T
        pressure = friction * self.patches[i, j] * self.pressure(contact, t)
        k = self.gyration

        def wrench(xi: np.ndarray) -> np.ndarray:
            fx, fy, torque = contact.wrench(np.array([xi[0], xi[1], xi[2] / k]), pressure)
            return np.array([fx, fy, torque / k])

        return wrench

    def slip(self, t: float, y: np.ndarray) -> np.ndarray:
        """Scaled slip twist of the table against the part."""
        table = self.table(t)
        return np.array([table[2] - y[3], table[3] - y[4], -self.gyration * y[5]])

    def slope(self, t: float, y: np.ndarray) -> np.ndarray:
        """Rate of the state of a sliding part."""
        contact = self.contact(y)
        slip = self.slip(t, y)
        if contact is None or self.friction == 0.0 or not slip.any():
            return np.array([y[3], y[4], y[5], *self.incline, 0.0])
        ax, ay, aw = self.grip(contact, t, self.friction)(slip)
        return np.array([y[3], y[4], y[5], ax + self.incline[0], ay + self.incline[1], aw / self.gyration])

    def needed(self, t: float) -> np.ndarray:
        """Wrench of friction per unit mass that moves the part with the table."""
        size = self.radius * self.w**2
        x, y = self.incline
        return np.array([-size * math.cos(self.w * t) - x, -size * math.sin(self.w * t) - y, 0.0])

    def carried(self, y: np.ndarray, t0: float, t: float) -> np.ndarray:
        """State at ``t`` of a part stuck since ``t0``."""
        there, here = self.table(t), self.table(t0)
        return np.array([y[0] + there[0] - here[0], y[1] + there[1] - here[1], y[2], there[2], there[3], 0.0])

    def load(self, y: np.ndarray, t: float, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """Share of static friction that moving with the table takes, and the twist towards which the part would give way."""
        needed = self.needed(t)
        contact = self.contact(y)
        if not needed.any():
            return 0.0, np.array([1.0, 0.0, 0.0])
        if contact is None or self.static == 0.0:
            return math.inf, needed / np.linalg.norm(needed)
        return load(self.grip(contact, t, self.static), needed, start)

    def holds(self, y: np.ndarray, t: float) -> bool:
        """Whether static friction can carry the part with the table."""
        return self.load(y, t)[0] <= 1.0 + ROUNDING

    def breakaway(self, y: np.ndarray, t: float) -> np.ndarray:
        """Scaled slip acceleration of a part that moves with the table and is no longer held."""
        contact = self.contact(y)
        needed = self.needed(t)
        if contact is None or self.friction == 0.0:
            return needed
        grip = self.grip(contact, t, self.friction)
        return escape(grip, needed, load(grip, needed)[1])
