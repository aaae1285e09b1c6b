"""Fit a machine's command to the wanted pushes of all parts near rest, by least squares.

A stroke of the plate is searched among centres of rotation on and around the table and directions without rotation, and then
refined. Pushes of cells are found by coordinate descent, which converges to the bounded least-squares solution.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.allocation.cut import cut_parts
from vibgym.kernels.jit import jit

SWEEPS = 60
"""Maximum number of sweeps of the coordinate descent."""

STILL = 1e-6
"""Change of a cell in a sweep at which the descent has converged."""

RIDGE = 1e-4
"""Weight of squared pushes relative to squared errors (ridge regularization)."""

HALVINGS = 5
"""Number of times the step is halved in the refinement of a stroke."""

FAR = 1e9
"""m, coordinate of the centre of rotation that marks a stroke without rotation."""


class Strokes(NamedTuple):
    """Strokes of the initial search."""

    stroke: np.ndarray  # (n, 3) of length 1
    centre: np.ndarray  # (n, 2) centre of rotation, m from the table's middle; (FAR, angle) without rotation
    step: np.ndarray  # (n, 2) spacing, m or rad
    push: np.ndarray  # (n, elements, 2)


@jit(inline=True)
def effect_of(pieces, count, push, effect):
    """Write the pushes ``effect`` (parts, 3) on parts due to the pushes ``push`` (elements, 2) of the elements."""
    effect[:] = 0.0
    for i in range(count):
        p, e = pieces.part[i], pieces.element[i]
        x, y = push[e, 0], push[e, 1]
        effect[p, 0] += pieces.share[i] * x
        effect[p, 1] += pieces.share[i] * y
        effect[p, 2] += pieces.lever[i, 0] * y - pieces.lever[i, 1] * x


@jit(inline=True)
def gain(effect, wanted, weight, most):
    """Return the decrease of the squared errors at the best strength of a stroke, and that strength, in [-most, most]."""
    along, size = 0.0, 1e-12
    for p in range(effect.shape[0]):
        for k in range(3):
            along += weight[p, k] * effect[p, k] * wanted[p, k]
            size += weight[p, k] * effect[p, k] * effect[p, k]
    strength = min(max(along / size, -most), most)
    return strength * (2.0 * along - strength * size), strength


@jit
def stroke_about(centre_x, centre_y, half, stroke):
    """Write the stroke (3,) of length 1 about a centre of rotation (m from the middle) or in a direction (FAR, rad)."""
    if centre_x >= FAR:
        stroke[0], stroke[1], stroke[2] = math.cos(centre_y), math.sin(centre_y), 0.0
        return
    length = math.sqrt(half * half + centre_x * centre_x + centre_y * centre_y)
    stroke[0], stroke[1], stroke[2] = centre_y / length, -centre_x / length, half / length


@jit
def plate_pushes(stroke, place, half, core, push):
    """Write the pushes (elements, 2) of a stroke of length 1 at ``place`` (elements, 2), m from the middle."""
    turn = stroke[2] / half
    slow = abs(turn) * core
    for e in range(place.shape[0]):
        x, y = stroke[0] - turn * place[e, 1], stroke[1] + turn * place[e, 0]
        scale = 1.0 / max(max(math.sqrt(x * x + y * y), slow), 1e-12)
        push[e, 0], push[e, 1] = scale * x, scale * y


@jit
def fit_strokes(
    start, stop, outlines, pose, present, wanted, weight, most, strokes, place, half, core, pieces, effect, push, result
):
    """Write the stroke with the smallest weighted squared error of each world.

    Args:
        start, stop: range of worlds.
        outlines, pieces: see :func:`vibgym.allocation.cut.cut_parts`.
        pose, present, wanted: (worlds, parts, 3), (worlds, parts), (worlds, parts, 3).
        weight: (worlds, parts, 3) weights of squared errors.
        most: largest strength.
        strokes: :class:`Strokes`.
        place: (elements, 2) centres of the elements, m from the middle.
        half, core: see :class:`.machines.Plate`, m.
        effect, push: (parts, 3) and (elements, 2), scratch.
        result: (worlds, 3) output.
    """
    for w in range(start, stop):
        result[w] = 0.0
        count = cut_parts(outlines, w, pose[w], present[w], pieces)
        best, strength, which = 0.0, 0.0, -1
        for k in range(strokes.stroke.shape[0]):
            effect_of(pieces, count, strokes.push[k], effect)
            decrease, best_strength = gain(effect, wanted[w], weight[w], most)
            if decrease > best:
                best, strength, which = decrease, best_strength, k
        if which < 0:
            continue
        a, b = strokes.centre[which, 0], strokes.centre[which, 1]
        da, db = 0.5 * strokes.step[which, 0], 0.5 * strokes.step[which, 1]
        stroke = result[w]
        for _ in range(HALVINGS):
            for turn in range(4):
                x = a + (da if turn == 0 else -da if turn == 1 else 0.0)
                y = b + (db if turn == 2 else -db if turn == 3 else 0.0)
                if a >= FAR and turn < 2:
                    continue
                stroke_about(x, y, half, stroke)
                plate_pushes(stroke, place, half, core, push)
                effect_of(pieces, count, push, effect)
                decrease, best_strength = gain(effect, wanted[w], weight[w], most)
                if decrease > best:
                    best, strength, a, b = decrease, best_strength, x, y
            da, db = 0.5 * da, 0.5 * db
        stroke_about(a, b, half, stroke)
        for k in range(3):
            stroke[k] *= strength


@jit
def fit_cells(
    start, stop, outlines, pose, present, wanted, weight, axis, least, most, pieces, following, first, missing, result
):
    """Write the pushes of all cells along their axes with the smallest weighted squared error of each world.

    Args:
        start, stop, outlines, pose, present, wanted, weight, pieces: see :func:`fit_strokes`.
        axis: (elements, 2) unit vectors.
        least, most: bounds of the pushes.
        following, first: (pieces,) and (elements,) int64, scratch: linked lists of the pieces on each element.
        missing: (parts, 3), scratch.
        result: (worlds, elements) output.
    """
    for w in range(start, stop):
        cell = result[w]
        cell[:] = 0.0
        count = cut_parts(outlines, w, pose[w], present[w], pieces)
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
