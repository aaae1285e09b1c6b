"""A part's outline laid on the surface, cut by the grid, and turned into contact points with the phasors under them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.physics.core.records import Body, Table, grip_of
from vibgym.physics.planar.outline import (
    MOMENTS,
    NEGLIGIBLE_PIECE,
    POINTS_PER_PIECE,
    contact_points,
    cut_outline,
    most_angles,
    support_holds,
)
from vibgym.physics.planar.phasors import phasor_under

FINEST_PIECES = 8
"""Most cells across an element (or across a smaller part) that the spin rule asks for."""

PLACED, OFF, NOWHERE = 0, 1, 2
"""What comes of a part at a pose: it is on the table; it falls; the pose is no number."""


class Cut(NamedTuple):
    """Working arrays of a cut and its points."""

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
    """Largest number of cells per element and direction that :func:`spin_split` asks for."""
    size = min(table.element_size, 2.0 * body.radius)
    return math.ceil(FINEST_PIECES * table.element_size / size)


def cells_across(table: Table, body: Body, split: int) -> int:
    """Most cells along a side of the box around a part, with ``split`` cells per element and direction."""
    return int(2.0 * body.radius / table.element_size * split) + 3


def new_cut(corners: int, across: int) -> Cut:
    """Working arrays for outlines of up to so many corners and cells along a side."""
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


@borrowing
def spin_split(table, body, speed, spin):
    """Cells per element that the spin asks for: none extra until ``omega x size`` reaches the slip speed.

    Four points carry a piece's second moments exactly; what they miss grows with the change of slip across the piece.
    """
    size = min(table.element_size, 2.0 * body.radius)
    across = abs(spin) * size
    if across < speed:
        return 1
    pieces = min(1.0 + across / max(speed, 1e-9 * across + 1e-300), float(FINEST_PIECES))
    return int(math.ceil(math.floor(pieces) * table.element_size / size))


@borrowing
def place_outline(body, x, y, heading, scale, outline_x, outline_y):
    """Outline in the world frame, in units of ``1 / scale``."""
    cosine, sine = 1.0, 0.0
    if body.turns:
        cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(body.outline.shape[0]):
        bx, by = body.outline[k, 0], body.outline[k, 1]
        outline_x[k] = (x + cosine * bx - sine * by) * scale
        outline_y[k] = (y + sine * bx + cosine * by) * scale


@borrowing
def place_part(table, body, split, x, y, heading, cut):
    """Lay the outline down at a pose, in cells; returns ``PLACED``, ``OFF`` or ``NOWHERE``."""
    if not abs(x + y + heading) < math.inf:
        return NOWHERE
    if not (x >= table.left and y >= table.bottom and x <= table.right and y <= table.top):
        return OFF
    pitch = table.element_size / split
    corners = body.outline.shape[0]
    outline_x, outline_y = cut.outline_x[:corners], cut.outline_y[:corners]
    place_outline(body, x, y, heading, 1.0 / pitch, outline_x, outline_y)
    if not body.convex and not support_holds(
        outline_x,
        outline_y,
        table.left / pitch,
        table.right / pitch,
        table.bottom / pitch,
        table.top / pitch,
        x / pitch,
        y / pitch,
        cut.angles,
    ):
        return OFF
    return PLACED


@borrowing
def cut_into_points(table, body, split, x, y, cut):
    """Cut the outline that has been laid down into contact points; returns how many, 0 if nothing is supported."""
    pitch = table.element_size / split
    corners = body.outline.shape[0]
    cut_outline(cut.outline_x[:corners], cut.outline_y[:corners], cut.cells, cut.box)
    return contact_points(
        cut.cells, cut.box, table.rows, table.columns, split, pitch, x, y,
        NEGLIGIBLE_PIECE * body.area / (pitch * pitch), cut.points, cut.under,
    )  # fmt: skip


@borrowing
def read_points(table, body, drive, world, n, cut, phasors, slot):
    """Phasors under the ``n`` contact points of the part of a slot; makes of their weights those with which they rub."""
    for piece in range(n // POINTS_PER_PIECE):
        element = cut.under[piece]
        c, s = phasor_under(phasors, slot, drive, world, element // table.columns, element % table.columns)
        grip = grip_of(body.patches, element // table.columns, element % table.columns)
        for k in range(POINTS_PER_PIECE * piece, POINTS_PER_PIECE * piece + POINTS_PER_PIECE):
            cut.phasor_c[k], cut.phasor_s[k] = c, s
            cut.points[0, k] *= grip


@borrowing
def points_at(table, body, split, drive, world, x, y, heading, cut, phasors, slot):
    """Contact points and their phasors at a pose, wherever that is; returns how many, 0 if nothing is supported."""
    width, depth, r = table.columns * table.element_size, table.rows * table.element_size, body.radius
    if not (x > -r and x < width + r and y > -r and y < depth + r and abs(heading) < math.inf):
        return 0  # nothing of it lies on the table; and far away an outline's corners have no digits left
    corners = body.outline.shape[0]
    scale = 1.0 / (table.element_size / split)
    place_outline(body, x, y, heading, scale, cut.outline_x[:corners], cut.outline_y[:corners])
    n = cut_into_points(table, body, split, x, y, cut)
    read_points(table, body, drive, world, n, cut, phasors, slot)
    return n
