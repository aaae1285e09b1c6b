"""Compiled rasteriser of ``observation="image"``: no pygame, the same pixels on every run."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit

GRID_EVEN, GRID_ODD, MARK = 64, 128, 255
"""Values of channel 2: elements with even and odd row + column, heading mark."""

MARK_HALF_WIDTH = 0.15
"""Half width of the heading mark over the part's radius."""

SNAP = 1024.0
"""Corners are rounded to 1 / SNAP pixel, so an edge through pixel centres stays one in spite of rounding errors."""


@jit(allocates=True)
def _corners(pose: np.ndarray, outline: np.ndarray, scale: float, height: int, corners: np.ndarray) -> bool:
    """Write the outline at ``pose`` (3,), in pixels from the top left, into ``corners`` (n, 2); False if not finite."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    for k in range(outline.shape[0]):
        x = pose[0] + cosine * outline[k, 0] - sine * outline[k, 1]
        y = pose[1] + sine * outline[k, 0] + cosine * outline[k, 1]
        corners[k, 0] = np.rint(x * scale * SNAP) / SNAP
        corners[k, 1] = height - np.rint(y * scale * SNAP) / SNAP
        if not (abs(corners[k, 0]) < math.inf and abs(corners[k, 1]) < math.inf):
            return False
    return True


@jit(allocates=True)
def _bounds(corners: np.ndarray, axis: int, size: int) -> tuple[int, int]:
    """Return first and one past the last pixel that the polygon can touch along ``axis``, within the image."""
    # Clamp before the conversion: a part may be arbitrarily far away.
    low = min(max(corners[:, axis].min(), 0.0), float(size))
    high = min(max(corners[:, axis].max(), 0.0), float(size))
    return math.floor(low), math.ceil(high)


@jit(allocates=True)
def _background(
    rows: int,
    columns: int,
    scale: float,
    pixels_per_element: int,
    zone: np.ndarray,
    zone_value: np.ndarray,
    inside: np.ndarray,
) -> np.ndarray:
    """Return the static background, (H, W, 3) uint8: zones in channel 1 and the grid in channel 2."""
    background = np.zeros((rows * pixels_per_element, columns * pixels_per_element, 3), dtype=np.uint8)
    for row in range(background.shape[0]):
        i = rows - 1 - row // pixels_per_element
        for j in range(columns):
            shade = GRID_EVEN if (i + j) % 2 == 0 else GRID_ODD
            for column in range(j * pixels_per_element, (j + 1) * pixels_per_element):
                background[row, column, 2] = shade
    # Zones are filled as polygons, like parts: zones that share a border share no pixel.
    here, outline, corners = np.zeros(3), np.empty((4, 2)), np.empty((4, 2))
    for k in range(zone.shape[0]):
        for corner in range(4):
            outline[corner, 0] = zone[k, 0] if corner == 0 or corner == 3 else zone[k, 2]
            outline[corner, 1] = zone[k, 1] if corner < 2 else zone[k, 3]
        if _corners(here, outline, scale, background.shape[0], corners):
            _fill(corners, zone_value[k], 1, inside, background)
    return background


@jit(allocates=True)
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    """Overwrite ``target`` with ``source``, both contiguous; many times faster than slices or three indices."""
    flat_source, flat_target = source.reshape(-1), target.reshape(-1)
    for k in range(flat_source.shape[0]):
        flat_target[k] = flat_source[k]


@jit(allocates=True)
def _scan(corners: np.ndarray, row: int, left: int, right: int, inside: np.ndarray) -> None:
    """Write into ``inside`` whether the centres of pixels ``left`` to ``right`` of ``row`` are in the polygon (even-odd).

    The scratch row holds one polygon at a time, so that overlapping polygons leave no holes.
    """
    inside[left:right] = False
    y = row + 0.5
    for k in range(corners.shape[0]):
        x0, y0 = corners[k - 1, 0], corners[k - 1, 1]
        x1, y1 = corners[k, 0], corners[k, 1]
        if (y0 <= y) != (y1 <= y):
            crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
            first = math.floor(min(max(crossing, float(left)), float(right)) - 0.5) + 1
            # Even-odd rule: pixels right of an edge are toggled.
            for column in range(first, right):
                inside[column] = not inside[column]


@jit(allocates=True)
def _fill(corners: np.ndarray, value: int, channel: int, inside: np.ndarray, image: np.ndarray) -> None:
    """Set ``channel`` of ``image`` (H, W, 3) to ``value`` inside the polygon."""
    top, bottom = _bounds(corners, 1, image.shape[0])
    left, right = _bounds(corners, 0, image.shape[1])
    for row in range(top, bottom):
        _scan(corners, row, left, right, inside)
        for column in range(left, right):
            if inside[column]:
                image[row, column, channel] = value


@jit(allocates=True)
def _mark(
    pose: np.ndarray,
    corners: np.ndarray,
    outline: np.ndarray,
    scale: float,
    background: np.ndarray,
    inside: np.ndarray,
    image: np.ndarray,
) -> None:
    """Set channel 2 inside the part: the wedge that shows its heading, and the grid around it.

    A part that overlaps another one therefore covers the other's wedge too.
    """
    height, width = image.shape[0], image.shape[1]
    radius = 0.0
    for k in range(outline.shape[0]):
        radius = max(radius, math.hypot(outline[k, 0], outline[k, 1]))
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    top, bottom = _bounds(corners, 1, height)
    left, right = _bounds(corners, 0, width)
    for row in range(top, bottom):
        _scan(corners, row, left, right, inside)
        y = (height - row - 0.5) / scale - pose[1]
        for column in range(left, right):
            if inside[column]:
                x = (column + 0.5) / scale - pose[0]
                ahead, aside = cosine * x + sine * y, cosine * y - sine * x
                wedge = ahead > 1e-6 * radius and abs(aside) < MARK_HALF_WIDTH * radius
                image[row, column, 2] = MARK if wedge else background[row, column, 2]


class Marks(NamedTuple):
    """Outlines and zones of all worlds, and their pixel values."""

    outline: np.ndarray  # (total, 2) corners of all parts, one part after the other, each in its own frame, m
    first: np.ndarray  # (kinds + 1,) int64; kind k has the corners from first[k] to before first[k + 1]
    kind: np.ndarray  # (worlds, parts) int64, or one row for all worlds
    value: np.ndarray  # (parts,) uint8
    zone: np.ndarray  # (zones, 4) smallest x and y, largest x and y, m
    zone_value: np.ndarray  # (zones,) uint8


@jit(allocates=True)
def rasterise(
    pose: np.ndarray,
    present: np.ndarray,
    goal: np.ndarray,
    goal_value: np.ndarray,
    marks: Marks,
    rows: int,
    columns: int,
    element_size: float,
    pixels_per_element: int,
    image: np.ndarray,
) -> None:
    """Draw the parts of each world, and their goals or goal zones.

    Channel 0 is the part's value inside a part, channel 1 is ``goal_value`` inside a part's outline at its goal and the zone's
    value inside a zone, channel 2 is the grid of elements and the parts' heading marks. Where parts or zones overlap, the
    later one is drawn. A pixel is inside if its centre is. A pose that is not finite is not drawn.

    Args:
        pose: (worlds, parts, 3) x, y (m), heading (rad); y points up, the origin is the surface's lower left corner.
        present: (worlds, parts) bool; absent parts are not drawn, nor their goals.
        goal: (worlds, parts, 3), like ``pose``.
        goal_value: (worlds, parts) uint8, 0 for no goal.
        marks: what all worlds share.
        rows, columns: elements along y and x.
        element_size: edge of an element, m.
        pixels_per_element: edge of an element in the image.
        image: (worlds, rows * pixels_per_element, columns * pixels_per_element, 3) uint8, contiguous, overwritten;
            its row 0 has the largest y.
    """
    outline, first = marks.outline, marks.first
    scale, height = pixels_per_element / element_size, rows * pixels_per_element
    corners, inside = np.empty_like(outline), np.empty(columns * pixels_per_element, dtype=np.bool_)
    background = _background(rows, columns, scale, pixels_per_element, marks.zone, marks.zone_value, inside)
    for world in range(pose.shape[0]):
        picture = image[world]
        _copy(background, picture)
        for part in range(pose.shape[1]):
            kind = marks.kind[min(world, marks.kind.shape[0] - 1), part]
            own = outline[first[kind] : first[kind + 1]]
            placed, shown = corners[: own.shape[0]], goal_value[world, part]
            if shown != 0 and present[world, part] and _corners(goal[world, part], own, scale, height, placed):
                _fill(placed, shown, 1, inside, picture)
        for part in range(pose.shape[1]):
            kind = marks.kind[min(world, marks.kind.shape[0] - 1), part]
            here, own = pose[world, part], outline[first[kind] : first[kind + 1]]
            placed = corners[: own.shape[0]]
            if present[world, part] and _corners(here, own, scale, height, placed):
                _fill(placed, marks.value[part], 0, inside, picture)
                _mark(here, placed, own, scale, background, inside, picture)
