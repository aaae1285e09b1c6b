"""Drawings in DXF, read by ezdxf."""

from __future__ import annotations

import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from ezdxf import bbox, recover
from ezdxf.audit import AuditError
from ezdxf.document import Drawing as Document
from ezdxf.entities import factory
from ezdxf.entities.dxfentity import DXFTagStorage
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.lldxf.const import DXFError

from vibgym import checks
from vibgym.plugins.drawings.contours import SAMPLES, Stroke
from vibgym.plugins.drawings.records import UNITS, Fault, factor_of, refusal

CODES = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 9: "mil", 13: "um", 14: "dm"}
"""Value of ``$INSUNITS`` -> unit."""

NOTES = frozenset(
    "ACAD_TABLE ARC_DIMENSION ATTDEF ATTRIB DIMENSION HATCH LARGE_RADIAL_DIMENSION LEADER MPOLYGON MTEXT MULTILEADER POINT "
    "TEXT TOLERANCE VIEWPORT WIPEOUT".split()
)
"""Types of entities that are no outlines: annotations, fillings, frames."""

REQUIRED = {
    "LINE": ("start", "end"), "CIRCLE": ("center", "radius"), "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis", "ratio"), "INSERT": ("insert",),
}  # fmt: skip
"""Attributes for which ezdxf has defaults, and a drawing has not."""

HARMLESS = frozenset(
    "INVALID_COLOR_INDEX INVALID_ELLIPSE_RATIO INVALID_LINEWEIGHT INVALID_TRANSPARENCY MISSING_REQUIRED_SEQEND "
    "REMOVED_STANDALONE_ATTRIB_ENTITY UNDEFINED_DIMENSION_STYLE UNDEFINED_LINETYPE UNDEFINED_TEXT_STYLE".split()
)
"""Repairs by ezdxf (:class:`ezdxf.audit.AuditError`) of entities that do not change their outlines."""

STRUCTURE = frozenset(["FOUND_TAG_OUTSIDE_SECTION", "MISSING_ENDSEC_TAG", "MISSING_SECTION_TAG"])
"""Repairs of a file that may have lost entities."""

BROKEN = ("acad_iso", "border", "cent", "dash", "divide", "dot", "hidden", "phantom")
"""Beginnings of the names of broken linetypes, for files without their definitions."""

DEEPEST = 30
"""Most blocks inside one another."""

SPAN = 64
"""Samples of a spline between two knots, at least."""


def read(
    content: bytes, flat: float, units: str | None, layers: tuple[str, ...] | None = None, without: tuple[str, ...] = ()
) -> tuple[list[Stroke], Counter[str], list[Fault]]:
    """Return the strokes of the model space of a DXF file, the numbers of other entities by type, and all faults.

    Args:
        flat: mm, largest distance from the plane of the drawing.
        layers, without: names in any case; None: all that are visible.
    """
    document = _document(content)
    code = document.header.get("$INSUNITS", 0)
    if code and code not in CODES and units is None:
        raise checks.refuse("$INSUNITS", code, f"one of {', '.join(f'{k} ({name})' for k, name in CODES.items())}")
    factor = factor_of(CODES.get(code), units, "$INSUNITS is 0 or missing")
    used = {entity.dxf.layer for entity in document.entitydb.values() if entity.dxf.hasattr("layer")}
    known = {name.lower(): name for name in (*used, *(layer.dxf.name for layer in document.layers))}
    for name in (*(layers or ()), *without):
        if name.lower() not in known:
            raise checks.unknown("layer", name, sorted(known.values()))
    reader = _Reader(document, factor, flat, layers, without)
    strokes = list(reader.strokes(document.modelspace(), _Place()))
    for layout in document.layouts:
        for entity in () if layout.is_modelspace else layout:
            reader.skipped[f"{entity.dxftype()} in paper space {layout.name!r}"] += entity.dxftype() != "VIEWPORT"
    return strokes, +reader.skipped, reader.faults


def _document(content: bytes) -> Document:
    """Return the document; entities and layers keep the names of linetypes without a definition.

    Raises:
        ValueError: not a DXF file, or one that lost geometry when ezdxf repaired it.
    """
    if content.startswith(b"AutoCAD Binary DXF"):
        raise checks.refuse("file", "binary DXF", "DXF in text")
    try:
        document, audit = recover.read(io.BytesIO(content))
    except (DXFError, OSError, ValueError, TypeError, IndexError, KeyError, AttributeError) as error:
        raise checks.refuse("file", str(error) or type(error).__name__, "a DXF file") from None
    faults = [
        Fault(("" if error.entity is None else f"{_label(error.entity)}: ") + error.message)
        for error in audit.errors
        if error.code != AuditError.INVALID_LAYER_NAME
    ]
    faults += [Fault(f"the file is damaged: {lost}") for fix in audit.fixes if (lost := _lost(fix))]
    if faults:
        raise refusal(faults)
    for fix in audit.fixes:
        if fix.code == AuditError.UNDEFINED_LINETYPE and fix.entity is not None and fix.data:
            fix.entity.dxf.linetype = str(fix.data)
    return document


