"""Vector fields of the surface: uniform, squeeze, radial, tangential and their sum (thesis section 4.2, fig. 4.4).

The line of a :class:`MovingSqueeze` moves with time.

A field is the direction and strength of the push at every point. Sampled at the elements' centres it determines the elements'
motion: strength is amplitude, direction is phase::

    field = radial(0.4, 0.1) + 0.5 * tangential(0.4, 0.1)
    simulator.advance(*field.drive(surface), periods=50)

Positions and strengths may be arrays that broadcast with (rows, columns), for instance (worlds, 1, 1): one field per world.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.surface import Surface
from vibgym.simulation.plant import lead_angle

Push = tuple[np.ndarray, np.ndarray]

DEFAULT_REACH = 0.026
"""Distance from a squeeze line or centre at which a field reaches full strength, m: one element of the prototype."""


@dataclass(frozen=True)
class Field:
    """A vector field: ``push(x, y)`` (m) returns its components; length 1 is full amplitude."""

    push: Callable[[np.ndarray, np.ndarray], Push]

    __array_ufunc__ = None  # array * field calls __rmul__ instead of broadcasting over the array

    def __add__(self, other: Field) -> Field:
        if not isinstance(other, Field):
            return NotImplemented

        def push(x: np.ndarray, y: np.ndarray) -> Push:
            (ax, ay), (bx, by) = self.push(x, y), other.push(x, y)
            return ax + bx, ay + by

        return Field(push)

    def __mul__(self, strength: Any) -> Field:
        _finite(strength=strength)

        def push(x: np.ndarray, y: np.ndarray) -> Push:
            ax, ay = self.push(x, y)
            return strength * ax, strength * ay

        return Field(push)

    __rmul__ = __mul__

    def around(self, x: Any, y: Any, radius: float) -> Field:
        """Return this field, restricted to elements whose centres are within ``radius`` (m) of ``(x, y)``."""
        radius = checks.number("radius", radius, above=0.0)
        _finite(x=x, y=y)

        def push(at_x: np.ndarray, at_y: np.ndarray) -> Push:
            near = (at_x - x) ** 2 + (at_y - y) ** 2 <= radius**2
            ax, ay = self.push(at_x, at_y)
            return np.where(near, ax, 0.0), np.where(near, ay, 0.0)

        return Field(push)

    def phasors(self, surface: Surface, *, friction: float | None = None) -> np.ndarray:
        """Return phasors of the elements as fractions of full amplitude, (..., rows, columns, 2), in the unit disc.

        Args:
            surface: the table.
            friction: of the part, to correct the direction by :func:`lead_angle`; None: no correction.
        """
        checks.instance("surface", surface, Surface)
        x, y = surface.element_centres()
        px, py = np.broadcast_arrays(*self.push(x, y))
        if friction is not None:
            lead = lead_angle(surface, friction)
            px, py = px * math.cos(lead) + py * math.sin(lead), py * math.cos(lead) - px * math.sin(lead)
        px, py = np.broadcast_arrays(px, py, np.zeros_like(x))[:2]
        scale = 1.0 / np.maximum(np.hypot(px, py), 1.0)
        return np.stack([-py * scale, -px * scale], axis=-1)

    def drive(self, surface: Surface, *, friction: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitude (m) and phase (rad) of every element, each (..., rows, columns), for ``Simulator.advance``."""
        phasors = self.phasors(surface, friction=friction)
        amplitude = np.hypot(phasors[..., 0], phasors[..., 1])
        assert surface.max_amplitude is not None
        return surface.max_amplitude * np.minimum(amplitude, 1.0), np.arctan2(phasors[..., 1], phasors[..., 0])


def _finite(**values: Any) -> None:
    for name, value in values.items():
        try:
            shape = np.shape(value)
        except (TypeError, ValueError, RecursionError):  # rows of different lengths
            shape = ()
        checks.array(name, value, shape)


def uniform(direction: Any, strength: Any = 1.0) -> Field:
    """Return a field with the same push everywhere, which moves parts along ``direction`` (rad from +x)."""
    _finite(direction=direction, strength=strength)
    return Field(
        lambda x, y: (strength * np.cos(direction) + 0.0 * x, strength * np.sin(direction) + 0.0 * y),
    )


