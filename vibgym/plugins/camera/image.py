"""Synthesis of the camera's image: coverage, blur, uneven light, noise of the pixels, eight bits.

Parts are dark tops at their height over a light surface; their sides are as light as the surface. The grey level of a pixel is
``level * (dark + (1 - dark) * bare)``, with the ``level`` of the empty surface and the uncovered share ``bare``. A sample draws
only the boxes around the parts; the rest of the canvas holds the empty surface.

The covered area of pixels is exact: each edge adds to the pixels that it crosses its contribution to the area right of it
(Green's theorem, line by line), and a running sum along the line gives the coverage (R. Levien, font-rs, 2016; S. Barrett,
stb_truetype 2, 2015).
"""

from __future__ import annotations

import functools
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.noise import philox
from vibgym.plugins.camera.optics import Optics, project

PIECE = 8.0
"""px: edges are cut into pieces of at most this length, since lenses bend them. At 1 % distortion a piece is straight to
0.001 px."""

BOTH, EVEN, ODD = -1, 0, 1
"""Lines of the image that are taken at one instant."""

_BLOCK = 8
"""Columns per counter of the random generator."""

PIXEL_NOISE = 0
"""Last word of the counters of pixel noise."""

_MAX = 1e7
"""px, largest coordinate that is drawn."""


class Shapes(NamedTuple):
    """Tops of the kinds of parts."""

    kind: np.ndarray  # (parts,) of the current world
    outline: np.ndarray  # (all corners, 2) m
    first: np.ndarray  # (kinds + 1,) of each kind's corners
    height: np.ndarray  # (kinds,) m


class Exposure(NamedTuple):
    """Radiometry of an image."""

    level: np.ndarray  # (lines, columns) float32 grey levels of the empty surface
    dark: float  # grey level of parts over that of the surface
    across: np.ndarray  # weights of the blur along a line, an odd number
    along: np.ndarray  # weights of the blur across lines
    noise: float  # grey levels, standard deviation
    quantiles: np.ndarray  # (65536,) float32 of the standard normal distribution


class Canvas(NamedTuple):
    """Buffers of an image; between two samples they hold the empty surface."""

    bare: np.ndarray  # (lines, columns) float32 uncovered share
    grey: np.ndarray  # (lines, columns) uint8


@functools.cache
def normal_quantiles() -> np.ndarray:
    """Return (65536,) float32 quantiles of the standard normal distribution, at the middles of equal intervals."""
    half = [NormalDist().inv_cdf((k + 0.5) / 65536.0) for k in range(32768)]
    return np.array(half + [-value for value in reversed(half)], dtype=np.float32)


def blur_weights(sigma: float) -> np.ndarray:
    """Return weights of a Gaussian blur of ``sigma`` pixels: integrals over pixels, within three sigma."""
    if sigma == 0.0:
        return np.ones(1)
    reach = math.ceil(3.0 * sigma)
    edges = (np.arange(2 * reach + 2) - reach - 0.5) / (sigma * math.sqrt(2.0))
    weights = np.diff([math.erf(edge) for edge in edges])
    return weights / weights.sum()


def weights_variance(weights: np.ndarray) -> float:
    """Return the second moment of blur weights, px^2."""
    place = np.arange(len(weights)) - len(weights) // 2
    return float((weights * place**2).sum())


@jit
def _blur(cover, weights, axis, scratch):
    """Convolve ``cover`` along an axis, with zeros beyond its borders."""
    reach = weights.shape[0] // 2
    if reach == 0:
        return
    lines, columns = cover.shape
    scratch[:] = 0.0
    for k in range(-reach, reach + 1):
        weight = weights[k + reach]
        if axis == 1:
            for line in range(lines):
                for column in range(max(0, -k), min(columns, columns - k)):
                    scratch[line, column] += weight * cover[line, column + k]
        else:
            for line in range(max(0, -k), min(lines, lines - k)):
                for column in range(columns):
                    scratch[line, column] += weight * cover[line + k, column]
    for line in range(lines):
        for column in range(columns):
            cover[line, column] = scratch[line, column]


