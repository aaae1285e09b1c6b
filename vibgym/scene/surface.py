"""The segmented surface: elements, horizontal motion, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.physics.core.records import Table
from vibgym.settings import Acceleration, BaseSettings, Length, read

LEDGE = 1e-3
"""m, distance of a centre of mass beyond a border with a wall at which a part falls; overlaps with walls are smaller."""

MAX_ELEMENTS = 1_000_000
"""Most elements of a surface."""


@dataclass(frozen=True)
class Surface:
    """A table of ``rows x columns`` square elements that share a fast horizontal circular motion.

    The origin is a corner of the surface, x runs along columns, y along rows, z up. All elements move horizontally by
    ``a_h (cos wt, sin wt)``; element (i, j) covers ``[j L, (j+1) L] x [i L, (i+1) L]`` and moves vertically by
    ``a_v cos(wt + alpha)`` with its own ``a_v`` and ``alpha``. Defaults are the prototype of P. Frei's thesis (2002).

    Arguments, their units and ranges are the fields of :class:`SurfaceSettings`.

    Raises:
        ValueError: a value is not finite or out of its range.
    """

    rows: int = 8
    columns: int = 32
    element_size: float = 0.026
    horizontal_amplitude: float = 2.7e-3
    frequency: float = 25.0
    gravity: float = 9.81
    max_amplitude: float | None = None

    def __post_init__(self) -> None:
        vars(self).update(vars(read(SurfaceSettings, vars(self), "")))
        if self.rows * self.columns > MAX_ELEMENTS:
            got = f"{self.columns} in {self.rows} rows"
            raise checks.refuse("columns", got, f"at most {MAX_ELEMENTS} elements in total")
        limit = self.lift_off_amplitude
        if self.max_amplitude is None:
            vars(self)["max_amplitude"] = limit
        elif self.max_amplitude > limit:
            raise checks.refuse("max_amplitude", self.max_amplitude, f"at most g / w^2 = {limit:.10g} m")

    @property
    def angular_frequency(self) -> float:
        """w = 2 pi f, rad/s."""
        return 2.0 * math.pi * self.frequency

    @property
    def period(self) -> float:
        """Duration of one oscillation, s."""
        return 1.0 / self.frequency

    @property
    def lift_off_amplitude(self) -> float:
        """Vertical amplitude ``g / w^2`` at which the contact force first vanishes, m."""
        return self.gravity / self.angular_frequency**2

    @property
    def width(self) -> float:
        """Extent along x, m."""
        return self.columns * self.element_size

    @property
    def depth(self) -> float:
        """Extent along y, m."""
        return self.rows * self.element_size

    @property
    def table_speed(self) -> float:
        """Speed ``a_h w`` of the horizontal motion, m/s."""
        return self.horizontal_amplitude * self.angular_frequency

    @property
    def full_scale(self) -> float:
        """Vertical acceleration ``a_v w^2`` at the largest amplitude, m/s^2."""
        assert self.max_amplitude is not None  # set on construction
        return self.max_amplitude * self.angular_frequency**2

    def slides_permanently(self, friction: float) -> bool:
        """Return whether a part of this (static) friction coefficient slides at all times, for every command of the elements.

        True if ``a_h w^2 > mu (g + a_v w^2)`` at the largest amplitude (thesis eqs. 3.17 to 3.23).
        """
        friction = checks.number("friction", friction, least=0.0)
        return self.horizontal_amplitude * self.angular_frequency**2 > friction * (self.gravity + self.full_scale)

    def idle_velocity(self, friction: float) -> np.ndarray:
        """Return the velocity (x, y) at the start of a period of a part that slides in place on elements at rest, m/s.

        The part circles with radius ``a_o = mu g / w^2`` and lags the table by ``arccos(a_o / a_h)`` (thesis eq. 3.30);
        without permanent sliding it moves with the table.
        """
        friction = checks.number("friction", friction, least=0.0)
        w = self.angular_frequency
        radius = friction * self.gravity / w**2
        if radius >= self.horizontal_amplitude:
            return np.array([0.0, self.table_speed])
        lag = math.acos(radius / self.horizontal_amplitude)
        return radius * w * np.array([math.sin(lag), math.cos(lag)])

    def check_amplitude(self, amplitude: np.ndarray) -> None:
        """Raise ValueError for amplitudes (m) above the largest, with a margin for rounding."""
        largest = float(amplitude.max())
        assert self.max_amplitude is not None
        if largest <= self.max_amplitude * (1.0 + 1e-12):
            return
        allowed = f"numbers in [0, {self.max_amplitude:.10g}]"
        if largest > self.lift_off_amplitude:
            best = math.sqrt(self.gravity / largest) / (2.0 * math.pi)
            allowed += (
                f"; parts lift off above g / w^2 = {self.lift_off_amplitude:.4g} m, which no model covers: lower the "
                f"amplitude, or the surface's frequency to {best:.4g} Hz"
            )
        raise checks.refuse("amplitude", f"{largest!r} m", allowed)

    def element_centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of every element's centre, each (rows, columns), m."""
        x = (np.arange(self.columns) + 0.5) * self.element_size
        y = (np.arange(self.rows) + 0.5) * self.element_size
        return np.meshgrid(x, y)

    def table(self, walls: Sequence[str] = ()) -> Table:
        """Return the surface for kernels, with walls along some of its borders."""
        left, right, bottom, top = (LEDGE if name in walls else 0.0 for name in ("left", "right", "bottom", "top"))
        return Table(
            self.rows, self.columns, self.element_size, self.gravity, self.period, self.horizontal_amplitude,
            self.table_speed, -left, self.width + right, -bottom, self.depth + top,
        )  # fmt: skip


class SurfaceSettings(BaseSettings):
    """Settings of a surface."""

    rows: int = Field(default=Surface.rows, ge=1, le=MAX_ELEMENTS)
    """Number of elements along y."""

    columns: int = Field(default=Surface.columns, ge=1, le=MAX_ELEMENTS)
    """Number of elements along x."""

    element_size: Length = Field(default=Surface.element_size, ge=1e-9, le=1e9)
    """Edge length L of an element."""

    horizontal_amplitude: Length = Field(default=Surface.horizontal_amplitude, ge=0.0, le=1e9)
    """Radius a_h of the horizontal motion; 0 is a still table."""

    frequency: float = Field(default=Surface.frequency, ge=1e-9, le=1e9)
    """Frequency of the motion, Hz."""

    gravity: Acceleration = Field(default=Surface.gravity, ge=1e-9, le=1e9)
    """Acceleration of gravity."""

    max_amplitude: Length | None = Field(default=Surface.max_amplitude, ge=0.0)
    """Largest vertical amplitude a_v; None is the lift-off limit ``g / w^2``, above which a part would leave the surface."""


def surface_from(value: Any, where: str = "surface") -> Surface:
    """Return a surface from ``"prototype"``, a mapping of :class:`SurfaceSettings`, or a Surface."""
    if isinstance(value, Surface):
        return value
    if isinstance(value, str):
        checks.choice(where, value, ("prototype",))
        return Surface()
    return Surface(**vars(read(SurfaceSettings, value, where)))
