"""Subpixel measurement: the grey level of a pixel at an edge is proportional to its covered area.

Pixels inside an object count in full, pixels outside not at all. Noise therefore enters only from a band around the boundary,
which is wide enough for the blur of the lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.plugins.camera.objects import Found, shift_moments


class Grey(NamedTuple):
    """Relation of grey levels to coverage."""

    level: np.ndarray  # (lines, columns) float32 of the empty surface, known from the reference image
    contrast: float  # 1 - dark: share of the level that a part removes
    lines: int  # half width of the band
    columns: int
    fine: bool  # whether grey levels are used; False: pixels belong to the object wholly or not at all


@jit
def _is_nearest(blobs, number, line, column, reach_l, reach_c):
    """Return whether the nearest labelled pixel around a pixel belongs to this object."""
    mine, other = 1 << 30, 1 << 30
    for l in range(max(line - reach_l, 0), min(line + reach_l + 1, blobs.label.shape[0])):  # noqa: E741
        for c in range(max(column - reach_c, 0), min(column + reach_c + 1, blobs.label.shape[1])):
            if blobs.label[l, c] != 0:
                away = (l - line) ** 2 + (c - column) ** 2
                if blobs.label[l, c] == number + 1:
                    mine = min(mine, away)
                else:
                    other = min(other, away)
    return mine <= other


@jit(allocates=True)
def shares(grey: np.ndarray, meaning: Grey, blobs: Found, number: int):
    """Return the covered share of every pixel around an object.

    Returns:
        (lines, columns) float64, and the line and column of its first pixel.
    """
    box, reach_l, reach_c = blobs.box[number], meaning.lines, meaning.columns
    if not meaning.fine:
        reach_l, reach_c = 0, 0
    top, bottom = max(box[0] - reach_l, 0), min(box[1] + reach_l, grey.shape[0])
    left, right = max(box[2] - reach_c, 0), min(box[3] + reach_c, grey.shape[1])
    share = np.zeros((bottom - top, right - left))
    runs = blobs.run[blobs.first[number] : blobs.first[number + 1]]
    if not meaning.fine:
        for k in range(runs.shape[0]):
            for column in range(runs[k, 1], runs[k, 2]):
                share[runs[k, 0] - top, column - left] = 1.0
        return share, top, left
    # First along lines: pixels near a run, and pixels well inside one.
    near = np.zeros(share.shape, dtype=np.uint8)
    deep = np.zeros(share.shape, dtype=np.uint8)
    for k in range(runs.shape[0]):
        line = runs[k, 0] - top
        for column in range(max(runs[k, 1] - reach_c, left), min(runs[k, 2] + reach_c, right)):
            near[line, column - left] = 1
        for column in range(runs[k, 1] + reach_c, runs[k, 2] - reach_c):
            deep[line, column - left] = 1
    crowded = False
    for line in range(max(top - reach_l, 0), min(bottom + reach_l, grey.shape[0])):  # within reach of the band
        for column in range(max(left - reach_c, 0), min(right + reach_c, grey.shape[1])):
            label = blobs.label[line, column]
            crowded = crowded or (label != 0 and label != number + 1)
    band, core = np.empty(share.shape[1], dtype=np.uint8), np.empty(share.shape[1], dtype=np.uint8)
    for line in range(share.shape[0]):
        band[:] = 0
        core[:] = 1 if reach_l <= line < share.shape[0] - reach_l else 0
        for other in range(max(line - reach_l, 0), min(line + reach_l + 1, share.shape[0])):
            for column in range(share.shape[1]):
                band[column] |= near[other, column]
                core[column] &= deep[other, column]
        for column in range(share.shape[1]):
            if core[column]:
                share[line, column] = 1.0
            elif band[column]:
                bare = grey[line + top, column + left] / meaning.level[line + top, column + left]
                share[line, column] = (1.0 - bare) / meaning.contrast
    if crowded:
        for line in range(share.shape[0]):
            for column in range(share.shape[1]):
                if share[line, column] != 0.0 and blobs.label[line + top, column + left] != number + 1:
                    if not _is_nearest(blobs, number, line + top, column + left, reach_l, reach_c):
                        share[line, column] = 0.0
    return share, top, left


@jit
def share_moments(share, top, left, moment):
    """Return moments (6,) M00, M10, M01, M20, M11, M02 of the shares, about the image's first pixel."""
    middle_l, middle_c = top + 0.5 * (share.shape[0] - 1), left + 0.5 * (share.shape[1] - 1)
    moment[:] = 0.0
    for line in range(share.shape[0]):
        y = line + top - middle_l
        s0, s1, s2 = 0.0, 0.0, 0.0
        for column in range(share.shape[1]):
            x, value = column + left - middle_c, share[line, column]
            s0 += value
            s1 += value * x
            s2 += value * x * x
        moment[0] += s0
        moment[1] += s1
        moment[2] += y * s0
        moment[3] += s2
        moment[4] += y * s1
        moment[5] += y * y * s0
    shift_moments(moment, middle_c, middle_l)


@jit
def complex_moment(share, top, left, column, line, jacobian, order):
    """Return the sum of share times z^order, where z = x + i y is the position of a pixel from (column, line), m.

    For order 2 its angle is twice that of the principal axis (eq. 5.7). Of a part with n-fold symmetry, orders below n vanish.
    """
    total_re, total_im = 0.0, 0.0
    for l in range(share.shape[0]):  # noqa: E741
        for c in range(share.shape[1]):
            if share[l, c] != 0.0:
                u, v = c + left - column, l + top - line
                x, y = jacobian[0] * u + jacobian[1] * v, jacobian[2] * u + jacobian[3] * v
                re, im = 1.0, 0.0
                for _ in range(order):
                    re, im = re * x - im * y, re * y + im * x
                total_re += share[l, c] * re
                total_im += share[l, c] * im
    return total_re, total_im
