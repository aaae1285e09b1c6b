"""A pattern of goals drawn apart: the places from which all its parts can go straight to their goals at once.

Whatever the stretch and the slant, the way back is an affine one: no two parts meet on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym import Part, Surface

SCALES = 25
"""Stretches along each axis that are tried."""

EDGE = 0.001
"""m that parts keep from the border in the pattern drawn apart."""

SLANTS = 13
"""Slants that are tried of patterns that fill the table's width, and stretches across it besides."""

NARROW = 0.010
"""m between parts below which a pattern that is drawn apart is slanted, too."""


def drawn_apart(
    surface: Surface, parts: Sequence[Part], goal: np.ndarray, heading: np.ndarray, apart: float
) -> np.ndarray:
    """Places (parts, 2) m of a pattern that is stretched along and across the table, and moved to where it fits.

    Of all stretches that leave the parts ``apart`` it is the one with the shortest way back; where none does, the one that
    leaves them farthest apart. Where that is less than :data:`NARROW`, patterns that are slanted are tried as well. Distances
    are those of the rectangles along the table that hold the parts.

    Args:
        surface: the table.
        parts: those that are there.
        goal: (parts, 2) m.
        heading: (parts,) rad, at the goals.
        apart: m.
    """
    if len(parts) < 2:
        return goal.copy()
    half = np.array([_half(part, angle) for part, angle in zip(parts, heading, strict=True)])
    size, span = np.array([surface.width, surface.depth]), np.ptp(goal, axis=0)
    room = size - 2.0 * (half.max(axis=0) + EDGE)
    offset = goal - (goal.min(axis=0) + 0.5 * span)
    one, other = np.triu_indices(len(goal), 1)
    between, both = offset[one] - offset[other], half[one] + half[other]
    enough = [_enough(between[:, axis], both[:, axis].max() + apart) for axis in range(2)]
    most = np.maximum(np.minimum(room / np.maximum(span, 1e-9), enough), 1.0)
    stretch = np.array(np.meshgrid(*(np.linspace(1.0, each, SCALES) for each in most), [0.0], indexing="ij"))
    best, distance = _best(stretch.reshape(3, -1), between, both, span, room, apart)
    if distance < min(apart, NARROW):
        steepest = (both[:, 0].max() + apart) / max(
            np.abs(between[:, 1][np.abs(between[:, 1]) > 1e-4]).min(initial=math.inf), 1e-9
        )
        slants = np.linspace(0.0, steepest, SLANTS)
        long = np.linspace(1.0, max(min(room[0] / max(span[0], 1e-9), 2.0 * enough[0]), 1.0), SCALES)
        stretch = np.array(np.meshgrid(long, np.linspace(1.0, most[1], SLANTS), slants, indexing="ij"))
        best, distance = _best(stretch.reshape(3, -1), between, both, span, room, apart)
    place = goal - offset + np.column_stack([best[0] * offset[:, 0] + best[2] * offset[:, 1], best[1] * offset[:, 1]])
    short = np.maximum(half + EDGE - place, 0.0).max(axis=0) - np.maximum(place - (size - half - EDGE), 0.0).max(axis=0)
    return place + short


def _enough(between: np.ndarray, apart: float) -> float:
    """Stretch that brings the nearest neighbours along an axis so far ``apart`` (m), centre from centre."""
    away = np.abs(between)
    near = away[away > 1e-4].min(initial=math.inf)
    return apart / near if near < math.inf else 1.0


def _best(
    stretch: np.ndarray, between: np.ndarray, both: np.ndarray, span: np.ndarray, room: np.ndarray, apart: float
) -> tuple[np.ndarray, float]:
    """Of stretches (3, n), along, across and how far rows are shifted over how far they are up, the best, and its distance."""
    along = np.abs(np.outer(stretch[0], between[:, 0]) + np.outer(stretch[2], between[:, 1])) - both[:, 0]
    across = np.outer(stretch[1], np.abs(between[:, 1])) - both[:, 1]
    distance = np.maximum(along, across).min(axis=1)
    away = np.hypot((stretch[0] - 1.0) * span[0] + stretch[2] * span[1], (stretch[1] - 1.0) * span[1])
    fits = stretch[0] * span[0] + stretch[2] * span[1] <= room[0] + 1e-9
    fits[0] = True  # as it is
    distance = np.where(fits, distance, -math.inf)
    good = distance >= min(apart, float(distance.max())) - 1e-9
    k = int(np.where(good, away, math.inf).argmin())
    return stretch[:, k], float(distance[k])


def _half(part: Part, heading: float) -> np.ndarray:
    """(2,) m, how far a part reaches along and across the table."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.abs(part.outline @ np.array([[cosine, sine], [-sine, cosine]])).max(axis=0)
