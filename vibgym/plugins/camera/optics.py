"""Projection of points to the image: pinhole camera with radial distortion, at any pose.

Image coordinates are ``(column, line)`` in pixels, with pixel centres at whole numbers and line 0 at the top, which is at the
largest y for a vertical optical axis. An image has every line of the chip, or one for every two (``pitch``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit

PIXELS = (752, 570)
"""Columns and lines of the prototype's camera (thesis section 5.1)."""

CHIP = 868e-3 * 6e-3 / 0.772
"""m, width. The thesis gives 6.7 mm, rounded; this value reproduces its field of view of 868 mm at 0.772 m with a 6 mm lens.
Pixels are square, like the thesis's of 1.15 mm, within 0.01 %."""

_NEAREST = 1e-6
"""m, least depth of a visible point."""


class Optics(NamedTuple):
    """The camera, for kernels."""

    place: np.ndarray  # (3,) m, of the lens in the surface's frame
    axes: np.ndarray  # (3, 3) rows: directions of increasing columns, of increasing lines, and of view
    focal: float  # px
    bend: float  # 1/px^2: a point r px from the centre is moved outwards by bend r^3 (Brown's first coefficient)
    column: float  # px, principal point
    line: float  # px, in lines of the chip
    pitch: float  # lines of the chip that make one line of the image


def optics_of(
    position: tuple[float, float],
    height: float = 0.772,
    *,
    tilt: tuple[float, float] = (0.0, 0.0),
    lens: float = 6e-3,
    chip: float = CHIP,
    pixels: tuple[int, int] = PIXELS,
    distortion: float = 0.0,
    pitch: int = 1,
) -> Optics:
    """Return the camera from its dimensions.

    Args:
        position: of the lens over the surface, m.
        height: of the lens above the surface, m.
        tilt: rotations about the surface's x and y axes from the vertical optical axis, rad (about y first).
        lens: focal length, m.
        chip: width of the chip, m; its pixels are square.
        pixels: columns and lines of the chip.
        distortion: displacement of the image's corner outwards, over its distance from the centre.
        pitch: lines of the chip that make one line of the image.
    """
    columns, lines = pixels
    (cx, sx), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in tilt)
    # With a vertical optical axis, columns grow along x and lines against y.
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    axes = np.ascontiguousarray(np.diag([1.0, -1.0, -1.0]) @ (about_x @ about_y).T)
    focal = lens * columns / chip
    corner = 0.25 * (columns**2 + lines**2)
    place = np.array([*position, height], dtype=np.float64)
    return Optics(place, axes, focal, distortion / corner, 0.5 * (columns - 1), 0.5 * (lines - 1), float(pitch))


@jit
def project(optics, x, y, z):
    """Return column and line at which a point (m) is seen; NaN behind the lens."""
    place, axes = optics.place, optics.axes
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    depth = axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz
    if not depth > _NEAREST:
        return math.nan, math.nan
    scale = optics.focal / depth
    u = scale * (axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz)
    v = scale * (axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz)
    moved = 1.0 + optics.bend * (u * u + v * v)
    return optics.column + moved * u, (optics.line + moved * v + 0.5) / optics.pitch - 0.5


@jit
def project_all(optics, points, places):
    """Apply :func:`project` for ``points`` (n, 3) into ``places`` (n, 2)."""
    for k in range(points.shape[0]):
        places[k, 0], places[k, 1] = project(optics, points[k, 0], points[k, 1], points[k, 2])


def projected(optics: Optics, points: np.ndarray) -> np.ndarray:
    """Return image coordinates (n, 2), column and line, of points (n, 3), m."""
    places = np.empty((len(points), 2))
    project_all(optics, np.ascontiguousarray(points, dtype=np.float64), places)
    return places
