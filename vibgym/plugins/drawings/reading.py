"""Drawings of parts, from files; lengths in mm.

A reader returns the strokes of a drawing (:mod:`.dxf`, :mod:`.svg`), which :mod:`.contours` joins to outlines, or a mesh as it
lies (:mod:`.stl`). Nothing is guessed: a drawing that does not describe exactly one part is an error that names the entity.
"""

from __future__ import annotations

import importlib
import math
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks, extras
from vibgym.files import reason
from vibgym.plugins.drawings.records import GAP, UNITS, Drawing, Fault, Solid, refusal
from vibgym.scene import outlines
from vibgym.scene.part_settings import DrawingSettings, PartSettings
from vibgym.scene.parts import STEEL_DENSITY, Part, StablePose, skipped_text
from vibgym.scene.surface import Surface

PACKAGES = {
    ".dxf": ("ezdxf", "scipy", "shapely"), ".svg": ("svgpathtools", "tinycss2", "cssselect2", "scipy", "shapely"),
    ".stl": ("trimesh", "scipy", "shapely", "networkx"),
}  # fmt: skip
"""Packages of the extra ``cad`` that read each kind of file."""

MAX_BYTES = 50_000_000
"""Largest drawing file."""

MIN_SIZE, COARSEST = 0.5, 0.02
"""mm: largest dimension below which a part is implausible; and largest tolerance over the largest dimension of a part."""

PRISM = 0.05
"""Relative deviation from a prism above which a mesh gives a warning."""


def read_part(settings: DrawingSettings, surface: Surface | None) -> tuple[Part, tuple[StablePose, ...]]:
    """Return the part in a file and the stable poses of a mesh, see :func:`vibgym.scene.parts.drawn_part`."""
    drawing = read(settings, surface)
    path, solid = Path(settings.file), drawing.solid
    properties = {name: getattr(settings, name) for name in PartSettings.model_fields}
    if properties["name"] is None:
        properties["name"] = path.stem
    if solid is None:
        if settings.thickness is not None:
            properties["height"] = settings.thickness
    else:
        for name in ("thickness", "height", "centre_height"):
            if name in settings.model_fields_set and getattr(settings, name) is not None:
                raise checks.conflict(f"{name} is that of the mesh, in {path.name}")
        properties |= {"height": 1e-3 * solid.height, "centre_height": 1e-3 * solid.centre_height}
        if settings.mass is None:
            properties["mass"] = (settings.density or STEEL_DENSITY) * 1e-9 * solid.volume
    if drawing.radius is not None:
        part = Part.disc(1e-3 * drawing.radius, **properties)
    else:
        part = Part.polygon(1e-3 * drawing.rim, holes=[1e-3 * hole for hole in drawing.holes], **properties)
    if solid is not None:
        _warn_of_shape(part, solid)
    elif settings.density is not None:
        part = replace(part, mass=settings.density * part.area * part.height)
    if drawing.skipped:
        warnings.warn(f"part {part.name!r}: skipped {skipped_text(drawing.skipped)}", stacklevel=4)
    return replace(part, skipped=drawing.skipped), solid.poses if solid else ()


def _warn_of_shape(part: Part, solid: Solid) -> None:
    """Warn of a mesh that differs from a plate with its outline, as which it moves."""
    inertia = 1e-6 * solid.gyration / part.gyration
    offset = 1e-3 * solid.offset / part.radius
    if solid.resting < 1.0 - PRISM or abs(inertia - 1.0) > PRISM or offset > PRISM:
        warnings.warn(
            f"part {part.name!r} is no prism: it rests on {100 * solid.resting:.0f} % of its outline, its centre of mass is "
            f"{solid.offset:.3g} mm from the outline's, its inertia {inertia:.2f} of a plate's; it moves as a plate",
            stacklevel=5,
        )


