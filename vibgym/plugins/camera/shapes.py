"""Appearance of parts: area, spread, elongation, and the moment from which the heading is measured."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.scene.outlines import contains
from vibgym.scene.parts import Part

MAX_ORDER = 12
"""Largest order of the moment that defines the heading."""

MIN_SHARE = 0.05
"""Least magnitude of a moment that defines the heading, as a share of the sum of absolute values."""


class Traits(NamedTuple):
    """Measured properties of every kind of parts."""

    kind: np.ndarray  # (parts,) of the current world
    area: np.ndarray  # (kinds,) m^2
    spread: np.ndarray  # (kinds,) m^2, of the area about its centroid: sum of the two principal moments over the area
    elongation: np.ndarray  # (kinds,) difference of the principal moments over their sum
    order: np.ndarray  # (kinds,) of the complex moment that defines the heading; 0: none
    phase: np.ndarray  # (kinds,) rad, angle of that moment at heading 0
    strength: np.ndarray  # (kinds,) m^order, its magnitude over the area
    height: np.ndarray  # (kinds,) m, of the top
    radius: np.ndarray  # (kinds,) m
    edge: np.ndarray  # (kinds,) m, length of the outline


@jit
def load_kinds(kinds, world, kind):
    """Write the kinds of a world's parts to ``kind`` (parts,)."""
    for part in range(kind.shape[0]):
        kind[part] = kinds[min(world, kinds.shape[0] - 1), part]


def outline_moment(outline: np.ndarray, order: int) -> complex:
    """Return the integral of (x + i y)^order over a polygon: 1 / 2i times that of conj(z) z^order along its border (Green)."""
    z = outline[:, 0] + 1j * outline[:, 1]
    step = np.roll(z, -1) - z
    nodes, weights = np.polynomial.legendre.leggauss(order // 2 + 2)  # exact for these polynomials
    t = 0.5 * (nodes + 1.0)
    along = z[:, None] + step[:, None] * t
    return complex((0.5 * weights * np.conj(along) * along**order * step[:, None]).sum() / 2j)


def size_moment(outline: np.ndarray, order: int) -> float:
    """Return the integral of |x + i y|^order over a polygon that contains the origin, or nearly."""
    x, y = outline[:, 0], outline[:, 1]
    nodes, weights = np.polynomial.legendre.leggauss(order + 4)
    t = 0.5 * (nodes + 1.0)
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    u, v = x[:, None] + (x1 - x)[:, None] * t, y[:, None] + (y1 - y)[:, None] * t
    cross = (x * y1 - x1 * y)[:, None]
    return abs(float((0.5 * weights * cross * np.hypot(u, v) ** order).sum() / (order + 2)))


def heading_order(part: Part) -> tuple[int, complex]:
    """Return order and value (m^order, at heading 0) of the first moment that defines the heading; order 0 if none does."""
    if part.symmetry == 0:
        return 0, 0.0
    for order in range(2, MAX_ORDER + 1):
        if order % part.symmetry == 0:
            moment = outline_moment(part.outline, order)
            if abs(moment) > MIN_SHARE * size_moment(part.outline, order):
                return order, moment / part.area
    return 0, 0.0


def traits_of(kinds: Sequence[Part], kind: np.ndarray) -> Traits:
    """Return the appearance of kinds of parts; ``kind``: (parts,) of the current world, live."""
    headings = [heading_order(part) for part in kinds]
    turned = np.array([abs(outline_moment(part.outline, 2)) for part in kinds])
    spread = np.array([part.gyration for part in kinds])
    area = np.array([part.area for part in kinds])
    return Traits(
        kind=kind,
        area=area,
        spread=spread,
        elongation=np.array([0.0 if part.symmetry == 0 else 1.0 for part in kinds]) * turned / (area * spread),
        order=np.array([order for order, _ in headings]),
        phase=np.array([cmath.phase(moment) for _, moment in headings]),
        strength=np.array([abs(moment) for _, moment in headings]),
        height=np.array([part.height for part in kinds]),
        radius=np.array([part.radius for part in kinds]),
        edge=np.array([np.hypot(*(np.roll(part.outline, -1, axis=0) - part.outline).T).sum() for part in kinds]),
    )


def room_inside(part: Part) -> float:
    """Return the radius of the largest circle inside a part, m, within 2 %, by search on a grid."""
    outline = part.outline
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre, span, best = 0.5 * (low + high), 0.5 * (high - low), 0.0
    for _ in range(6):  # a grid, then finer ones around the best point
        offsets = np.linspace(-1.0, 1.0, 25)
        points = (centre + np.stack(np.meshgrid(*(offsets[:, None] * span).T), axis=-1)).reshape(-1, 2)
        depth = _depth(points, outline)
        best = max(best, float(depth.max()))
        centre, span = points[int(depth.argmax())], span / 4.0
    return best


def _depth(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return the distance of points (n, 2) to the outline, negative outside."""
    edge = np.roll(outline, -1, axis=0) - outline
    relative = points[:, None] - outline
    t = np.clip((relative * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    away = np.linalg.norm(relative - t[..., None] * edge, axis=-1).min(axis=1)
    return np.where(contains(outline, points), away, -away)
