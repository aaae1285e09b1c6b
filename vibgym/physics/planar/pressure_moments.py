"""Moments of the pressure under a part, for a bundle of worlds at a time.

Friction does not care for single pieces of the contact area where slip varies little across the part: the moments of the
pressure, up to the fourth order, give force and torque as a series (:func:`vibgym.physics.planar.wrench.expanded_wrench`)
at a cost that does not depend on the number of elements underneath. With ``z = x + i y`` from the centre of mass,

    M_ab = sum over pieces of p * integral of z^a conj(z)^b,      a >= b, a + b <= 4

and ``M_ba`` is its conjugate. Pressure is ``g - C cos wt + S sin wt`` on each piece, so every moment comes three times: for
1, C and S. Worlds stand side by side in the innermost index (lanes): the compiler turns the loops over lanes into vector
instructions. Arrays are flat, and the offsets constants, because it vectorises nothing else.
"""

from __future__ import annotations

from vibgym._numba.jit import borrowing, inlined
from vibgym.physics.planar.phasors import phasor_under

LANES = 8
"""Worlds side by side. Loops over lanes take their number at run time: a constant would be unrolled, not vectorised."""

PIECE_FIELDS = 10
"""Area, x, y, xx, xy, yy (raw, in the cell), offset x and y of the cell's corner (m), C, S (m/s^2)."""

MOMENT_ROWS = 45
"""M00, M11, M22, then real and imaginary part of M10, M21, M20, M31, M30, M40; each for 1, C and S."""

STRIP_KURTOSIS = 0.6
"""A piece's central fourth moments, relative to those of a normal distribution with its second moments. Uniform strips
have 0.6 along their length. They only count where slip varies strongly across a part, and third ones are taken as zero."""


@borrowing
def collect_pieces(cells, box, table, x, y, smallest, pieces, rows, columns, lane):
    """Write the supported pieces of one world into its lane, all but their phasors.

    Args:
        cells, box: from :func:`vibgym.physics.planar.outline.cut_outline` on the element grid.
        x, y: m, centre of mass.
        smallest: area (in cells) below which a piece is left out.
        pieces: flat, (piece, field, lane).
        rows, columns: (>= pieces) overwritten with row and column of each piece's element.

    Returns:
        Number of pieces and their area (in cells).
    """
    n, total = 0, 0.0
    for i in range(box[3]):
        height, height_y, height_yy = 0.0, 0.0, 0.0
        row = box[1] + i
        supported_row = row >= 0 and row < table.rows
        for j in range(box[2] - 1, -1, -1):
            cell = i * box[2] + j
            area = cells[cell, 0] + height
            column = box[0] + j
            if area > smallest and supported_row and column >= 0 and column < table.columns:
                at = n * PIECE_FIELDS * LANES + lane
                pieces[at] = area
                pieces[at + LANES] = cells[cell, 1] + 0.5 * height
                pieces[at + 2 * LANES] = cells[cell, 2] + height_y
                pieces[at + 3 * LANES] = cells[cell, 3] + height / 3.0
                pieces[at + 4 * LANES] = cells[cell, 4] + 0.5 * height_y
                pieces[at + 5 * LANES] = cells[cell, 5] + height_yy
                pieces[at + 6 * LANES] = column * table.element_size - x
                pieces[at + 7 * LANES] = row * table.element_size - y
                rows[n], columns[n] = row, column
                n += 1
                total += area
            height += cells[cell, 6]
            height_y += cells[cell, 7]
            height_yy += cells[cell, 8]
    return n, total


@borrowing
def read_phasors(drive, world, rows, columns, n, phasors, slot, pieces, lane):
    """Write the phasors of the elements under a part's pieces into its lane.

    Args:
        rows, columns: of the ``n`` pieces' elements.
        phasors, slot: what has been read for the part, see :func:`vibgym.physics.planar.phasors.phasor_under`.
    """
    for k in range(n):
        at = (k * PIECE_FIELDS + 8) * LANES + lane
        pieces[at], pieces[at + LANES] = phasor_under(phasors, slot, drive, world, rows[k], columns[k])


@borrowing
def clear_pieces(pieces, lane, start, stop):
    """Make a lane's pieces weightless, so that it can stand beside lanes with more."""
    for piece in range(start, stop):
        for field in range(PIECE_FIELDS):
            pieces[(piece * PIECE_FIELDS + field) * LANES + lane] = 0.0