def read(settings: DrawingSettings, surface: Surface | None = None) -> Drawing:
    """Read a drawing of one part.

    Args:
        surface: on which the part must fit at some heading; None: not checked.

    Raises:
        ValueError: a file that cannot be read, or that does not describe exactly one part; the message begins with the path.
            The attribute ``faults`` lists all faults of a drawing (:class:`vibgym.plugins.drawings.records.Fault`).
        MissingExtra: the extra ``cad`` is not installed.

    Warns:
        UserWarning: ``units`` that differ from those in the file.
    """
    path = Path(settings.file)
    kind = path.suffix.lower()
    if settings.units is not None:
        checks.choice("units", settings.units, tuple(UNITS))
    for name in ("scale", "layer", "without_layers", "part", "gap", "stable_pose"):
        if getattr(settings, name) not in (None, ()) and (name == "stable_pose") != (kind == ".stl"):
            raise checks.conflict(f"{name} is not an option of {kind} files, such as {path.name}")
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise checks.refuse("file", str(path), f"a readable file ({reason(error)})") from None
    extras.require("cad", *PACKAGES[kind])
    tolerance = _in_mm(settings.tolerance)
    with checks.within(path, kind=checks.Refused):
        if len(content) > MAX_BYTES:
            raise checks.refuse("file", f"{len(content)} bytes", f"at most {MAX_BYTES} bytes")
        reader = importlib.import_module(f"vibgym.plugins.drawings.{kind[1:]}")
        if kind == ".stl":
            rings, solid = reader.read(content, tolerance, settings.units, settings.stable_pose)
            skipped = Counter[str]()
        else:
            rings, skipped = _flat(reader, content, settings, tolerance, surface)
            solid = None
        _check_size(rings[0], tolerance)
        _check_fit(rings[0], surface, rings[0])
        corners = sum(map(len, rings))
        if corners > outlines.MAX_CORNERS:
            most = outlines.MAX_CORNERS
            raise checks.conflict(f"the outline has {corners} corners, more than {most}: give a larger tolerance_mm")
    radius = radius_of(rings[0], tolerance) if len(rings) == 1 else None
    return Drawing(rings[0], tuple(rings[1:]), radius, dict(skipped), solid)


def _flat(
    reader: Any, content: bytes, settings: DrawingSettings, tolerance: float, surface: Surface | None
) -> tuple[list[np.ndarray], Counter[str]]:
    """Return outline and holes of a part in a flat drawing, and what is skipped."""
    from vibgym.plugins.drawings import contours

    factor = 1.0 if settings.scale is None else settings.scale
    layers, without = (
        (names,) if isinstance(names, str) else names for names in (settings.layer, settings.without_layers)
    )
    gap = GAP * tolerance
    strokes, skipped, faults = reader.read(content, gap / factor, settings.units, layers, without)
    strokes = [stroke._replace(points=factor * stroke.points) for stroke in strokes]
    if not strokes:
        left = f" (skipped: {skipped_text(skipped)})" if skipped else ""
        raise refusal(faults or [Fault(f"the drawing has no outline: no lines or curves{left}")])
    # Before anything else is wrong: the largest line alone, since a file may have several parts.
    whole = np.concatenate([stroke.points for stroke in strokes])
    _check_size(whole, tolerance)
    largest = max((stroke.points for stroke in strokes), key=lambda points: np.ptp(points, axis=0).max())
    _check_fit(largest, surface, whole)
    bridge = 0.0 if settings.gap is None else _in_mm(settings.gap)
    rings, notes = contours.outline_of(strokes, tolerance, gap, bridge, settings.part, faults)
    return rings, +(skipped + notes)


def _in_mm(length: float) -> float:
    """Return a length in mm without the rounding of the conversion: of 0.05 mm exactly 0.05."""
    return float(f"{1e3 * length:.12g}")


def _check_size(points: np.ndarray, tolerance: float) -> None:
    extent = np.ptp(points, axis=0)
    least = max(MIN_SIZE, tolerance / COARSEST)
    if extent.max() < least:
        why = "" if least == MIN_SIZE else f", {1.0 / COARSEST:g} times tolerance_mm={tolerance:g}"
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
    along = np.ptp(points @ np.array([np.cos(angle), np.sin(angle)]), axis=0)
    return bool(((along <= width) & (np.roll(along, -90) <= depth)).any())


def radius_of(ring: np.ndarray, tolerance: float) -> float | None:
    """Return the radius of the circle with the area of a ring, if no edge is farther from it than the tolerance; else None."""
    radius = math.sqrt(abs(outlines.signed_area(ring)) / math.pi)
    points = ring - outlines.centroid(ring)
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    away = np.abs(np.hypot(*np.concatenate([points, middles]).T) - radius).max()
    return radius if away <= tolerance else None
