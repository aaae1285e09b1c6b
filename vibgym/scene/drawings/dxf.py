"""Drawings in DXF, read by ezdxf."""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from vibgym import checks, extras
from vibgym.scene.drawings.contours import SAMPLES, Stroke
from vibgym.scene.drawings.records import UNITS, factor_of

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document
    from ezdxf.entities.dxfgfx import DXFGraphic

CODES = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 9: "mil", 13: "um", 14: "dm"}
"""Value of ``$INSUNITS`` -> unit."""

NOTES = frozenset(
    "ACAD_TABLE ARC_DIMENSION ATTDEF ATTRIB DIMENSION HATCH LARGE_RADIAL_DIMENSION LEADER MPOLYGON MTEXT MULTILEADER POINT "
    "TEXT TOLERANCE VIEWPORT WIPEOUT".split()
)
"""Types of entities that are no outlines: annotations, fillings, frames."""

DEEPEST = 30
"""Most blocks inside one another."""

SPAN = 64
"""Samples of a spline between two knots, at least."""


def read(content: bytes, flat: float, units: str | None, layer: str | None) -> tuple[list[Stroke], Counter[str]]:
    """Return the strokes of the model space of a DXF file, and the numbers of other entities by type.

    Args:
        content: of the file.
        flat: mm, largest distance from the plane of the drawing.
        units, layer: see :func:`vibgym.scene.drawings.drawing.read`.
    """
    extras.require("cad", "ezdxf")
    document = _document(content)
    code = document.header.get("$INSUNITS", 0)
    if code and code not in CODES:
        raise checks.refuse("$INSUNITS", code, f"one of {', '.join(f'{k} ({name})' for k, name in CODES.items())}")
    factor = factor_of(CODES.get(code), units, "$INSUNITS is 0 or missing")
    if layer is not None and layer not in document.layers:
        raise checks.unknown("layer", layer, sorted(each.dxf.name for each in document.layers))
    skipped: Counter[str] = Counter()
    reader = _Reader(factor, flat, layer, document, skipped)
    strokes = [stroke for entity in document.modelspace() for stroke in reader.strokes(entity, _label(entity))]
    return strokes, skipped


def _document(content: bytes) -> Document:
    from ezdxf import recover
    from ezdxf.lldxf.const import DXFError

    if content.startswith(b"AutoCAD Binary DXF"):
        raise checks.refuse("file", "binary DXF", "DXF in text")
    try:
        document, audit = recover.read(io.BytesIO(content))
    except (DXFError, OSError, ValueError, TypeError, IndexError, KeyError, AttributeError) as error:
        raise checks.refuse("file", str(error) or type(error).__name__, "a DXF file") from None
    if audit.has_errors:
        fault = audit.errors[0]
        where = "" if fault.entity is None else f"{_label(fault.entity)}: "
        raise checks.conflict(f"{where}{fault.message}")
    return document


def _label(entity: Any) -> str:
    return f"{entity.dxftype()} {entity.dxf.handle}"


