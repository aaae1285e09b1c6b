"""Picture of one world: elements, zones, goal, trails and parts, to scale."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from vibgym import checks
from vibgym.rendering.colours import PARTS
from vibgym.rendering.side import HEIGHT, Side, strip

if TYPE_CHECKING:
    from vibgym.rendering.canvas import Canvas

DEFAULT_SIZE = (960, 640)
"""Largest width and height of the table in pixels; elements take 4 to 64 whole pixels."""

TRAIL_STEPS = 250
"""Steps of a trail."""

WALLS = ("left", "right", "bottom", "top")
"""Borders of the surface that can have a wall."""


def require_pygame() -> ModuleType:
    """Import pygame without its greeting.

    Raises:
        ImportError: pygame is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError as error:
        raise ImportError("drawing needs pygame: pip install vibgym[render]") from error
    return pygame


@dataclass(frozen=True)
class Zone:
    """Goal zone of a kind of parts.

    Attributes:
        low, high: smallest and largest x, y, m.
        kind: number of the kind.
        label: text on the zone.

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
    """Content of a picture of one world; SI units, y up, origin in the lower left corner of the surface.

    Attributes:
        pose: (parts, 3) x, y (m) and heading (rad); not drawn unless finite.
        phasors: (rows, columns, 2) vertical oscillation (C, S) of each element as a fraction of full scale.
        goals: (parts, 3) x, y, heading or (parts, 2) x, y; not drawn unless finite; None for no goals.
        tolerance: radius of the circle around each goal, m; None for no circles.
        trails: past centres of each part, (k, 2) m, oldest first; empty for no trails.
        zones: drawn in the colours of their kinds.
        paths: line along which each part's goal moves, (k, 2) m; empty for goals that stay.
        caption: one line of text under the table.
        side: view from the side, under the picture; None: nothing.
    """

    pose: np.ndarray
    phasors: np.ndarray
    goals: np.ndarray | None = None
    tolerance: float | None = None
    trails: Sequence[np.ndarray] = ()
    zones: tuple[Zone, ...] = ()
    caption: str = ""
    paths: Sequence[np.ndarray] = ()
    side: Side | None = None


def _kinds(outlines: Sequence[np.ndarray]) -> list[int]:
    """Return kinds of parts by their outlines."""
    shapes: list[bytes] = []
    for outline in outlines:
        if outline.tobytes() not in shapes:
            shapes.append(outline.tobytes())
    return [shapes.index(outline.tobytes()) for outline in outlines]


def _colour_of(kind: int) -> tuple[int, int, int]:
    return PARTS[kind % len(PARTS)]


class SurfacePainter:
    """Painter of views of one surface with fixed parts. Needs no display.

    Copies and pickles draw the same pixels.

    Args:
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        pixels_per_metre: scale; by default the prototype's picture is 1000 pixels wide.
        kinds: number of each part's kind, 0 or more; by default parts with the same outline are of one kind.
        walls: borders with a wall, among "left", "right", "bottom" and "top".
        side: whether pictures include a view from the side.

    Raises:
        ImportError: pygame is not installed.
        ValueError: a wrong number of kinds, a kind that is not a whole number >= 0, or an unknown wall.
    """

    def __init__(
        self,
        rows: int,
        columns: int,
        element_size: float,
        outlines: Sequence[np.ndarray],
        pixels_per_metre: float | None = None,
        kinds: Sequence[int] | None = None,
        walls: Sequence[str] = (),
        side: bool = False,
    ) -> None:
        require_pygame()
        if pixels_per_metre is None:
            pixels_per_metre = max(4, min(64, DEFAULT_SIZE[0] // columns, DEFAULT_SIZE[1] // rows)) / element_size
        self._outlines = [np.ascontiguousarray(outline, dtype=np.float64) for outline in outlines]
        kinds = _kinds(self._outlines) if kinds is None else kinds
        kinds = [checks.count(f"kinds[{k}]", kind, least=0) for k, kind in enumerate(kinds)]
        if len(kinds) != len(self._outlines):
            raise checks.refuse("kinds", kinds, f"one for each of {len(self._outlines)} parts")
        self._colours = [_colour_of(kind) for kind in kinds]
        borders = [checks.choice(f"walls[{k}]", wall, WALLS) for k, wall in enumerate(walls)]
        self._side = side
        self._table = (rows, columns, element_size, pixels_per_metre, borders)

    @cached_property
    def _canvas(self) -> Canvas:
        from vibgym.rendering.canvas import Canvas

        return Canvas(*self._table)

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except the surfaces."""
        return {name: value for name, value in vars(self).items() if name != "_canvas"}

    @property
    def width(self) -> int:
        """Width in pixels."""
        return self._canvas.size[0]

    @property
    def height(self) -> int:
        """Height in pixels."""
        if not self._side:
            return self._canvas.size[1]
        return self._canvas.size[1] + HEIGHT

    def paint(self, view: View) -> np.ndarray:
        """Return the picture (height, width, 3) uint8 of ``view``; a new array every time.

        Raises:
            ValueError: there are trails, goals or paths, but not one for each part.
        """
        parts = len(self._outlines)
        for name, values in (("trails", view.trails), ("goals", view.goals), ("paths", view.paths)):
            count = 0 if values is None else len(values)
            if count not in (0, parts):
                raise checks.refuse(name, f"{count} {name}", f"none, or one for each of {parts} parts")
        canvas = self._canvas
        canvas.begin(np.asarray(view.phasors, dtype=np.float64))
        for zone in view.zones:
            canvas.zone(np.array(zone.low), np.array(zone.high), _colour_of(zone.kind), zone.label)
        for path, colour in zip(view.paths, self._colours, strict=False):
            canvas.path(np.asarray(path, dtype=np.float64).reshape(-1, 2), colour)
        if view.goals is not None:
            for goal, outline in zip(np.asarray(view.goals, dtype=np.float64), self._outlines, strict=False):
                canvas.goal(goal, outline, view.tolerance)
        for trail, colour in zip(view.trails, self._colours, strict=False):
            canvas.trail(np.asarray(trail, dtype=np.float64).reshape(-1, 2), colour)
        for pose, outline, colour in zip(view.pose, self._outlines, self._colours, strict=True):
            canvas.part(np.asarray(pose, dtype=np.float64), outline, colour)
        picture = canvas.finish(view.caption)
        return np.concatenate([picture, self._strip(view.side)]) if self._side else picture

    def _strip(self, side: Side | None) -> np.ndarray:
        """Return the view from the side."""
        from vibgym.rendering.canvas import MARGIN

        _, columns, size, scale, _ = self._table
        nothing = Side([np.full((3, 3), np.nan)] * len(self._outlines), np.zeros((0, 3)))
        return strip(side or nothing, self.width, MARGIN, columns * size, scale, list(self._colours))


