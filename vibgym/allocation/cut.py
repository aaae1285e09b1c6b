"""Exact contact areas of parts on elements: outlines cut by the element grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import Part, Surface
from vibgym.kernels.jit import jit
from vibgym.physics.planar.contact_area import MOMENTS, cut_outline
from vibgym.scene.kinds import Kinds


class Outlines(NamedTuple):
    """Outlines of the kinds of parts, concatenated, and the element grid."""

    kind: (
        np.ndarray
    )  # (worlds, parts) int64, one row where all worlds have the same parts, see vibgym.scene.kinds; live
    vertex: np.ndarray  # (all vertices, 2) m, of kind k from first[k] to first[k + 1]
    first: np.ndarray  # (kinds + 1,) int64
    area: np.ndarray  # (kinds,) m^2, of the polygon
    gyration: np.ndarray  # (kinds,) radius of gyration, m
    radius: np.ndarray  # (kinds,) of the outlines, m
    rows: int
    columns: int
    element_size: float  # m


class Pieces(NamedTuple):
    """Pieces of a world's parts, each the area of a part on an element; the first ``count`` rows are used."""

    part: np.ndarray  # (room,) int64
    element: np.ndarray  # (room,) int64, row times columns plus column
    share: np.ndarray  # (room,) of the part's area; a part's shares add up to 1 if it is wholly on the surface
    lever: np.ndarray  # (room, 2) share times centroid about the part's centre, in radii of gyration
    x: np.ndarray  # (vertices,) scratch: a part's outline, in elements
    y: np.ndarray
    cells: np.ndarray  # (cells, MOMENTS) and (4,) scratch, see vibgym.physics.planar.contact_area.cut_outline
    box: np.ndarray


def outlines_of(surface: Surface, parts: Sequence[Part]) -> Outlines:
    """Return the parts' outlines for :func:`cut_parts`."""
    kinds = Kinds.of(parts)
    shapes = [part.outline for part in kinds.every]
    vertex = np.concatenate(shapes)
    first = np.cumsum([0, *(len(shape) for shape in shapes)])
    area = np.empty(len(shapes))
    for k, shape in enumerate(shapes):
        x, y = shape.T
        area[k] = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
    gyration = np.sqrt([part.gyration for part in kinds.every])
    radius = np.array([part.radius for part in kinds.every])
    grid = surface.rows, surface.columns, surface.element_size
    return Outlines(kinds.kind, vertex, first, area, gyration, radius, *grid)


def new_pieces(surface: Surface, parts: Sequence[Part]) -> Pieces:
    """Allocate the pieces of one world."""
    largest = Kinds.of(parts).largest(lambda part: part.radius)
    across = [math.floor(2.0 * part.radius / surface.element_size) + 2 for part in largest]
    room, corners = sum(count**2 for count in across), max(len(part.outline) for part in Kinds.of(parts).every)
    # Rounding may place the outline in one more row and column.
    cells, box = np.zeros(((max(across) + 1) ** 2, MOMENTS)), np.zeros(4, dtype=np.int64)
    (part, element), (x, y) = np.zeros((2, room), dtype=np.int64), np.zeros((2, corners))
    return Pieces(part, element, np.zeros(room), np.zeros((room, 2)), x, y, cells, box)


@jit
def cut_parts(outlines, world, pose, present, pieces):
    """Cut the parts of a world at ``pose`` (parts, 3) into ``pieces``, in the order of the parts; returns their number."""
    kinds = outlines.kind[min(world, outlines.kind.shape[0] - 1)]
    vertex, first, size = outlines.vertex, outlines.first, outlines.element_size
    cells, box, count = pieces.cells, pieces.box, 0
    for p in range(pose.shape[0]):
        kind = kinds[p]
        x, y, heading, reach = pose[p, 0] / size, pose[p, 1] / size, pose[p, 2], outlines.radius[kind] / size
        near = x > -reach and y > -reach and x < outlines.columns + reach and y < outlines.rows + reach
        if not (present[p] and near and abs(heading) < math.inf):
            continue
        cosine, sine, n = math.cos(heading) / size, math.sin(heading) / size, first[kind + 1] - first[kind]
        for k in range(n):
            dx, dy = vertex[first[kind] + k, 0], vertex[first[kind] + k, 1]
            pieces.x[k], pieces.y[k] = x + cosine * dx - sine * dy, y + sine * dx + cosine * dy
        cut_outline(pieces.x[:n], pieces.y[:n], cells, box)
        whole = outlines.area[kind] / (size * size)
        per_area, per_lever = 1.0 / whole, size / (whole * outlines.gyration[kind])
        for i in range(box[3]):
            row, height, height_y = box[1] + i, 0.0, 0.0
            for j in range(box[2] - 1, -1, -1):
                cell, column = cells[i * box[2] + j], box[0] + j
                area = cell[0] + height
                on_table = 0 <= row < outlines.rows and 0 <= column < outlines.columns
                if on_table and area > 1e-9 * whole:
                    pieces.part[count], pieces.element[count] = p, row * outlines.columns + column
                    pieces.share[count] = per_area * area
                    pieces.lever[count, 0] = per_lever * (cell[1] + 0.5 * height + (column - x) * area)
                    pieces.lever[count, 1] = per_lever * (cell[2] + height_y + (row - y) * area)
                    count += 1
                height += cell[6]
                height_y += cell[7]
    return count


@jit
def effects(outlines, pose, present, push, gain, pieces, effect):
    """Compute the effect on the parts, near rest and to first order, see :meth:`vibgym.allocation.Allocator.effect`.

    Args:
        outlines: of :func:`vibgym.allocation.cut.outlines_of`.
        pose: (worlds, parts, 3).  present: (worlds, parts) bool.
        push: (worlds, elements, 2) over full amplitude.
        gain: (worlds or 1, elements) gains from commanded to actual phasors.
        pieces: scratch.
        effect: (worlds, parts, 3), overwritten.
    """
    for w in range(pose.shape[0]):
        effect[w], strength = 0.0, gain[min(w, gain.shape[0] - 1)]
        for i in range(cut_parts(outlines, w, pose[w], present[w], pieces)):
            p, e = pieces.part[i], pieces.element[i]
            x, y = strength[e] * push[w, e, 0], strength[e] * push[w, e, 1]
            effect[w, p, 0] += pieces.share[i] * x
            effect[w, p, 1] += pieces.share[i] * y
            effect[w, p, 2] += pieces.lever[i, 0] * y - pieces.lever[i, 1] * x


@jit
def reaches(outlines, pose, present, pieces, reach):
    """Compute the largest pushes that turn parts, see :meth:`vibgym.allocation.Allocator.reach`.

    Args:
        outlines, pose, present, pieces: see :func:`effects`.
        reach: (worlds, parts), overwritten.
    """
    for w in range(pose.shape[0]):
        reach[w] = 0.0
        for i in range(cut_parts(outlines, w, pose[w], present[w], pieces)):
            reach[w, pieces.part[i]] += (pieces.lever[i, 0] ** 2 + pieces.lever[i, 1] ** 2) ** 0.5
