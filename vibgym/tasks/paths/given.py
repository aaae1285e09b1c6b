"""Paths that are given as settings, checked against what their parts can do and against one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.paths import route
from vibgym.tasks.paths.reach import EFFORT, RAMP, SHARE, Reach, bisected
from vibgym.tasks.paths.shapes import Shape, shape_from

SPACING = 1e-3
"""m, at most, between the places at which a path is checked."""

MOST_PLACES = 200_000
"""Of all checks of one path: 200 m."""

SLACK = 1e-9


class GivenPaths:
    """The same paths in all episodes; only headings that are kept are drawn.

    Args:
        surface, parts: the scene.
        paths: a mapping for each part, see :mod:`vibgym.tasks.paths.shapes`.
        apart: m, required minimum distance between parts at all times and for all headings.
        argument: what errors call the paths.

    Attributes:
        draws: uniform numbers for an episode.  lasts: s, of the longest path.
        routes: (parts, rows, 6), see :mod:`vibgym.tasks.paths.route`; headings that are kept are 0.  shape: of these.

    Raises:
        ValueError: a bad setting, a path that leaves the surface or that its part cannot follow, or two that come too near.
    """

    def __init__(
        self, surface: Surface, parts: Sequence[Part], paths: Sequence[Any], apart: float, argument: str = "paths"
    ) -> None:
        if len(paths) != len(parts):
            raise checks.refuse(argument, f"{len(paths)} paths", f"one for each of {len(parts)} parts")
        self.surface, self.parts, self._argument = surface, tuple(parts), argument
        made = [
            self._route(f"{argument}[{k}]", value, part)
            for k, (value, part) in enumerate(zip(paths, parts, strict=True))
        ]
        rows = max(len(each) for each in made)
        self.routes = np.stack([route.padded(each, rows) for each in made])
        self.shape = (len(parts), rows, 6)
        self.lasts = max(float(route.duration(each[0])) for each in made)
        self.draws = len(parts)
        self._check_apart(apart)

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
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
        header = [0.0, speed, rate, window, 0.0, float(along)]
        found = self._assembled(name, shape, corner, header)
        self._check_place(name, shape, found, part)
        fastest = bisected(0.0, speed, lambda each: reach.most_effort(self._motion(found, each)) <= EFFORT)
        if fastest < speed * (1.0 - 1e-6):
            allowed = f"at most {fastest:.4g} m/s {whose}: its bends and ramps need more acceleration than there is"
            raise checks.refuse(f"{name}.speed", f"{speed:.4g} m/s", allowed)
        return found

    @staticmethod
    def _assembled(name: str, shape: Shape, corner: float, header: list[float]) -> np.ndarray:
        with checks.within(name, "."):  # the shape does not know whose it is
            start, lengths, curvatures = shape.course(corner)
        rows = [np.array([each], dtype=np.float64) for each in (start, lengths, curvatures, header)]
        return route.routes(*rows)[0]

    @staticmethod
    def _motion(path: np.ndarray, speed: float | None = None) -> np.ndarray:
        """Motion (n, 9) at instants that are near enough to one another."""
        path = path.copy()
        if speed is not None:
            path[0, route.SPEED] = speed
        count = min(int(path[0, route.LENGTH] / SPACING) + 100, MOST_PLACES)
        return route.sample(path, np.linspace(0.0, route.duration(path[0]), count))

    def _check_place(self, name: str, shape: Shape, path: np.ndarray, part: Part) -> None:
        """Whether the part stays on the surface; if not, its size is at fault, or where it lies if it would fit elsewhere."""
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
        """Whether no two parts come near at any instant, each within its circumscribed circle."""
        speed = max(path[0, route.SPEED] for path in self.routes)
        count = min(int(self.lasts * speed / SPACING) + 100, MOST_PLACES)
        times = np.linspace(0.0, self.lasts, count)
        places = [route.sample(path, times)[:, :2] for path in self.routes]
        for k, part in enumerate(self.parts):
            for j in range(k):
                gap = np.hypot(*(places[k] - places[j]).T) - part.radius - self.parts[j].radius
                if gap.min() < apart - SLACK:
                    at = times[gap.argmin()]
                    near = f"comes within {1e3 * gap.min():.4g} mm of that of {self._argument}[{j}] at {at:.2f} s"
                    got = f"a path on which the part {near}"
                    allowed = f"at least {1e3 * apart:.4g} mm between parts at all times, for all headings"
                    raise checks.refuse(f"{self._argument}[{k}]", got, allowed)


def with_headings(routes: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Routes (n, parts, rows, 6) like these (parts, rows, 6), with headings that are kept drawn by ``uniform`` (n, parts)."""
    drawn = np.tile(routes, (len(uniform), 1, 1, 1))
    kept = 1.0 - drawn[:, :, 0, route.ALONG]
    drawn[:, :, 0, route.HEADING] = kept * np.pi * (2.0 * uniform - 1.0)
    return drawn
