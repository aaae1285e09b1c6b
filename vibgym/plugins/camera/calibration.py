"""Calibration: the map from the image to the surface, from a picture of a template (thesis section 5.1.3).

The template has dark marks in a grid from border to border of the surface. Between four marks the map is bilinear: the position
in a tetragon is the solution of a quadratic equation (eqs. 5.25 to 5.27). The centroid of an object is transformed, not its
boundary; the Jacobian for lengths and angles comes from the same marks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.plugins.camera.edges import Grey, share_moments, shares
from vibgym.plugins.camera.objects import Found, Interest, find, new_found


class Grid(NamedTuple):
    """Marks in the image and on the surface; the first one is at the origin."""

    places: np.ndarray  # (rows, columns, 2) px, column and line
    jacobian: np.ndarray  # (rows, columns, 2, 2) derivatives of (x, y) by column and line, m/px
    width: float  # m from column to column
    height: float  # m from row to row


class Template(NamedTuple):
    """A grid of square marks on the surface, from border to border; the first one is at the origin."""

    width: float  # m, from mark to mark
    height: float  # m
    rows: int
    columns: int
    mark: float  # m, length of a mark's side

    def marks(self) -> np.ndarray:
        """Return (rows, columns, 2) m, centres."""
        return np.stack(np.meshgrid(self.width * np.arange(self.columns), self.height * np.arange(self.rows)), axis=-1)

    def outline(self) -> np.ndarray:
        """Return (4, 2) m, a mark about its centre."""
        return 0.5 * self.mark * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@jit(allocates=True)
def _centroids(grey: np.ndarray, interest: Interest, meaning: Grey, blobs: Found, places: np.ndarray) -> None:
    find(grey, interest, blobs)
    moment = np.empty(6)
    for k in range(blobs.count[0]):
        share, top, left = shares(grey, meaning, blobs, k)
        share_moments(share, top, left, moment)
        places[k, 0], places[k, 1] = moment[1] / moment[0], moment[2] / moment[0]


def find_marks(grey: np.ndarray, interest: Interest, meaning: Grey, most: int) -> np.ndarray:
    """Return centroids (n, 2), column and line, of all dark objects wholly inside the area of interest."""
    blobs = new_found((grey.shape[0], grey.shape[1]), most)
    places = np.empty((most, 2))
    _centroids(grey, interest, meaning, blobs, places)
    count = int(blobs.count[0])
    return places[:count][~blobs.clipped[:count]]


def assign_marks(seen: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Assign the marks ``seen`` (n, 2) to those ``expected`` (rows, columns, 2), px; returns positions (rows, columns, 2).

    From the middle of the grid outwards, each mark is searched at its expected position plus the displacement of a neighbour,
    since distortion may displace outer marks by more than half of their distance.

    Raises:
        ValueError: a mark is missing, or there is one too many.
    """
    rows, columns = expected.shape[:2]
    near = 0.5 * np.array(
        [np.abs(np.diff(expected[..., 0], axis=1)).min(), np.abs(np.diff(expected[..., 1], axis=0)).min()]
    )
    grid = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1).reshape(-1, 2)
    order = np.argsort(((grid - grid.mean(axis=0)) ** 2).sum(axis=1), kind="stable")
    places, left = np.full(expected.shape, np.nan), seen.copy()
    for node in grid[order]:
        known = grid[np.isfinite(places[grid[:, 0], grid[:, 1], 0])]
        there = expected[tuple(node)]
        if len(known):
            neighbour = tuple(known[((known - node) ** 2).sum(axis=1).argmin()])
            there = there + places[neighbour] - expected[neighbour]
        away = np.abs((left - there) / near).max(axis=1)
        if len(left) and away.min() < 1.0:
            nearest = int(away.argmin())
            places[tuple(node)] = left[nearest]
            left = np.delete(left, nearest, axis=0)
    missing = np.argwhere(np.isnan(places[..., 0]))
    if len(missing):
        names = ", ".join(f"row {row} column {column}" for row, column in missing[:5])
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        raise checks.conflict(f"template: no mark at {names}{more}, of {rows} x {columns}")
    if len(left):
        at = f"column {left[0, 0]:.1f}, line {left[0, 1]:.1f}"
        raise checks.conflict(f"template: {len(left)} marks too many for {rows} x {columns}, one at {at} of the image")
    return places


