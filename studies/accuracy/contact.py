"""Contact area of a flat part on the elements, cut by shapely, and the friction wrench over it, integrated exactly.

Pressure is constant on each piece of the area, so only the direction of slip must be integrated. With a slip twist
``(u_x, u_y, s)`` the slip at a point ``r`` is ``u = (u_x, u_y) + s z^ x r``. For ``s != 0`` this is a rotation about the slip
centre ``c``, and ``u/|u|`` rotated by -90 degrees is the gradient of ``|r - c|``. By Gauss's theorem both integrals become
line integrals along the straight edges of the piece, with closed forms

    int (r - c)/|r - c| dA = loop |r - c| nu dl         int |r - c| dA = (1/3) loop |r - c| (r - c).nu dl

at any distance of the centre, so that no cubature has to resolve the singularity. Far from the centre (small ``s``) these forms
lose digits, but the direction is smooth and a Gauss rule on triangles is exact to rounding.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import shapely

_POLYGON = 3  # shapely's type id


class Cubature(NamedTuple):
    """Limit of the closed form, and order of the Gauss rule beyond it; the error is ``far**-(2 order - 1)``."""

    far: float = 20.0  # distance of the slip centre from the centre of mass, in radii of the part
    order: int = 6


FINE = Cubature()
COARSE = Cubature(8.0, 4)


class Contact:
    """The pieces of a contact area: one for each element below the part, or more for non-convex parts.

    Args:
        rings: outlines of the pieces about the centre of mass, each (n, 2), m, in either sense, not closed.
        element: (pieces, 2) row and column of the element below each.
        radius: of the circle about the centre of mass that contains them, m.
    """

    def __init__(self, rings: list[np.ndarray], element: np.ndarray, radius: float, cubature: Cubature = FINE) -> None:
        self.element = element
        self.radius = radius
        self.cubature = cubature
        counts = np.array([len(ring) for ring in rings])
        self._start = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self._piece = np.repeat(np.arange(len(rings)), counts)
        self._here = np.concatenate(rings)
        follows = np.arange(1, len(self._here) + 1)
        follows[self._start + counts - 1] = self._start
        self._there = self._here[follows]
        # Twice the signed areas of the triangles (first corner, here, there) of the fan over each piece; with signs, the fan
        # is also valid for pieces that are not convex.
        first = self._here[self._start][self._piece]
        a, b = self._here - first, self._there - first
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        signed = np.add.reduceat(cross, self._start) / 2.0
        self._sense = np.sign(signed)[self._piece]
        self._fan, self._fan_corner = cross * self._sense / 2.0, first
        self.area = np.abs(signed)
        """(pieces,) m^2."""
        self._nodes: tuple[np.ndarray, ...] | None = None

    def wrench(self, twist: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Return the integral of ``p u/|u|`` and of its moment about the centre of mass, (3,).

        Args:
            twist: (3,) slip ``u_x``, ``u_y`` at the centre of mass (m/s) and its rotation ``s`` (rad/s); any scale but
                zero.
            pressure: (pieces,), constant on each; force and torque come in its unit times m^2 and m^3.
        """
        ux, uy, s = float(twist[0]), float(twist[1]), float(twist[2])
        if math.hypot(ux, uy) > self.cubature.far * self.radius * abs(s):
            return self._smooth(ux, uy, s, pressure)
        return self._near(-uy / s, ux / s, math.copysign(1.0, s), pressure)

    def _near(self, cx: float, cy: float, sense: float, pressure: np.ndarray) -> np.ndarray:
        px, py = self._here[:, 0] - cx, self._here[:, 1] - cy
        qx, qy = self._there[:, 0] - cx, self._there[:, 1] - cy
        ex, ey = qx - px, qy - py
        length = np.hypot(ex, ey)
        length[length == 0.0] = 1.0  # a repeated corner: all its terms vanish
        tx, ty = ex / length, ey / length
        height = px * ty - py * tx  # of the centre over the edge's line, along its outer normal (ty, -tx)
        low, high = px * tx + py * ty, qx * tx + qy * ty
        distance = np.abs(height) + 1e-300
        along = 0.5 * (
            high * np.hypot(qx, qy)
            - low * np.hypot(px, py)
            + height * height * (np.arcsinh(high / distance) - np.arcsinh(low / distance))
        )
        along *= self._sense * pressure[self._piece]
        gradient_x, gradient_y = float(along @ ty), -float(along @ tx)
        force_x, force_y = -sense * gradient_y, sense * gradient_x
        torque = sense * float(along @ height) / 3.0 + cx * force_y - cy * force_x
        return np.array([force_x, force_y, torque])

    def _smooth(self, ux: float, uy: float, s: float, pressure: np.ndarray) -> np.ndarray:
        if self._nodes is None:
            self._nodes = self._gauss()
        x, y, weight, piece = self._nodes
        vx, vy = ux - s * y, uy + s * x
        stress = weight * pressure[piece] / np.hypot(vx, vy)
        vx *= stress
        vy *= stress
        return np.array([vx.sum(), vy.sum(), float(x @ vy - y @ vx)])

    def _gauss(self) -> tuple[np.ndarray, ...]:
        """Return nodes of a Gauss rule on every triangle of the fans (collapsed squares): x, y, weight, piece."""
        node, weight = np.polynomial.legendre.leggauss(self.cubature.order)
        node, weight = 0.5 * (node + 1.0), 0.5 * weight
        a, b = (grid.ravel() for grid in np.meshgrid(node, node))
        share = (np.outer(weight, weight) * node).ravel() * 2.0
        used = np.flatnonzero(self._fan)
        first, here, there = self._fan_corner[used], self._here[used], self._there[used]
        points = first[:, None] + a[:, None] * ((here - first)[:, None] + b[:, None] * (there - here)[:, None])
        points = points.reshape(-1, 2)
        return (
            np.ascontiguousarray(points[:, 0]),
            np.ascontiguousarray(points[:, 1]),
            (self._fan[used, None] * share).ravel(),
            np.repeat(self._piece[used], len(share)),
        )


