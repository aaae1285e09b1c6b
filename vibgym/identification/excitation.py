"""Excitation: commands that make all parameters of a machine visible in the motion of its parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.plant import lead_angle

SECONDS = 120.0
"""Length of a recording that identifies all parameters."""

SHORTEST, LONGEST = 3, 12
"""Periods with the same command."""

COAST, SMALL, FULL = 0.12, 0.3, 0.2
"""Shares of the commands: elements at rest (friction), amplitudes inside a possible dead zone, full amplitude (top speed)."""

LARGEST_DEAD_ZONE = 2e-4
"""m, range of the small amplitudes: twice the prototype's dead zone."""

REACTION = 4
"""Periods assumed between a pose and the effect of the command that it leads to."""

BRAKING = 0.25
"""Assumed deceleration over ``mu g``; about half is available at full amplitude."""

TURN = 1.0
"""rad, standard deviation of the elements' directions about that of the part."""

RETURN = 0.1
"""m/s, speed at which a part is sent back into its region."""

CANDIDATES = 32
"""Points drawn for each new waypoint."""

BORDER = 0.01
"""m between a part at its waypoint and the border of its region."""


class Excitation:
    """Commands for a recording, from the poses that the camera measures.

    Each part visits waypoints in its own region, a strip of the surface, so that parts do not touch; waypoints prefer
    elements that no part has visited. Commands are held for a few periods, at random strength; each element has its own
    amplitude and phase, spread about those that push the part to its waypoint. Near the border of its region a part is pushed
    back at full amplitude.

    Args:
        surface: nominal surface.
        parts: nominal parts, one or a list.
        seed: of all random numbers.

    Raises:
        ValueError: the parts do not fit side by side.
    """

    def __init__(self, surface: Surface, parts: Part | Sequence[Part], seed: int = 0) -> None:
        self.surface = checks.instance("surface", surface, Surface)
        self.parts = (parts,) if isinstance(parts, Part) else tuple(parts)
        if not self.parts:
            raise checks.refuse("parts", parts, "a vibgym.Part or a list of them")
        self._rng = np.random.default_rng(checks.count("seed", seed, least=0))
        count, margin = len(self.parts), max(part.radius for part in self.parts) + BORDER
        strip = surface.width / count
        first = np.arange(count) * strip
        self._low = np.column_stack([first + margin, np.full(count, margin)])
        self._high = np.column_stack([first + strip - margin, np.full(count, surface.depth - margin)])
        if (self._high <= self._low).any():
            got = f"{count} of radius {max(part.radius for part in self.parts):g} m"
            raise checks.refuse("parts", got, "parts that have room to move side by side, in strips of the surface")
        self._centres = np.stack(surface.element_centres())
        owner = np.minimum(self._centres[0] // strip, count - 1).astype(np.int64)
        self._own = owner == np.arange(count)[:, None, None]
        self._lead = [lead_angle(surface, part.friction) for part in self.parts]
        self._visits = np.zeros((surface.rows, surface.columns))
        self._last: np.ndarray | None = None
        self._speed = np.zeros((count, 2))
        self._goal = self.start[:, :2].copy()
        self._left = np.zeros(count, dtype=np.int64)
        self._returning = np.zeros(count, dtype=bool)
        self._amplitude = np.zeros((surface.rows, surface.columns))
        self._phase = np.zeros((surface.rows, surface.columns))

    @property
    def start(self) -> np.ndarray:
        """(parts, 3) poses in the middle of the regions."""
        middle = 0.5 * (self._low + self._high)
        return np.column_stack([middle, np.zeros(len(middle))])

    def command(self, pose: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitude (m) and phase (rad) of every element, each (rows, columns), for the next period.

        Args:
            pose: (parts, 3) measured poses, NaN for parts that are not seen.

        Raises:
            ValueError: poses have the wrong shape.
        """
        pose = checks.shaped("pose", pose, ((len(self.parts), 3),), "poses")
        seen = np.isfinite(pose[:, :2]).all(axis=1)
        last = self._last
        if last is None:
            last = np.where(seen[:, None], pose[:, :2], self.start[:, :2])
        now = np.where(seen[:, None], pose[:, :2], last + self._speed * self.surface.period)
        self._speed += 0.5 * ((now - last) / self.surface.period - self._speed)
        self._last = now
        for k, part in enumerate(self.parts):
            self._visits[self._under(now[k], part)] += 1.0
            braking = np.hypot(*self._speed[k]) / (2.0 * BRAKING * part.friction * self.surface.gravity)
            ahead = now[k] + self._speed[k] * (REACTION * self.surface.period + braking)
            outside = bool(((ahead < self._low[k]) | (ahead > self._high[k])).any())
            self._left[k] -= 1
            if self._left[k] < 0 or outside != self._returning[k]:
                self._renew(k, ahead, outside)
        return self._amplitude.copy(), self._phase.copy()

    def _under(self, at: np.ndarray, part: Part) -> np.ndarray:
        """Return which elements' centres are under a part at ``at``."""
        return np.hypot(self._centres[0] - at[0], self._centres[1] - at[1]) < part.radius

    def _renew(self, k: int, ahead: np.ndarray, outside: bool) -> None:
        """Draw the next command of a part's elements."""
        rng, most, own = self._rng, self.surface.max_amplitude, self._own[k]
        self._returning[k] = outside
        self._left[k] = SHORTEST if outside else rng.integers(SHORTEST, LONGEST + 1)
        if outside:  # brake, and return along the violated axes
            inwards = np.sign(np.clip(ahead, self._low[k], self._high[k]) - ahead)
            aim = ahead + inwards * RETURN - self._speed[k]
        else:
            if np.hypot(*(self._goal[k] - ahead)) < self.surface.element_size:
                self._goal[k] = self._waypoint(k)
            aim = self._goal[k]
        direction = math.atan2(*(aim - ahead)[::-1]) - self._lead[k]
        number = int(own.sum())
        kind = 1.0 if outside else rng.random()
        turn = TURN
        if kind < COAST:
            amplitude = np.zeros(number)
        elif kind < COAST + SMALL:
            amplitude = rng.uniform(0.0, min(LARGEST_DEAD_ZONE, most), number)
        elif kind < 1.0 - FULL:
            amplitude = most * rng.uniform(0.2, 1.0) * rng.uniform(0.4, 1.0, number)
        else:
            amplitude, turn = np.full(number, most), 0.3
        angle = direction + turn * rng.standard_normal(number)
        self._amplitude[own] = amplitude
        self._phase[own] = np.arctan2(-np.cos(angle), -np.sin(angle))

    def _waypoint(self, k: int) -> np.ndarray:
        """Return the candidate whose elements have been visited least."""
        points = self._rng.uniform(self._low[k], self._high[k], (CANDIDATES, 2))
        return min(points, key=lambda point: self._visits[self._under(point, self.parts[k])].sum())