def grid_of(template: Template, places: np.ndarray) -> Grid:
    """Return the map from the image to the surface, from the positions of the marks in the image (rows, columns, 2)."""
    along = np.gradient(places, template.width, axis=1, edge_order=2 if template.columns > 2 else 1)
    across = np.gradient(places, template.height, axis=0, edge_order=2 if template.rows > 2 else 1)
    jacobian = np.ascontiguousarray(np.linalg.inv(np.stack([along, across], axis=-1)))
    return Grid(np.ascontiguousarray(places), jacobian, template.width, template.height)


@jit
def _cross(ax, ay, bx, by):
    return ax * by - ay * bx


@jit
def _within(grid, row, column, u, v):
    """Return (xi, eta) of the pixel (u, v) in a tetragon: the nearest solution of the quadratic equation."""
    places = grid.places
    u0, v0 = places[row, column, 0], places[row, column, 1]
    ex, ey = places[row, column + 1, 0] - u0, places[row, column + 1, 1] - v0  # along xi
    fx, fy = places[row + 1, column, 0] - u0, places[row + 1, column, 1] - v0  # along eta
    gx, gy = places[row + 1, column + 1, 0] - u0 - ex - fx, places[row + 1, column + 1, 1] - v0 - ey - fy
    px, py = u - u0, v - v0
    # p = xi e + eta f + xi eta g. The cross product with e + eta g leaves a quadratic in eta.
    a = _cross(fx, fy, gx, gy)
    b = _cross(fx, fy, ex, ey) + _cross(gx, gy, px, py)
    c = _cross(ex, ey, px, py)
    root = math.sqrt(max(b * b - 4.0 * a * c, 0.0))
    eta = -2.0 * c / (b + math.copysign(root, b)) if b != 0.0 or root != 0.0 else 0.0
    dx, dy = ex + eta * gx, ey + eta * gy
    qx, qy = px - eta * fx, py - eta * fy
    return (qx * dx + qy * dy) / (dx * dx + dy * dy), eta


@jit
def locate(grid, u, v, jacobian):
    """Return the position (x, y), m, on the surface of column ``u``, line ``v``; extrapolated beyond the marks.

    Args:
        jacobian: (4,) derivatives of x by column and line around there, then of y, written.
    """
    rows, columns = grid.places.shape[0] - 1, grid.places.shape[1] - 1
    row, column = rows // 2, columns // 2
    xi, eta = 0.5, 0.5
    for _ in range(rows + columns + 4):  # from tetragon to tetragon, several at a time
        xi, eta = _within(grid, row, column, u, v)
        then_column = min(max(column + math.floor(xi), 0), columns - 1)
        then_row = min(max(row + math.floor(eta), 0), rows - 1)
        if then_column == column and then_row == row:
            break
        row, column = then_row, then_column
    s, t = min(max(xi, 0.0), 1.0), min(max(eta, 0.0), 1.0)
    for i in range(2):
        for j in range(2):
            below = (1.0 - s) * grid.jacobian[row, column, i, j] + s * grid.jacobian[row, column + 1, i, j]
            above = (1.0 - s) * grid.jacobian[row + 1, column, i, j] + s * grid.jacobian[row + 1, column + 1, i, j]
            jacobian[2 * i + j] = (1.0 - t) * below + t * above
    return (column + xi) * grid.width, (row + eta) * grid.height


@jit(allocates=True)
def locate_all(grid: Grid, places: np.ndarray, points: np.ndarray) -> None:
    """Apply :func:`locate` for ``places`` (n, 2) into ``points`` (n, 2)."""
    jacobian = np.empty(4)
    for k in range(places.shape[0]):
        points[k, 0], points[k, 1] = locate(grid, places[k, 0], places[k, 1], jacobian)


@jit
def at_height(x, y, foot_x, foot_y, height, z):
    """Return (x, y) of a point at height ``z`` that appears at (x, y) on the surface.

    Args:
        foot_x, foot_y: m, point below the lens, at a distance of ``height``.
    """
    nearer = (height - z) / height
    return foot_x + nearer * (x - foot_x), foot_y + nearer * (y - foot_y)