def _lost(fix: Any) -> str | None:
    """Return what a repair by ezdxf says if it may have changed an outline; else None."""
    text = re.sub(r"\b([A-Z0-9_]+)\(#([0-9A-Fa-f]+)\)", r"\1 \2", fix.message)
    words = set(re.findall(r"\b[A-Z][A-Z0-9_]+\b", text))
    shapes = {word for word in words if issubclass(factory.ENTITY_CLASSES.get(word, object), DXFGraphic)} - NOTES
    name = AuditError(fix.code).name
    return text if name in STRUCTURE or (shapes and name not in HARMLESS) else None


def _label(entity: Any) -> str:
    return f"{entity.dxftype()} {entity.dxf.handle}"


class _Place(NamedTuple):
    """Where entities are: in the model space, or in a block at an insertion.

    Attributes:
        label: appended to theirs.
        matrix: (4, 4), of rows, to the model space.
        layer, linetype: of the insertion, which entities on layer 0 and with BYBLOCK have.
        off: the insertion whose layer is off; None: none.
        depth: of nested blocks.
    """

    label: str = ""
    matrix: np.ndarray = np.eye(4)
    layer: str | None = None
    linetype: str = "CONTINUOUS"
    off: str | None = None
    depth: int = 0


class _Reader:
    """Converter of entities to strokes.

    Args:
        factor: mm per unit.
        flat: mm, largest deviation from a plane parallel to the page.
        layers, without: see :func:`read`.

    Attributes:
        skipped: number of entities that are not read, by type and reason.
        faults: of entities that cannot be read.
    """

    def __init__(
        self, document: Document, factor: float, flat: float, layers: tuple[str, ...] | None, without: tuple[str, ...]
    ) -> None:
        self.factor, self.flat = factor, flat
        self.layers = None if layers is None else {name.lower() for name in layers}
        self.without = {name.lower() for name in without}
        table = {layer.dxf.name.lower(): layer for layer in document.layers}
        self.frozen = {name for name, layer in table.items() if layer.is_frozen()}
        self.off = {name for name, layer in table.items() if layer.is_off()} | {"defpoints"}
        self.linetype = {name: layer.dxf.linetype.lower() for name, layer in table.items()}
        self.broken = {kind.dxf.name.lower(): bool(kind.simplified_line_pattern()) for kind in document.linetypes}
        self.skipped, self.faults = Counter[str](), list[Fault]()
        self.level: float | None = None

    def strokes(self, entities: Iterable[DXFGraphic], at: _Place) -> Iterator[Stroke]:
        """Yield the strokes of entities; add to :attr:`faults` for those that are no outlines, or not parallel to the page."""
        for entity in entities:
            label = _label(entity) + at.label
            try:
                yield from self._strokes(entity, label, at)
            except checks.Refused as error:
                self.faults.append(Fault(str(error), self._centre(entity, at)))
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:  # of ezdxf
                self.faults.append(Fault(f"{label} is invalid: {error}", self._centre(entity, at)))

    def _centre(self, entity: DXFGraphic, at: _Place) -> np.ndarray | None:
        """Return the centre (2,) mm of an entity at fault; None if ezdxf cannot find it."""
        try:
            centre = np.array([*bbox.extents([entity]).center, 1.0])
        except Exception:  # of an entity that may be invalid in any way
            return None
        return self.factor * (centre @ at.matrix)[:2]

    def _strokes(self, entity: Any, label: str, at: _Place) -> Iterator[Stroke]:
        kind, (layer, linetype, hidden) = entity.dxftype(), self._properties(entity)
        layer = at.layer if layer == "0" and at.layer is not None else layer
        key = layer.lower()
        linetype = self.linetype.get(key, "") if linetype == "bylayer" else linetype
        linetype = at.linetype if linetype == "byblock" else linetype
        reason = "that is invisible" if hidden else None
        if key in self.frozen or (key in self.off and kind != "INSERT"):
            reason = f"on hidden layer {layer!r}"
        elif key in self.without or not (self.layers is None or key in self.layers or kind == "INSERT"):
            reason = f"on layer {layer!r}, which is not selected"
        elif kind in NOTES:
            reason = ""
        elif self.broken.get(linetype, linetype.startswith(BROKEN)) and kind != "INSERT":
            reason = f"with linetype {linetype!r}"
        absent = [name for name in REQUIRED.get(kind, ()) if not entity.dxf.hasattr(name)]
        if reason is not None:
            self.skipped[f"{kind} {reason}".strip()] += 1
        elif absent:
            raise checks.conflict(f"{label} has no {absent[0].replace('_', ' ')}")
        elif kind == "INSERT":
            off = label if key in self.off else at.off
            yield from self._block(entity, label, at._replace(layer=layer, linetype=linetype, off=off))
        elif at.off is not None:
            raise checks.conflict(
                f"{label}: the layer of {at.off} is off, that of the entity is not, and viewers differ in what they draw; "
                "freeze that layer, turn it on, or leave it out by without_layers="
            )
        else:
            for piece in self._pieces(entity, kind, label):
                yield Stroke(self._flat(_samples(piece, label), at.matrix, label), label)

    def _properties(self, entity: Any) -> tuple[str, str, bool]:
        """Return layer, linetype, and whether an entity is invisible."""
        if isinstance(entity, DXFTagStorage):  # of a type that ezdxf does not know
            tags = (tag for subclass in entity.xtags.subclasses for tag in subclass)
            return next((tag.value for tag in tags if tag.code == 8), "0"), "", False
        return entity.dxf.layer, entity.dxf.linetype.lower(), bool(entity.dxf.get("invisible", 0))

    def _block(self, insert: Any, label: str, at: _Place) -> Iterator[Stroke]:
        block = insert.block()
        if at.depth >= DEEPEST:
            raise checks.conflict(f"{label}: blocks are nested more than {DEEPEST} deep")
        if block is None or block.block.is_xref:
            what = "is in another file" if block is not None else "is unknown"
            raise checks.conflict(f"{label}: block {insert.dxf.name!r} {what}")
        for one in insert.multi_insert() if insert.mcount > 1 else (insert,):
            matrix = np.array(list(one.matrix44().rows())) @ at.matrix
            yield from self.strokes(block, at._replace(label=f" in {label}", matrix=matrix, depth=at.depth + 1))

    def _pieces(self, entity: Any, kind: str, label: str) -> Iterator[Any]:
        """Yield an entity, or the lines and arcs of a polyline."""
        if kind not in ("LWPOLYLINE", "POLYLINE"):
            yield entity
            return
        if kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
            raise checks.conflict(f"{label} is a mesh, not a polyline")
        if kind == "POLYLINE" and entity.dxf.flags & 6:
            raise checks.conflict(f"{label} is fitted by a curve or spline: explode it")
        self.skipped[f"{kind} with a width, of which the centre line is read"] += entity.has_width
        for piece in entity.virtual_entities():
            if piece.dxftype() != "LINE" or piece.dxf.start != piece.dxf.end:  # repeated corners
                yield piece

    def _flat(self, points: np.ndarray, matrix: np.ndarray, label: str) -> np.ndarray:
        """Return points (n, 2) in mm."""
        points = (points @ matrix[:3, :3] + matrix[3, :3]) * self.factor
        if not np.isfinite(points).all():
            raise checks.conflict(f"{label} has coordinates that are not finite")
        self.level = float(points[0, 2]) if self.level is None else self.level
        if np.abs(points[:, 2] - self.level).max() > self.flat:
            raise checks.conflict(f"{label} does not lie in the plane of the drawing, at z = {self.level:.6g} mm")
        return np.ascontiguousarray(points[:, :2])


