"""The command of a rival that serves all parts best: least squares of the pushes that they want, near rest.

A stroke of the plate is looked for among centres of rotation all over the table and around it, and directions without
rotation, and then refined; cells are found one after the other, in turns (coordinate descent, which ends at the least squares
within bounds).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.allocation.cut import cut_parts
from vibgym.kernels.jit import borrowing, inlined

SWEEPS = 60
"""Over all cells under parts, most."""

STILL = 1e-6
"""Change of a cell in a sweep below which nothing more is to be won."""

RIDGE = 1e-4
"""Price of a cell's push, squared, over that of an error: of many ways that which takes least."""

HALVINGS = 5
"""Of the steps in which a stroke is refined."""

FAR = 1e9
"""m, about where a centre of rotation lies that stands for no rotation."""


class Strokes(NamedTuple):
    """Strokes that are tried first."""

    stroke: np.ndarray  # (n, 3) of length 1
    centre: np.ndarray  # (n, 2) m, of rotation, from the table's middle; (FAR, angle) without
    step: np.ndarray  # (n, 2) between neighbours, m or rad
    push: np.ndarray  # (n, elements, 2)


@inlined
def served(pieces, count, push, effect):
    """Pushes ``effect`` (parts, 3) that parts get of those of the elements (elements, 2)."""
    effect[:] = 0.0
    for i in range(count):
        p, e = pieces.part[i], pieces.element[i]
        x, y = push[e, 0], push[e, 1]
        effect[p, 0] += pieces.share[i] * x
        effect[p, 1] += pieces.share[i] * y
        effect[p, 2] += pieces.lever[i, 0] * y - pieces.lever[i, 1] * x


@inlined
def gain(effect, wanted, weight, most):
    """What the best strength of a stroke takes off the squared errors, and that strength, in [-most, most]."""
    along, size = 0.0, 1e-12
    for p in range(effect.shape[0]):
        for k in range(3):
            along += weight[p, k] * effect[p, k] * wanted[p, k]
            size += weight[p, k] * effect[p, k] * effect[p, k]
    strength = min(max(along / size, -most), most)
    return strength * (2.0 * along - strength * size), strength


@borrowing
def stroke_about(centre_x, centre_y, half, stroke):
    """Write the stroke (3,) of length 1 about a centre of rotation (m from the middle), or in a direction (FAR, rad)."""
    if centre_x >= FAR:
        stroke[0], stroke[1], stroke[2] = math.cos(centre_y), math.sin(centre_y), 0.0
        return
    length = math.sqrt(half * half + centre_x * centre_x + centre_y * centre_y)
    stroke[0], stroke[1], stroke[2] = centre_y / length, -centre_x / length, half / length


@borrowing
def plate_pushes(stroke, place, half, core, push):
    """Pushes (elements, 2) of a stroke of length 1 on elements at ``place`` (elements, 2), m from the middle."""
    turn = stroke[2] / half
    slow = abs(turn) * core
    for e in range(place.shape[0]):
        x, y = stroke[0] - turn * place[e, 1], stroke[1] + turn * place[e, 0]
        scale = 1.0 / max(max(math.sqrt(x * x + y * y), slow), 1e-12)
        push[e, 0], push[e, 1] = scale * x, scale * y


@borrowing
def fit_strokes(
    start, stop, outlines, pose, present, wanted, weight, most, strokes, place, half, core, pieces, effect, push, found
):
    """The stroke of the plate that serves the parts best, of each world.

    Args:
        start, stop: worlds.
        outlines, pieces: see :func:`vibgym.allocation.cut.cut_parts`.
        pose, present, wanted: (worlds, parts, 3), (worlds, parts), (worlds, parts, 3).
        weight: (worlds, parts, 3) of errors.
        most: strength.
        strokes: :class:`Strokes`.
        place: (elements, 2) m from the middle.  half, core: m, of :class:`.machines.Plate`.
        effect, push: (parts, 3) and (elements, 2), scratch.
        found: (worlds, 3), overwritten.
    """
    for w in range(start, stop):
        found[w] = 0.0
        count = cut_parts(outlines, pose[w], present[w], pieces)
        best, strength, which = 0.0, 0.0, -1
        for k in range(strokes.stroke.shape[0]):
            served(pieces, count, strokes.push[k], effect)
            won, own = gain(effect, wanted[w], weight[w], most)
            if won > best:
                best, strength, which = won, own, k
        if which < 0:
            continue
        a, b = strokes.centre[which, 0], strokes.centre[which, 1]
        da, db = 0.5 * strokes.step[which, 0], 0.5 * strokes.step[which, 1]
        stroke = found[w]
        for _ in range(HALVINGS):
            for turn in range(4):
                x = a + (da if turn == 0 else -da if turn == 1 else 0.0)
                y = b + (db if turn == 2 else -db if turn == 3 else 0.0)
                if a >= FAR and turn < 2:
                    continue
                stroke_about(x, y, half, stroke)
                plate_pushes(stroke, place, half, core, push)
                served(pieces, count, push, effect)
                won, own = gain(effect, wanted[w], weight[w], most)
                if won > best:
                    best, strength, a, b = won, own, x, y
            da, db = 0.5 * da, 0.5 * db
        stroke_about(a, b, half, stroke)
        for k in range(3):
            stroke[k] *= strength


@borrowing
def fit_cells(
    start, stop, outlines, pose, present, wanted, weight, axis, least, most, pieces, following, first, missing, found
):
    """What every cell does along its axis so that the parts are served best, of each world.

    Args:
        start, stop, outlines, pose, present, wanted, weight, pieces: see :func:`fit_strokes`.
        axis: (elements, 2).
        least, most: of what cells do.
        following, first: (room,) and (elements,) int64, scratch: the pieces on each element.
        missing: (parts, 3), scratch.
        found: (worlds, elements), overwritten.
    """
    for w in range(start, stop):
        cell = found[w]
        cell[:] = 0.0
        count = cut_parts(outlines, pose[w], present[w], pieces)
        first[:] = -1
        for i in range(count):
            following[i] = first[pieces.element[i]]
            first[pieces.element[i]] = i
        for p in range(missing.shape[0]):
            for k in range(3):
                missing[p, k] = wanted[w, p, k]
        for _ in range(SWEEPS):
            moved = 0.0
            for e in range(first.shape[0]):
                if first[e] < 0:
                    continue
                x, y = axis[e, 0], axis[e, 1]
                slope, size = -RIDGE * cell[e], RIDGE
                i = first[e]
                while i >= 0:
                    p = pieces.part[i]
                    bx, by = pieces.share[i] * x, pieces.share[i] * y
                    bt = pieces.lever[i, 0] * y - pieces.lever[i, 1] * x
                    slope += weight[w, p, 0] * bx * missing[p, 0] + weight[w, p, 1] * by * missing[p, 1]
                    slope += weight[w, p, 2] * bt * missing[p, 2]
                    size += weight[w, p, 0] * bx * bx + weight[w, p, 1] * by * by + weight[w, p, 2] * bt * bt
                    i = following[i]
                change = min(max(cell[e] + slope / size, least), most) - cell[e]
                if change == 0.0:
                    continue
                cell[e] += change
                moved = max(moved, abs(change))
                i = first[e]
                while i >= 0:
                    p = pieces.part[i]
                    missing[p, 0] -= change * pieces.share[i] * x
                    missing[p, 1] -= change * pieces.share[i] * y
                    missing[p, 2] -= change * (pieces.lever[i, 0] * y - pieces.lever[i, 1] * x)
                    i = following[i]
            if moved < STILL:
                break