@inlined
def piece_moments(pieces, at, pitch, share):
    """Moments of the lane's piece that begins at ``at``: its weight times 1, C, S, and z-moments per weight.

    Args:
        pieces: flat (piece, field, lane).
        pitch: m, size of a cell.
        share: one over the lane's supported area, in cells.
    """
    raw = pieces[at]
    weight = raw * share
    inverse = 1.0 / max(raw, 1e-300)
    # Clamping only ever touches slivers whose moments have lost their digits.
    u = min(max(pieces[at + LANES] * inverse, 0.0), 1.0)
    v = min(max(pieces[at + 2 * LANES] * inverse, 0.0), 1.0)
    uu = min(max(pieces[at + 3 * LANES] * inverse - u * u, 0.0), 0.25)
    uv = min(max(pieces[at + 4 * LANES] * inverse - u * v, -0.25), 0.25)
    vv = min(max(pieces[at + 5 * LANES] * inverse - v * v, 0.0), 0.25)
    x, y = u * pitch + pieces[at + 6 * LANES], v * pitch + pieces[at + 7 * LANES]
    # Central moments of the piece: q of z conj(z), p of z^2, and the fourth ones.
    q = (uu + vv) * pitch * pitch
    px, py = (uu - vv) * pitch * pitch, 2.0 * uv * pitch * pitch
    fx, fy = 3.0 * STRIP_KURTOSIS * (px * px - py * py), 6.0 * STRIP_KURTOSIS * px * py  # of z^4
    tx, ty = 3.0 * STRIP_KURTOSIS * q * px, 3.0 * STRIP_KURTOSIS * q * py  # of z^3 conj(z)
    fourth = STRIP_KURTOSIS * (2.0 * q * q + px * px + py * py)  # of z^2 conj(z)^2
    # Powers of the centroid, and the moments about the centre of mass by binomial expansion.
    r2 = x * x + y * y
    x2, y2 = x * x - y * y, 2.0 * x * y
    x3, y3 = x2 * x - y2 * y, x2 * y + y2 * x
    x4, y4 = x2 * x2 - y2 * y2, 2.0 * x2 * y2
    cpx, cpy = x * px - y * py, x * py + y * px  # z p
    dpx, dpy = x * px + y * py, x * py - y * px  # conj(z) p
    m11 = r2 + q
    m22 = r2 * r2 + 2.0 * (x2 * px + y2 * py) + 4.0 * r2 * q + fourth
    one = r2 + 2.0 * q
    m21x, m21y = one * x + dpx, one * y + dpy
    m20x, m20y = x2 + px, y2 + py
    three = r2 + 3.0 * q
    m31x, m31y = three * x2 + 3.0 * r2 * px + tx, three * y2 + 3.0 * r2 * py + ty
    m30x, m30y = x3 + 3.0 * cpx, y3 + 3.0 * cpy
    m40x = x4 + 6.0 * (x2 * px - y2 * py) + fx
    m40y = y4 + 6.0 * (x2 * py + y2 * px) + fy
    return (
        weight, weight * pieces[at + 8 * LANES], weight * pieces[at + 9 * LANES],
        m11, m22, x, y, m21x, m21y, m20x, m20y, m31x, m31y, m30x, m30y, m40x, m40y,
    )  # fmt: skip


