"""Gaps between elements that a part can bridge.

The model's elements have no gaps; those of a machine have. A part does not tip into a gap while its centre of mass is above the
convex hull of its contact area, which is over the elements alone. Beside a crossing of two gaps the support is the narrowest: a
disc of radius r bridges gaps of r between rows, but only of ``2 r / sqrt(5)`` between rows and columns.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.scene.parts import Part

HEADINGS, HALVINGS = 24, 8
"""Headings, and bisections of the gap."""

ACROSS = np.array([0.001, 0.25, 0.5, 0.75, 0.999])
"""Positions of the centre of mass across a gap; the part has the least support just beside an element."""


def bridged_gap(part: Part, most: float) -> float:
    """Return the widest gap between rows and columns of elements that a part bridges, at most ``most``, m.

    At all sampled poses, whose centres of mass are above a gap or above a crossing of two. Other gaps are not considered.
    """
    rings = [part.rim, *part.holes]
    starts, ends = np.concatenate(rings), np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    if _bridges(starts, ends, most):
        return most
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _bridges(starts, ends, middle) else (low, middle)
    return low


def _bridges(starts: np.ndarray, ends: np.ndarray, gap: float) -> bool:
    """Return whether the part with these edges, (n, 2) about the centre of mass, bridges a gap at all sampled poses."""
    # Left and lower border of the gaps relative to the centre of mass. One across y that is far away is none.
    near, far = -gap * ACROSS, 10.0 * max(float(np.abs(starts).max()), gap)
    borders = np.array([(x, y) for x in near for y in (*near, far)])
    for angle in np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, s], [-s, c]])
        if not all(_supported(starts @ turn, ends @ turn, border, gap) for border in borders):
            return False
    return True


def _supported(starts: np.ndarray, ends: np.ndarray, border: np.ndarray, gap: float) -> bool:
    """Return whether the origin is in the convex hull of the part without the strips from ``border`` to ``border + gap``.

    Its corners are the part's, its edges' crossings with borders, and corners of elements under the part.
    """
    corners = np.array([border + (i * gap, k * gap) for i in (0, 1) for k in (0, 1)])
    lines = [(axis, border[axis] + k * gap) for axis in (0, 1) for k in (0, 1)]
    crossings = [_crossings(starts, ends, *line) for line in lines]
    points = np.concatenate([starts, *crossings, corners[_inside(starts, ends, corners)]])
    points = points[((points <= border + 1e-12) | (points >= border + gap - 1e-12)).all(axis=1)]
    if len(points) == 0:
        return False
    angle = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    return bool(np.diff(angle, append=angle[0] + 2.0 * math.pi).max() <= math.pi + 1e-9)


def _crossings(starts: np.ndarray, ends: np.ndarray, axis: int, level: float) -> np.ndarray:
    """Return the points (n, 2) where edges cross the line on which coordinate ``axis`` is ``level``."""
    first, second = starts[:, axis] - level, ends[:, axis] - level
    cut = first * second < 0.0
    share = (first[cut] / (first[cut] - second[cut]))[:, None]
    points = starts[cut] + share * (ends[cut] - starts[cut])
    points[:, axis] = level
    return points


def _inside(starts: np.ndarray, ends: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (n,) whether points (n, 2) are inside the outline and outside the holes: an odd number of edges to the right."""
    x, y = points[:, :1], points[:, 1:]
    spans = (starts[:, 1] > y) != (ends[:, 1] > y)
    rise = np.where(spans, ends[:, 1] - starts[:, 1], 1.0)
    right = x < starts[:, 0] + (y - starts[:, 1]) / rise * (ends[:, 0] - starts[:, 0])
    return (spans & right).sum(axis=1) % 2 == 1
