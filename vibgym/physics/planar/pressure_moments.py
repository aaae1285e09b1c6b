"""Moments of the pressure under a group of eight parts.

If slip varies little across a part, friction depends only on the moments of the pressure under it. Up to the fourth order they
give force and torque as a series (:func:`vibgym.physics.planar.wrench.expanded_wrench`), at a cost that does not depend on the
number of elements. With ``z = x + i y`` from the centre of mass,

    M_ab = sum over pieces of p * integral of z^a conj(z)^b,      a >= b, a + b <= 4

and ``M_ba`` is its conjugate. Pressure is ``g - C cos wt + S sin wt`` on each piece, so each moment is stored three times: for
``g``, C and S. Factors on friction of elements are included. The innermost index of flat arrays is the lane
(:mod:`vibgym.kernels.vector`).
"""

from __future__ import annotations

import numpy as np

from vibgym.kernels.jit import exact
from vibgym.kernels.vector import (
    LANES,
    WIDTH,
    bits,
    broadcast_register,
    load_register,
    maximum,
    minimum,
    select,
    store,
)
from vibgym.physics.core.drive import phasor_under
from vibgym.physics.core.records import grip_of
from vibgym.physics.planar.group_cut import CELL

MOMENT_ROWS = 45
"""Rows M00, M11, M22, then real and imaginary part of M10, M21, M20, M31, M30, M40; each for ``g``, C and S."""

SHAPE_MOMENTS = 14
"""Moments of a piece over its weight: all but M00."""

PIECE_FIELDS = 3 + SHAPE_MOMENTS
"""Fields of a piece: weight, weight times C, weight times S, and the moments."""

PIECE = PIECE_FIELDS * WIDTH

AT_A_TIME = 2
"""Moments summed over all pieces in one loop: as many as registers hold."""

STRIP_KURTOSIS = 0.6
"""A piece's central fourth moments over those of a normal distribution with its second moments. Uniform strips have 0.6 along
their length. Third moments are neglected. Both matter only if slip varies strongly across a part."""


@exact(inline=True)
def store_moments(pieces, at, uu, uv, vv, x, y):
    """Write the moments of a piece over its weight.

    Args:
        pieces, at: flat array and index of the first moment.
        uu, uv, vv: second central moments, m^2.
        x, y: centroid from the centre of mass, m.
    """
    # Central moments of the piece: q of z conj(z), p of z^2, and the fourth ones.
    q, px, py = uu + vv, uu - vv, 2.0 * uv
    fx, fy = 3.0 * STRIP_KURTOSIS * (px * px - py * py), 6.0 * STRIP_KURTOSIS * (px * py)  # of z^4
    tx, ty = 3.0 * STRIP_KURTOSIS * (q * px), 3.0 * STRIP_KURTOSIS * (q * py)  # of z^3 conj(z)
    fourth = STRIP_KURTOSIS * (2.0 * (q * q) + px * px + py * py)  # of z^2 conj(z)^2
    # Powers of the centroid, and the moments about the centre of mass by binomial expansion.
    r2 = x * x + y * y
    x2, y2 = x * x - y * y, 2.0 * (x * y)
    x3, y3 = x2 * x - y2 * y, x2 * y + y2 * x
    one, three = r2 + 2.0 * q, r2 + 3.0 * q
    store(pieces, at, r2 + q)
    store(pieces, at + WIDTH, r2 * r2 + 2.0 * (x2 * px + y2 * py) + 4.0 * r2 * q + fourth)
    store(pieces, at + 2 * WIDTH, x)
    store(pieces, at + 3 * WIDTH, y)
    store(pieces, at + 4 * WIDTH, one * x + (x * px + y * py))
    store(pieces, at + 5 * WIDTH, one * y + (x * py - y * px))
    store(pieces, at + 6 * WIDTH, x2 + px)
    store(pieces, at + 7 * WIDTH, y2 + py)
    store(pieces, at + 8 * WIDTH, three * x2 + (3.0 * r2 * px + tx))
    store(pieces, at + 9 * WIDTH, three * y2 + (3.0 * r2 * py + ty))
    store(pieces, at + 10 * WIDTH, x3 + 3.0 * (x * px - y * py))
    store(pieces, at + 11 * WIDTH, y3 + 3.0 * (x * py + y * px))
    store(pieces, at + 12 * WIDTH, x2 * x2 - y2 * y2 + (6.0 * (x2 * px - y2 * py) + fx))
    store(pieces, at + 13 * WIDTH, 2.0 * (x2 * y2) + (6.0 * (x2 * py + y2 * px) + fy))


