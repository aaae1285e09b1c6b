"""Picture of one world: elements, parts, goal and trail, to scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibgym.rendering import colours as palette
from vibgym.rendering._pygame import require_pygame

DEFAULT_SIZE = (960, 640)
"""The table is drawn as large as fits into this (width, height) in pixels, elements being 4 to 64 whole pixels."""


@dataclass(frozen=True)
class View:
    """All that a picture needs: one world, SI units, y up, origin in the lower left corner of the surface.

    Attributes:
        pose: (parts, 3) x, y (m) and heading (rad) of each part; one that is not finite is not drawn.
        phasors: (rows, columns, 2) vertical oscillation (C, S) of each element as a fraction of full scale.
        goal_pose: (3,) x, y, heading or (2,) x, y of part 0's goal; None for no goal.
        goal_tolerance: radius of the circle around the goal, m; None for no circle.
        trail: (k, 2) past centres of part 0, m, oldest first.
        caption: one line of text under the table.
    """

    pose: np.ndarray
    phasors: np.ndarray
    goal_pose: np.ndarray | None
    goal_tolerance: float | None
    trail: np.ndarray
    caption: str = ""


def _kinds(outlines: Sequence[np.ndarray]) -> list[int]:
    """Number of each part's kind: parts with the same outline are of one kind."""
    shapes: list[bytes] = []
    for outline in outlines:
        if outline.tobytes() not in shapes:
            shapes.append(outline.tobytes())
    return [shapes.index(outline.tobytes()) for outline in outlines]


class SurfacePainter:
    """Draws views of one surface with fixed parts. Needs no display.

    Args:
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        outlines: (n, 2) corners of each part in its own frame, m.
        pixels_per_metre: scale; by default the prototype's picture is 1000 pixels wide.
        colours: fill (r, g, b) of each part; by default one for each different outline.

    Attributes:
        width, height: of the picture in pixels.

    Raises:
        ImportError: pygame is not installed.
    """

    def __init__(
        self,
        rows: int,
        columns: int,
        element_size: float,
        outlines: Sequence[np.ndarray],
        pixels_per_metre: float | None = None,
        colours: Sequence[tuple[int, int, int]] | None = None,
    ) -> None:
        require_pygame()
        from vibgym.rendering.canvas import Canvas

        if pixels_per_metre is None:
            pixels_per_metre = max(4, min(64, DEFAULT_SIZE[0] // columns, DEFAULT_SIZE[1] // rows)) / element_size
        self._outlines = [np.ascontiguousarray(outline, dtype=np.float64) for outline in outlines]
        if colours is None:
            colours = [palette.PARTS[kind % len(palette.PARTS)] for kind in _kinds(self._outlines)]
        self._colours = [tuple(colour) for colour in colours]
        self._canvas = Canvas(rows, columns, element_size, pixels_per_metre)
        self.width, self.height = self._canvas.size

    def paint(self, view: View) -> np.ndarray:
        """Picture (height, width, 3) uint8 of ``view``; a new array every time."""
        canvas = self._canvas
        canvas.begin(np.asarray(view.phasors, dtype=np.float64))
        if view.goal_pose is not None:
            canvas.goal(np.asarray(view.goal_pose, dtype=np.float64), self._outlines[0], view.goal_tolerance)
        canvas.trail(np.asarray(view.trail, dtype=np.float64).reshape(-1, 2))
        for pose, outline, colour in zip(view.pose, self._outlines, self._colours, strict=True):
            canvas.part(np.asarray(pose, dtype=np.float64), outline, colour)
        return canvas.finish(view.caption)
