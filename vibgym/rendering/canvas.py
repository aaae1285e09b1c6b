"""The layers of the picture, bottom to top. Needs pygame."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache

import numpy as np
import pygame

from vibgym.rendering import colours, legend, shapes

MARGIN = 20
"""White border in pixels."""

FINE = 3
"""The table is drawn this many times larger and scaled down, which smooths edges."""

ARROW_LENGTH = 0.46
"""Length of an arrow at full amplitude over the element's edge."""

ARROW_FROM = 0.03
"""Elements with less amplitude have no arrow."""

WALL = 11
"""Thickness of a wall in pixels, limited by the margin."""

TAG, SMALLEST_TAG = 18, 10
"""Size of a zone's label, and the smallest to which it is scaled down to fit."""

CAPTION, SMALL_CAPTION = 22, 14
"""Size of the caption, and in pictures that are too narrow for it."""

TRAIL_POINTS = 400
"""Older centres are not drawn."""

KEPT = 32
"""Cached layers of goals and zones."""

TRAIL_PIXELS = 1.5
"""Length of a trail's pieces, in pixels, at least."""


@lru_cache(maxsize=32)
def _tag(label: str, room: float, colour: tuple[int, ...]) -> pygame.Surface | None:
    """Render ``label`` at most ``room`` wide, in fine pixels; None where it would be too small to read."""
    text = legend.render_text(label, TAG * FINE, colour)
    if text.get_width() <= room:
        return text
    size = math.floor(TAG * room / text.get_width())
    return legend.render_text(label, size * FINE, colour) if size >= SMALLEST_TAG else None