@jit(allocates=True)
def seen_outline(optics: Optics, outline: np.ndarray, pose: np.ndarray, height: float):
    """Return the outline in the image (n, 2), its edges cut into short pieces; empty if it is far outside."""
    count = outline.shape[0]
    corners = np.empty((count + 1, 4))
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    total = 0
    for k in range(count + 1):
        x, y = outline[k % count, 0], outline[k % count, 1]
        corners[k, 0], corners[k, 1] = pose[0] + cosine * x - sine * y, pose[1] + sine * x + cosine * y
        corners[k, 2], corners[k, 3] = project(optics, corners[k, 0], corners[k, 1], height)
        if not abs(corners[k, 2]) + abs(corners[k, 3]) < _MAX:
            return np.empty((0, 2))
        if k:
            length = math.hypot(corners[k, 2] - corners[k - 1, 2], corners[k, 3] - corners[k - 1, 3])
            total += max(math.ceil(length / PIECE), 1)
    places = np.empty((total, 2))
    at = 0
    for k in range(1, count + 1):
        length = math.hypot(corners[k, 2] - corners[k - 1, 2], corners[k, 3] - corners[k - 1, 3])
        pieces = max(math.ceil(length / PIECE), 1)
        places[at, 0], places[at, 1] = corners[k - 1, 2], corners[k - 1, 3]
        for piece in range(1, pieces):
            t = piece / pieces
            x = corners[k - 1, 0] + t * (corners[k, 0] - corners[k - 1, 0])
            y = corners[k - 1, 1] + t * (corners[k, 1] - corners[k - 1, 1])
            places[at + piece, 0], places[at + piece, 1] = project(optics, x, y, height)
        at += pieces
    return places


@jit(allocates=True)
def hide(places: np.ndarray, exposure: Exposure, lines_seen: int, bare: np.ndarray, box: np.ndarray) -> bool:
    """Subtract the polygon ``places`` from ``bare``, on even, odd or both lines.

    Args:
        box: (4,) first line, line after the last, first column, column after the last of the changed region; overwritten.

    Returns:
        Whether the polygon touches the image.
    """
    lines, columns = bare.shape
    box[:] = 0
    if places.shape[0] == 0:
        return False
    margin_l, margin_c = exposure.along.shape[0] // 2 + 1, exposure.across.shape[0] // 2 + 1
    low, high, first, last = math.inf, -math.inf, math.inf, -math.inf
    for k in range(places.shape[0]):
        low, high = min(low, places[k, 1]), max(high, places[k, 1])
        first, last = min(first, places[k, 0]), max(last, places[k, 0])
    top, bottom = math.floor(low) - margin_l, math.ceil(high) + margin_l + 1
    left, right = math.floor(first) - margin_c, math.ceil(last) + margin_c + 2
    if bottom <= 0 or top >= lines or right <= 0 or left >= columns:
        return False
    cover = np.zeros((bottom - top, right - left))
    add_polygon(places, places.shape[0], left, top, cover)
    scratch = np.empty_like(cover)
    _blur(cover, exposure.across, 1, scratch)
    _blur(cover, exposure.along, 0, scratch)
    for line in range(max(top, 0), min(bottom, lines)):
        if lines_seen == BOTH or (line & 1) == lines_seen:
            for column in range(max(left, 0), min(right, columns)):
                bare[line, column] *= 1.0 - cover[line - top, column - left]
    # Noise is drawn by blocks of columns.
    box[0], box[1] = max(top, 0), min(bottom, lines)
    box[2], box[3] = max(left, 0) // _BLOCK * _BLOCK, min((right + _BLOCK - 1) // _BLOCK * _BLOCK, columns)
    return True


