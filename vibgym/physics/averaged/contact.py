"""What the averaged model computes at one pose: contact points and phasors under a part, mean acceleration, wobble."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.averaged.averages import (
    Averages,
    Scratch,
    first_order,
    make_scratch,
    second_order,
    velocity_wobble,
    wobble,
)
from vibgym.physics.contact_area.outline import (
    MOMENTS,
    NEGLIGIBLE_PIECE,
    POINTS_PER_PIECE,
    contact_points,
    cut_outline,
    support_holds,
)
from vibgym.physics.core.drive import element_phasor
from vibgym.physics.core.jit import jit

FINEST_PIECES = 8
"""Most cells across an element (or across a smaller part) that fast spin asks for."""

CLOSE = 1e-5
"""Error allowed in the wobble that is taken off at the start, over the table's speed."""


class AveragedScheme(NamedTuple):
    """Order, step sizes and tables."""

    order: int  # 1 or 2
    stride: int  # periods that one span of steps covers
    steps: int  # in each span
    tables: Averages


class Workspace(NamedTuple):
    """Arrays that one call needs again and again."""

    outline_x: np.ndarray
    outline_y: np.ndarray
    cells: np.ndarray
    box: np.ndarray
    points: np.ndarray  # (3, capacity)
    under: np.ndarray  # element of every piece
    phasor_c: np.ndarray  # of every point
    phasor_s: np.ndarray
    element_c: np.ndarray
    element_s: np.ndarray
    read_for: np.ndarray  # world whose phasors are in element_c, element_s
    scratch: Scratch


@jit
def make_workspace(table, body):
    """A workspace for parts like ``body``."""
    n = body.outline.shape[0]
    size = min(table.element_size, 2.0 * body.radius)
    split = int(math.ceil(FINEST_PIECES * table.element_size / size))
    across = int(2.0 * body.radius / table.element_size * split) + 3
    capacity = across * across * POINTS_PER_PIECE + 8
    elements = table.rows * table.columns
    return Workspace(
        np.empty(n),
        np.empty(n),
        np.empty((across * across, MOMENTS)),
        np.empty(4, np.int64),
        np.empty((3, capacity)),
        np.empty(capacity, np.int64),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(elements),
        np.empty(elements),
        np.full(elements, -1),
        make_scratch(),
    )


@jit
def cells_for_spin(table, body, spin):
    """Cells per element and direction: one, and more where spin changes the slip strongly across a piece."""
    size = min(table.element_size, 2.0 * body.radius)
    across = abs(spin) * size
    if across < table.speed:
        return 1
    pieces = min(1.0 + across / table.speed, float(FINEST_PIECES))
    return int(math.ceil(math.floor(pieces) * table.element_size / size))


@jit
def cut(table, body, x, y, heading, spin, work):
    """Cut the outline at a pose: contact points and their elements. Returns the number of points, 0 without support."""
    width, height = table.columns * table.element_size, table.rows * table.element_size
    if not (x >= 0.0 and y >= 0.0 and x <= width and y <= height):
        return 0
    split = cells_for_spin(table, body, spin)
    pitch = table.element_size / split
    scale = 1.0 / pitch
    cosine, sine = 1.0, 0.0
    if body.turns:
        cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(body.outline.shape[0]):
        bx, by = body.outline[k, 0], body.outline[k, 1]
        work.outline_x[k] = (x + cosine * bx - sine * by) * scale
        work.outline_y[k] = (y + sine * bx + cosine * by) * scale
    if not body.convex and not support_holds(
        work.outline_x, work.outline_y, width * scale, height * scale, x * scale, y * scale
    ):
        return 0
    cut_outline(work.outline_x, work.outline_y, work.cells, work.box)
    smallest = NEGLIGIBLE_PIECE * body.area * scale * scale
    return contact_points(
        work.cells, work.box, table.rows, table.columns, split, pitch, x, y, smallest, work.points, work.under
    )


@jit
def read_phasors(table, drive, world, n, work):
    """Phasors of the elements under the contact points."""
    for piece in range(n // POINTS_PER_PIECE):
        element = work.under[piece]
        if work.read_for[element] != world:
            work.read_for[element] = world
            work.element_c[element], work.element_s[element] = element_phasor(
                drive, world, element // table.columns, element % table.columns
            )
        for k in range(POINTS_PER_PIECE * piece, POINTS_PER_PIECE * piece + POINTS_PER_PIECE):
            work.phasor_c[k], work.phasor_s[k] = work.element_c[element], work.element_s[element]


@jit
def mean_acceleration(table, body, scheme, n, moments, vx, vy, spin, work):
    """Mean acceleration (m/s^2, m/s^2, rad/s^2) at a mean velocity, for the points, phasors and moments at hand."""
    mu = body.friction
    ax, ay, aw = first_order(
        scheme.tables,
        work.points,
        work.phasor_c,
        work.phasor_s,
        n,
        table.gravity,
        table.speed,
        body.radius,
        vx,
        vy,
        spin,
        work.scratch,
    )
    if scheme.order == 2:
        small = mu * table.period / (2.0 * math.pi)
        bx, by, bw = second_order(
            scheme.tables, moments, table.gravity, table.speed, body.gyration, vx, vy, work.scratch
        )
        ax, ay, aw = ax + small * bx, ay + small * by, aw + small * bw
    return mu * ax, mu * ay, mu / body.gyration * aw


@jit
def steady_part(table, body, scheme, moments, vx, vy, result, work):
    """Mean velocity that belongs to an instantaneous one, by Broyden's method; leaves its wobble in ``result``."""
    size = body.friction * table.period / (2.0 * math.pi)
    tables, scratch = scheme.tables, work.scratch
    ux, uy = vx, vy
    rx, ry = velocity_wobble(tables, moments, table.gravity, table.speed, ux, uy, scratch)
    rx, ry = size * rx, size * ry
    hxx, hxy, hyx, hyy = 1.0, 0.0, 0.0, 1.0
    for _ in range(12):
        if abs(rx) + abs(ry) < CLOSE * table.speed:
            break
        sx, sy = -(hxx * rx + hxy * ry), -(hyx * rx + hyy * ry)
        ux, uy = ux + sx, uy + sy
        qx, qy = velocity_wobble(tables, moments, table.gravity, table.speed, ux, uy, scratch)
        qx, qy = ux + size * qx - vx, uy + size * qy - vy
        dx, dy = qx - rx, qy - ry
        rx, ry = qx, qy
        px, py = hxx * dx + hxy * dy, hyx * dx + hyy * dy
        lx, ly = sx * hxx + sy * hyx, sx * hxy + sy * hyy
        scale = sx * px + sy * py
        if abs(scale) > 1e-12 * (sx * sx + sy * sy):
            ex, ey = (sx - px) / scale, (sy - py) / scale
            hxx, hxy, hyx, hyy = hxx + ex * lx, hxy + ex * ly, hyx + ey * lx, hyy + ey * ly
    # Never farther from the instantaneous velocity than a wobble can be.
    wobble(tables, moments, table.gravity, table.speed, body.gyration, ux, uy, result, scratch)
    return vx - size * result[0], vy - size * result[1]
