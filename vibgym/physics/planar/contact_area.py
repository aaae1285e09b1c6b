"""Contact area of one part: the outline cut by the element grid, and contact points with weights and phasors.

Pressure is constant on a piece, which one element carries, so friction depends on area, centroid and second moments of the
pieces. These follow from Green's theorem along the outline: each boundary segment inside a cell adds to that cell, and all
cells to its left in the same row receive the full-width share of its height, which is propagated from right to left.
Non-convex outlines, edges on grid lines and corners on grid corners need no special case.

Lengths in the functions of the cut are in units of the grid's pitch.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.drive import phasor_under
from vibgym.physics.core.records import Body, Table, grip_of

MOMENTS = 9
"""Columns of the cell table: area, x, y, xx, xy, yy of the partial strips, then the height moments 1, y, yy."""

POINTS_PER_PIECE = 4
NEGLIGIBLE_PIECE = 1e-11
"""Share of the part's area below which a piece is omitted: its moments are rounding noise."""

_GAUSS = 0.5 / math.sqrt(3.0)


@jit
def _add_segment(cell, x0, y0, x1, y1):
    """Add one boundary segment, in the cell's coordinates. Two Gauss points integrate the cubics exactly."""
    height = y1 - y0
    x_middle, y_middle = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    x_offset, y_offset = _GAUSS * (x1 - x0), _GAUSS * height
    xa, xb = x_middle - x_offset, x_middle + x_offset
    ya, yb = y_middle - y_offset, y_middle + y_offset
    weight = 0.5 * height
    xxa, xxb = 0.5 * xa * xa, 0.5 * xb * xb
    cell[0] += weight * (xa + xb)
    cell[1] += weight * (xxa + xxb)
    cell[2] += weight * (xa * ya + xb * yb)
    cell[3] += weight * (xxa * xa + xxb * xb) * (2.0 / 3.0)
    cell[4] += weight * (xxa * ya + xxb * yb)
    cell[5] += weight * (xa * ya * ya + xb * yb * yb)
    cell[6] += height
    cell[7] += weight * (ya + yb)
    cell[8] += weight * (ya * ya + yb * yb)


@jit
def cut_outline(x, y, cells, box):
    """Compute the moments of all cells of the bounding box of a closed outline ``x, y`` (counter-clockwise).

    Args:
        x, y: vertices, in units of the grid pitch.
        cells: (>= cells of the bounding box, MOMENTS), overwritten.
        box: int array (4), overwritten with first column, first row, columns, rows of the bounding box.
    """
    n = x.shape[0]
    x_low, x_high, y_low, y_high = x[0], x[0], y[0], y[0]
    for k in range(1, n):
        x_low, x_high = min(x_low, x[k]), max(x_high, x[k])
        y_low, y_high = min(y_low, y[k]), max(y_high, y[k])
    left, bottom = math.floor(x_low), math.floor(y_low)
    columns, rows = int(math.floor(x_high) - left) + 1, int(math.floor(y_high) - bottom) + 1
    box[0], box[1], box[2], box[3] = int(left), int(bottom), columns, rows
    for cell in range(columns * rows):
        for k in range(MOMENTS):
            cells[cell, k] = 0.0

    bx, by = x[n - 1] - left, y[n - 1] - bottom
    for k in range(n):
        ax, ay = bx, by
        bx, by = x[k] - left, y[k] - bottom
        dx, dy = bx - ax, by - ay
        if dy == 0.0:  # a horizontal edge has no area to its left
            continue
        column, row = min(int(ax), columns - 1), min(int(ay), rows - 1)
        inverse_dx, inverse_dy = 1.0 / dx, 1.0 / dy
        step_x, step_y = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
        line_x = float(column + 1 if dx > 0.0 else column)  # next grid lines ahead
        line_y = float(row + 1 if dy > 0.0 else row)
        t_x = (line_x - ax) * inverse_dx if dx != 0.0 else 2.0  # parameter along the edge at which they are crossed
        t_y = (line_y - ay) * inverse_dy
        px, py = ax, ay
        # Without branches in the loop: the next line is unpredictable.
        while min(t_x, t_y) < 1.0:
            across = t_x <= t_y
            qx = line_x if across else ax + t_y * dx
            qy = ay + t_x * dy if across else line_y
            _add_segment(cells[row * columns + column], px - column, py - row, qx - column, qy - row)
            px, py = qx, qy
            # Rounding may lead one cell past the box; the formulas also hold in the last cell.
            column = min(max(column + (step_x if across else 0), 0), columns - 1)
            row = min(max(row + (0 if across else step_y), 0), rows - 1)
            line_x += step_x if across else 0.0
            line_y += 0.0 if across else step_y
            t_x = (line_x - ax) * inverse_dx if dx != 0.0 else 2.0
            t_y = (line_y - ay) * inverse_dy
        _add_segment(cells[row * columns + column], px - column, py - row, bx - column, by - row)


