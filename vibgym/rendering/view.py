"""Picture of one world: elements, zones, goal, trails and parts, to scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from vibgym import checks
from vibgym.rendering import colours as palette
from vibgym.rendering._pygame import require_pygame

if TYPE_CHECKING:
    from vibgym.rendering.canvas import Canvas

DEFAULT_SIZE = (960, 640)
"""The table is drawn as large as fits into this (width, height) in pixels, elements being 4 to 64 whole pixels."""

TRAIL_STEPS = 250
"""Older places are left out of trails."""

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
class Side:
    """What is to be seen of a world from the side.

    Attributes:
        bottoms: of each part, (n, 3) m, the corners of its bottom; one that is not finite is not drawn.
        plates: (k, 3) m, from where to where along x plates reach that parts lie over, and how high they stand.
    """

    bottoms: Sequence[np.ndarray]
    plates: np.ndarray


@dataclass(frozen=True)
class View:
    """All that a picture needs: one world, SI units, y up, origin in the lower left corner of the surface.

    Attributes:
        pose: (parts, 3) x, y (m) and heading (rad) of each part; one that is not finite is not drawn.
        phasors: (rows, columns, 2) vertical oscillation (C, S) of each element as a fraction of full scale.
        goals: (parts, 3) x, y, heading or (parts, 2) x, y of each part's goal, one that is not finite is not drawn; None for
            no goals.
        tolerance: radius of the circle around each goal, m; None for no circles.
        trails: one (k, 2) array of past centres for each part, m, oldest first, drawn in the part's colour; none for no trails.
        zones: drawn under everything that moves, in the colours of their kinds.
        paths: one (k, 2) array for each part, m: the line that its goal goes along; none for goals that stay.
        caption: one line of text under the table.
        side: what is drawn from the side, with heights magnified, under the picture; None: nothing.
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
    """Return the number of each part's kind: parts with the same outline are of one kind."""
    shapes: list[bytes] = []
    for outline in outlines:
        if outline.tobytes() not in shapes:
            shapes.append(outline.tobytes())
    return [shapes.index(outline.tobytes()) for outline in outlines]


def _colour_of(kind: int) -> tuple[int, int, int]:
    return palette.PARTS[kind % len(palette.PARTS)]


class SurfacePainter:
    """Draws views of one surface with fixed parts. Needs no display.

    Its surfaces are made with the first picture; copies, pickled or not, make their own and draw the same.

    Args:
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        pixels_per_metre: scale; by default the prototype's picture is 1000 pixels wide.
        colours: fill (r, g, b) of each part; by default that of its kind.
        kinds: number of each part's kind, 0 or more; by default parts with the same outline are of one kind.
        walls: borders at which a wall stands, among "left", "right", "bottom" and "top".
        side: whether pictures have room under them for a view from the side.

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
        side: bool = False,
    ) -> None:
        require_pygame()
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
        self._side = side
        self._table = (rows, columns, element_size, pixels_per_metre, borders)

    @cached_property
    def _canvas(self) -> Canvas:
        from vibgym.rendering.canvas import Canvas

        return Canvas(*self._table)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the surfaces."""
        return {name: value for name, value in vars(self).items() if name != "_canvas"}

    @property
    def width(self) -> int:
        """Of the picture, in pixels."""
        return self._canvas.size[0]

    @property
    def height(self) -> int:
        """Of the picture, in pixels."""
        if not self._side:
            return self._canvas.size[1]
        from vibgym.rendering.side import HEIGHT

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
            colour = self._kinds.get(zone.kind, _colour_of(zone.kind))
            canvas.zone(np.array(zone.low), np.array(zone.high), colour, zone.label)
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
        from vibgym.rendering.side import strip

        _, columns, size, scale, _ = self._table
        nothing = Side([np.full((3, 3), np.nan)] * len(self._outlines), np.zeros((0, 3)))
        return strip(side or nothing, self.width, MARGIN, columns * size, scale, list(self._colours))


@dataclass(frozen=True)
class Scenery:
    """What stays the same in all pictures of a task; can be pickled, and needs no pygame until something is painted.

    Attributes:
        rows, columns: elements along y and x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        kinds: number of each part's kind.
        walls: borders at which a wall stands.
        zones: where the kinds shall end; empty for tasks without.
        goal_size: numbers of a goal that count: 3 for poses, 2 for positions, 0 for tasks without.
        tolerance: m, from goals; None for tasks without.
        trail: past centres of each part that are shown.
        asked: of each part, whether it has a goal; empty: all of them.
        side: whether pictures have room for a view from the side.
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
    asked: tuple[bool, ...] = ()
    side: bool = False

    def painter(self, pixels_per_metre: float | None = None) -> SurfacePainter:
        """Return a painter for views of the task."""
        table = (self.rows, self.columns, self.element_size, self.outlines, pixels_per_metre)
        return SurfacePainter(*table, kinds=self.kinds, walls=self.walls, side=self.side)

    def _since_it_came(self, trail: np.ndarray) -> np.ndarray:
        """Return trails (k, parts, 2) from the latest arrival of each part in its slot on."""
        middle = 0.5 * self.element_size * np.array([self.columns, self.rows])
        beside = np.asarray((np.abs(trail - middle) > 2.0 * middle).any(axis=-1))
        before = np.asarray(np.maximum.accumulate(beside[::-1], axis=0))[::-1]
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
            pose, goal: (parts, 3) x, y (m), heading (rad); goals of tasks without are not looked at.
            present: (parts,) bool; absent parts are not drawn.
            phasors: (rows, columns, 2) fractions of full scale.
            trail: (k, parts, 2) centres of the steps up to now, m, oldest first, of which the last ones are drawn.
            caption: one line.
            paths: (n, 2) of each part, m: lines along which goals move; none where they stay.
            side: what is drawn from the side.
        """
        there = np.asarray(present, dtype=bool)[:, None]
        asked = there & np.array(self.asked)[:, None] if self.asked else there
        return View(
            pose=np.where(there, pose, np.nan),
            phasors=phasors,
            goals=np.where(asked, goal[:, : self.goal_size], np.nan) if self.goal_size else None,
            tolerance=self.tolerance,
            trails=list(np.moveaxis(np.where(there, self._since_it_came(trail[-self.trail :]), np.nan), 1, 0)),
            zones=self.zones,
            caption=caption,
            paths=[np.where(here, path, np.nan) for here, path in zip(there, paths, strict=False)],
            side=side,
        )
