"""Timed paths, given as settings or drawn for every episode, and the motions that a part can follow."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import read
from vibgym.simulation.plant import means, plant_of
from vibgym.tasks import route
from vibgym.tasks.route import PathSettings, Shape, shape_from

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
        drag, side, ahead = (np.interp(s, self._node, each) for each in (self._drag, self._across, self._along))
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
        """Return the largest effort of a motion (n, 9), see :data:`vibgym.tasks.route.MOTION`."""
        speed = np.minimum(np.hypot(motion[:, 3], motion[:, 4]), self.surface.table_speed)
        return float(self.effort(speed, motion[:, 6], motion[:, 7], motion[:, 8], motion[:, 5]).max())


Name = Literal["circle", "square", "figure_eight"]

LARGEST, SMALLEST = 0.1, 0.4
"""m, largest radius (or half a side); smallest one over the largest one that fits."""

ROOM = 1.2
"""Smallest radius (or half a side) over that of a corner."""

NUMBERS = 7
"""Uniform numbers of a path: shape, size, place in x and y, start, direction, heading."""

PIECES = 9

INSTANTS = 1000
"""Samples of the effort of a path."""

AROUND = {"circle": 2.0 * math.pi, "square": 8.0, "figure_eight": 4.0 * math.pi}
"""Length of a path over its radius (or half a side), at most."""


class DrawnSettings(PathSettings):
    """Settings of drawn paths."""

    shapes: tuple[Name, ...] = Field(default=("circle", "square", "figure_eight"), min_length=1)


class DrawnPaths:
    """Paths of random shape, size, place, start and direction. Each part has its own cell of the surface.

    Args:
        surface, parts: the scene.
        settings: a mapping of :class:`DrawnSettings`.
        apart: m, minimum distance between parts that the cells ensure, for all headings.

    Attributes:
        draws: uniform numbers per episode.  lasts: s, duration of the longest possible path.

    Raises:
        ValueError: a bad setting, or no room for a path that the parts can follow.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Any, apart: float) -> None:
        known = read(DrawnSettings, settings, "paths")
        self.parts, self._shapes = tuple(parts), list(dict.fromkeys(known.shapes))
        reach = [Reach(surface, part) for part in parts]
        fastest, hardest = (min(getattr(each, name) for each in reach) for name in ("fastest", "acceleration"))
        speed = SHARE[known.heading] * min(each.top_speed for each in reach) if known.speed is None else known.speed
        rate = RAMP * hardest if known.acceleration is None else known.acceleration
        if speed > fastest:
            raise checks.refuse("paths.speed", speed, f"a number > 0 and <= {fastest:.4g} m/s for these parts")
        along, window = known.heading == "along", 2.0 * max(part.radius for part in parts)
        self._corner = max(each.corner(speed, *([window] if along else [])) for each in reach)
        self._header = np.array([0.0, speed, rate, window, 0.0, float(along)])
        self._cells = self._cells_of(surface, apart, ROOM * self._corner)
        self.draws = NUMBERS * len(self.parts)
        self.shape = (len(self.parts), PIECES + 2, 6)
        most = bisected(0.0, rate, lambda each: self._effort(reach, each) <= EFFORT)
        if known.acceleration is not None and most < rate * (1.0 - 1e-6):
            allowed = f"a number > 0 and <= {most:.4g} m/s^2 for these parts and bends"
            raise checks.refuse("paths.acceleration", rate, allowed)
        self._header[route.ACCELERATION] = most
        longest = max(
            AROUND[name] * each.max() for name, each in zip(self._shapes, self._radii(self._cells)[1], strict=True)
        )
        self.lasts = float(route.duration(np.array([longest, *self._header[1:]])))

    def _effort(self, reach: Sequence[Reach], rate: float) -> float:
        """Return the largest effort of all paths with the smallest radii, which are the hardest, at this acceleration."""
        number = np.zeros((len(self._shapes), len(self.parts), NUMBERS))
        number[..., 0] = (np.arange(len(self._shapes))[:, None] + 0.5) / len(self._shapes)
        paths = self.draw(number.reshape(len(self._shapes), -1))
        paths[:, :, 0, route.ACCELERATION] = rate
        efforts = []
        for shape, part in np.ndindex(paths.shape[:2]):
            times = np.linspace(0.0, route.duration(paths[shape, part, 0]), INSTANTS)
            efforts.append(reach[part].most_effort(route.sample(paths[shape, part], times)))
        return max(efforts)

    def _radii(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest radius (or half a side) of each shape in each cell, (shapes, n) from cells (n, 4)."""
        size = cells[:, 2:] - cells[:, :2]
        short, long = 0.5 * size.min(axis=1), 0.5 * size.max(axis=1)
        each = [np.minimum(short, 0.5 * long) if name == "figure_eight" else short for name in self._shapes]
        most = np.minimum(each, max(LARGEST, ROOM * self._corner))
        return np.maximum(SMALLEST * most, np.minimum(most, ROOM * self._corner)), most

    def _cells_of(self, surface: Surface, apart: float, least: float) -> np.ndarray:
        """Return the largest cells (parts, 4) of the parts' centres: x_low, y_low, x_high, y_high."""
        radius = max(part.radius for part in self.parts)
        size, best, found = np.array([surface.width, surface.depth]), -math.inf, np.zeros((0, 4))
        for columns in range(1, len(self.parts) + 1):
            count = np.array([columns, math.ceil(len(self.parts) / columns)])
            step = (size + apart) / count  # from cell to cell
            cell = step - 2.0 * radius - apart
            if cell.min() <= 0.0:
                continue
            k = np.arange(len(self.parts))
            low = radius + np.column_stack([k // count[1], k % count[1]]) * step
            cells = np.concatenate([low, low + cell], axis=1)
            most = self._radii(cells)[1].min()
            if most > best:
                best, found = most, cells
        if best < least:
            got = f"{len(self.parts)} parts of radius up to {radius:.4g} m"
            allowed = (
                f"as many as have room for paths of radius {1e3 * least:.4g} mm, {1e3 * apart:.4g} mm apart, on "
                f"{surface.width:g} x {surface.depth:g} m; slower paths need less"
            )
            raise checks.refuse("parts", got, allowed)
        return found

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Return routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
        n, parts = len(uniform), len(self.parts)
        number = uniform.reshape(n, parts, NUMBERS)
        choice = np.minimum((len(self._shapes) * number[..., 0]).astype(int), len(self._shapes) - 1)
        low, high = (each[choice, np.arange(parts)] for each in self._radii(self._cells))
        radius = low + (high - low) * number[..., 1]
        names = np.array(self._shapes)[choice]
        circle, square, eight = (names == name for name in ("circle", "square", "figure_eight"))
        # A figure of eight lies along the longer side of its cell.
        size = self._cells[:, 2:] - self._cells[:, :2]
        wide = np.array([size[:, 0] >= size[:, 1], size[:, 0] < size[:, 1]]).T
        reach = radius[..., None] * np.where(eight[..., None] & wide, 2.0, 1.0)
        centre = self._cells[:, :2] + reach + np.maximum(size - 2.0 * reach, 0.0) * number[..., 2:4]
        sign = np.where(number[..., 5] < 0.5, 1.0, -1.0)

        # A circle begins anywhere, a square in the middle of any side, a figure of eight at its centre, either way.
        turn = 2.0 * math.pi * number[..., 4]
        quarter = 0.5 * math.pi * np.floor(4.0 * number[..., 4])
        half = np.where(wide[:, 0], 0.5 * math.pi, 0.0) + math.pi * np.floor(2.0 * number[..., 4])
        begin = np.where(circle, turn, quarter)
        out = np.where(eight, 0.0, radius)
        direction = np.where(eight, half, begin + sign * 0.5 * math.pi)
        x, y = centre[..., 0] + out * np.cos(begin), centre[..., 1] + out * np.sin(begin)

        lengths, curvatures = np.zeros((2, n, parts, PIECES))
        side, corner = 2.0 * (radius - self._corner), np.full_like(radius, self._corner)
        for k in range(PIECES):
            straight = 0.5 * side if k in (0, PIECES - 1) else side
            lengths[..., k] = np.where(square, straight if k % 2 == 0 else 0.5 * math.pi * corner, 0.0)
            curvatures[..., k] = np.where(square, 0.0 if k % 2 == 0 else sign / corner, 0.0)
        around = np.where(square, 0.0, 2.0 * math.pi * radius)
        lengths[..., 0] = np.where(square, lengths[..., 0], around)
        curvatures[..., 0] = np.where(square, 0.0, sign / radius)
        lengths[..., 1] = np.where(eight, around, lengths[..., 1])
        curvatures[..., 1] = np.where(eight, -sign / radius, curvatures[..., 1])

        header = np.tile(self._header, (n, parts, 1))
        header[..., route.HEADING] = (1.0 - header[..., route.ALONG]) * math.pi * (2.0 * number[..., 6] - 1.0)
        start = np.stack([x, y, direction], axis=2)
        flat = [each.reshape(n * parts, -1) for each in (start, lengths, curvatures, header)]
        return route.routes(*flat).reshape(n, parts, PIECES + 2, 6)


SPACING = 1e-3
"""m, largest distance between the points at which a path is checked."""

MOST_PLACES = 200_000
"""Points of one path: 200 m."""

SLACK = 1e-9


class GivenPaths:
    """The same paths in all episodes; only kept headings are drawn.

    Args:
        surface, parts: the scene.
        paths: a mapping for each part, see :class:`vibgym.tasks.Follow`.
        apart: m, required minimum distance between parts at all times and for all headings.
        argument: name for errors.

    Attributes:
        draws: uniform numbers per episode.  lasts: s, duration of the longest path.
        routes: (parts, rows, 6), see :mod:`vibgym.tasks.route`; kept headings are 0.  shape: of these.

    Raises:
        ValueError: a bad setting, a path that leaves the surface or that its part cannot follow, or two that come too near.
    """

    def __init__(
        self, surface: Surface, parts: Sequence[Part], paths: Sequence[Any], apart: float, argument: str = "paths"
    ) -> None:
        if len(paths) != len(parts):
            raise checks.refuse(argument, f"{len(paths)} paths", f"one for each of {len(parts)} parts")
        self.surface, self.parts, self._argument = surface, tuple(parts), argument
        made = [self._route(f"{argument}[{k}]", value, part) for k, (value, part) in enumerate(zip(paths, parts))]
        rows = max(len(each) for each in made)
        self.routes = np.stack([route.padded(each, rows) for each in made])
        self.shape = (len(parts), rows, 6)
        self.lasts = max(float(route.duration(each[0])) for each in made)
        self.draws = len(parts)
        self._check_apart(apart)

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Return routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
        return with_headings(self.routes, uniform)

    def _route(self, name: str, value: Any, part: Part) -> np.ndarray:
        shape, reach = shape_from(value, name), Reach(self.surface, part)
        window = 2.0 * part.radius
        speed = SHARE[shape.heading] * reach.top_speed if shape.speed is None else shape.speed
        rate = RAMP * reach.acceleration if shape.acceleration is None else shape.acceleration
        whose = f"for {part.name!r} on this surface"
        if speed > reach.fastest:
            raise checks.refuse(f"{name}.speed", speed, f"a number > 0 and <= {reach.fastest:.4g} m/s {whose}")
        if rate > reach.acceleration:
            allowed = f"a number > 0 and <= {reach.acceleration:.4g} m/s^2 {whose}"
            raise checks.refuse(f"{name}.acceleration", rate, allowed)
        along = shape.heading == "along"
        corner = getattr(shape, "corner", None) or reach.corner(speed, *([window] if along else []))
        with checks.within(name, "."):
            course = shape.course(corner)
        rows = (np.array([each], dtype=np.float64) for each in (*course, [0.0, speed, rate, window, 0.0, float(along)]))
        found = route.routes(*rows)[0]
        self._check_place(name, shape, found, part)
        fastest = bisected(0.0, speed, lambda each: reach.most_effort(self._motion(found, each)) <= EFFORT)
        if fastest < speed * (1.0 - 1e-6):
            allowed = f"at most {fastest:.4g} m/s {whose}: its bends and ramps need more acceleration than there is"
            raise checks.refuse(f"{name}.speed", f"{speed:.4g} m/s", allowed)
        return found

    @staticmethod
    def _motion(path: np.ndarray, speed: float | None = None) -> np.ndarray:
        """Return the motion (n, 9) at points at most :data:`SPACING` apart, optionally at another speed."""
        path = path.copy()
        if speed is not None:
            path[0, route.SPEED] = speed
        count = min(int(path[0, route.LENGTH] / SPACING) + 100, MOST_PLACES)
        return route.sample(path, np.linspace(0.0, route.duration(path[0]), count))

    def _check_place(self, name: str, shape: Shape, path: np.ndarray, part: Part) -> None:
        """Check that the part stays on the surface; errors name the size, or the place if the path would fit elsewhere."""
        place, margin = self._motion(path)[:, :2], part.radius - SLACK
        room = np.array([self.surface.width, self.surface.depth])
        off = ((place < margin) | (place > room - margin)).any(axis=1)
        if off.any():
            key = shape.SIZE if (np.ptp(place, axis=0) > room - 2.0 * margin).any() else shape.PLACE
            low, high = part.radius, room - part.radius
            allowed = (
                f"a path on which {part.name!r} lies wholly on the surface for every heading: "
                f"x in [{low:.4g}, {high[0]:.4g}] and y in [{low:.4g}, {high[1]:.4g}] m"
            )
            raise checks.refuse(f"{name}.{key}", f"a path through {place[off][0].round(4).tolist()}", allowed)

    def _check_apart(self, apart: float) -> None:
        """Check that no two circumscribed circles come near at any instant."""
        speed = max(path[0, route.SPEED] for path in self.routes)
        count = min(int(self.lasts * speed / SPACING) + 100, MOST_PLACES)
        times = np.linspace(0.0, self.lasts, count)
        places = [route.sample(path, times)[:, :2] for path in self.routes]
        for k, part in enumerate(self.parts):
            for j in range(k):
                gap = np.hypot(*(places[k] - places[j]).T) - part.radius - self.parts[j].radius
                if gap.min() < apart - SLACK:
                    at = f"of that of {self._argument}[{j}] at {times[gap.argmin()]:.2f} s"
                    got = f"a path on which the part comes within {1e3 * gap.min():.4g} mm {at}"
                    allowed = f"at least {1e3 * apart:.4g} mm between parts at all times, for all headings"
                    raise checks.refuse(f"{self._argument}[{k}]", got, allowed)


def with_headings(routes: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Return routes (n, parts, rows, 6) with kept headings drawn by ``uniform`` (n, parts), from routes (parts, rows, 6)."""
    drawn = np.tile(routes, (len(uniform), 1, 1, 1))
    kept = 1.0 - drawn[:, :, 0, route.ALONG]
    drawn[:, :, 0, route.HEADING] = kept * np.pi * (2.0 * uniform - 1.0)
    return drawn