@dataclass(frozen=True)
class Scenery:
    """Content that all pictures of a task share; can be pickled, and needs pygame only for painting.

    Attributes:
        rows, columns: elements along y and x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        kinds: number of each part's kind.
        walls: borders with a wall.
        zones: goal zones of the kinds.
        goal_size: 3 for goal poses, 2 for goal positions, 0 without goals.
        tolerance: m, from goals; None without goals.
        trail: number of past centres of each part that are shown.
        scored: whether each part has a goal; empty: all have one.
        side: whether pictures include a view from the side.
    """

    rows: int
    columns: int
    element_size: float
    outlines: tuple[np.ndarray, ...]
    kinds: tuple[int, ...]
    walls: tuple[str, ...] = ()
    zones: tuple[Zone, ...] = ()
    goal_size: int = 0
    tolerance: float | None = None
    trail: int = TRAIL_STEPS
    scored: tuple[bool, ...] = ()
    side: bool = False

    def painter(self, pixels_per_metre: float | None = None) -> SurfacePainter:
        """Return a painter for views of the task."""
        table = (self.rows, self.columns, self.element_size, self.outlines, pixels_per_metre)
        return SurfacePainter(*table, kinds=self.kinds, walls=self.walls, side=self.side)

    def _since_it_came(self, trail: np.ndarray) -> np.ndarray:
        """Return trails (k, parts, 2) since the last arrival of each part in its slot; nan before."""
        middle = 0.5 * self.element_size * np.array([self.columns, self.rows])
        outside = np.asarray((np.abs(trail - middle) > 2.0 * middle).any(axis=-1))
        before = np.asarray(np.maximum.accumulate(outside[::-1], axis=0))[::-1]
        return np.where(before[..., None], np.nan, trail)

    def view(
        self,
        pose: np.ndarray,
        present: np.ndarray,
        goal: np.ndarray,
        phasors: np.ndarray,
        trail: np.ndarray,
        caption: str,
        paths: Sequence[np.ndarray] = (),
        side: Side | None = None,
    ) -> View:
        """Return the view of a world.

        Args:
            pose, goal: (parts, 3) x, y (m), heading (rad).
            present: (parts,) bool; absent parts are not drawn.
            trail: (k, parts, 2) past centres, m, oldest first.
            phasors, caption, paths, side: see :class:`View`.
        """
        there = np.asarray(present, dtype=bool)[:, None]
        scored = there & np.array(self.scored)[:, None] if self.scored else there
        return View(
            pose=np.where(there, pose, np.nan),
            phasors=phasors,
            goals=np.where(scored, goal[:, : self.goal_size], np.nan) if self.goal_size else None,
            tolerance=self.tolerance,
            trails=list(np.moveaxis(np.where(there, self._since_it_came(trail[-self.trail :]), np.nan), 1, 0)),
            zones=self.zones,
            caption=caption,
            paths=[np.where(here, path, np.nan) for here, path in zip(there, paths, strict=False)],
            side=side,
        )