def squeeze(x: Any, y: Any, angle: Any, strength: Any = 1.0, reach: float = DEFAULT_REACH) -> Field:
    """Return a field that pushes towards a line from both sides, which aligns parts with it.

    Args:
        x, y: a point of the line, m.
        angle: direction of the line, rad from +x.
        strength: at ``reach`` (m) from the line and beyond; in between the push falls to zero on the line.
    """
    reach = checks.number("reach", reach, above=0.0)
    _finite(x=x, y=y, angle=angle, strength=strength)
    across_x, across_y = -np.sin(angle), np.cos(angle)

    def push(at_x: np.ndarray, at_y: np.ndarray) -> Push:
        towards = -strength * np.clip(((at_x - x) * across_x + (at_y - y) * across_y) / reach, -1.0, 1.0)
        return towards * across_x, towards * across_y

    return Field(push)


@dataclass(frozen=True)
class MovingSqueeze:
    """A squeeze field with a moving line, which transports the parts on it (thesis section 4.2)::

        line = MovingSqueeze(0.1, 0.1, math.pi / 2, velocity=(0.1, 0.0))
        simulator.advance(*line.at(period * surface.period).drive(surface), periods=1)

    Parts follow at the distance at which the push balances friction: to first order, for slow lines,
    ``reach * v g / (strength * a_v w^2 a_h w)``. A line faster than the part's speed at full strength leaves the part behind.

    In the thesis the line moves "in discrete steps given by the position of the edges of the surface elements". For that, use
    a small ``reach``, a ``pitch`` of one element, and a line that begins on an edge.

    Args:
        x, y: a point of the line at time 0, m.
        angle: direction of the line, rad from +x.
        velocity: of that point, (x, y) m/s; the component along the line has no effect.
        strength, reach: of :func:`squeeze`.
        pitch: step by which the line moves, rounded to the nearest, m; None: continuous.

    Raises:
        ValueError: an invalid value.
    """

    x: Any
    y: Any
    angle: Any
    velocity: tuple[Any, Any]
    strength: Any = 1.0
    reach: float = DEFAULT_REACH
    pitch: float | None = None

    def __post_init__(self) -> None:
        checks.number("reach", self.reach, above=0.0)
        if self.pitch is not None:
            checks.number("pitch", self.pitch, above=0.0)
        if not isinstance(self.velocity, Sequence) or len(self.velocity) != 2:
            raise checks.refuse("velocity", self.velocity, "two numbers or arrays, x and y in m/s")
        along_x, along_y = self.velocity
        _finite(x=self.x, y=self.y, angle=self.angle, strength=self.strength)
        _finite(**{"velocity[0]": along_x, "velocity[1]": along_y})

    def place(self, time: Any) -> Push:
        """Return a point (x, y) of the line, m, at a time (s, number or array); it moves perpendicular to the line."""
        _finite(time=time)
        across_x, across_y = -np.sin(self.angle), np.cos(self.angle)
        way = (self.velocity[0] * across_x + self.velocity[1] * across_y) * np.asarray(time)
        if self.pitch is not None:
            way = self.pitch * np.round(way / self.pitch)
        return self.x + way * across_x, self.y + way * across_y

    def at(self, time: Any) -> Field:
        """Return the field at a time (s)."""
        return squeeze(*self.place(time), self.angle, self.strength, self.reach)


def radial(x: Any, y: Any, strength: Any = 1.0, reach: float = DEFAULT_REACH) -> Field:
    """Return a field towards the centre ``(x, y)`` (m), which positions parts there; negative strength pushes away."""
    return _central(x, y, strength, reach, lambda dx, dy: (-dx, -dy))


def tangential(x: Any, y: Any, strength: Any = 1.0, reach: float = DEFAULT_REACH) -> Field:
    """Return a field around the centre ``(x, y)`` (m), counter-clockwise; clockwise with negative strength."""
    return _central(x, y, strength, reach, lambda dx, dy: (-dy, dx))


def _central(x: Any, y: Any, strength: Any, reach: float, turn: Callable[..., Push]) -> Field:
    reach = checks.number("reach", reach, above=0.0)
    _finite(x=x, y=y, strength=strength)

    def push(at_x: np.ndarray, at_y: np.ndarray) -> Push:
        dx, dy = at_x - x, at_y - y
        scale = strength / np.maximum(np.hypot(dx, dy), reach)
        px, py = turn(dx, dy)
        return scale * px, scale * py

    return Field(push)