class _Reader:
    """Converter of entities to strokes.

    Args:
        factor: mm per unit.
        flat: mm, largest deviation from a plane parallel to the page.
        layer: to read; None: all that are visible.
        skipped: counts entities by type.
    """

    def __init__(
        self, factor: float, flat: float, layer: str | None, document: Document, skipped: Counter[str]
    ) -> None:
        self.factor, self.flat, self.layer, self.skipped = factor, flat, layer, skipped
        self.hidden = {each.dxf.name for each in document.layers if each.is_off() or each.is_frozen()} | {"Defpoints"}
        self.level: float | None = None

    def strokes(self, entity: DXFGraphic, label: str, depth: int = 0, on: str | None = None) -> Iterator[Stroke]:
        """Yield the strokes of an entity.

        Args:
            label: of it, with those of the blocks that contain it.
            depth: of nested blocks.
            on: layer of the insertion, which entities of a block on layer 0 have.

        Raises:
            ValueError: an entity that is no outline, or not parallel to the page.
        """
        kind, layer = entity.dxftype(), entity.dxf.layer
        layer = on if layer == "0" and on is not None else layer
        if kind == "INSERT":
            yield from self._block(entity, label, depth, layer)
            return
        if layer in self.hidden or entity.dxf.get("invisible", 0) or self.layer not in (None, layer):
            self.skipped[f"{kind} on a hidden or other layer"] += 1
        elif kind in NOTES:
            self.skipped[kind] += 1
        elif kind in ("LWPOLYLINE", "POLYLINE"):
            yield from self._polyline(entity, label)
        else:
            points = self._samples(entity, kind, label)
            yield Stroke(self._flat(points, label), kind != "LINE", label)

    def _block(self, insert: Any, label: str, depth: int, layer: str) -> Iterator[Stroke]:
        if depth >= DEEPEST:
            raise checks.conflict(f"{label}: blocks are nested more than {DEEPEST} deep")
        if insert.block() is None:
            raise checks.conflict(f"{label}: unknown block {insert.dxf.name!r}")
        for one in insert.multi_insert() if insert.mcount > 1 else (insert,):
            try:
                inner = list(one.virtual_entities(skipped_entity_callback=_refuse_in(label)))
            except (ValueError, ZeroDivisionError, ArithmeticError) as error:
                raise checks.conflict(f"{label}: {error}") from None
            for entity in inner:
                source = entity.source_of_copy
                name = entity.dxftype() if source is None else _label(source)
                yield from self.strokes(entity, f"{name} in {label}", depth + 1, layer)

    def _polyline(self, entity: Any, label: str) -> Iterator[Stroke]:
        if entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
            raise checks.conflict(f"{label} is a mesh, not a polyline")
        if entity.dxftype() == "POLYLINE" and entity.dxf.flags & 6:
            raise checks.conflict(f"{label} is fitted by a curve or spline: explode it")
        for piece in entity.virtual_entities():
            points = self._samples(piece, piece.dxftype(), label)
            if len(points) > 2 or np.hypot(*(points[1] - points[0])[:2]) * self.factor > self.flat:  # repeated corners
                yield Stroke(self._flat(points, label), piece.dxftype() != "LINE", label)

    def _samples(self, entity: Any, kind: str, label: str) -> np.ndarray:
        """Return fine samples (n, 3) of a line or curve, in units of the file."""
        try:
            if kind == "LINE":
                return np.array([entity.dxf.start, entity.dxf.end], dtype=float)
            if kind == "ARC":
                begin, end = entity.dxf.start_angle, entity.dxf.end_angle
                sweep = (end - begin) % 360.0 or 360.0
                return np.array(list(entity.vertices(np.linspace(begin, begin + sweep, _count(sweep / 360.0)))), float)
            if kind == "CIRCLE":
                return np.array(list(entity.vertices(np.linspace(0.0, 360.0, SAMPLES + 1))), dtype=float)
            if kind == "ELLIPSE":
                begin, whole = entity.dxf.start_param, 2.0 * math.pi
                sweep = (entity.dxf.end_param - begin) % whole or whole
                share = sweep / whole
                return np.array(list(entity.vertices(np.linspace(begin, begin + sweep, _count(share)))), dtype=float)
            if kind == "SPLINE":
                curve = entity.construction_tool()
                knots = np.array(curve.knots())
                knots = np.unique(knots[curve.order - 1 : curve.count + 1])
                per = max(SPAN, 2 ** math.ceil(math.log2(SAMPLES / (len(knots) - 1))))
                t = np.interp(np.arange((len(knots) - 1) * per + 1) / per, np.arange(len(knots)), knots)
                return np.array(list(curve.points(t)), dtype=float)
        except (ValueError, ZeroDivisionError, ArithmeticError, TypeError, IndexError) as error:
            raise checks.conflict(f"{label} is invalid: {error}") from None
        raise checks.conflict(f"{label}: entities of type {kind} are not outlines; remove it or select a layer")

    def _flat(self, points: np.ndarray, label: str) -> np.ndarray:
        """Return points (n, 2) in mm."""
        points = points * self.factor
        if not np.isfinite(points).all():
            raise checks.conflict(f"{label} has coordinates that are not finite")
        if points.shape[1] > 2:
            self.level = float(points[0, 2]) if self.level is None else self.level
            if np.abs(points[:, 2] - self.level).max() > self.flat:
                raise checks.conflict(f"{label} does not lie in the plane of the drawing, at z = {self.level:.6g} mm")
        return np.ascontiguousarray(points[:, :2])


def _count(share: float) -> int:
    """Return the number of samples of a share of a full turn: one more than a power of two."""
    return 2 ** max(3, math.ceil(math.log2(SAMPLES * share))) + 1


def _refuse_in(label: str) -> Any:
    def refuse(entity: Any, why: str) -> None:
        raise checks.conflict(f"{_label(entity)} in {label} cannot be transformed ({why}); explode the block")

    return refuse


assert set(CODES.values()) <= set(UNITS)
