"""Picture of one world: elements, zones, goal, trails and parts, to scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vibgym import checks
from vibgym.rendering import colours as palette
from vibgym.rendering._pygame import require_pygame

DEFAULT_SIZE = (960, 640)
"""The table is drawn as large as fits into this (width, height) in pixels, elements being 4 to 64 whole pixels."""


WALLS = ("left", "right", "bottom", "top")
"""Borders of the surface at which a wall can stand."""


@dataclass(frozen=True)
class Zone:
    """Rectangle in which the parts of one kind shall end.

    Attributes:
        low: smallest x, y, m.
        high: largest x, y, m.
        kind: number of the parts' kind.
        label: what is written on it.

    Raises:
        ValueError: a number is not finite, the rectangle has no area or the kind is not a whole number >= 0.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    kind: int
    label: str = ""

    def __post_init__(self) -> None:
        low = checks.array("low", self.low, (2,))
        high = checks.array("high", self.high, (2,))
        if not (low < high).all():
            raise checks.refuse("high", self.high, f"larger than low, {self.low}, along both axes")
        checks.count("kind", self.kind, least=0)
        object.__setattr__(self, "low", tuple(low.tolist()))
        object.__setattr__(self, "high", tuple(high.tolist()))


@dataclass(frozen=True)
class View:
    """All that a picture needs: one world, SI units, y up, origin in the lower left corner of the surface.

    Attributes:
        pose: (parts, 3) x, y (m) and heading (rad) of each part; one that is not finite is not drawn.
        phasors: (rows, columns, 2) vertical oscillation (C, S) of each element as a fraction of full scale.
        goal_pose: (3,) x, y, heading or (2,) x, y of part 0's goal; None for no goal.
        goal_tolerance: radius of the circle around the goal, m; None for no circle.
        trail: (k, 2) past centres of part 0, m, oldest first, drawn in ink.
        caption: one line of text under the table.
        zones: drawn under everything that moves, in the colours of their kinds.
        trails: one (k, 2) array for each part like ``trail``, drawn in the part's colour; none for no trails.
    """

    pose: np.ndarray
    phasors: np.ndarray
    goal_pose: np.ndarray | None
    goal_tolerance: float | None
    trail: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    caption: str = ""
    zones: tuple[Zone, ...] = ()
    trails: Sequence[np.ndarray] = ()


def _kinds(outlines: Sequence[np.ndarray]) -> list[int]:
    """Number of each part's kind: parts with the same outline are of one kind."""
    shapes: list[bytes] = []
    for outline in outlines:
        if outline.tobytes() not in shapes:
            shapes.append(outline.tobytes())
    return [shapes.index(outline.tobytes()) for outline in outlines]


def _colour_of(kind: int) -> tuple[int, int, int]:
    return palette.PARTS[kind % len(palette.PARTS)]


def _points(trail: np.ndarray) -> np.ndarray:
    return np.asarray(trail, dtype=np.float64).reshape(-1, 2)


class SurfacePainter:
    """Draws views of one surface with fixed parts. Needs no display.

    Args:
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        pixels_per_metre: scale; by default the prototype's picture is 1000 pixels wide.
        colours: fill (r, g, b) of each part; by default that of its kind.
        kinds: number of each part's kind, 0 or more; by default parts with the same outline are of one kind.
        walls: borders at which a wall stands, among "left", "right", "bottom" and "top".

    Attributes:
        width, height: of the picture in pixels.

    Raises:
        ImportError: pygame is not installed.
        ValueError: there are more or fewer kinds or colours than parts, a kind is not a whole number >= 0, or there is
            no such wall.
    """

    def __init__(
        self,
        rows: int,
        columns: int,
        element_size: float,
        outlines: Sequence[np.ndarray],
        pixels_per_metre: float | None = None,
        colours: Sequence[tuple[int, int, int]] | None = None,
        kinds: Sequence[int] | None = None,
        walls: Sequence[str] = (),
    ) -> None:
        require_pygame()
        from vibgym.rendering.canvas import Canvas

        if pixels_per_metre is None:
            pixels_per_metre = max(4, min(64, DEFAULT_SIZE[0] // columns, DEFAULT_SIZE[1] // rows)) / element_size
        self._outlines = [np.ascontiguousarray(outline, dtype=np.float64) for outline in outlines]
        kinds = _kinds(self._outlines) if kinds is None else kinds
        kinds = [checks.count(f"kinds[{k}]", kind, least=0) for k, kind in enumerate(kinds)]
        colours = [_colour_of(kind) for kind in kinds] if colours is None else colours
        for name, values in (("kinds", kinds), ("colours", colours)):
            if len(values) != len(self._outlines):
                raise checks.refuse(name, values, f"one for each of {len(self._outlines)} parts")
        self._colours = [tuple(colour) for colour in colours]
        # A zone has the colour of the first part that shall end there, also where colours were given.
        self._kinds = dict(zip(reversed(kinds), reversed(self._colours), strict=True))
        borders = [checks.choice(f"walls[{k}]", wall, WALLS) for k, wall in enumerate(walls)]
        self._canvas = Canvas(rows, columns, element_size, pixels_per_metre, borders)
        self.width, self.height = self._canvas.size

    def paint(self, view: View) -> np.ndarray:
        """Picture (height, width, 3) uint8 of ``view``; a new array every time.

        Raises:
            ValueError: there are trails, but not one for each part.
        """
        trails, parts = len(view.trails), len(self._outlines)
        if trails not in (0, parts):
            raise checks.refuse("trails", f"{trails} trails", f"none, or one for each of {parts} parts")
        canvas = self._canvas
        canvas.begin(np.asarray(view.phasors, dtype=np.float64))
        for zone in view.zones:
            colour = self._kinds.get(zone.kind, _colour_of(zone.kind))
            canvas.zone(np.array(zone.low), np.array(zone.high), colour, zone.label)
        if view.goal_pose is not None:
            canvas.goal(np.asarray(view.goal_pose, dtype=np.float64), self._outlines[0], view.goal_tolerance)
        canvas.trail(_points(view.trail), palette.INK)
        for points, colour in zip(view.trails, self._colours, strict=False):
            canvas.trail(_points(points), colour)
        for pose, outline, colour in zip(view.pose, self._outlines, self._colours, strict=True):
            canvas.part(np.asarray(pose, dtype=np.float64), outline, colour)
        return canvas.finish(view.caption)
