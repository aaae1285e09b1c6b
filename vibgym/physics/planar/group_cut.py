"""Cut of the outlines of a group of parts by the element grid: area, centroid and second moments of every piece.

The integrals are those of :mod:`vibgym.physics.planar.contact_area`, with other loops: each edge visits all rows and columns of
elements that the edge of any part in the group reaches. Where a part's edge does not pass through a cell, its piece has no
height and adds exactly zero, so a part's result does not depend on the other lanes.

Lengths in this file are in elements, from the corner of a window of whole elements that contains the part.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import exact
from vibgym.kernels.vector import (
    LANES,
    WIDTH,
    absolute,
    broadcast_register,
    copysign,
    lane_maximum,
    lane_minimum,
    load_register,
    maximum,
    minimum,
    select,
    store,
)

CELL_FIELDS = 9
"""Fields of a cell: area, 2 x, y, 3 xx, 2 xy, yy of the strips to its left border, then the height moments 1, y, yy."""

CELL = CELL_FIELDS * WIDTH

MARGIN = 1e-9
"""Margin of the window over the part's radius, so that rounded corners stay inside."""

_SPREAD = math.sqrt(1.0 / 12.0)
_SMALLEST = 1e-30  # avoids 0/0 in the slopes of edges along the grid
_FAR = 1e9


def window(radius: float) -> int:
    """Return the elements along a side of the window of a part; ``radius`` in elements."""
    return int(2.0 * radius * (1.0 + MARGIN)) + 2


@exact(inline=True)
def add_strip(cells, at, x0, y0, x1, y1, sign):
    """Add the strip to the left of a piece of an edge, in the coordinates of its cell.

    Integrals are exact: along a straight piece the mean of a product is the product of the means plus a twelfth of that of the
    differences, and so on.
    """
    height = sign * (y1 - y0)
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    dx, dy = _SPREAD * (x1 - x0), _SPREAD * (y1 - y0)
    xx, xy, across = dx * dx, dx * dy, dy * dy
    mean_xx, mean_xy, mean_yy = x * x + xx, x * y + xy, y * y + across
    store(cells, at, load_register(cells, at) + height * x)
    store(cells, at + WIDTH, load_register(cells, at + WIDTH) + height * mean_xx)
    store(cells, at + 2 * WIDTH, load_register(cells, at + 2 * WIDTH) + height * mean_xy)
    store(cells, at + 3 * WIDTH, load_register(cells, at + 3 * WIDTH) + height * (x * (mean_xx + 2.0 * xx)))
    store(cells, at + 4 * WIDTH, load_register(cells, at + 4 * WIDTH) + height * (y * mean_xx + 2.0 * x * xy))
    store(cells, at + 5 * WIDTH, load_register(cells, at + 5 * WIDTH) + height * (x * mean_yy + 2.0 * y * xy))
    store(cells, at + 6 * WIDTH, load_register(cells, at + 6 * WIDTH) + height)
    store(cells, at + 7 * WIDTH, load_register(cells, at + 7 * WIDTH) + height * y)
    store(cells, at + 8 * WIDTH, load_register(cells, at + 8 * WIDTH) + height * mean_yy)


@exact(inline=True)
def _guarded(d):
    return copysign(maximum(absolute(d), _SMALLEST), d)


@exact(inline=True)
def _within(value, low, high):
    return minimum(maximum(value, low), high)


@exact
def add_edge(ax, ay, bx, by, cutting, across, cells, crossings):
    """Add an edge of every outline from ``a`` to ``b`` to the cells that it passes through.

    Args:
        ax, ay, bx, by: ends of the edges, in the window.
        cutting: mask of the lanes to cut; edges of others must have no length.
        across: cells along a side of the window.
        cells: flat (cell, field, register).
        crossings: flat (column, register), a working array.

    Returns:
        First and last row, first and last column that any edge reaches.
    """
    dx, dy = bx - ax, by - ay
    slope, steepness = dx / _guarded(dy), dy / _guarded(dx)
    left, right, bottom, top = minimum(ax, bx), maximum(ax, bx), minimum(ay, by), maximum(ay, by)
    forward = dx >= 0.0
    # From left to right.
    sign, begin, end = select(forward, 1.0, -1.0), select(forward, ay, by), select(forward, by, ay)
    first_row, last_row = int(lane_minimum(select(cutting, bottom, _FAR))), int(lane_maximum(top))
    first_column, last_column = int(lane_minimum(select(cutting, left, _FAR))), int(lane_maximum(right))
    # Crossings of the edge with the line to the right of each column; cells above and beside each other share them, since
    # nearly vertical edges would leak otherwise. Ends are exact.
    for column in range(first_column, last_column + 1):
        line = broadcast_register(float(column + 1))
        at = select(line >= right, end, ay + (line - ax) * steepness)
        store(crossings, column * WIDTH, select(line <= left, begin, at))
    low = bottom
    x_low = _within(ax + (low - ay) * slope, left, right)
    for row in range(first_row, last_row + 1):
        high = _within(broadcast_register(float(row + 1)), bottom, top)
        x_high = _within(ax + (high - ay) * slope, left, right)
        x_left, x_right = minimum(x_low, x_high), maximum(x_low, x_high)
        floor, ceiling = low - float(row), high - float(row)
        x0, y0 = x_left, _within(begin - float(row), floor, ceiling)
        for column in range(first_column, last_column + 1):
            y1 = _within(load_register(crossings, column * WIDTH) - float(row), floor, ceiling)
            x1 = _within(broadcast_register(float(column + 1)), x_left, x_right)
            at = (row * across + column) * CELL
            add_strip(cells, at, x0 - float(column), y0, x1 - float(column), y1, sign)
            x0, y0 = x1, y1
        low, x_low = high, x_high
    return first_row, last_row, first_column, last_column


@exact
def cut_outlines(outline, first, corners, x, y, cosine, sine, cutting, across, cells, crossings):
    """Add the moments of all cells that the outlines of a group touch.

    Args:
        outline: flat (corner, 2, lane) m, about the centres of mass; outlines with fewer corners repeat their last one.
        first: first lane.
        corners: number of corners of the outline with the most.
        x, y: centres of mass in the window, in elements; zero in lanes that are not cut.
        cosine, sine: of the headings, over the size of an element (m^-1); zero in lanes that are not cut.
        cutting: mask of the lanes to cut.
        across: cells along a side of the window.
        cells: flat (across x across, field, register), zeros, added to.
        crossings: flat (across, register), a working array.

    Returns:
        First and last row, first and last column that any outline reaches.
    """
    ox, oy = (
        load_register(outline, first + 2 * (corners - 1) * LANES),
        load_register(outline, first + (2 * corners - 1) * LANES),
    )
    ax, ay = x + cosine * ox - sine * oy, y + sine * ox + cosine * oy
    box = across, -1, across, -1
    for k in range(corners):
        ox, oy = load_register(outline, first + 2 * k * LANES), load_register(outline, first + (2 * k + 1) * LANES)
        bx, by = x + cosine * ox - sine * oy, y + sine * ox + cosine * oy
        first_row, last_row, first_column, last_column = add_edge(ax, ay, bx, by, cutting, across, cells, crossings)
        box = (
            min(box[0], first_row), max(box[1], last_row), min(box[2], first_column), max(box[3], last_column),
        )  # fmt: skip
        ax, ay = bx, by
    return box
