"""What a part can do: how much of the elements' amplitude a motion asks for, to first order of the averaged model.

With V = a_h w, the speed v = s V, A = a_v w^2, and all elements under the part alike, the mean acceleration along the velocity
and to its left is

    mu (Q(s) p - g d(s)),   mu P(s) q,   p^2 + q^2 <= A^2,

where d, P and Q are means over a period of the direction of slip (thesis eqs. 5.60, 5.61). So a motion has an *effort*, the
share of the largest amplitude that it needs. It is 1 on a straight line at the top speed, 0.72 V.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

EFFORT = 0.9
"""Largest effort of a path: the rest is left for corrections."""

SWIRL = 0.4
"""Share of mu A m k / 2, the torque under a swirl, that is counted on: elements have but one phase each. An optimum over
all phasors reaches 0.42 to 0.85 of it under the aluminium block, 0.38 to 0.85 under a disc of 40 mm, in 400 poses."""

SHARE = {"kept": 1.0 / 2.0, "along": 1.0 / 3.0}
"""Speed of paths over the part's top speed where none is given, by heading: turning takes its share of the amplitude."""

RAMP = 0.25
"""Acceleration at both ends over what the part can do from rest, where none is given."""

STRAIGHT = 1e-6
"""1/m, smallest curvature of a corner."""

_PHASES, _NODES = 2048, 1000
_HALVINGS = 30


@functools.cache
def means() -> np.ndarray:
    """(4, nodes) s in [0, 1), d, P and Q, each by the mean over phases."""
    phase = (np.arange(_PHASES) + 0.5) * (2.0 * math.pi / _PHASES)
    cos, sin, s = np.cos(phase), np.sin(phase), np.arange(_NODES)[:, None] / _NODES
    slip = np.sqrt(1.0 - 2.0 * s * cos + s * s)
    drag, across, along = (s - cos) / slip, sin * sin / slip, cos * (cos - s) / slip
    return np.stack([s[:, 0], drag.mean(axis=1), across.mean(axis=1), along.mean(axis=1)])


def bisected(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """The largest number from ``low`` to ``high`` that ``holds``, if all smaller ones do; ``low`` if none does."""
    if holds(high):
        return high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class Reach:
    """What the elements can do with a part.

    Args:
        surface, part: the pair.

    Attributes:
        top_speed: m/s, on a straight line with the largest amplitude.
        fastest: m/s, on a straight line with the effort that paths may take.
        acceleration: m/s^2, from rest with that effort.

    Raises:
        ValueError: the elements cannot move the part at all.
    """

    def __init__(self, surface: Surface, part: Part) -> None:
        if not (surface.table_speed > 0.0 and surface.full_scale > 0.0 and part.friction > 0.0):
            allowed = "parts with friction on a surface whose table and elements move"
            raise checks.refuse("parts", f"{part.name!r}, which the elements cannot move", allowed)
        self.surface, self.part = surface, part
        self._node, self._drag, self._across, self._along = means()
        self._push = part.friction * surface.full_scale  # m/s^2
        self._brake = part.friction * surface.gravity
        gyration = math.sqrt(part.body().gyration)
        self._twist = SWIRL * 0.5 * self._push / gyration  # rad/s^2
        self._spin_drag = 0.5 * self._brake / surface.table_speed  # 1/s
        self.top_speed, self.fastest = (self._steady(effort) for effort in (1.0, EFFORT))
        self.acceleration = 0.5 * EFFORT * self._push

    def _steady(self, effort: float) -> float:
        return bisected(0.0, 0.999 * self.surface.table_speed, lambda speed: self.effort(speed) <= effort)

    def effort(self, speed: Any, along: Any = 0.0, across: Any = 0.0, turning: Any = 0.0, spin: Any = 0.0) -> Any:
        """Share of the largest amplitude that motions need; more than 1: out of reach. All broadcast against one another.

        Args:
            speed: m/s.  along, across: acceleration along the velocity and to its left, m/s^2.
            turning, spin: rad/s^2, rad/s; what they need is added, which is safe.
        """
        s = np.asarray(speed) / self.surface.table_speed
        drag, side, ahead = (np.interp(s, self._node, each) for each in (self._drag, self._across, self._along))
        push = np.hypot((along + self._brake * drag) / ahead, across / side) / self._push
        return push + (np.abs(turning) + self._spin_drag * np.abs(spin)) / self._twist

    def corner(self, speed: float, window: float = math.inf) -> float:
        """Radius of a corner, m, at which ``speed`` takes half of what a straight line leaves of the effort.

        Args:
            window: m, over which a part that turns with its path does so; infinite for parts that keep their heading.
        """
        most = 0.5 * (self.effort(speed) + EFFORT)
        turns = 0.0 if math.isinf(window) else 1.0

        def easy(curvature: float) -> bool:
            across = curvature * speed * speed
            return self.effort(speed, 0.0, across, turns * across / window, turns * curvature * speed) <= most

        return 1.0 / max(bisected(0.0, self._push / (speed * speed), easy), STRAIGHT)

    def most_effort(self, motion: np.ndarray) -> float:
        """Largest effort of a motion (n, 9), see :data:`vibgym.tasks.paths.route.MOTION`."""
        speed = np.minimum(np.hypot(motion[:, 3], motion[:, 4]), self.surface.table_speed)
        return float(self.effort(speed, motion[:, 6], motion[:, 7], motion[:, 8], motion[:, 5]).max())
