"""Routes: paths of straight lines and arcs with a trapezoidal speed profile, and their settings.

A route is an array (rows, 6): a header (:data:`HEADER`), the pieces (:data:`PIECE`) in order, and straight pieces of no
length up to the number of rows. At a distance ``u`` into a piece with direction ``phi`` and curvature ``kappa``

    position = (x, y) + u sinc(kappa u / 2) (cos, sin)(phi + kappa u / 2).

The heading of a part that turns with its path is the mean direction of the path over a window ``w``, so that heading and
spin are continuous where a line meets an arc; for this, the path is extended straight beyond its ends:

    heading(s) = (Phi(s + w / 2) - Phi(s - w / 2)) / w,   Phi = integral of phi over s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.settings import Acceleration, Angle, BaseSettings, Length, Speed, read

HEADER = ("length", "speed", "acceleration", "window", "heading", "along")
"""- length: m, of the whole path; speed: m/s; acceleration: m/s^2; window: m
- heading: rad, of the part, or added to that of the path; along: 1 if the part turns with the path, else 0
"""
LENGTH, SPEED, ACCELERATION, WINDOW, HEADING, ALONG = range(len(HEADER))

PIECE = ("start", "x", "y", "direction", "curvature", "turned")
"""- start: m, s at its beginning; x, y (m), direction (rad), turned (m rad, Phi): there; curvature: 1/m, to the left"""
START, X, Y, DIRECTION, CURVATURE, TURNED = range(len(PIECE))

MOTION = ("x", "y", "heading", "vx", "vy", "spin", "along", "across", "turning")
"""Motion at an instant: m, m, rad; m/s, m/s, rad/s; acceleration along the path and to its left, m/s^2; rad/s^2."""

SMALL = 1e-9
"""m, length of a path that stays at a point."""


class Course(NamedTuple):
    """The beginning of a path, and its pieces."""

    start: Sequence[float]  # x, y (m), direction (rad)
    lengths: Sequence[float]  # m
    curvatures: Sequence[float]  # 1/m


def routes(start: np.ndarray, lengths: np.ndarray, curvatures: np.ndarray, header: np.ndarray) -> np.ndarray:
    """Return routes (n, pieces + 2, 6).

    Args:
        start: (n, 3) x, y (m), direction (rad).
        lengths, curvatures: (n, pieces) m, 1/m.
        header: (n, 6); lengths are computed.
    """
    n, pieces = lengths.shape
    turn = lengths * curvatures
    route = np.zeros((n, pieces + 2, 6))
    begin = np.concatenate([np.zeros((n, 1)), lengths.cumsum(axis=1)], axis=1)
    direction = start[:, 2:] + np.concatenate([np.zeros((n, 1)), turn.cumsum(axis=1)], axis=1)
    chord = lengths * np.sinc(0.5 * turn / np.pi)
    middle = direction[:, :-1] + 0.5 * turn
    step = np.stack([chord * np.cos(middle), chord * np.sin(middle), lengths * middle], axis=2)
    place = np.concatenate([np.zeros((n, 1, 3)), step.cumsum(axis=1)], axis=1)
    route[:, 0] = header
    route[:, 0, LENGTH] = begin[:, -1]
    route[:, 1:, START], route[:, 1:, DIRECTION] = begin, direction
    route[:, 1:, X : Y + 1] = start[:, None, :2] + place[..., :2]
    route[:, 1:-1, CURVATURE] = curvatures
    route[:, 1:, TURNED] = place[..., 2]
    return route


def padded(route: np.ndarray, rows: int) -> np.ndarray:
    """Return a route (k, 6) extended to ``rows`` rows."""
    return np.concatenate([route, np.repeat(route[-1:], rows - len(route), axis=0)])


@jit
def peak_speed(header):
    """Return the largest speed, m/s: that of the header, or less on a short route."""
    return min(header[SPEED], math.sqrt(header[ACCELERATION] * header[LENGTH]))


@jit
def duration(header):
    """Return the time from rest at the beginning to rest at the end, s."""
    speed = peak_speed(header)
    return header[LENGTH] / speed + speed / header[ACCELERATION]


@jit
def progress(header, time):
    """Return s (m), speed and acceleration along the path at ``time`` (s); at rest before and after."""
    speed, rate = peak_speed(header), header[ACCELERATION]
    ramp, end = speed / rate, header[LENGTH] / speed + speed / rate
    if time <= 0.0:
        return 0.0, 0.0, 0.0
    if time >= end:
        return header[LENGTH], 0.0, 0.0
    if time < ramp:
        return 0.5 * rate * time * time, rate * time, rate
    left = end - time
    if left < ramp:
        return header[LENGTH] - 0.5 * rate * left * left, rate * left, -rate
    return speed * (time - 0.5 * ramp), speed, 0.0


@jit
def piece_at(route, s):
    """Return the row of the piece that contains ``s``; beyond the ends that of the first or last one."""
    low, high = 1, route.shape[0] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if route[middle, START] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@jit
def directed(route, s):
    """Return direction (rad), curvature (1/m) and Phi (m rad) of the path at ``s``; straight beyond its ends."""
    row = route[piece_at(route, s)]
    u = s - row[START]
    curvature = row[CURVATURE] if u >= 0.0 else 0.0
    return row[DIRECTION] + curvature * u, curvature, row[TURNED] + u * (row[DIRECTION] + 0.5 * curvature * u)


@jit
def motion_at(route, time, motion):
    """Write the :data:`MOTION` of a route (rows, 6) at ``time`` (s) into ``motion`` (9,)."""
    header = route[0]
    s, speed, rate = progress(header, time)
    row = route[piece_at(route, s)]
    u = s - row[START]
    half = 0.5 * row[CURVATURE] * u
    chord = u * (math.sin(half) / half) if half != 0.0 else u
    motion[0] = row[X] + chord * math.cos(row[DIRECTION] + half)
    motion[1] = row[Y] + chord * math.sin(row[DIRECTION] + half)
    direction = row[DIRECTION] + row[CURVATURE] * u
    motion[3], motion[4] = speed * math.cos(direction), speed * math.sin(direction)
    motion[6], motion[7] = rate, row[CURVATURE] * speed * speed
    window, along = header[WINDOW], header[ALONG]
    ahead, bend_ahead, turned_ahead = directed(route, s + 0.5 * window)
    behind, bend_behind, turned_behind = directed(route, s - 0.5 * window)
    slope = (ahead - behind) / window
    motion[2] = header[HEADING] + along * ((turned_ahead - turned_behind) / window)
    motion[5] = along * (speed * slope)
    motion[8] = along * (rate * slope + speed * speed * ((bend_ahead - bend_behind) / window))


@jit
def first_poses(paths, motion, pose):
    """Compute the first poses (n, parts, 3) of routes (n, parts, rows, 6); ``motion`` (9,) is scratch."""
    for world in range(paths.shape[0]):
        for i in range(paths.shape[1]):
            motion_at(paths[world, i], 0.0, motion)
            for axis in range(3):
                pose[world, i, axis] = motion[axis]


@jit
def sample_route(route, times, motion):
    """Compute the :data:`MOTION` (n, 9) of a route at ``times`` (n,)."""
    for k in range(times.shape[0]):
        motion_at(route, times[k], motion[k])


def sample(route: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the :data:`MOTION` (n, 9) of a route (rows, 6) at ``times`` (n,), s."""
    motion = np.empty((len(times), len(MOTION)))
    sample_route(np.ascontiguousarray(route), np.ascontiguousarray(times, dtype=np.float64), motion)
    return motion