@jit
def contact_points(cells, box, rows, columns, split, pitch, x, y, smallest, points, elements):
    """Turn the moment table into weighted points relative to ``(x, y)``, four for each supported piece.

    The points lie at centroid +- sqrt(2) times the columns of the Cholesky factor of the piece's second moments: area,
    centroid and second moments are exact, third moments are those of a centrally symmetric piece (zero).

    Args:
        cells, box: from :func:`cut_outline` on a grid of ``split`` cells per element and direction.
        rows, columns: elements of the surface; pieces beyond carry no load.
        pitch: m, size of a cell.
        x, y: m, centre of mass.
        smallest: area (in cells) below which a piece is omitted.
        points: (3, capacity) overwritten with weight (sums to 1), x and y (m) relative to the centre of mass; padded
            with zero weights to a multiple of eight, for whole vectors in the friction loop.
        elements: (capacity / 4) overwritten with row * columns + column of each piece's element.

    Returns:
        Number of points, a multiple of eight; 0 when nothing is supported.
    """
    spread = math.sqrt(2.0) * pitch
    weight, point_x, point_y = points[0], points[1], points[2]
    n, total = 0, 0.0
    for i in range(box[3]):
        height, height_y, height_yy = 0.0, 0.0, 0.0
        row = box[1] + i
        supported_row = row >= 0 and row < rows * split
        for j in range(box[2] - 1, -1, -1):
            cell = cells[i * box[2] + j]
            area = cell[0] + height
            column = box[0] + j
            if area > smallest and supported_row and column >= 0 and column < columns * split:
                # Clamping changes only slivers whose moments are dominated by rounding.
                cx = min(max((cell[1] + 0.5 * height) / area, 0.0), 1.0)
                cy = min(max((cell[2] + height_y) / area, 0.0), 1.0)
                xx = min(max((cell[3] + height / 3.0) / area - cx * cx, 1e-20), 0.25)
                xy = (cell[4] + 0.5 * height_y) / area - cx * cy
                yy = min(max((cell[5] + height_yy) / area - cy * cy, 0.0), 0.25)
                l_xx = math.sqrt(xx)
                l_xy = min(max(xy / l_xx, -math.sqrt(yy)), math.sqrt(yy))
                l_yy = math.sqrt(max(yy - l_xy * l_xy, 0.0))
                rx, ry = (column + cx) * pitch - x, (row + cy) * pitch - y
                elements[n // 4] = row // split * columns + column // split
                for k in range(n, n + 4):
                    weight[k] = 0.25 * area
                point_x[n], point_y[n] = rx + spread * l_xx, ry + spread * l_xy
                point_x[n + 1], point_y[n + 1] = rx - spread * l_xx, ry - spread * l_xy
                point_x[n + 2], point_y[n + 2] = rx, ry + spread * l_yy
                point_x[n + 3], point_y[n + 3] = rx, ry - spread * l_yy
                n += 4
                total += area
            height += cell[6]
            height_y += cell[7]
            height_yy += cell[8]
    if n == 0:
        return 0
    padded = (n + 7) // 8 * 8
    for k in range(n, padded):
        weight[k], point_x[k], point_y[k], elements[k // 4] = 0.0, 0.0, 0.0, elements[0]
    for k in range(n):
        weight[k] /= total
    return padded


@jit
def _enter_angle(angles, count, x, y):
    """Insert the direction of ``(x, y)`` into the first ``count`` angles, which are ascending."""
    angle = math.atan2(y, x)
    k = count
    while k > 0 and angles[k - 1] > angle:
        angles[k] = angles[k - 1]
        k -= 1
    angles[k] = angle


@jit
def support_holds(outline_x, outline_y, left, right, bottom, top, x, y, angles):
    """Return whether the centre of mass ``(x, y)`` is in the convex hull of the part of the outline on the surface.

    The hull's corners are outline vertices on the surface, crossings of the outline with the border and corners of the
    surface inside the outline. The point is outside if and only if a line through it has all of them strictly on one side.

    Args:
        left, right, bottom, top: borders of the surface, in the outline's units.
        angles: (:func:`most_angles`) working array.
    """
    if x < left or y < bottom or x > right or y > top:
        return False
    n = outline_x.shape[0]
    count = 0
    for k in range(n):
        ax, ay = outline_x[k - 1], outline_y[k - 1]
        bx, by = outline_x[k], outline_y[k]
        if bx >= left and by >= bottom and bx <= right and by <= top:
            if bx == x and by == y:
                return True
            _enter_angle(angles, count, bx - x, by - y)
            count += 1
        for side in range(4):
            # Crossings with the left, bottom, right and top border.
            across = side % 2 == 0
            line = (right if side > 1 else left) if across else (top if side > 1 else bottom)
            a, b = (ax - line, bx - line) if across else (ay - line, by - line)
            if a * b < 0.0:
                t = a / (a - b)
                px, py = (line, ay + t * (by - ay)) if across else (ax + t * (bx - ax), line)
                at, begin, end = (py, bottom, top) if across else (px, left, right)
                if at >= begin and at <= end:
                    if px == x and py == y:
                        return True
                    _enter_angle(angles, count, px - x, py - y)
                    count += 1
    for side in range(4):
        px, py = right if side % 2 else left, top if side > 1 else bottom
        inside = False
        for k in range(n):
            ax, ay = outline_x[k - 1], outline_y[k - 1]
            bx, by = outline_x[k], outline_y[k]
            if (ay > py) != (by > py) and px < ax + (py - ay) / (by - ay) * (bx - ax):
                inside = not inside
        if inside:
            if px == x and py == y:
                return True
            _enter_angle(angles, count, px - x, py - y)
            count += 1
    if count == 0:
        return False
    widest = angles[0] + 2.0 * math.pi - angles[count - 1]
    for k in range(1, count):
        widest = max(widest, angles[k] - angles[k - 1])
    return widest <= math.pi + 1e-12


def most_angles(corners: int) -> int:
    """Return the size of the working array of :func:`support_holds` for an outline with ``corners`` corners."""
    return 5 * corners + 4


FINEST_PIECES = 8
"""Largest number of cells across an element (or a smaller part) in :func:`spin_split`."""

PLACED, OFF, NOWHERE = 0, 1, 2
"""Results of :func:`place_part`: on the table; falls; the pose is not finite."""


class Cut(NamedTuple):
    """Working arrays of the cut of one part."""

    outline_x: np.ndarray  # (most corners,)
    outline_y: np.ndarray
    angles: np.ndarray  # (most_angles(most corners),)
    cells: np.ndarray  # (cells, MOMENTS)
    box: np.ndarray  # (4,)
    points: np.ndarray  # (3, capacity): weight (share of the load, times the element's factor on friction), x, y
    under: np.ndarray  # (capacity,) element under each piece
    phasor_c: np.ndarray  # (capacity,) m/s^2, of the points
    phasor_s: np.ndarray
    load: np.ndarray  # (capacity,)


def finest_split(table: Table, body: Body) -> int:
    """Return the largest number of cells per element and direction in :func:`spin_split`."""
    size = min(table.element_size, 2.0 * body.radius)
    return math.ceil(FINEST_PIECES * table.element_size / size)


def cells_across(table: Table, body: Body, split: int) -> int:
    """Return a bound on the cells along a side of a part's bounding box, with ``split`` cells per element and direction."""
    return int(2.0 * body.radius / table.element_size * split) + 3


def new_cut(corners: int, across: int) -> Cut:
    """Allocate working arrays for outlines of up to ``corners`` corners and ``across`` cells along a side."""
    capacity = across * across * POINTS_PER_PIECE + 8
    return Cut(
        outline_x=np.zeros(corners),
        outline_y=np.zeros(corners),
        angles=np.zeros(most_angles(corners)),
        cells=np.zeros((across * across, MOMENTS)),
        box=np.zeros(4, np.int64),
        points=np.zeros((3, capacity)),
        under=np.zeros(capacity, np.int64),
        phasor_c=np.zeros(capacity),
        phasor_s=np.zeros(capacity),
        load=np.zeros(capacity),
    )


@jit
def spin_split(table, body, speed, spin):
    """Return the cells per element and direction for a spin: 1 until ``omega x size`` reaches the slip speed.

    Four points have a piece's second moments exactly; their error grows with the change of slip across the piece.
    """
    size = min(table.element_size, 2.0 * body.radius)
    across = abs(spin) * size
    if across < speed:
        return 1
    pieces = min(1.0 + across / max(speed, 1e-9 * across + 1e-300), float(FINEST_PIECES))
    return int(math.ceil(math.floor(pieces) * table.element_size / size))


@jit
def place_outline(body, x, y, heading, scale, outline_x, outline_y):
    """Compute the outline in the world frame, in units of ``1 / scale``."""
    cosine, sine = 1.0, 0.0
    if body.turns:
        cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(body.outline.shape[0]):
        bx, by = body.outline[k, 0], body.outline[k, 1]
        outline_x[k] = (x + cosine * bx - sine * by) * scale
        outline_y[k] = (y + sine * bx + cosine * by) * scale


@jit
def place_part(table, body, split, x, y, heading, cut):
    """Compute the outline at a pose, in cells; return ``PLACED``, ``OFF`` or ``NOWHERE``."""
    if not abs(x + y + heading) < math.inf:
        return NOWHERE
    if not (x >= table.left and y >= table.bottom and x <= table.right and y <= table.top):
        return OFF
    pitch = table.element_size / split
    corners = body.outline.shape[0]
    outline_x, outline_y = cut.outline_x[:corners], cut.outline_y[:corners]
    place_outline(body, x, y, heading, 1.0 / pitch, outline_x, outline_y)
    if not body.convex and not support_holds(
        outline_x, outline_y, table.left / pitch, table.right / pitch, table.bottom / pitch, table.top / pitch,
        x / pitch, y / pitch, cut.angles,
    ):  # fmt: skip
        return OFF
    return PLACED


@jit
def cut_into_points(table, body, split, x, y, cut):
    """Cut the placed outline into contact points; return their number, 0 without support."""
    pitch = table.element_size / split
    corners = body.outline.shape[0]
    cut_outline(cut.outline_x[:corners], cut.outline_y[:corners], cut.cells, cut.box)
    return contact_points(
        cut.cells, cut.box, table.rows, table.columns, split, pitch, x, y,
        NEGLIGIBLE_PIECE * body.area / (pitch * pitch), cut.points, cut.under,
    )  # fmt: skip


@jit
def read_points(table, body, drive, world, n, cut, phasors, slot):
    """Read the phasors under ``n`` contact points, and multiply their weights by the elements' factors on friction."""
    for piece in range(n // POINTS_PER_PIECE):
        element = cut.under[piece]
        c, s = phasor_under(phasors, slot, drive, world, element // table.columns, element % table.columns)
        grip = grip_of(body.patches, element // table.columns, element % table.columns)
        for k in range(POINTS_PER_PIECE * piece, POINTS_PER_PIECE * piece + POINTS_PER_PIECE):
            cut.phasor_c[k], cut.phasor_s[k] = c, s
            cut.points[0, k] *= grip


@jit
def points_at(table, body, split, drive, world, x, y, heading, cut, phasors, slot):
    """Compute contact points and phasors at any pose; return their number, 0 without support."""
    width, depth, r = table.columns * table.element_size, table.rows * table.element_size, body.radius
    if not (x > -r and x < width + r and y > -r and y < depth + r and abs(heading) < math.inf):
        return 0  # off the table; far away, an outline's corners would have no significant digits
    corners = body.outline.shape[0]
    scale = 1.0 / (table.element_size / split)
    place_outline(body, x, y, heading, scale, cut.outline_x[:corners], cut.outline_y[:corners])
    n = cut_into_points(table, body, split, x, y, cut)
    read_points(table, body, drive, world, n, cut, phasors, slot)
    return n