@exact
def read_missing(scene, g, first, row, column, missing):
    """Read phasor and friction factor of a cell's elements, for the lanes from ``first`` on whose bits are set."""
    workspace = scene.workspace
    cell, base = row * workspace.across + column, workspace.base[g]
    workspace.known[g, cell] |= missing << first
    c, s = workspace.phasor_c[g], workspace.phasor_s[g]
    for k in range(WIDTH):
        if missing >> k & 1:
            lane = first + k
            slot = g * LANES + lane
            at_row, at_column = np.int64(base[LANES + lane]) + row, np.int64(base[lane]) + column
            c[cell * LANES + lane], s[cell * LANES + lane] = phasor_under(
                workspace.phasors, slot, scene.drive, workspace.world[slot], at_row, at_column
            )  # fmt: skip
            workspace.grip[g, cell * LANES + lane] = grip_of(
                scene.state.patches[workspace.world[slot]], at_row, at_column
            )


@exact
def collect_pieces(scene, g, first, x, y, smallest, box):
    """Convert the cells that a group's outlines touch to pieces in ``workspace.pieces``, and clear the cells.

    Args:
        x, y: centres of mass in the window, in elements.
        smallest: area (in cells) below which a piece is omitted.
        box: first and last row and column, from :func:`vibgym.physics.planar.group_cut.cut_outlines`.

    Returns:
        Number of pieces, their area (in cells), and the sums of the weights (areas times the elements' factors on friction), of
        weights times C, and of weights times S.
    """
    table, workspace = scene.table, scene.workspace
    pitch, cells, pieces, across = table.element_size, workspace.cells, workspace.pieces, workspace.across
    base_x, base_y = load_register(workspace.base[g], first), load_register(workspace.base[g], LANES + first)
    covered, total = broadcast_register(0.0), broadcast_register(0.0)
    total_c, total_s, n = broadcast_register(0.0), broadcast_register(0.0), 0
    zero, square = broadcast_register(0.0), pitch * pitch
    for row in range(box[0], box[1] + 1):
        height, height_y, height_yy = zero, zero, zero
        place = base_y + float(row)
        on_row = (place >= 0.0) & (place < float(table.rows))
        for column in range(box[3], box[2] - 1, -1):
            at = (row * across + column) * CELL
            area = load_register(cells, at) + height
            place = base_x + float(column)
            held = on_row & (place >= 0.0) & (place < float(table.columns)) & (area > smallest)
            lanes = bits(held)
            if lanes != 0:
                cell = row * across + column
                missing = lanes & ~(workspace.known[g, cell] >> first)
                if missing != 0:
                    read_missing(scene, g, first, row, column, missing)
                weight, inverse = select(held, area, 0.0), 1.0 / select(held, area, 1.0)
                c, s = (
                    load_register(workspace.phasor_c[g], cell * LANES + first),
                    load_register(workspace.phasor_s[g], cell * LANES + first),
                )
                covered = covered + weight
                weight = weight * load_register(workspace.grip[g], cell * LANES + first)
                weight_c, weight_s = weight * c, weight * s
                # Clamping changes only slivers whose moments are dominated by rounding.
                u = minimum(maximum(0.5 * (load_register(cells, at + WIDTH) + height) * inverse, 0.0), 1.0)
                v = minimum(maximum((load_register(cells, at + 2 * WIDTH) + height_y) * inverse, 0.0), 1.0)
                uu = (load_register(cells, at + 3 * WIDTH) + height) * (1.0 / 3.0) * inverse - u * u
                uv = 0.5 * (load_register(cells, at + 4 * WIDTH) + height_y) * inverse - u * v
                vv = (load_register(cells, at + 5 * WIDTH) + height_yy) * inverse - v * v
                piece = n * PIECE
                store(pieces, piece, weight)
                store(pieces, piece + WIDTH, weight_c)
                store(pieces, piece + 2 * WIDTH, weight_s)
                store_moments(
                    pieces, piece + 3 * WIDTH,
                    square * minimum(maximum(uu, 0.0), 0.25), square * minimum(maximum(uv, -0.25), 0.25),
                    square * minimum(maximum(vv, 0.0), 0.25),
                    (u + float(column) - x) * pitch, (v + float(row) - y) * pitch,
                )  # fmt: skip
                total, total_c, total_s, n = total + weight, total_c + weight_c, total_s + weight_s, n + 1
            height = height + load_register(cells, at + 6 * WIDTH)
            height_y = height_y + load_register(cells, at + 7 * WIDTH)
            height_yy = height_yy + load_register(cells, at + 8 * WIDTH)
            for field in range(0, CELL, WIDTH):
                store(cells, at + field, zero)
    return n, covered, total, total_c, total_s


