"""Timed paths: straight lines and arcs with a trapezoidal speed profile, their settings, and the motions a part can follow.

A path is an array (rows, 6), a *route*: a header (:data:`HEADER`), the pieces (:data:`PIECE`) in order, and straight pieces of
no length up to the number of rows. At a distance ``u`` into a piece with direction ``phi`` and curvature ``kappa``

    position = (x, y) + u sinc(kappa u / 2) (cos, sin)(phi + kappa u / 2).

The heading of a part that turns with its path is the mean direction of the path over a window ``w``, so that heading and
spin are continuous where a line meets an arc; for this, the path is extended straight beyond its ends:

    heading(s) = (Phi(s + w / 2) - Phi(s - w / 2)) / w,   Phi = integral of phi over s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import Acceleration, Angle, BaseSettings, Length, Speed, read
from vibgym.simulation.plant import means, plant_of

EFFORT = 0.9
"""Largest effort of a path; the rest is for corrections."""

SWIRL = 0.4
"""Assumed share of mu A m k / 2, the torque under a swirl, since every element has one phase. An optimum over all phasors
reaches 0.42 to 0.85 of it under the aluminium block, 0.38 to 0.85 under a disc of 40 mm, in 400 poses."""

SHARE = {"kept": 1.0 / 2.0, "along": 1.0 / 3.0}
"""Default speed over the part's top speed, by heading: turning takes a share of the amplitude."""

RAMP = 0.25
"""Default acceleration at both ends over the part's largest one from rest."""

STRAIGHT = 1e-6
"""1/m, smallest curvature of a corner."""

_HALVINGS = 30


