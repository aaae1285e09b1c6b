"""Segments of a recording: stretches of some periods of one part, each simulated from its own initial state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibgym import checks
from vibgym.identification.log import Log
from vibgym.scene.parts import Part, kinds_of

SHORT, LONG = 10, 40
"""Periods of a segment: few where parameters are far off, since errors grow along a path; more are more exact. Long ones begin
where short ones do."""

MIN_IMAGES = 8
"""Images of a part in a segment; its initial state takes two."""

MIN_SEGMENTS = 10
"""Segments of a recording."""

GAP = 1.5
"""Periods between two commands from which on cycles are missing."""

CLEARANCE = 1e-3
"""m between the circumscribed circles of two parts; nearer ones may touch, which is not modelled."""

EARLY = 0.25
"""Periods by which an image may precede the start of its segment (jitter of its timestamp)."""


@dataclass(frozen=True)
class Segment:
    """Images of a part in some periods without gap.

    Attributes:
        part: index.
        kind: index of its kind.
        first: row of the first period.
        instant: (n,) periods after the start of the first one at which images were taken.
        pose: (n, 3) measured poses, headings continuous.
        elements: (m, 2) row and column of the elements that the part may have touched.
    """

    part: int
    kind: int
    first: int
    instant: np.ndarray
    pose: np.ndarray
    elements: np.ndarray


@dataclass(frozen=True)
class Timing:
    """Timestamps of a recording.

    Attributes:
        period, deviation: s, estimated period of the table and its standard deviation.
        gaps: (n, 2) row before the gap, and missing cycles.
        cycle: (n,) instant of each row's image, in periods, on the scale of row numbers.
        pieces: first and last row (exclusive) of stretches without gaps.
    """

    period: float
    deviation: float
    gaps: np.ndarray
    cycle: np.ndarray
    pieces: list[tuple[int, int]]


def timing_of(log: Log, nominal: float) -> Timing:
    """Return the timing of a recording; ``nominal`` period in s.

    The machine sends one command a period, so commands are the clock of the table. A straight line through their timestamps
    removes their jitter.

    Raises:
        ValueError: commands are not one nominal period apart, within 20 %.
    """
    step = np.diff(log.time)
    usual = float(np.median(step))
    if not 0.8 * nominal <= usual <= 1.25 * nominal:
        allowed = f"about {nominal:g} s apart, one period of the surface"
        raise checks.refuse("log.time", f"commands {usual:.4g} s apart", allowed)
    breaks = np.flatnonzero(step > GAP * usual)
    number = np.arange(len(log))
    lost = np.round(step[breaks] / usual).astype(int) - 1
    whole = number.copy()
    for row, more in zip(breaks, lost, strict=True):
        whole[row + 1 :] += more
    edges = [0, *(breaks + 1).tolist(), len(log)]
    pieces = list(zip(edges[:-1], edges[1:]))
    # One slope, and an offset for each piece: the missing cycles of a gap need not be known.
    centred = [(number[a:b] - number[a:b].mean(), log.time[a:b] - log.time[a:b].mean()) for a, b in pieces]
    weight = sum(float(n @ n) for n, _ in centred)
    period = sum(float(n @ t) for n, t in centred) / weight
    rest = sum(float(((t - period * n) ** 2).sum()) for n, t in centred)
    deviation = float(np.sqrt(rest / max(len(log) - len(pieces) - 1, 1) / weight))
    cycle = np.full(len(log), np.nan)
    for a, b in pieces:
        origin = (log.time[a:b] - period * number[a:b]).mean()
        cycle[a:b] = (log.taken[a:b] - origin) / period
    return Timing(period, deviation, np.column_stack([breaks, lost]), cycle, pieces)


def segments_of(
    log: Log, timing: Timing, parts: tuple[Part, ...], element_size: float, skip: int, length: int
) -> list[Segment]:
    """Return the segments of a recording.

    Args:
        parts: of the recording.
        element_size: m.
        skip: rows at the start of each piece, whose commands in effect may be unknown.
        length: periods of a segment.

    Raises:
        ValueError: too little data.
    """
    _, kinds = kinds_of(parts, Part.same_as)
    near = _too_near(log, parts)
    fresh = np.append(True, np.diff(log.taken) != 0.0)
    segments = []
    for a, b in timing.pieces:
        for first in range(a + skip, b - MIN_IMAGES, length):
            last = min(first + length, b)
            inside = (timing.cycle >= first - EARLY) & (timing.cycle < last - EARLY) & fresh
            inside[:a] = inside[b:] = False
            for k, part in enumerate(parts):
                rows = np.flatnonzero(inside & np.isfinite(log.pose[:, k, 0]))
                if len(rows) < MIN_IMAGES or near[rows, k].any():
                    continue
                pose = log.pose[rows, k].copy()
                pose[:, 2] = unwrapped(pose[:, 2], part.symmetry)
                elements = _touched(pose, part, element_size, log.amplitude.shape[1:])
                segments.append(Segment(k, int(kinds[k]), first, timing.cycle[rows] - first, pose, elements))
    if len(segments) < MIN_SEGMENTS:
        got = f"{len(segments)} stretches of {length} periods with {MIN_IMAGES} images and without gaps"
        allowed = f"a recording with at least {MIN_SEGMENTS}; record longer, or with fewer gaps"
        raise checks.refuse("log", got, allowed)
    return segments


def unwrapped(heading: np.ndarray, symmetry: int) -> np.ndarray:
    """Return continuous headings from measured ones, which are known modulo the part's symmetry (0: a disc, zeros)."""
    if symmetry == 0:
        return np.zeros_like(heading)
    return np.unwrap(heading, period=2.0 * np.pi / symmetry)


def _touched(pose: np.ndarray, part: Part, size: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return (m, 2) elements within the part's radius, with a margin for noise and motion between images."""
    rows, columns = np.arange(shape[0]), np.arange(shape[1])
    x, y = pose[:, 0, None], pose[:, 1, None]
    dx = np.maximum(np.maximum(columns * size - x, x - (columns + 1) * size), 0.0)
    dy = np.maximum(np.maximum(rows * size - y, y - (rows + 1) * size), 0.0)
    reach = part.radius + 0.2 * size
    return np.argwhere((dx[:, None, :] ** 2 + dy[:, :, None] ** 2 < reach**2).any(axis=0))


def _too_near(log: Log, parts: tuple[Part, ...]) -> np.ndarray:
    """Return (n, parts) whether another part may touch this one."""
    near = np.zeros(log.pose.shape[:2], dtype=bool)
    for k, part in enumerate(parts):
        for other, that in enumerate(parts):
            if other != k:
                gap = np.hypot(*(log.pose[:, k, :2] - log.pose[:, other, :2]).T) - part.radius - that.radius
                near[:, k] |= gap < CLEARANCE  # False where one of the two was not seen
    return near