@borrowing
def add_pieces(pieces, pitch, share, before, after, lanes):
    """``after = before +`` the moments of two pieces of every lane.

    Args:
        pieces: flat (2, field, lane).
        pitch: m, size of a cell.
        share: (lane) one over the lane's supported area, in cells.
        before, after: flat (row, lane), different arrays: loops that read and write the same one do not vectorise.
        lanes: ``LANES``.
    """
    for j in range(lanes):
        (
            w0, c0, s0, p11, p22, p10x, p10y, p21x, p21y, p20x, p20y, p31x, p31y, p30x, p30y, p40x, p40y,
        ) = piece_moments(pieces, j, pitch, share[j])  # fmt: skip
        (
            w1, c1, s1, q11, q22, q10x, q10y, q21x, q21y, q20x, q20y, q31x, q31y, q30x, q30y, q40x, q40y,
        ) = piece_moments(pieces, PIECE_FIELDS * LANES + j, pitch, share[j])  # fmt: skip
        after[j] = before[j] + (w0 + w1)
        after[1 * LANES + j] = before[1 * LANES + j] + (c0 + c1)
        after[2 * LANES + j] = before[2 * LANES + j] + (s0 + s1)
        after[3 * LANES + j] = before[3 * LANES + j] + (w0 * p11 + w1 * q11)
        after[4 * LANES + j] = before[4 * LANES + j] + (c0 * p11 + c1 * q11)
        after[5 * LANES + j] = before[5 * LANES + j] + (s0 * p11 + s1 * q11)
        after[6 * LANES + j] = before[6 * LANES + j] + (w0 * p22 + w1 * q22)
        after[7 * LANES + j] = before[7 * LANES + j] + (c0 * p22 + c1 * q22)
        after[8 * LANES + j] = before[8 * LANES + j] + (s0 * p22 + s1 * q22)
        after[9 * LANES + j] = before[9 * LANES + j] + (w0 * p10x + w1 * q10x)
        after[10 * LANES + j] = before[10 * LANES + j] + (c0 * p10x + c1 * q10x)
        after[11 * LANES + j] = before[11 * LANES + j] + (s0 * p10x + s1 * q10x)
        after[12 * LANES + j] = before[12 * LANES + j] + (w0 * p10y + w1 * q10y)
        after[13 * LANES + j] = before[13 * LANES + j] + (c0 * p10y + c1 * q10y)
        after[14 * LANES + j] = before[14 * LANES + j] + (s0 * p10y + s1 * q10y)
        after[15 * LANES + j] = before[15 * LANES + j] + (w0 * p21x + w1 * q21x)
        after[16 * LANES + j] = before[16 * LANES + j] + (c0 * p21x + c1 * q21x)
        after[17 * LANES + j] = before[17 * LANES + j] + (s0 * p21x + s1 * q21x)
        after[18 * LANES + j] = before[18 * LANES + j] + (w0 * p21y + w1 * q21y)
        after[19 * LANES + j] = before[19 * LANES + j] + (c0 * p21y + c1 * q21y)
        after[20 * LANES + j] = before[20 * LANES + j] + (s0 * p21y + s1 * q21y)
        after[21 * LANES + j] = before[21 * LANES + j] + (w0 * p20x + w1 * q20x)
        after[22 * LANES + j] = before[22 * LANES + j] + (c0 * p20x + c1 * q20x)
        after[23 * LANES + j] = before[23 * LANES + j] + (s0 * p20x + s1 * q20x)
        after[24 * LANES + j] = before[24 * LANES + j] + (w0 * p20y + w1 * q20y)
        after[25 * LANES + j] = before[25 * LANES + j] + (c0 * p20y + c1 * q20y)
        after[26 * LANES + j] = before[26 * LANES + j] + (s0 * p20y + s1 * q20y)
        after[27 * LANES + j] = before[27 * LANES + j] + (w0 * p31x + w1 * q31x)
        after[28 * LANES + j] = before[28 * LANES + j] + (c0 * p31x + c1 * q31x)
        after[29 * LANES + j] = before[29 * LANES + j] + (s0 * p31x + s1 * q31x)
        after[30 * LANES + j] = before[30 * LANES + j] + (w0 * p31y + w1 * q31y)
        after[31 * LANES + j] = before[31 * LANES + j] + (c0 * p31y + c1 * q31y)
        after[32 * LANES + j] = before[32 * LANES + j] + (s0 * p31y + s1 * q31y)
        after[33 * LANES + j] = before[33 * LANES + j] + (w0 * p30x + w1 * q30x)
        after[34 * LANES + j] = before[34 * LANES + j] + (c0 * p30x + c1 * q30x)
        after[35 * LANES + j] = before[35 * LANES + j] + (s0 * p30x + s1 * q30x)
        after[36 * LANES + j] = before[36 * LANES + j] + (w0 * p30y + w1 * q30y)
        after[37 * LANES + j] = before[37 * LANES + j] + (c0 * p30y + c1 * q30y)
        after[38 * LANES + j] = before[38 * LANES + j] + (s0 * p30y + s1 * q30y)
        after[39 * LANES + j] = before[39 * LANES + j] + (w0 * p40x + w1 * q40x)
        after[40 * LANES + j] = before[40 * LANES + j] + (c0 * p40x + c1 * q40x)
        after[41 * LANES + j] = before[41 * LANES + j] + (s0 * p40x + s1 * q40x)
        after[42 * LANES + j] = before[42 * LANES + j] + (w0 * p40y + w1 * q40y)
        after[43 * LANES + j] = before[43 * LANES + j] + (c0 * p40y + c1 * q40y)
        after[44 * LANES + j] = before[44 * LANES + j] + (s0 * p40y + s1 * q40y)


@borrowing
def pressure_moments(pieces, most, pitch, share, moments, spare, lanes):
    """Moments of up to ``most`` pieces a lane, normalised to the supported area.

    Args:
        pieces: flat (piece, field, lane) from :func:`collect_pieces`, weightless where a lane has fewer, and one more.
        moments: flat (MOMENT_ROWS, lane), overwritten with them.
        spare: likewise, a working array.
    """
    size = PIECE_FIELDS * LANES
    rounds = (most + 1) // 2
    # The two arrays take turns: begin with the one that leaves the result in ``moments``.
    before, after = (moments, spare) if rounds % 2 == 0 else (spare, moments)
    for k in range(MOMENT_ROWS * LANES):
        before[k] = 0.0
    for k in range(rounds):
        add_pieces(pieces[2 * k * size : 2 * (k + 1) * size], pitch, share, before, after, lanes)
        before, after = after, before
