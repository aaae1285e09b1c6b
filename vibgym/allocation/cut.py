"""Exact contact areas of parts on elements: outlines cut by the element grid; and aprons.

Plates circle with the table and parts travel within a step, so a part reaches elements that do not carry it yet. If these
rested, a rigid part would meet a step in height. Elements in the apron around a part therefore continue the field under it, a
uniform push and a rotation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym import Part, Surface
from vibgym.kernels.jit import borrowing


class Outlines(NamedTuple):
    """Outlines of all parts, concatenated, and the element grid."""

    vertex: np.ndarray  # (all vertices, 2) m, of part p from first[p] to first[p + 1]
    first: np.ndarray  # (parts + 1,) int64
    area: np.ndarray  # (parts,) m^2, of the polygon
    gyration: np.ndarray  # (parts,) radius of gyration, m
    rows: int
    columns: int
    element_size: float  # m


class Pieces(NamedTuple):
    """Pieces of a world's parts, each the area of a part on an element; the first ``count`` rows are used."""

    part: np.ndarray  # (room,) int64
    element: np.ndarray  # (room,) int64, row times columns plus column
    share: np.ndarray  # (room,) of the part's area; a part's shares add up to 1 if it is wholly on the surface
    lever: np.ndarray  # (room, 2) share times centroid about the part's centre, in radii of gyration
    strip: np.ndarray  # (vertices, 2) scratch: outline clipped to a column, and its further cuts
    cell: np.ndarray
    spare: np.ndarray


def outlines_of(surface: Surface, parts: tuple[Part, ...], apron: float = 0.0) -> Outlines:
    """Return the parts' outlines for :func:`cut_parts`, moved ``apron`` m away from the centre of mass."""
    reach = [np.hypot(*part.outline.T)[:, None] for part in parts]
    vertex = np.concatenate([part.outline * (1.0 + apron / far) for part, far in zip(parts, reach, strict=True)])
    first = np.cumsum([0, *(len(part.outline) for part in parts)])
    area = np.empty(len(parts))
    for p, part in enumerate(parts):
        x, y = part.outline.T
        area[p] = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
    gyration = np.sqrt([part.gyration for part in parts])
    return Outlines(vertex, first, area, gyration, surface.rows, surface.columns, surface.element_size)


def new_pieces(surface: Surface, parts: tuple[Part, ...], apron: float = 0.0) -> Pieces:
    """Allocate the pieces of one world, for outlines with such an apron."""
    room = sum((math.floor(2.0 * (part.radius + apron) / surface.element_size) + 2) ** 2 for part in parts)
    # Each of four cuts keeps at most every vertex and adds at most one per edge.
    most = 16 * max(len(part.outline) for part in parts)
    whole = np.zeros((2, room), dtype=np.int64)
    scratch = np.empty((3, most, 2))
    return Pieces(whole[0], whole[1], np.zeros(room), np.zeros((room, 2)), scratch[0], scratch[1], scratch[2])


@borrowing
def cut_along(source, count, axis, place, side, result):
    """Clip a polygon (count, 2) below (``side`` 1) or above (-1) ``place`` along an axis; returns the number of vertices."""
    kept = 0
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        here, there = side * (place - source[k, axis]), side * (place - source[j, axis])
        if here >= 0.0:
            result[kept, 0], result[kept, 1] = source[k, 0], source[k, 1]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            part = here / (here - there)
            other = 1 - axis
            result[kept, axis] = place
            result[kept, other] = source[k, other] + part * (source[j, other] - source[k, other])
            kept += 1
    return kept


@borrowing
def cut_parts(outlines, pose, present, pieces):
    """Cut the parts of one world at ``pose`` (parts, 3) into ``pieces``; returns their number."""
    vertex, first, size = outlines.vertex, outlines.first, outlines.element_size
    strip, cell, spare = pieces.strip, pieces.cell, pieces.spare
    count = 0
    for p in range(pose.shape[0]):
        if not present[p]:
            continue
        cosine, sine, n = math.cos(pose[p, 2]), math.sin(pose[p, 2]), first[p + 1] - first[p]
        low, high = math.inf, -math.inf
        for k in range(n):
            x = pose[p, 0] + cosine * vertex[first[p] + k, 0] - sine * vertex[first[p] + k, 1]
            low, high = min(low, x), max(high, x)
        left, right = max(int(math.floor(low / size)), 0), min(int(math.floor(high / size)), outlines.columns - 1)
        for column in range(left, right + 1):
            low, high = math.inf, -math.inf
            for k in range(n):
                dx, dy = vertex[first[p] + k, 0], vertex[first[p] + k, 1]
                spare[k, 0] = pose[p, 0] + cosine * dx - sine * dy
                spare[k, 1] = pose[p, 1] + sine * dx + cosine * dy
            m = cut_along(spare, n, 0, column * size, -1.0, cell)
            m = cut_along(cell, m, 0, (column + 1) * size, 1.0, strip)
            for k in range(m):
                low, high = min(low, strip[k, 1]), max(high, strip[k, 1])
            if m == 0:
                continue
            bottom, top = max(int(math.floor(low / size)), 0), min(int(math.floor(high / size)), outlines.rows - 1)
            for row in range(bottom, top + 1):
                m_row = cut_along(strip, m, 1, row * size, -1.0, spare)
                m_row = cut_along(spare, m_row, 1, (row + 1) * size, 1.0, cell)
                area, ax, ay = 0.0, 0.0, 0.0
                for k in range(m_row):
                    j = k + 1 if k + 1 < m_row else 0
                    x0, y0 = cell[k, 0] - pose[p, 0], cell[k, 1] - pose[p, 1]
                    x1, y1 = cell[j, 0] - pose[p, 0], cell[j, 1] - pose[p, 1]
                    cross = x0 * y1 - x1 * y0
                    area += 0.5 * cross
                    ax += cross * (x0 + x1) / 6.0
                    ay += cross * (y0 + y1) / 6.0
                if area <= 1e-9 * outlines.area[p]:
                    continue
                pieces.part[count], pieces.element[count] = p, row * outlines.columns + column
                pieces.share[count] = area / outlines.area[p]
                pieces.lever[count, 0] = ax / (outlines.area[p] * outlines.gyration[p])
                pieces.lever[count, 1] = ay / (outlines.area[p] * outlines.gyration[p])
                count += 1
    return count