@jit(allocates=True)
def expose(exposure: Exposure, box: np.ndarray, key: np.ndarray, sample: int, canvas: Canvas) -> None:
    """Compute the grey levels within a box from ``bare``, with the noise of the sample, which does not depend on the box.

    Args:
        box: (4,) as from :func:`hide`; its columns begin and end with a block, or with the image.
    """
    level, noise = exposure.level, np.float32(exposure.noise)
    dark, light, half = np.float32(exposure.dark), np.float32(1.0 - exposure.dark), np.float32(0.5)
    least, most = np.float32(0.0), np.float32(255.0)
    word = np.zeros(4, dtype=np.int64)
    for line in range(box[0], box[1]):
        for first in range(box[2], box[3], _BLOCK):
            if noise > 0.0:
                word[0], word[1], word[2], word[3] = philox(key, sample, line, first // _BLOCK, PIXEL_NOISE)
            for k in range(min(_BLOCK, box[3] - first)):
                index = (word[k >> 1] >> (16 * (k & 1))) & 0xFFFF
                value = level[line, first + k] * (dark + light * canvas.bare[line, first + k])
                value += noise * exposure.quantiles[index] + half
                canvas.grey[line, first + k] = np.uint8(min(max(value, least), most))


@jit(allocates=True)
def draw(
    optics: Optics, shapes: Shapes, exposure: Exposure, pose: np.ndarray, earlier: np.ndarray, shown: np.ndarray,
    key: np.ndarray, sample: int, canvas: Canvas, boxes: np.ndarray,
) -> None:  # fmt: skip
    """Draw the parts of one world, and write the changed regions to ``boxes``.

    Args:
        pose: (parts, 3) when the even lines are taken.
        earlier: (parts, 3) when the odd lines are; (0, 3) if all are taken at once.
        shown: (parts,) bool.
        boxes: (parts, 2, 4) int64, see :func:`hide`; for even and for odd lines.
    """
    halves = 1 if earlier.shape[0] == 0 else 2
    for p in range(pose.shape[0]):
        kind = shapes.kind[p]
        outline = shapes.outline[shapes.first[kind] : shapes.first[kind + 1]]
        boxes[p] = 0
        for half in range(2):  # the even lines, or all of them, and the odd ones
            if shown[p] and half < halves:
                places = seen_outline(optics, outline, pose[p] if half == 0 else earlier[p], shapes.height[kind])
                hide(places, exposure, BOTH if halves == 1 else half, canvas.bare, boxes[p, half])
    for p in range(pose.shape[0]):
        for field in range(2):
            expose(exposure, boxes[p, field], key, sample, canvas)


@jit
def wipe(boxes, background, canvas):
    """Restore the empty surface where parts were drawn."""
    for p in range(boxes.shape[0]):
        for field in range(2):
            box = boxes[p, field]
            for line in range(box[0], box[1]):
                for column in range(box[2], box[3]):
                    canvas.bare[line, column] = 1.0
                    canvas.grey[line, column] = background[line, column]


@jit(allocates=True)
def whole_image(
    optics: Optics, shapes: Shapes, exposure: Exposure, pose: np.ndarray, earlier: np.ndarray, shown: np.ndarray,
    key: np.ndarray, sample: int, bare: np.ndarray, image: np.ndarray,
) -> None:  # fmt: skip
    """Write the whole image (lines, columns) uint8 of one world, with noise everywhere.

    Args:
        bare: (lines, columns) float32, uncovered share of each pixel, overwritten.
    """
    bare[:] = 1.0
    canvas = Canvas(bare, image)
    boxes = np.zeros((pose.shape[0], 2, 4), dtype=np.int64)
    draw(optics, shapes, exposure, pose, earlier, shown, key, sample, canvas, boxes)
    everything = np.array([0, image.shape[0], 0, image.shape[1]])
    expose(exposure, everything, key, sample, canvas)


@jit
def _add_edge(x0, y0, x1, y1, cover):
    """Add the contributions of one edge, whose ends lie in ``cover``; pixel (l, c) is [c, c + 1] x [l, l + 1]."""
    if y0 == y1:
        return
    sign = 1.0
    if y0 > y1:
        sign = -1.0
        x0, y0, x1, y1 = x1, y1, x0, y0
    slope = (x1 - x0) / (y1 - y0)
    x = x0
    first, last = math.floor(y0), math.ceil(y1)
    for line in range(first, last):
        dy = min(line + 1.0, y1) - max(float(line), y0)
        then = x + slope * dy
        if line == last - 1:
            then = x1  # without rounding errors beyond the edge's last pixel
        d = sign * dy
        left, right = min(x, then), max(x, then)
        c0, c1 = math.floor(left), math.ceil(right)
        if c1 <= c0 + 1:
            beyond = 0.5 * (x + then) - c0
            cover[line, c0] += d * (1.0 - beyond)
            cover[line, c0 + 1] += d * beyond
        else:
            s = 1.0 / (right - left)
            within, over = left - c0, right - c1 + 1.0
            area0, area1 = 0.5 * s * (1.0 - within) ** 2, 0.5 * s * over**2
            cover[line, c0] += d * area0
            if c1 == c0 + 2:
                cover[line, c0 + 1] += d * (1.0 - area0 - area1)
            else:
                first_two = s * (1.5 - within)
                cover[line, c0 + 1] += d * (first_two - area0)
                for column in range(c0 + 2, c1 - 1):
                    cover[line, column] += d * s
                cover[line, c1 - 1] += d * (1.0 - first_two - (c1 - c0 - 3) * s - area1)
            cover[line, c1] += d * area1
        x = then


@jit
def add_polygon(corners, count, left, top, cover):
    """Write the share of every pixel that a polygon covers into ``cover`` (lines, columns), initially zeros.

    Args:
        corners: (n, 2) column and line, pixel centres at whole numbers, in either sense; the first ``count`` are used.
        left, top: pixel of ``cover[0, 0]``. The polygon is inside, with an empty column on the right.
    """
    dx, dy = 0.5 - left, 0.5 - top
    for k in range(count):
        before = k - 1 if k else count - 1
        x0, y0 = corners[before, 0] + dx, corners[before, 1] + dy
        _add_edge(x0, y0, corners[k, 0] + dx, corners[k, 1] + dy, cover)
    for line in range(cover.shape[0]):
        total = 0.0
        for column in range(cover.shape[1]):
            total += cover[line, column]
            cover[line, column] = min(abs(total), 1.0)