class Cutter:
    """Cutter of a part's outline by the elements, with a test of support.

    Args:
        surface, part: of ``vibgym.scene``; only their plain attributes are read.
    """

    def __init__(self, surface: Any, part: Any, cubature: Cubature = FINE) -> None:
        self.rows, self.columns, self.size = surface.rows, surface.columns, surface.element_size
        self.outline = np.asarray(part.outline, dtype=float)
        self.turns = part.symmetry != 0  # a disc's area does not depend on its heading
        self.radius = float(np.hypot(*self.outline.T).max())
        self.cubature = cubature
        self._cells: dict[tuple[int, int], shapely.Polygon] = {}
        self._extent = np.array([self.columns, self.rows]) * self.size
        self._whole = _depth(shapely.Polygon(self.outline).convex_hull, 0.0, 0.0)

    def cut(self, x: float, y: float, heading: float) -> Contact | None:
        """Return the contact at a pose; None if the part is wholly off the surface."""
        outline = self._placed(heading)
        place = np.array([x, y])
        last = np.array([self.columns, self.rows]) - 1
        low = np.floor((outline.min(axis=0) + place) / self.size).astype(int)
        high = np.floor((outline.max(axis=0) + place) / self.size).astype(int)
        if (low == high).all() and (low >= 0).all() and (low <= last).all():
            return Contact([outline], low[None, ::-1], self.radius, self.cubature)
        low, high = np.maximum(low, 0), np.minimum(high, last)
        below = [(i, j) for i in range(low[1], high[1] + 1) for j in range(low[0], high[0] + 1)]
        if not below:
            return None
        cells = [self._cell(i, j) for i, j in below]
        parts, index = shapely.get_parts(
            shapely.intersection(shapely.Polygon(outline + place), cells), return_index=True
        )
        area = (shapely.get_type_id(parts) == _POLYGON) & (shapely.area(parts) > 0.0)
        if not area.any():
            return None
        parts, index = parts[area], index[area]
        corners, owner = shapely.get_coordinates(parts, return_index=True)
        ends = np.flatnonzero(np.diff(owner)) + 1
        # shapely closes its rings; the last corner repeats the first
        rings = [ring[:-1] - place for ring in np.split(corners, ends)]
        return Contact(rings, np.array(below)[index], self.radius, self.cubature)

    def support(self, x: float, y: float, heading: float) -> float:
        """Return the distance of the centre of mass from the border of the support polygon, m; negative outside.

        The support polygon is the convex hull of the contact area.
        """
        outline = self._placed(heading)
        place = np.array([x, y])
        if (outline.min(axis=0) + place >= 0.0).all() and (outline.max(axis=0) + place <= self._extent).all():
            return self._whole
        resting = shapely.Polygon(outline + place).intersection(shapely.box(0.0, 0.0, *self._extent))
        if resting.area == 0.0:
            return -max(self.radius, 1e-300)
        return _depth(resting.convex_hull, x, y)

    def _placed(self, heading: float) -> np.ndarray:
        if not self.turns:
            return self.outline
        c, s = math.cos(heading), math.sin(heading)
        return self.outline @ np.array([[c, s], [-s, c]])

    def _cell(self, i: int, j: int) -> shapely.Polygon:
        if (i, j) not in self._cells:
            size = self.size
            self._cells[i, j] = shapely.box(j * size, i * size, (j + 1) * size, (i + 1) * size)
        return self._cells[i, j]


def _depth(hull: Any, x: float, y: float) -> float:
    point = shapely.Point(x, y)
    return hull.exterior.distance(point) if hull.covers(point) else -hull.distance(point)