def _samples(entity: Any, label: str) -> np.ndarray:
    """Return fine samples (n, 3) of a line or curve, in units of the file; of a curve 2^n + 1."""
    kind = entity.dxftype()
    if kind == "LINE":
        return np.array([entity.dxf.start, entity.dxf.end], dtype=float)
    if kind in ("ARC", "CIRCLE", "ELLIPSE"):
        begin, end, turn = 0.0, 0.0, 2.0 * math.pi if kind == "ELLIPSE" else 360.0
        if kind == "ARC":
            begin, end = entity.dxf.start_angle, entity.dxf.end_angle
        elif kind == "ELLIPSE":
            begin, end = entity.dxf.start_param, entity.dxf.end_param
        sweep = (end - begin) % turn or turn
        count = 2 ** max(3, math.ceil(math.log2(SAMPLES * sweep / turn)))
        return np.array(list(entity.vertices(np.linspace(begin, begin + sweep, count + 1))), dtype=float)
    if kind == "SPLINE":
        curve = entity.construction_tool()
        knots = np.unique(curve.knots()[curve.order - 1 : curve.count + 1])
        per = max(SPAN, 2 ** math.ceil(math.log2(SAMPLES / (len(knots) - 1))))
        t = np.interp(np.arange((len(knots) - 1) * per + 1) / per, np.arange(len(knots)), knots)
        return np.array(list(curve.points(t)), dtype=float)
    raise checks.conflict(f"{label}: entities of type {kind} are not outlines; remove it or select a layer")


assert set(CODES.values()) <= set(UNITS)
