"""Fast rasteriser behind ``observation="image"``: compiled, no pygame, the same pixels on every run."""

from __future__ import annotations

import math

import numpy as np

from vibgym.physics._jit import jit

GRID_EVEN, GRID_ODD, MARK = 64, 128, 255
"""Values of channel 2: elements with even and odd row + column, heading mark."""

MARK_HALF_WIDTH = 0.15
"""Half width of the heading mark over the part's radius."""

SNAP = 1024.0
"""Corners are rounded to 1 / SNAP pixel, so an edge through pixel centres stays one in spite of rounding errors."""


@jit
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


@jit
def _bounds(corners: np.ndarray, axis: int, size: int) -> tuple[int, int]:
    """First and one past the last pixel that the polygon can touch along ``axis``, within the image."""
    # Clamp before the conversion: a part may be arbitrarily far away.
    low = min(max(corners[:, axis].min(), 0.0), float(size))
    high = min(max(corners[:, axis].max(), 0.0), float(size))
    return math.floor(low), math.ceil(high)


@jit
def _fill(corners: np.ndarray, value: int, channel: int, image: np.ndarray) -> None:
    """Set ``channel`` of ``image`` (H, W, 3) to ``value`` inside the polygon, by the even-odd rule, where it was 0."""
    count = corners.shape[0]
    top, bottom = _bounds(corners, 1, image.shape[0])
    left, right = _bounds(corners, 0, image.shape[1])
    for row in range(top, bottom):
        y = row + 0.5
        for k in range(count):
            x0, y0 = corners[k - 1, 0], corners[k - 1, 1]
            x1, y1 = corners[k, 0], corners[k, 1]
            if (y0 <= y) != (y1 <= y):
                crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
                first = math.floor(min(max(crossing, float(left)), float(right)) - 0.5) + 1
                # Everything right of an edge changes sides; what all edges leave changed is inside.
                for column in range(first, right):
                    image[row, column, channel] ^= value


@jit
def _mark(pose: np.ndarray, corners: np.ndarray, radius: float, scale: float, image: np.ndarray) -> None:
    """Set channel 2 on the wedge of the part that shows its heading."""
    height, width = image.shape[0], image.shape[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    top, bottom = _bounds(corners, 1, height)
    left, right = _bounds(corners, 0, width)
    for row in range(top, bottom):
        y = (height - row - 0.5) / scale - pose[1]
        for column in range(left, right):
            if image[row, column, 0] != 0:
                x = (column + 0.5) / scale - pose[0]
                ahead, aside = cosine * x + sine * y, cosine * y - sine * x
                if ahead > 1e-6 * radius and abs(aside) < MARK_HALF_WIDTH * radius:
                    image[row, column, 2] = MARK


@jit
def rasterise(
    pose: np.ndarray,
    outline: np.ndarray,
    goal: np.ndarray,
    goal_value: np.ndarray,
    rows: int,
    columns: int,
    element_size: float,
    pixels_per_element: int,
    image: np.ndarray,
) -> None:
    """Draw one part and its goal for each world.

    Channel 0 is 255 inside the part, channel 1 is ``goal_value`` inside the part's outline at its goal, channel 2 is
    the grid of elements and the part's heading mark. A pixel is inside if its centre is. A pose that is not finite is
    not drawn.

    Args:
        pose: (worlds, 3) float64, x, y (m), heading (rad); y points up, the origin is the surface's lower left corner.
        outline: (n, 2) float64 corners of the part in its own frame, m; need not be convex.
        goal: (worlds, 3) float64, like ``pose``.
        goal_value: (worlds,) uint8, 0 for no goal.
        rows: elements along y.
        columns: elements along x.
        element_size: edge of an element, m.
        pixels_per_element: edge of an element in the image.
        image: (worlds, rows * pixels_per_element, columns * pixels_per_element, 3) uint8, overwritten; its row 0 has
            the largest y.
    """
    scale = pixels_per_element / element_size
    height, width = rows * pixels_per_element, columns * pixels_per_element
    corners = np.empty((outline.shape[0], 2))
    radius = 0.0
    for k in range(outline.shape[0]):
        radius = max(radius, math.hypot(outline[k, 0], outline[k, 1]))
    for world in range(pose.shape[0]):
        picture = image[world]
        for row in range(height):
            i = rows - 1 - row // pixels_per_element
            for column in range(width):
                picture[row, column, 0] = 0
                picture[row, column, 1] = 0
                even = (i + column // pixels_per_element) % 2 == 0
                picture[row, column, 2] = GRID_EVEN if even else GRID_ODD
        if goal_value[world] != 0 and _corners(goal[world], outline, scale, height, corners):
            _fill(corners, goal_value[world], 1, picture)
        if _corners(pose[world], outline, scale, height, corners):
            _fill(corners, 255, 0, picture)
            _mark(pose[world], corners, radius, scale, picture)
