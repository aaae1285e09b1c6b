"""Ways of the pusher around the T, in the frame of the T's centre of mass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import shortest_path

from studies.pusht.scene import BAR, CENTRE, RADIUS, STEM

CLEARANCE = 12.0
"""Distance of pusher and T on the way to a push, px."""

SPACING = 9.0
"""Distance of neighbouring points around the T, px."""

TOLERANCE = 2.0
"""Part of the clearance (px) that chords between points may lack."""


class Ways(NamedTuple):
    """Points around the T, and the shortest ways between them."""

    point: np.ndarray  # (n, 2) px
    inward: np.ndarray  # (n, 2) unit vectors towards the T
    length: np.ndarray  # (n, n) px
    before: np.ndarray  # (n, n) index of the last point before the second on the way from the first


def rotation(heading: float) -> np.ndarray:
    """Return the matrix (2, 2) that turns row vectors by ``heading``."""
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, s], [-s, c]])


def distance(point: np.ndarray) -> np.ndarray:
    """Return the distances (...) of points (..., 2) from the T, px; negative: inside."""
    distances = []
    for size, middle in ((BAR, 0.5 * BAR[1]), (STEM, BAR[1] + 0.5 * STEM[1])):
        beyond = np.abs(point - (0.0, middle - CENTRE[1])) - 0.5 * size
        distances.append(np.hypot(*np.moveaxis(np.maximum(beyond, 0.0), -1, 0)) + np.minimum(beyond.max(axis=-1), 0.0))
    return np.minimum(*distances)


def is_clear(start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Return whether the pusher keeps its clearance, or that at the start, on segments (..., 2)."""
    shares = np.linspace(0.0, 1.0, 24)[:, None]
    distances = distance(start[..., None, :] + shares * (stop - start)[..., None, :])
    return np.all(distances >= np.minimum(RADIUS + CLEARANCE - TOLERANCE, distances[..., :1] - 0.5), axis=-1)


def ways() -> Ways:
    """Return points at ``CLEARANCE`` from contact, and the ways between them along segments that are clear."""
    angles = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = np.zeros(len(rays)), np.full(len(rays), 200.0)
    inner = np.array([0.0, BAR[1] - CENTRE[1]])  # from where every ray leaves the enlarged T once
    for _ in range(40):
        middle = 0.5 * (low + high)
        outside = distance(inner + middle[:, None] * rays) > RADIUS + CLEARANCE
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    ring = inner + high[:, None] * rays
    along = np.cumsum(np.hypot(*(ring - np.roll(ring, 1, axis=0)).T))
    count = int(along[-1] / SPACING)
    point = ring[np.searchsorted(along, np.arange(count) * along[-1] / count)]
    slope = [distance(point + step) - distance(point - step) for step in 1e-3 * np.eye(2)]
    inward = -np.column_stack(slope)
    inward /= np.hypot(*inward.T)[:, None]
    one, other = np.broadcast_arrays(point[:, None], point[None])
    edges = np.where(is_clear(one, other), np.hypot(*np.moveaxis(other - one, -1, 0)), np.inf)
    length, before = shortest_path(edges, return_predecessors=True)
    return Ways(point, inward, length, before)
