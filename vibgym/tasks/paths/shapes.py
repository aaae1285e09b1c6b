"""Shapes of paths, as settings and as lines and arcs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.config import Settings, parse
from vibgym.tasks.paths.route import Course

MOST_POINTS, MOST_LAPS = 200, 100

LEAST_SIZE, MOST_SIZE = 1e-4, 1e3
"""m."""

MOST_TURN = 8.0 * math.pi
"""rad."""

LEAST_SPEED = 1e-3
"""m/s; of the ramps: m/s^2."""

SHARPEST = math.radians(170.0)
"""Turn at a corner beyond which a rounded one would reach too far away from it."""

Coordinate = Annotated[float, Field(ge=-MOST_SIZE, le=MOST_SIZE)]

Place = list[Coordinate]


class PathSettings(Settings):
    """What all shapes have.

    Attributes:
        speed: m/s between the ramps at both ends; by default a share of the part's top speed.
        acceleration: m/s^2, of the ramps; by default a share of what the part can do from rest.
        heading: ``"kept"``: as at the start; ``"along"``: the part turns with the path.
    """

    PLACE: ClassVar[str] = "centre"
    """The setting that says where the shape lies, for errors ..."""

    SIZE: ClassVar[str] = "radius"
    """... and the one that says how large it is."""

    speed: float | None = Field(default=None, ge=LEAST_SPEED)
    acceleration: float | None = Field(default=None, ge=LEAST_SPEED)
    heading: Literal["kept", "along"] = "kept"


class ClosedSettings(PathSettings):
    """What closed shapes have: ``laps``, and whether they are run through ``clockwise``."""

    laps: int = Field(default=1, ge=1, le=MOST_LAPS)
    clockwise: bool = False


class CircleSettings(ClosedSettings):
    """A circle: ``centre`` and ``radius``, m; ``start``: rad, where on it the path begins, 0: at the largest x."""

    shape: Literal["circle"]
    centre: Place = Field(min_length=2, max_length=2)
    radius: float = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    start: float = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)

    def course(self, corner: float) -> Course:
        """Its pieces."""
        sign = -1.0 if self.clockwise else 1.0
        x = self.centre[0] + self.radius * math.cos(self.start)
        y = self.centre[1] + self.radius * math.sin(self.start)
        length = 2.0 * math.pi * self.radius * self.laps
        return Course((x, y, self.start + sign * 0.5 * math.pi), [length], [sign / self.radius])


class EightSettings(ClosedSettings):
    """Two circles that touch at ``centre``, m, where the path begins.

    ``radius``: m, of both; ``turn``: rad, from x to the line of centres. ``clockwise`` is the first of them.
    """

    shape: Literal["figure_eight"]
    centre: Place = Field(min_length=2, max_length=2)
    radius: float = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    turn: float = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)

    def course(self, corner: float) -> Course:
        """Its pieces."""
        sign = -1.0 if self.clockwise else 1.0
        lengths = [2.0 * math.pi * self.radius] * (2 * self.laps)
        curvatures = [sign / self.radius, -sign / self.radius] * self.laps
        return Course((*self.centre, self.turn + 0.5 * math.pi), lengths, curvatures)


class SquareSettings(ClosedSettings):
    """A square with round corners: ``centre`` and ``side``, m; ``turn``: rad, of its sides.

    The path begins in the middle of a side, the lower one without turn. ``corner``: radius, m; by default as small as the speed
    allows, see :meth:`vibgym.tasks.paths.Reach.corner`.
    """

    SIZE: ClassVar[str] = "side"

    shape: Literal["square"]
    centre: Place = Field(min_length=2, max_length=2)
    side: float = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    turn: float = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)
    corner: float | None = Field(default=None, ge=LEAST_SIZE, le=MOST_SIZE)

    def course(self, corner: float) -> Course:
        """Its pieces."""
        half, cos, sin = 0.5 * self.side, math.cos(self.turn), math.sin(self.turn)
        rows = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        points = np.array(self.centre) + rows @ np.array([[cos, sin], [-sin, cos]])
        return rounded(points[[1, 0, 3, 2]] if self.clockwise else points, corner, self.laps, "side")


class PolylineSettings(PathSettings):
    """A line through ``points`` (n, 2), m, with round corners, see :class:`SquareSettings`.

    Attributes:
        closed: back to the first point; the path then begins in the middle between the first two.
        laps: of a closed one.
    """

    PLACE: ClassVar[str] = "points"
    SIZE: ClassVar[str] = "points"

    shape: Literal["polyline"]
    points: list[tuple[Coordinate, Coordinate]] = Field(min_length=2, max_length=MOST_POINTS)
    closed: bool = False
    laps: int = Field(default=1, ge=1, le=MOST_LAPS)
    corner: float | None = Field(default=None, ge=LEAST_SIZE, le=MOST_SIZE)

    def course(self, corner: float) -> Course:
        """Its pieces."""
        if self.laps > 1 and not self.closed:
            raise checks.conflict(f"laps {self.laps} requires a closed polyline")
        if self.closed and len(self.points) < 3:
            raise checks.refuse("points", f"{len(self.points)} points", "at least 3 where the polyline is closed")
        return rounded(np.array(self.points), corner, self.laps if self.closed else 0, "points")


Shape = CircleSettings | EightSettings | SquareSettings | PolylineSettings

SHAPES: dict[str, type[Shape]] = {
    "circle": CircleSettings,
    "square": SquareSettings,
    "polyline": PolylineSettings,
    "figure_eight": EightSettings,
}
"""By the name in ``shape``."""


def shape_from(value: Any, where: str) -> Shape:
    """A shape from a mapping.

    Raises:
        ValueError: an unknown shape, or a bad setting of it.
    """
    if not isinstance(value, Mapping) or "shape" not in value:
        raise checks.refuse(where, value, f"a mapping with 'shape', one of {', '.join(map(repr, SHAPES))}")
    return parse(SHAPES[checks.choice(f"{where}.shape", value["shape"], tuple(SHAPES))], value, where)


def rounded(points: np.ndarray, corner: float, laps: int, name: str) -> Course:
    """A line through points (n, 2), m, with round corners.

    Args:
        corner: radius, m.
        laps: of a closed line, which begins in the middle between the first two points; 0: an open one.
        name: of the setting, for errors.

    Raises:
        ValueError: two points in a row are the same, the line turns back, or a corner finds no room.
    """
    if laps:
        middle = 0.5 * (points[0] + points[1])
        lap = [*points[1:], points[0]]
        points = np.array([middle, *lap * laps, middle])
    edge = np.diff(points, axis=0)
    length = np.hypot(edge[:, 0], edge[:, 1])
    if not (length > 1e-9).all():
        raise checks.refuse(name, points[length.argmin()].tolist(), "places that differ from the one before")
    direction = np.arctan2(edge[:, 1], edge[:, 0])
    turn = np.diff(direction)
    turn -= 2.0 * math.pi * np.round(turn / (2.0 * math.pi))
    if (np.abs(turn) > SHARPEST).any():
        sharp = int(np.abs(turn).argmax())
        got = f"a turn of {math.degrees(abs(turn[sharp])):.1f} deg at {points[sharp + 1].round(6).tolist()}"
        raise checks.refuse(name, got, f"at most {math.degrees(SHARPEST):g} deg")
    # Of edges, by the corners at their ends.
    taken = np.concatenate([[0.0], corner * np.tan(0.5 * np.abs(turn)), [0.0]])
    left = length - taken[:-1] - taken[1:]
    if left.min() < -1e-9:
        short = int(left.argmin())
        got = f"{1e3 * length[short]:.4g} mm between corners of radius {1e3 * corner:.4g} mm"
        allowed = f"at least {1e3 * (taken[short] + taken[short + 1]):.4g} mm there, or smaller corners"
        raise checks.refuse(name, got, allowed)
    lengths, curvatures = [max(float(left[0]), 0.0)], [0.0]
    for bend, straight in zip(turn.tolist(), left[1:].tolist(), strict=True):
        if bend != 0.0:
            lengths.append(corner * abs(bend))
            curvatures.append(math.copysign(1.0 / corner, bend))
        lengths.append(max(straight, 0.0))
        curvatures.append(0.0)
    return Course((*points[0].tolist(), float(direction[0])), lengths, curvatures)
