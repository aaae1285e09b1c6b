"""Drawings of parts, from files; lengths in mm.

A reader returns the strokes of a drawing (:mod:`.dxf`, :mod:`.svg`), which :mod:`.contours` joins to outlines, or a mesh as it
lies (:mod:`.stl`). Nothing is guessed: a drawing that does not describe exactly one part is an error that names the entity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import reason
from vibgym.scene import outlines
from vibgym.scene.drawings import contours, dxf, stl, svg
from vibgym.scene.drawings.records import GAP, TOLERANCE, UNITS, Drawing
from vibgym.scene.surface import Surface

MOST_BYTES = 50_000_000
"""Largest drawing file."""

LEAST_SIZE, LEAST_TOLERANCE = 0.5, 1e-4
"""mm: largest dimension below which a part is implausible, and the finest tolerance."""

COARSEST = 0.02
"""Largest tolerance over the largest dimension of a part."""


def read(
    path: str | Path,
    tolerance: float = TOLERANCE,
    units: str | None = None,
    layer: str | None = None,
    stable_pose: int | None = None,
    surface: Surface | None = None,
) -> Drawing:
    """Read a drawing of one part.

    Args:
        path: a ``.dxf``, ``.svg`` or ``.stl`` file.
        tolerance: mm, of flattened curves.
        units: a key of :data:`UNITS`, for files that do not name their unit; STL files are in mm by default.
        layer: of a DXF file, whose other layers are not read.
        stable_pose: number of a pose of an STL file, the most probable one is 0; None: as modelled.
        surface: on which the part must fit; None: not checked.

    Raises:
        ValueError: a file that cannot be read, or that does not describe exactly one part; the message begins with the path.
        MissingExtra: the extra ``cad`` is not installed.
    """
    readers: dict[str, Callable[..., Any]] = {".dxf": dxf.read, ".svg": svg.read, ".stl": stl.read}
    if not isinstance(path, str | Path):
        raise checks.refuse("file", path, "a path")
    path = Path(path)
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise checks.refuse("file", str(path), "a drawing: " + ", ".join(readers))
    tolerance = checks.number("tolerance_mm", tolerance, least=LEAST_TOLERANCE)
    if units is not None:
        checks.choice("units", units, tuple(UNITS))
    options = {"layer": (layer, ".dxf"), "stable_pose": (stable_pose, ".stl")}
    for name, (value, kind) in options.items():
        if value is not None and path.suffix.lower() != kind:
            raise checks.conflict(f"{name} is an option of {kind} files, not of {path.name}")
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise checks.refuse("file", str(path), f"a readable file ({reason(error)})") from None
    with checks.within(path, kind=checks.Refused):
        if len(content) > MOST_BYTES:
            raise checks.refuse("file", f"{len(content)} bytes", f"at most {MOST_BYTES} bytes")
        mine = {name: value for name, (value, kind) in options.items() if path.suffix.lower() == kind}
        if path.suffix.lower() == ".stl":
            rings, solid = reader(content, tolerance, units, **mine)
            skipped: Mapping[str, int] = {}
            _check_size(rings[0], tolerance, surface)
        else:
            strokes, skipped = reader(content, GAP * tolerance, units, **mine)
            if strokes:
                _check_size(np.concatenate([each.points for each in strokes]), tolerance, surface)
            rings, solid = contours.outline_of(strokes, tolerance, GAP * tolerance), None
        corners = sum(map(len, rings))
        if corners > outlines.MOST_CORNERS:
            most = outlines.MOST_CORNERS
            raise checks.conflict(f"the outline has {corners} corners, more than {most}: give a larger tolerance_mm")
    radius = radius_of(rings[0], tolerance) if len(rings) == 1 else None
    return Drawing(rings[0], tuple(rings[1:]), radius, dict(skipped), solid)


def _check_size(points: np.ndarray, tolerance: float, surface: Surface | None) -> None:
    extent = np.ptp(points, axis=0)
    size, shown = float(extent.max()), f"{extent[0]:.4g} x {extent[1]:.4g} mm"
    if size < LEAST_SIZE:
        raise checks.refuse("part", shown, f"larger than {LEAST_SIZE:g} mm: are the units right?")
    if tolerance > COARSEST * size:
        raise checks.refuse(
            "tolerance_mm", tolerance, f"at most {COARSEST:g} of the part's size, {COARSEST * size:.3g}"
        )
    if surface is not None and not fits(points, 1e3 * surface.width, 1e3 * surface.depth):
        table = f"{1e3 * surface.width:.4g} x {1e3 * surface.depth:.4g} mm"
        raise checks.refuse("part", shown, f"smaller than the table of {table}: are the units right?")


def fits(points: np.ndarray, width: float, depth: float) -> bool:
    """Return whether points (n, 2) fit into a rectangle at one of 180 headings."""
    angle = np.linspace(0.0, math.pi, 180, endpoint=False)
    along = points @ np.array([np.cos(angle), np.sin(angle)])
    across = points @ np.array([-np.sin(angle), np.cos(angle)])
    return bool(((np.ptp(along, axis=0) <= width) & (np.ptp(across, axis=0) <= depth)).any())


def radius_of(ring: np.ndarray, tolerance: float) -> float | None:
    """Return the radius of the circle with the area of a ring, if no edge is farther from it than the tolerance; else None."""
    radius = math.sqrt(abs(outlines.signed_area(ring)) / math.pi)
    points = ring - outlines.centroid(ring)
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    away = np.abs(np.hypot(*np.concatenate([points, middles]).T) - radius).max()
    return radius if away <= tolerance else None
