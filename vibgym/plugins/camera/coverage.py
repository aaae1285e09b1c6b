"""Exact area of every pixel that a polygon covers, by the accumulation that font renderers use.

Each edge leaves in the pixels that it crosses what it adds to the area right of it (Green's theorem, line by line); a running
sum along the line then gives the coverage (R. Levien, font-rs, 2016; S. Barrett, stb_truetype 2, 2015).
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing


@borrowing
def _add_edge(x0, y0, x1, y1, cover):
    """Leave the traces of one edge, whose ends lie in ``cover``; pixel (l, c) is [c, c + 1] x [l, l + 1]."""
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
            then = x1  # no rounding errors that reach into a pixel outside
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


@borrowing
def add_polygon(corners, count, left, top, cover):
    """Write the share of every pixel that a polygon covers into ``cover`` (lines, columns), which holds zeros.

    Args:
        corners: (n, 2) column and line, pixel centres at whole numbers, in either sense; ``count`` of them count.
        left, top: pixel of ``cover[0, 0]``. The polygon lies inside, with a column to spare on the right.
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