@exact(inline=True)
def _keep(moments, at, cutting, value):
    """Store a moment in the lanes that were cut."""
    store(moments, at, select(cutting, value, load_register(moments, at)))


@exact
def sum_moments(pieces, n, cutting, inverse, gravity, moments, first):
    """Sum the moments of ``n`` pieces of every lane.

    Args:
        cutting: mask of the lanes whose moments are overwritten.
        inverse: one over the areas, 1 / cells.
        gravity: m/s^2, times ``inverse``.
        moments: flat (MOMENT_ROWS, lane); the first three rows are not written.
    """
    for shape in range(0, SHAPE_MOMENTS, AT_A_TIME):
        a, ac, a_s = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
        b, bc, bs = broadcast_register(0.0), broadcast_register(0.0), broadcast_register(0.0)
        for piece in range(0, n * PIECE, PIECE):
            weight = load_register(pieces, piece)
            weight_c, weight_s = load_register(pieces, piece + WIDTH), load_register(pieces, piece + 2 * WIDTH)
            at = piece + (3 + shape) * WIDTH
            one, other = load_register(pieces, at), load_register(pieces, at + WIDTH)
            a, ac, a_s = a + weight * one, ac + weight_c * one, a_s + weight_s * one
            b, bc, bs = b + weight * other, bc + weight_c * other, bs + weight_s * other
        row = (3 + 3 * shape) * LANES + first
        _keep(moments, row, cutting, a * gravity)
        _keep(moments, row + 1 * LANES, cutting, ac * inverse)
        _keep(moments, row + 2 * LANES, cutting, a_s * inverse)
        _keep(moments, row + 3 * LANES, cutting, b * gravity)
        _keep(moments, row + 4 * LANES, cutting, bc * inverse)
        _keep(moments, row + 5 * LANES, cutting, bs * inverse)


@exact
def pressure_moments(scene, g, first, x, y, smallest, box, cutting):
    """Compute the moments of the pressure over the area, from the cells that a group's outlines touch; clear the cells.

    Args:
        x, y, smallest, box: see :func:`collect_pieces`.
        cutting: mask of the lanes whose moments are overwritten.

    Returns:
        Mask of the lanes that are supported.
    """
    moments = scene.workspace.moments[g]
    n, covered, total, total_c, total_s = collect_pieces(scene, g, first, x, y, smallest, box)
    held = covered > 0.0
    inverse = select(held, 1.0, 0.0) / select(held, covered, 1.0)
    gravity = scene.table.gravity * inverse
    _keep(moments, first, cutting, total * gravity)
    _keep(moments, LANES + first, cutting, total_c * inverse)
    _keep(moments, 2 * LANES + first, cutting, total_s * inverse)
    sum_moments(scene.workspace.pieces, n, cutting, inverse, gravity, moments, first)
    return held