def bisected(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """Return the largest number from ``low`` to ``high`` that ``holds``, if all smaller ones do; ``low`` if none does."""
    if holds(high):
        return high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class Reach:
    """Motions that the elements can give a part.

    Attributes:
        top_speed: m/s, on a straight line with the largest amplitude.
        fastest: m/s, on a straight line with the largest effort of paths.
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
        plant = plant_of(surface, [part])
        self._push = 2.0 * float(plant.push[0])  # m/s^2, of which half acts near rest
        self._brake = part.friction * surface.gravity
        self._twist = SWIRL * float(plant.turn_push[0])  # rad/s^2
        self._spin_drag = float(plant.drag[0])  # 1/s
        self.top_speed, self.fastest = (self._steady(effort) for effort in (1.0, EFFORT))
        self.acceleration = 0.5 * EFFORT * self._push

    def _steady(self, effort: float) -> float:
        return bisected(0.0, 0.999 * self.surface.table_speed, lambda speed: self.effort(speed) <= effort)

    def effort(self, speed: Any, along: Any = 0.0, across: Any = 0.0, turning: Any = 0.0, spin: Any = 0.0) -> Any:
        """Return the share of the largest amplitude that motions need; more than 1: impossible. Arguments broadcast.

        Args:
            speed: m/s.  along, across: acceleration along the velocity and to its left, m/s^2.
            turning, spin: rad/s^2, rad/s; their share is added, which is an upper bound.
        """
        s = np.asarray(speed) / self.surface.table_speed
        drag, side, ahead = (np.interp(s, self._node, values) for values in (self._drag, self._across, self._along))
        push = np.hypot((along + self._brake * drag) / ahead, across / side) / self._push
        return push + (np.abs(turning) + self._spin_drag * np.abs(spin)) / self._twist

    def corner(self, speed: float, window: float = math.inf) -> float:
        """Return the radius of a corner, m, at which ``speed`` takes half of the effort that a straight line leaves.

        Args:
            window: m, over which a part turns with its path; infinite for parts that keep their heading.
        """
        most = 0.5 * (self.effort(speed) + EFFORT)
        turns = 0.0 if math.isinf(window) else 1.0

        def easy(curvature: float) -> bool:
            across = curvature * speed * speed
            return self.effort(speed, 0.0, across, turns * across / window, turns * curvature * speed) <= most

        return 1.0 / max(bisected(0.0, self._push / (speed * speed), easy), STRAIGHT)

    def most_effort(self, motion: np.ndarray) -> float:
        """Return the largest effort of a motion (n, 9), see :data:`INSTANT`."""
        speed = np.minimum(np.hypot(motion[:, 3], motion[:, 4]), self.surface.table_speed)
        return float(self.effort(speed, motion[:, 6], motion[:, 7], motion[:, 8], motion[:, 5]).max())


HEADER = ("length", "speed", "acceleration", "window", "heading", "along")
"""- length: m, of the whole path; speed: m/s; acceleration: m/s^2; window: m
- heading: rad, of the part, or added to that of the path; along: 1 if the part turns with the path, else 0
"""
LENGTH, SPEED, ACCELERATION, WINDOW, HEADING, ALONG = range(len(HEADER))

PIECE = ("start", "x", "y", "direction", "curvature", "turned")
"""- start: m, s at its beginning; x, y (m), direction (rad), turned (m rad, Phi): there; curvature: 1/m, to the left"""
START, X, Y, DIRECTION, CURVATURE, TURNED = range(len(PIECE))

INSTANT = ("x", "y", "heading", "vx", "vy", "spin", "along", "across", "turning")
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
    """Write the :data:`INSTANT` of a route (rows, 6) at ``time`` (s) into ``motion`` (9,)."""
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


@jit(allocates=True)
def first_poses(paths, pose):
    """Compute the first poses (n, parts, 3) of routes (n, parts, rows, 6)."""
    motion = np.empty(len(INSTANT))
    for world in range(paths.shape[0]):
        for i in range(paths.shape[1]):
            motion_at(paths[world, i], 0.0, motion)
            for axis in range(3):
                pose[world, i, axis] = motion[axis]


@jit
def sample_route(route, times, motion):
    """Compute the :data:`INSTANT` (n, 9) of a route at ``times`` (n,)."""
    for k in range(times.shape[0]):
        motion_at(route, times[k], motion[k])


def sample(route: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the :data:`INSTANT` (n, 9) of a route (rows, 6) at ``times`` (n,), s."""
    motion = np.empty((len(times), len(INSTANT)))
    sample_route(np.ascontiguousarray(route), np.ascontiguousarray(times, dtype=np.float64), motion)
    return motion


def sampled(route: np.ndarray, instants: int) -> np.ndarray:
    """Return the :data:`INSTANT` (instants, 9) of a route at equal intervals, from its beginning to its end."""
    return sample(route, np.linspace(0.0, duration(route[0]), instants))


def turn_kept(routes: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Set the kept headings of routes (n, parts, rows, 6), in place, to any direction, by ``uniform`` (n, parts) in [0, 1)."""
    kept = 1.0 - routes[:, :, 0, ALONG]
    routes[:, :, 0, HEADING] = kept * math.pi * (2.0 * uniform - 1.0)
    return routes


MAX_POINTS, MAX_LAPS = 200, 100

MIN_SIZE, MAX_SIZE = 1e-4, 1e3
"""m."""

MAX_TURN = 8.0 * math.pi
"""rad."""

MIN_SPEED = 1e-3
"""m/s; of the ramps: m/s^2."""

SHARPEST = math.radians(170.0)
"""Largest turn at a corner."""

Coordinate = Annotated[Length, Field(ge=-MAX_SIZE, le=MAX_SIZE)]

Place = tuple[Coordinate, Coordinate]


class PathSettings(BaseSettings):
    """Settings of all shapes, see :class:`vibgym.tasks.Follow`.

    Attributes:
        PLACE, SIZE: settings of place and size, for errors.
    """

    PLACE: ClassVar[str] = "centre"
    SIZE: ClassVar[str] = "radius"

    speed: Speed | None = Field(default=None, ge=MIN_SPEED)
    acceleration: Acceleration | None = Field(default=None, ge=MIN_SPEED)
    heading: Literal["kept", "along"] = "kept"


class ClosedSettings(PathSettings):
    """Settings of closed shapes: ``laps`` and direction."""

    laps: int = Field(default=1, ge=1, le=MAX_LAPS)
    clockwise: bool = False


class CircleSettings(ClosedSettings):
    """A circle; ``start``: rad, where the path begins, 0: at the largest x."""

    shape: Literal["circle"]
    centre: Place
    radius: Length = Field(ge=MIN_SIZE, le=MAX_SIZE)
    start: Angle = Field(default=0.0, ge=-MAX_TURN, le=MAX_TURN)

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
    radius: Length = Field(ge=MIN_SIZE, le=MAX_SIZE)
    turn: Angle = Field(default=0.0, ge=-MAX_TURN, le=MAX_TURN)

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
    side: Length = Field(ge=MIN_SIZE, le=MAX_SIZE)
    turn: Angle = Field(default=0.0, ge=-MAX_TURN, le=MAX_TURN)
    corner: Length | None = Field(default=None, ge=MIN_SIZE, le=MAX_SIZE)

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
    points: tuple[Place, ...] = Field(min_length=2, max_length=MAX_POINTS)
    closed: bool = False
    laps: int = Field(default=1, ge=1, le=MAX_LAPS)
    corner: Length | None = Field(default=None, ge=MIN_SIZE, le=MAX_SIZE)

    def course(self, corner: float) -> Course:
        """Return the pieces."""
        if self.laps > 1 and not self.closed:
            raise checks.conflict(f"laps {self.laps} requires a closed polyline")
        if self.closed and len(self.points) < 3:
            raise checks.refuse("points", f"{len(self.points)} points", "at least 3 where the polyline is closed")
        return rounded(np.array(self.points), corner, self.laps if self.closed else 0, "points")


def profile(name: str, settings: PathSettings, reach: Sequence[Reach]) -> tuple[np.ndarray, float]:
    """Return the header (6,) of a path, without its length, and the radius of its corners, m.

    Args:
        name: of the path, for errors.
        reach: of the parts that are to follow it.

    Raises:
        ValueError: a speed or an acceleration that a part cannot reach.
    """
    fastest, hardest = (min(getattr(own, limit) for own in reach) for limit in ("fastest", "acceleration"))
    speed, rate = settings.speed, settings.acceleration
    speed = SHARE[settings.heading] * min(own.top_speed for own in reach) if speed is None else speed
    rate = RAMP * hardest if rate is None else rate
    whose = "for " + ", ".join(dict.fromkeys(repr(own.part.name) for own in reach)) + " on this surface"
    for key, value, most, unit in (("speed", speed, fastest, "m/s"), ("acceleration", rate, hardest, "m/s^2")):
        if value > most:
            raise checks.refuse(f"{name}.{key}", value, f"a number > 0 and <= {most:.4g} {unit} {whose}")
    along, window = settings.heading == "along", 2.0 * max(own.part.radius for own in reach)
    corner = max(own.corner(speed, window if along else math.inf) for own in reach)
    return np.array([0.0, speed, rate, window, 0.0, float(along)]), corner


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