MOST_POINTS, MOST_LAPS = 200, 100

LEAST_SIZE, MOST_SIZE = 1e-4, 1e3
"""m."""

MOST_TURN = 8.0 * math.pi
"""rad."""

LEAST_SPEED = 1e-3
"""m/s; of the ramps: m/s^2."""

SHARPEST = math.radians(170.0)
"""Largest turn at a corner."""

Coordinate = Annotated[Length, Field(ge=-MOST_SIZE, le=MOST_SIZE)]

Place = tuple[Coordinate, Coordinate]


class PathSettings(BaseSettings):
    """Settings of all shapes, see :class:`vibgym.tasks.Follow`.

    Attributes:
        PLACE, SIZE: settings of place and size, for errors.
    """

    PLACE: ClassVar[str] = "centre"
    SIZE: ClassVar[str] = "radius"

    speed: Speed | None = Field(default=None, ge=LEAST_SPEED)
    acceleration: Acceleration | None = Field(default=None, ge=LEAST_SPEED)
    heading: Literal["kept", "along"] = "kept"


class ClosedSettings(PathSettings):
    """Settings of closed shapes: ``laps`` and direction."""

    laps: int = Field(default=1, ge=1, le=MOST_LAPS)
    clockwise: bool = False


class CircleSettings(ClosedSettings):
    """A circle; ``start``: rad, where the path begins, 0: at the largest x."""

    shape: Literal["circle"]
    centre: Place
    radius: Length = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    start: Angle = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)

    def course(self, corner: float) -> Course:
        """Return the pieces."""
        sign = -1.0 if self.clockwise else 1.0
        x = self.centre[0] + self.radius * math.cos(self.start)
        y = self.centre[1] + self.radius * math.sin(self.start)
        length = 2.0 * math.pi * self.radius * self.laps
        return Course((x, y, self.start + sign * 0.5 * math.pi), [length], [sign / self.radius])


