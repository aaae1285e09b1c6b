"""Rigid prisms and discs: inertia and contact points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

RINGS = 7
"""Rings of contact points between the middle of a bottom and its rim: 113 points of a block."""

RIM = 72
"""Contact points around the rim of a disc."""


class Body(NamedTuple):
    """A rigid body and its contact points.

    Attributes:
        mass: kg.
        inertia: (3, 3) kg m^2 about the centre of mass, in the body's axes.
        points: (n, 3) m, contact points relative to the centre of mass, all on the bottom.
        shares: (n,) share of the bottom's stiffness, of sum 1: the area of each point, so that a flat part on level plates sags
            evenly and has even pressure.
        friction: coefficient of Coulomb friction.
    """

    mass: float
    inertia: np.ndarray
    points: np.ndarray
    shares: np.ndarray
    friction: float

    @property
    def centre_height(self) -> float:
        """Height of the centre of mass above the bottom, m."""
        return -float(self.points[0, 2])

    def inverse_mass(self, point: int) -> float:
        """Return the change of velocity of a contact point by a vertical unit impulse on it, 1/kg."""
        arm = np.cross(self.points[point], [0.0, 0.0, 1.0])
        return 1.0 / self.mass + float(arm @ np.linalg.solve(self.inertia, arm))


def prism(
    outline: np.ndarray, height: float, friction: float, *, mass: float = 1.0, centre_height: float | None = None,
    corners_only: bool = False, rings: int = RINGS,
) -> Body:  # fmt: skip
    """Return a convex prism of uniform density.

    Args:
        outline: (n, 2) m, counter-clockwise about the centroid.
        height: m, for the moments of inertia.
        friction: Coulomb's.
        mass: kg.
        centre_height: m, of the centre of mass above the bottom; None is half the height.
        corners_only: whether only corners carry the prism, like one with a slightly hollow bottom.
        rings: of points around the middle.
    """
    outline = np.asarray(outline, dtype=float)
    moments = _second_moments(outline)
    if corners_only:
        points, shares = outline, np.full(len(outline), 1.0 / len(outline))
    else:
        points, shares = _fan(outline, rings)
    return _body(points, shares, moments, height, friction, mass, centre_height)


def disc(
    radius: float, height: float, friction: float, *, mass: float = 1.0, centre_height: float | None = None, rim: int = RIM
) -> Body:  # fmt: skip
    """Return a disc of uniform density; see :func:`prism`. Rings of points represent rings of area, the last is the rim."""
    edges = np.array([0.0, 0.15, 0.37, 0.59, 0.81, 0.95, 1.0])  # between the rings, in radii
    counts = (1, 8, 12, 16, 20, rim)
    points, shares = [], []
    for inner, outer, count in zip(edges[:-1], edges[1:], counts, strict=True):
        at = 0.0 if inner == 0.0 else 1.0 if outer == 1.0 else 0.5 * (inner + outer)
        angle = 2.0 * math.pi * np.arange(count) / count
        points.append(radius * at * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        shares.append(np.full(count, (outer**2 - inner**2) / count))
    moments = np.eye(2) * radius**2 / 4.0
    return _body(np.concatenate(points), np.concatenate(shares), moments, height, friction, mass, centre_height)


def _body(
    points: np.ndarray, shares: np.ndarray, moments: np.ndarray, height: float, friction: float, mass: float,
    centre_height: float | None,
) -> Body:  # fmt: skip
    above = 0.5 * height if centre_height is None else centre_height
    spread = np.zeros((3, 3))
    spread[:2, :2] = moments
    spread[2, 2] = height**2 / 12.0
    inertia = mass * (np.trace(spread) * np.eye(3) - spread)
    feet = np.concatenate([points, np.full((len(points), 1), -above)], axis=1)
    return Body(mass, inertia, feet, shares, friction)


def _second_moments(outline: np.ndarray) -> np.ndarray:
    """Return the mean of ``r r^T`` over the area within an outline about its centroid, (2, 2) m^2."""
    ends = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * ends[:, 1] - outline[:, 1] * ends[:, 0]
    total = np.zeros((2, 2))
    for a, b, c in zip(outline, ends, cross, strict=True):
        total += c * (np.outer(a + b, a + b) + np.outer(a, a) + np.outer(b, b)) / 24.0
    return total / (0.5 * cross.sum())


def _fan(outline: np.ndarray, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points of concentric copies of the outline, and the share of the area of each.

    The triangles between the centroid and the edges are divided into small ones, with a third of the area for each corner.
    """
    shares: dict[tuple[float, float], float] = {}
    total = 0.0
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        area = 0.5 * (a[0] * b[1] - a[1] * b[0])
        total += area

        def at(i: int, j: int, a: np.ndarray = a, b: np.ndarray = b) -> tuple[float, float]:
            x, y = (i * a + j * b) / rings
            return round(float(x), 12) + 0.0, round(float(y), 12) + 0.0  # neighbours share points

        for i in range(rings):
            for j in range(rings - i):
                small = [(at(i, j), at(i + 1, j), at(i, j + 1))]
                if i + j < rings - 1:
                    small.append((at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)))
                for corner in (vertex for triangle in small for vertex in triangle):
                    shares[corner] = shares.get(corner, 0.0) + area / rings**2 / 3.0
    return np.array(list(shares)), np.array(list(shares.values())) / total
