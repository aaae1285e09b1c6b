"""Drawings of parts, from files; lengths in mm.

A reader returns the strokes of a drawing (:mod:`.dxf`, :mod:`.svg`), which :mod:`.contours` joins to outlines, or a mesh as it
lies (:mod:`.stl`). Nothing is guessed: a drawing that does not describe exactly one part is an error that names the entity.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks, extras
from vibgym.files import reason
from vibgym.scene import outlines
from vibgym.scene.drawings import contours, dxf, stl, svg
from vibgym.scene.drawings.records import GAP, TOLERANCE, UNITS, Drawing, summary
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
    *,
    scale: float | None = None,
    layer: str | Sequence[str] | None = None,
    without_layers: str | Sequence[str] = (),
    part: int | None = None,
    gap: float | None = None,
    stable_pose: int | None = None,
    surface: Surface | None = None,
) -> Drawing:
    """Read a drawing of one part.

    Arguments are those of :meth:`vibgym.Part.from_file`, with ``tolerance`` and ``gap`` in mm. ``surface``: None, not checked.

    Raises:
        ValueError: a file that cannot be read, or that does not describe exactly one part; the message begins with the path.
            The attribute ``faults`` lists all faults of a drawing (:class:`vibgym.scene.drawings.records.Fault`).
        MissingExtra: the extra ``cad`` is not installed.

    Warns:
        UserWarning: ``units`` that differ from those in the file.
    """
    readers: dict[str, Callable[..., Any]] = {".dxf": dxf.read, ".svg": svg.read, ".stl": stl.read}
    if not isinstance(path, str | Path):
        raise checks.refuse("file", path, "a path")
    path = Path(path)
    kind = path.suffix.lower()
    reader = readers.get(kind)
    if reader is None:
        raise checks.refuse("file", str(path), "a drawing: " + ", ".join(readers))
    tolerance = checks.number("tolerance_mm", tolerance, least=LEAST_TOLERANCE)
    bridge = 0.0 if gap is None else checks.number("gap_mm", gap, least=0.0)
    layers, without = None if layer is None else _names("layer", layer), _names("without_layers", without_layers)
    if units is not None:
        checks.choice("units", units, tuple(UNITS))
    factor = 1.0 if scale is None else checks.number("scale", scale, above=0.0)
    options = {
        "scale": scale,
        "layer": layers,
        "without_layers": without or None,
        "part": part,
        "gap_mm": gap,
        "stable_pose": stable_pose,
    }
    for name, value in options.items():
        if value is not None and (name == "stable_pose") != (kind == ".stl"):
            raise checks.conflict(f"{name} is not an option of {kind} files, such as {path.name}")
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise checks.refuse("file", str(path), f"a readable file ({reason(error)})") from None
    with checks.within(path, kind=checks.Refused):
        if len(content) > MOST_BYTES:
            raise checks.refuse("file", f"{len(content)} bytes", f"at most {MOST_BYTES} bytes")
        skipped, solid = Counter[str](), None
        if kind == ".stl":
            rings, solid = reader(content, tolerance, units, stable_pose)
        else:
            strokes, skipped, *faults = reader(content, GAP * tolerance / factor, units, layers, without)
            extras.require("cad", "scipy", "shapely")
            strokes = [each._replace(points=factor * each.points) for each in strokes]
            if not strokes and not any(faults):
                left = f" (skipped: {summary(skipped)})" if skipped else ""
                raise checks.conflict(f"the drawing has no outline: no lines or curves{left}")
            if strokes:
                # Before anything else is wrong: the largest line alone, since a file may have several parts.
                whole = np.concatenate([each.points for each in strokes])
                _check_size(whole, tolerance)
                largest = max((each.points for each in strokes), key=lambda each: np.ptp(each, axis=0).max())
                _check_fit(largest, surface, whole)
            rings, notes = contours.outline_of(strokes, tolerance, GAP * tolerance, bridge, part, *faults)
            skipped = +(skipped + notes)
        _check_size(rings[0], tolerance)
        _check_fit(rings[0], surface, rings[0])
        corners = sum(map(len, rings))
        if corners > outlines.MOST_CORNERS:
            most = outlines.MOST_CORNERS
            raise checks.conflict(f"the outline has {corners} corners, more than {most}: give a larger tolerance_mm")
    radius = radius_of(rings[0], tolerance) if len(rings) == 1 else None
    return Drawing(rings[0], tuple(rings[1:]), radius, dict(skipped), solid)


def _names(argument: str, value: str | Sequence[str]) -> tuple[str, ...]:
    """Return one name or several as a tuple."""
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or not all(isinstance(each, str) for each in names):
        raise checks.refuse(argument, value, "a name or a list of names")
    return tuple(names)


def _check_size(points: np.ndarray, tolerance: float) -> None:
    extent = np.ptp(points, axis=0)
    size = float(extent.max())
    least = max(LEAST_SIZE, tolerance / COARSEST)
    if size < least:
        why = "" if least == LEAST_SIZE else f", {1.0 / COARSEST:g} times tolerance_mm={tolerance:g}"
        allowed = f"larger than {least:g} mm{why}: are the units right (units=, such as 'in')?"
        raise checks.refuse("part", _extent(extent), allowed)


def _check_fit(points: np.ndarray, surface: Surface | None, whole: np.ndarray) -> None:
    if surface is not None and not fits(points, 1e3 * surface.width, 1e3 * surface.depth):
        table = f"table of {_extent(1e3 * np.array([surface.width, surface.depth]))}: are the units right?"
        raise checks.refuse("part", _extent(np.ptp(whole, axis=0)), f"smaller than the {table}")


def _extent(size: np.ndarray) -> str:
    return f"{size[0]:.4g} x {size[1]:.4g} mm"


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