class Canvas:
    """Picture of a surface: call :meth:`begin`, draw layers in any number, then call :meth:`finish`.

    Args:
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        pixels_per_metre: scale.
        walls: borders with a wall.
    """

    def __init__(
        self, rows: int, columns: int, element_size: float, pixels_per_metre: float, walls: Sequence[str] = ()
    ) -> None:
        self._shape = (rows, columns)
        self._scale = FINE * pixels_per_metre
        table = np.array([columns, rows]) * element_size * pixels_per_metre
        width, table_bottom = (math.ceil(edge) + 2 * MARGIN for edge in table)
        # Video encoders require even sizes.
        self.size = (width + width % 2, table_bottom + legend.HEIGHT + (table_bottom + legend.HEIGHT) % 2)
        self._origin = FINE * np.array([MARGIN, MARGIN + table[1]])
        self._edge = element_size * self._scale
        self._centres = self._to_pixels(
            (np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) + 0.5) * element_size
        )
        self._fine = pygame.Surface((FINE * self.size[0], FINE * table_bottom), 0, 32)
        self._kept: dict[Hashable, tuple[pygame.Surface, list[int]] | None] = {}
        self._empty = self._fine.copy()
        self._empty.fill(colours.PAPER)
        low, size = FINE * np.array([MARGIN, MARGIN]), FINE * table
        for grow, colour in ((12, colours.FRAME), (3, colours.GAP)):
            rectangle = [*(low - grow), *(size + 2 * grow)]
            pygame.draw.rect(self._empty, colour, rectangle, border_radius=2 * grow)
        for wall in walls:
            pygame.draw.rect(self._empty, colours.INK, shapes.bar(wall, walls, low, low + size, FINE * WALL, 12))
        # Most elements rest in most pictures.
        self._tiles(self._empty, np.zeros((rows, columns, 2)), np.ones((rows, columns), dtype=bool))
        self._base = pygame.Surface(self.size, 0, 32)
        # Scaling darkens white a little; the band under the table has to match.
        self._base.fill(pygame.transform.smoothscale(self._empty, (self.size[0], table_bottom)).get_at((1, 1)))
        self._caption_top = table_bottom - 8
        self._caption_width = legend.draw(self._base, table_bottom - 8, MARGIN, pixels_per_metre)

    def _tiles(self, picture: pygame.Surface, phasors: np.ndarray, which: np.ndarray) -> None:
        """Draw the elements ``which`` (rows, columns) bool in the colours of their phasors (rows, columns, 2)."""
        corners = np.rint(self._centres[which] - 0.5 * self._edge + 0.5 * FINE).astype(int).tolist()
        size, radius = round(self._edge - FINE), min(3 * FINE, round(0.1 * self._edge))
        for corner, tint in zip(corners, colours.element_colours(phasors[which]).tolist(), strict=True):
            pygame.draw.rect(picture, tint, (*corner, size, size), border_radius=radius)

    def _to_pixels(self, points: np.ndarray) -> np.ndarray:
        return self._origin + points * (self._scale, -self._scale)

    def _placed(self, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return points in the body frame at ``pose``, in fine pixels."""
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        return self._to_pixels(pose[:2] + points @ np.array([[cosine, sine], [-sine, cosine]]))

    def _blend(
        self,
        points: np.ndarray,
        padding: float,
        draw: Callable[[pygame.Surface, np.ndarray], None],
        key: Hashable = None,
    ) -> None:
        """Blend what ``draw`` paints around ``points`` over the picture, see :func:`shapes.painted`.

        Args:
            key: cache key of layers that do not change between pictures; None: not cached.
        """
        layer = self._kept.get(key) if key is not None else None
        if layer is None:
            layer = shapes.painted(self._fine.get_size(), points, padding, draw)
            if key is not None:
                if len(self._kept) >= KEPT:
                    self._kept.clear()
                self._kept[key] = layer
        if layer is not None:
            self._fine.blit(*layer)

    def begin(self, phasors: np.ndarray) -> None:
        """Start over with the elements at ``phasors`` (rows, columns, 2), fractions of full scale."""
        self._fine.blit(self._empty, (0, 0))
        phasors = np.nan_to_num(phasors).reshape(*self._shape, 2)
        edge = self._edge
        self._tiles(self._fine, phasors, np.hypot(phasors[..., 0], phasors[..., 1]) > 0.0)
        strength = np.hypot(phasors[..., 0], phasors[..., 1])
        moving = strength >= ARROW_FROM
        if moving.any():
            # Push is (-S, -C) with y up; pixels have y down.
            push = np.stack([-phasors[moving, 1], phasors[moving, 0]], axis=1)
            push *= ARROW_LENGTH * edge / np.maximum(1.0, strength[moving])[:, None]
            arrows = shapes.arrow_outlines(self._centres[moving], push, 0.085 * edge)
            shades = colours.arrow_colours(phasors[moving]).tolist()
            for arrow, shade in zip(arrows.tolist(), shades, strict=True):
                pygame.draw.polygon(self._fine, shade, arrow)

    def zone(self, low: np.ndarray, high: np.ndarray, colour: tuple[int, ...], label: str) -> None:
        """Draw a rectangle from ``low`` to ``high`` (2,), m: a tint, a dashed border and a tag with ``label``."""
        corners = self._to_pixels(np.array([[low[0], high[1]], high, [high[0], low[1]], low]))
        corners = corners.clip(0.0, self._fine.get_size())
        # Within the rectangle, so that zones side by side do not hide each other's borders.
        inset = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * 2.2 * FINE
        pieces = shapes.dashes(corners + inset, 6.0 * FINE)
        light = colours.is_light(colour)
        contrast = colours.INK if light else colours.PAPER

        def draw(layer: pygame.Surface, origin: np.ndarray) -> None:
            pygame.draw.polygon(layer, (*colour, 120 if light else 66), corners - origin)
            for width, shade in ((3.8 * FINE, contrast), (2.2 * FINE, colour)):
                for piece in pieces:
                    shapes.stroke(layer, piece - origin, width, (*shade, 255))

        self._blend(corners, 0.0, draw, ("zone", low.tobytes(), high.tobytes(), colour))
        if label:
            self.tag(low, high, colour, label)

    def tag(self, low: np.ndarray, high: np.ndarray, colour: tuple[int, ...], label: str) -> None:
        """Draw ``label`` in the upper left corner of a rectangle from ``low`` to ``high`` (2,), m, if it fits."""
        corner, right = self._to_pixels(np.array([[low[0], high[1]], high])).clip(0.0, self._fine.get_size())
        text = _tag(label, 0.8 * (right[0] - corner[0]), colours.INK if colours.is_light(colour) else colours.PAPER)
        if text is None:
            return
        place = pygame.Rect(np.floor(corner), text.get_size()).inflate(14 * FINE, 7 * FINE)
        place.topleft = np.floor(corner).astype(int).tolist()
        pygame.draw.rect(self._fine, colour, place, border_bottom_right_radius=5 * FINE)
        self._fine.blit(text, text.get_rect(center=place.center))

    def path(self, points: np.ndarray, colour: tuple[int, ...]) -> None:
        """Draw a faint line through ``points`` (k, 2), m, along which a goal moves."""
        points = self._to_pixels(points)
        points = points[((points >= 0.0) & (points <= self._fine.get_size())).all(axis=1)]
        if len(points) < 2:
            return

        def draw(layer: pygame.Surface, low: np.ndarray) -> None:
            for width, shade in ((4.0 * FINE, (*colours.PAPER, 150)), (1.6 * FINE, (*colour, 170))):
                shapes.stroke(layer, points - low, width, shade)

        self._blend(points, 3.0 * FINE, draw, ("path", points.tobytes(), colour))

    def goal(self, pose: np.ndarray, outline: np.ndarray, tolerance: float | None) -> None:
        """Draw a ghost of ``outline`` at ``pose`` (3,) or a crosshair at ``pose`` (2,), and the circle of ``tolerance``, m."""
        if not np.isfinite(pose).all():
            return
        centre = self._to_pixels(pose[:2])
        lines: list[np.ndarray] = []
        around = centre[None]
        if len(pose) == 3:
            ghost = around = self._placed(pose, outline)
            wedge = self._placed(pose, shapes.wedge(outline))
            lines += shapes.dashes(ghost, 4.5 * FINE)
        else:
            arm, clear = 12.0 * FINE, 4.0 * FINE
            for way in np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]):
                lines.append(centre + np.outer([clear, arm], way))
        radius = 0.0 if tolerance is None else tolerance * self._scale

        def draw(layer: pygame.Surface, low: np.ndarray) -> None:
            if len(pose) == 3:
                pygame.draw.polygon(layer, (*colours.PAPER, 160), ghost - low)
                shapes.polygon_within(layer, wedge - low, ghost - low, (*colours.INK, 150))
            for width, colour in ((4.5 * FINE, (*colours.PAPER, 220)), (1.9 * FINE, (*colours.INK, 255))):
                for line in lines:
                    shapes.stroke(layer, line - low, width, colour)
                if radius > 0.0:
                    ring = shapes.circle_points(centre, radius) - low
                    shapes.stroke(layer, ring, 0.7 * width, colour, closed=True)

        key = ("goal", pose.tobytes(), outline.tobytes(), tolerance)
        self._blend(np.vstack([around, centre]), max(radius, 12.0 * FINE) + 4.0 * FINE, draw, key)

    def trail(self, points: np.ndarray, colour: tuple[int, ...]) -> None:
        """Draw a line through ``points`` (k, 2), m, oldest first, fading with age; light colours get a dark edge."""
        points = self._to_pixels(points[-TRAIL_POINTS:])
        # Points far off the picture need no layer, and overflow pygame's integers.
        outside = np.flatnonzero(~((points >= 0.0) & (points <= self._fine.get_size())).all(axis=1))
        points = points[outside[-1] + 1 if len(outside) else 0 :]
        if len(points) < 2:
            return
        alpha = np.linspace(30.0, 240.0, len(points))[1:]
        # Segments shorter than a pixel or two are invisible and take half the time of a picture.
        along = np.hypot(*np.diff(points, axis=0).T).cumsum()
        kept = np.append(np.diff(along // (TRAIL_PIXELS * FINE)) > 0, True)
        points, alpha = points[np.append(True, kept)], alpha[kept]
        lines = [(2.4 * FINE, colour, 1.0)]
        if colours.is_light(colour):
            lines.insert(0, (4.4 * FINE, colours.INK, 0.7))

        def draw(layer: pygame.Surface, low: np.ndarray) -> None:
            for width, shade, share in lines:
                strengths = np.rint(share * alpha).astype(int).tolist()
                shapes.segments(layer, points - low, width, [(*shade, strength) for strength in strengths])

        self._blend(points, 3.0 * FINE, draw)

    def part(self, pose: np.ndarray, outline: np.ndarray, colour: tuple[int, ...], ahead: bool = True) -> None:
        """Draw a part with ``outline`` (n, 2) at ``pose`` (3,), and with ``ahead`` its heading mark, a wedge."""
        if not np.isfinite(pose).all():
            return
        body = self._placed(pose, outline)
        wedge = self._placed(pose, shapes.wedge(outline))
        mark = colours.INK if colours.is_light(colour) else colours.PAPER
        shade = [round(0.45 * channel) for channel in colour]

        def draw(layer: pygame.Surface, low: np.ndarray) -> None:
            pygame.draw.polygon(layer, (*colours.INK, 60), body - low + 2.0 * FINE)
            pygame.draw.polygon(layer, (*colour, 240), body - low)
            shapes.stroke(layer, body - low, 1.6 * FINE, (*shade, 215), closed=True)
            if ahead:
                shapes.polygon_within(layer, wedge - low, body - low, mark)

        self._blend(body, 4.0 * FINE, draw)

    def finish(self, caption: str) -> np.ndarray:
        """Return the picture (H, W, 3) uint8, with ``caption`` under the table."""
        picture = self._base.copy()
        small = (self.size[0], self._fine.get_height() // FINE)
        table = pygame.transform.smoothscale(self._fine, small)
        picture.blit(table, (0, 0), (0, 0, small[0], small[1] - 8))
        if caption:
            text = legend.render_text(caption, CAPTION, colours.INK)
            if text.get_width() > self._caption_width:
                text = legend.render_text(caption, SMALL_CAPTION, colours.INK)
            picture.blit(text, (MARGIN, self._caption_top + 15), (0, 0, self._caption_width, text.get_height()))
        pixels = bytearray(pygame.image.tobytes(picture, "RGB"))
        return np.frombuffer(pixels, dtype=np.uint8).reshape(self.size[1], self.size[0], 3)
