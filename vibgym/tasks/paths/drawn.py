"""Paths that are drawn anew for every episode: circles, squares and figures of eight, a part in each cell of the surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.config import parse
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.paths import route
from vibgym.tasks.paths.reach import EFFORT, RAMP, SHARE, Reach, bisected
from vibgym.tasks.paths.shapes import PathSettings

Name = Literal["circle", "square", "figure_eight"]

LARGEST, SMALLEST = 0.1, 0.4
"""m, largest radius (or half a side); smallest one as a share of the largest one that fits."""

ROOM = 1.2
"""Smallest radius (or half a side) over that of a corner."""

NUMBERS = 7
"""Uniform numbers for a path: shape, size, place in x and y, start, direction, heading."""

PIECES = 9

INSTANTS = 1000
"""At which the effort of a path is looked at."""

AROUND = {"circle": 2.0 * math.pi, "square": 8.0, "figure_eight": 4.0 * math.pi}
"""Length of a path over its radius (or half a side), at most."""


class DrawnSettings(PathSettings):
    """What drawn paths have in common: ``shapes``, all of them by default, and :class:`PathSettings`."""

    shapes: list[Name] = Field(default=["circle", "square", "figure_eight"], min_length=1)


class DrawnPaths:
    """Paths of random shape, size, place, start and direction. Each part has a cell of the surface to itself.

    Args:
        surface, parts: the scene.
        settings: a mapping of :class:`DrawnSettings`.
        apart: m, minimum distance between parts that the cells ensure, for all headings.

    Attributes:
        draws: uniform numbers for an episode.  lasts: s, of the longest path that can be drawn.

    Raises:
        ValueError: a bad setting, or no room for a path that the parts can follow.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Any, apart: float) -> None:
        known = parse(DrawnSettings, settings, "paths")
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
        """Largest effort of all paths with the smallest radii, which are the hardest, at this acceleration."""
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
        """Smallest and largest radius (or half a side) of each shape in each cell, (shapes, n) from cells (n, 4)."""
        size = cells[:, 2:] - cells[:, :2]
        short, long = 0.5 * size.min(axis=1), 0.5 * size.max(axis=1)
        each = [np.minimum(short, 0.5 * long) if name == "figure_eight" else short for name in self._shapes]
        most = np.minimum(each, max(LARGEST, ROOM * self._corner))
        return np.maximum(SMALLEST * most, np.minimum(most, ROOM * self._corner)), most

    def _cells_of(self, surface: Surface, apart: float, least: float) -> np.ndarray:
        """(parts, 4) where the centres of each part may be: x_low, y_low, x_high, y_high; as large as can be."""
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
        """Routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
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
