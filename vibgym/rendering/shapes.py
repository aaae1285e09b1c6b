"""Drawing primitives on a pygame surface, in its pixels. Needs pygame."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pygame

Colour = tuple[int, ...]


def wedge(outline: np.ndarray) -> np.ndarray:
    """Return the heading mark (3, 2) of a part with ``outline``, in its frame."""
    reach, half = outline[:, 0].max(), 0.2 * np.abs(outline).max()
    return np.array([[0.84 * reach, 0.0], [0.2 * reach, half], [0.2 * reach, -half]])


def bar(
    wall: str, walls: Sequence[str], low: np.ndarray, high: np.ndarray, thickness: float, frame: float
) -> list[float]:
    """Return left, top, width and height of a wall outside the rectangle from ``low`` to ``high`` (2,).

    It extends past the rectangle's corners to the ``frame``, or to the adjacent one of ``walls``.
    """
    left, right, top, bottom = (thickness if side in walls else frame for side in ("left", "right", "top", "bottom"))
    if wall in ("left", "right"):
        start = low[0] - thickness if wall == "left" else high[0]
        return [start, low[1] - top, thickness, high[1] - low[1] + top + bottom]
    start = low[1] - thickness if wall == "top" else high[1]
    return [low[0] - left, start, high[0] - low[0] + left + right, thickness]


def arrow_outlines(tails: np.ndarray, vectors: np.ndarray, thickness: float) -> np.ndarray:
    """Return outlines (n, 7, 2) of arrows from ``tails`` (n, 2) along ``vectors`` (n, 2), shaft ``thickness`` wide at most.

    Short arrows are thinner too, so that they keep their shape.
    """
    length = np.hypot(vectors[:, 0], vectors[:, 1])
    along = vectors / length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    shaft = 0.5 * np.minimum(thickness, 0.22 * length)
    head_width, head = 2.7 * shaft, np.minimum(4.2 * shaft, 0.7 * length)
    neck = length - head
    profile = [(0.0, shaft), (neck, shaft), (neck, head_width), (length, 0.0)]
    profile += [(neck, -head_width), (neck, -shaft), (0.0, -shaft)]
    corners = [along * np.reshape(x, (-1, 1)) + across * np.reshape(y, (-1, 1)) for x, y in profile]
    return tails[:, None, :] + np.stack(corners, axis=1)


def stroke(surface: pygame.Surface, points: np.ndarray, width: float, colour: Colour, closed: bool = False) -> None:
    """Draw a line of any ``width`` with round joints and ends through ``points`` (n, 2)."""
    points = np.vstack([points, points[:1]]) if closed else points
    segments(surface, points, width, [colour] * (len(points) - 1))


def segments(surface: pygame.Surface, points: np.ndarray, width: float, colours: Sequence[Colour]) -> None:
    """Draw the straight lines between ``points`` (n, 2) with round ends, each in its colour, later ones on top.

    pygame cuts the ends of its wide lines along the axes, so that they are drawn as polygons.
    """
    step = np.diff(points, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])[:, None]
    side = np.stack([-step[:, 1], step[:, 0]], axis=1) * (0.5 * width / np.where(length > 0.0, length, np.inf))
    corners = np.stack([points[:-1] + side, points[1:] + side, points[1:] - side, points[:-1] - side], axis=1)
    ends = points.tolist()
    for k, (quad, colour) in enumerate(zip(corners.tolist(), colours, strict=True)):
        if length[k] > 0.0:
            pygame.draw.polygon(surface, colour, quad)
        pygame.draw.circle(surface, colour, ends[k], 0.5 * width)
        pygame.draw.circle(surface, colour, ends[k + 1], 0.5 * width)


def dashes(points: np.ndarray, length: float) -> list[np.ndarray]:
    """Cut the closed line through ``points`` (n, 2) into dashes of about ``length`` with equal gaps, each (k, 2)."""
    loop = np.vstack([points, points[:1]])
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(loop, axis=0).T))])
    count = max(4, round(distance[-1] / (2.0 * length)))
    pieces = []
    for start in np.arange(count) * (distance[-1] / count):
        end = start + 0.5 * distance[-1] / count
        inner = distance[(distance > start) & (distance < end)]
        at = np.concatenate([[start], inner, [end]])
        pieces.append(np.stack([np.interp(at, distance, loop[:, k]) for k in (0, 1)], axis=1))
    return pieces


def circle_points(centre: np.ndarray, radius: float) -> np.ndarray:
    """Return points (96, 2) of a circle."""
    angle = np.arange(96) * (2.0 * np.pi / 96)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def polygon_within(surface: pygame.Surface, points: np.ndarray, window: np.ndarray, colour: Colour) -> None:
    """Fill the part of a polygon (n, 2) that lies inside another, ``window`` (m, 2)."""
    inner = pygame.Surface(surface.get_size(), pygame.SRCALPHA, 32)
    pygame.draw.polygon(inner, colour, points)
    mask = pygame.Surface(surface.get_size(), pygame.SRCALPHA, 32)
    pygame.draw.polygon(mask, (255, 255, 255, 255), window)
    inner.blit(mask, (0, 0), special_flags=pygame.BLEND_RGBA_MULT)
    surface.blit(inner, (0, 0))


def painted(
    size: tuple[int, int],
    points: np.ndarray,
    padding: float,
    draw: Callable[[pygame.Surface, np.ndarray], None],
) -> tuple[pygame.Surface, list[int]] | None:
    """Return a layer around ``points`` (n, 2) with the transparent colours of ``draw``, and its rectangle in the picture.

    ``draw`` gets the layer and its origin in the picture of this ``size``. None where the layer would miss the picture.
    """
    low = np.maximum(np.floor(points.min(axis=0) - padding), 0.0)
    high = np.minimum(np.ceil(points.max(axis=0) + padding), size)
    if not (low < high).all():
        return None
    layer = pygame.Surface((high - low).astype(int).tolist(), pygame.SRCALPHA, 32)
    draw(layer, low)
    return layer, low.astype(int).tolist()