class EightSettings(ClosedSettings):
    """Two circles that touch at ``centre``, where the path begins; ``clockwise``: the first of them."""

    shape: Literal["figure_eight"]
    centre: Place
    radius: Length = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    turn: Angle = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)

    def course(self, corner: float) -> Course:
        """Return the pieces."""
        sign = -1.0 if self.clockwise else 1.0
        lengths = [2.0 * math.pi * self.radius] * (2 * self.laps)
        curvatures = [sign / self.radius, -sign / self.radius] * self.laps
        return Course((*self.centre, self.turn + 0.5 * math.pi), lengths, curvatures)


class SquareSettings(ClosedSettings):
    """A square with round corners; the path begins in the middle of the lower side."""

    SIZE: ClassVar[str] = "side"

    shape: Literal["square"]
    centre: Place
    side: Length = Field(ge=LEAST_SIZE, le=MOST_SIZE)
    turn: Angle = Field(default=0.0, ge=-MOST_TURN, le=MOST_TURN)
    corner: Length | None = Field(default=None, ge=LEAST_SIZE, le=MOST_SIZE)

    def course(self, corner: float) -> Course:
        """Return the pieces."""
        half, cos, sin = 0.5 * self.side, math.cos(self.turn), math.sin(self.turn)
        rows = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        points = np.array(self.centre) + rows @ np.array([[cos, sin], [-sin, cos]])
        return rounded(points[[1, 0, 3, 2]] if self.clockwise else points, corner, self.laps, "side")


class PolylineSettings(PathSettings):
    """A line through ``points`` with round corners; if ``closed``, it begins in the middle between the first two points."""

    PLACE: ClassVar[str] = "points"
    SIZE: ClassVar[str] = "points"

    shape: Literal["polyline"]
    points: tuple[Place, ...] = Field(min_length=2, max_length=MOST_POINTS)
    closed: bool = False
    laps: int = Field(default=1, ge=1, le=MOST_LAPS)
    corner: Length | None = Field(default=None, ge=LEAST_SIZE, le=MOST_SIZE)

    def course(self, corner: float) -> Course:
        """Return the pieces."""
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
"""Shapes by name."""


def shape_from(value: Any, where: str) -> Shape:
    """Return a shape from a mapping.

    Raises:
        ValueError: an unknown shape, or a bad setting of it.
    """
    if not isinstance(value, Mapping) or "shape" not in value:
        raise checks.refuse(where, value, f"a mapping with 'shape', one of {', '.join(map(repr, SHAPES))}")
    return read(SHAPES[checks.choice(f"{where}.shape", value["shape"], tuple(SHAPES))], value, where)


def rounded(points: np.ndarray, corner: float, laps: int, name: str) -> Course:
    """Return a line through points (n, 2), m, with round corners.

    Args:
        corner: radius, m.
        laps: of a closed line, which begins in the middle between the first two points; 0: an open one.
        name: of the setting, for errors.

    Raises:
        ValueError: two consecutive points are the same, the line turns back, or there is no room for a corner.
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
    # Length of each edge that the corners at its ends take.
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