@borrowing
def field_under(pieces, first, last, columns, push):
    """Fit a uniform push and a turn to the elements' pushes (rows, columns, 2) under one part.

    Args:
        pieces, first, last: pieces of the part.

    Returns:
        Push x and y, and turn; an element at ``r`` radii of gyration gets ``turn z^ x r``.
    """
    area, x, y, torque, square = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first, last):
        e, share, ax, ay = pieces.element[i], pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1]
        px, py = push[e // columns, e % columns, 0], push[e // columns, e % columns, 1]
        area, x, y = area + share, x + share * px, y + share * py
        torque += ax * py - ay * px
        square += (ax * ax + ay * ay) / share
    return x / area, y / area, torque / max(square, 1e-300)


@borrowing
def spread_fields(start, stop, outlines, grown, least, most, pose, present, pieces, around, mark, push):
    """Continue the parts' fields on the free elements around them.

    Args:
        start, stop: worlds.
        outlines, grown: of :func:`vibgym.allocation.cut.outlines_of`, of the parts and of parts as large as their aprons.
        least, most: amplitudes of elements that move, over the surface's largest.
        pose: (worlds, parts, 3).  present: (worlds, parts) bool.
        pieces, around: scratch, for parts and for aprons.
        mark: (elements,) bool scratch, False, and left so.
        push: (worlds, rows, columns, 2), changed in place.
    """
    columns = outlines.columns
    for w in range(start, stop):
        count, beside = cut_parts(outlines, pose[w], present[w], pieces), cut_parts(grown, pose[w], present[w], around)
        for i in range(count):
            mark[pieces.element[i]] = True
        first, at = 0, 0
        while first < count:  # pieces are in the order of the parts
            part, last = pieces.part[first], first
            while last < count and pieces.part[last] == part:
                last += 1
            x, y, turn = field_under(pieces, first, last, columns, push[w])
            first = last
            while at < beside and around.part[at] <= part:
                e, share, mine = around.element[at], around.share[at], around.part[at] == part
                ax, ay = around.lever[at, 0] / share, around.lever[at, 1] / share
                at += 1
                if mark[e] or not mine:
                    continue
                px, py = x - turn * ay, y + turn * ax
                size = math.sqrt(px * px + py * py)
                scale = min(size, most) / size if size > 0.0 and size >= least else 0.0
                push[w, e // columns, e % columns, 0], push[w, e // columns, e % columns, 1] = scale * px, scale * py
                mark[e] = True  # belongs to the first part
        for j in range(beside):
            mark[around.element[j]] = False
        for i in range(count):
            mark[pieces.element[i]] = False


@borrowing
def effects(outlines, pose, present, push, gain, pieces, effect):
    """Compute the effect on the parts, near rest and to first order, see :meth:`vibgym.allocation.Allocator.effect`.

    Args:
        outlines: of :func:`vibgym.allocation.cut.outlines_of`.
        pose: (worlds, parts, 3).  present: (worlds, parts) bool.
        push: (worlds, elements, 2) over full amplitude.
        gain: (worlds, elements) gains from commanded to actual phasors.
        pieces: scratch.
        effect: (worlds, parts, 3), overwritten.
    """
    for w in range(pose.shape[0]):
        effect[w] = 0.0
        for i in range(cut_parts(outlines, pose[w], present[w], pieces)):
            p, e = pieces.part[i], pieces.element[i]
            x, y = gain[w, e] * push[w, e, 0], gain[w, e] * push[w, e, 1]
            effect[w, p, 0] += pieces.share[i] * x
            effect[w, p, 1] += pieces.share[i] * y
            effect[w, p, 2] += pieces.lever[i, 0] * y - pieces.lever[i, 1] * x


@borrowing
def reaches(outlines, pose, present, pieces, reach):
    """Compute the largest pushes that turn parts, see :meth:`vibgym.allocation.Allocator.reach`.

    Args:
        outlines, pose, present, pieces: see :func:`effects`.
        reach: (worlds, parts), overwritten.
    """
    for w in range(pose.shape[0]):
        reach[w] = 0.0
        for i in range(cut_parts(outlines, pose[w], present[w], pieces)):
            reach[w, pieces.part[i]] += (pieces.lever[i, 0] ** 2 + pieces.lever[i, 1] ** 2) ** 0.5
