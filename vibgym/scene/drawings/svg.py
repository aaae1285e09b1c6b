"""Drawings in SVG; svgpathtools parses paths and transforms."""

from __future__ import annotations

import io
import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from xml.parsers import expat

import numpy as np

from vibgym import checks, extras
from vibgym.scene.drawings.contours import SAMPLES, Stroke
from vibgym.scene.drawings.records import UNITS, factor_of

USER = {
    "": 1.0,
    "px": 1.0,
    "in": 96.0,
    "cm": 96.0 / 2.54,
    "mm": 96.0 / 25.4,
    "q": 24.0 / 25.4,
    "pt": 4.0 / 3.0,
    "pc": 16.0,
}
"""Unit of a length -> user units (CSS Values and Units 3, section 6.2)."""

GROUPS, USES = ("g", "a"), "use"
NO_OUTLINE = frozenset(
    "clipPath defs desc filter foreignObject image linearGradient marker mask metadata namedview pattern radialGradient script "
    "style symbol text title".split()
)
"""Elements that are not part of an outline: definitions, text, pictures."""

TRANSFORMS = re.compile(r"\s*((matrix|translate|scale|rotate|skewX|skewY)\s*\([-+.\deE,\s]+\)[\s,]*)*")

DEEPEST = 60
"""Most elements inside one another."""


def read(
    content: bytes, flat: float, units: str | None, layers: tuple[str, ...] | None = None, without: tuple[str, ...] = ()
) -> tuple[list[Stroke], Counter[str]]:
    """Return the strokes of an SVG file, whose y axis points down, and the numbers of other elements; see :mod:`.dxf`."""
    del flat  # a plane drawing
    if layers is not None or without:
        raise checks.conflict("layers of SVG files cannot be selected")
    extras.require("cad", "svgpathtools")
    root = _tree(content)
    reader = _Reader(root)
    matrix = np.diag([1.0, -1.0, 1.0]) @ _page(root, units)
    strokes = list(reader.strokes(root, matrix))
    return strokes, reader.skipped


def _tree(content: bytes) -> ET.Element:
    """Return the root; each element has the number of its line as attribute ``line``, and its name without namespace."""
    parser = expat.ParserCreate(namespace_separator="}")
    builder = ET.TreeBuilder()

    def start(name: str, attributes: dict[str, str]) -> None:
        plain = {key.rpartition("}")[2]: value for key, value in attributes.items()}
        builder.start(name.rpartition("}")[2], {**plain, "line": str(parser.CurrentLineNumber)})

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: builder.end(name) and None
    try:
        parser.ParseFile(io.BytesIO(content))
    except expat.ExpatError as error:
        raise checks.refuse("file", str(error), "well-formed XML") from None
    root = builder.close()
    if root.tag != "svg":
        raise checks.refuse("file", f"element {root.tag!r}", "an SVG document")
    return root


def _page(root: ET.Element, units: str | None) -> np.ndarray:
    """Return the (3, 3) matrix from the coordinates of the file to mm."""
    sizes = [_length(root, name) for name in ("width", "height")]
    box = [float(each) for each in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if each]
    if len(box) not in (0, 4) or (box and min(box[2:]) <= 0.0):
        raise checks.refuse(_label(root) + ": viewBox", root.get("viewBox"), "x, y, width > 0, height > 0")
    known = [(size, unit) for size, unit in sizes if unit not in ("", "px", "%", None)]
    if not known:
        return np.diag(
            [*(2 * [factor_of(None, units, "the width and height of the svg element have no physical unit")]), 1.0]
        )
    if units is not None:
        raise checks.conflict(f"units={units!r}, but the file has a width or height in {known[0][1]}")
    per_user = UNITS["in"] / USER["in"]
    if not box:
        return np.diag([per_user, per_user, 1.0])
    scales = [
        size * USER[unit] / extent
        for (size, unit), extent in zip(sizes, box[2:], strict=True)
        if unit not in ("", "px", "%", None)
    ]
    if root.get("preserveAspectRatio", "").strip() == "none" and len(scales) == 2:
        return np.diag([per_user * scales[0], per_user * scales[1], 1.0])
    return np.diag([per_user * min(scales), per_user * min(scales), 1.0])


def _length(element: ET.Element, name: str, default: str | None = None) -> tuple[float, str | None]:
    """Return number and unit of a length; ``(0, None)`` without one.

    Raises:
        ValueError: not a length.
    """
    text = element.get(name, default)
    if text is None or text.strip() == "auto":
        return 0.0, None
    found = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(%|[a-zA-Z]*)\s*", text)
    if found is None or (found[2] != "%" and found[2].lower() not in USER):
        raise checks.refuse(f"{_label(element)}: {name}", text, "a length")
    return float(found[1]), found[2].lower()


def _user(element: ET.Element, name: str, default: str = "0") -> float:
    """Return a length in user units."""
    size, unit = _length(element, name, default)
    if unit == "%":
        raise checks.refuse(f"{_label(element)}: {name}", element.get(name), "a length, not a percentage")
    return size * USER[unit or ""]


def _label(element: ET.Element) -> str:
    return f"{element.tag} in line {element.get('line')}"


class _Reader:
    """Converter of elements to strokes; ``skipped`` counts the others."""

    def __init__(self, root: ET.Element) -> None:
        self.skipped: Counter[str] = Counter()
        self.named = {each.get("id"): each for each in root.iter() if each.get("id")}

    def strokes(self, element: ET.Element, matrix: np.ndarray, depth: int = 0) -> Iterator[Stroke]:
        """Yield the strokes of an element, in mm.

        Args:
            matrix: (3, 3) from the coordinates around the element to mm.
            depth: of the element.

        Raises:
            ValueError: an element that is not supported, or invalid.
        """
        kind, label = element.tag, _label(element)
        if depth > DEEPEST:
            raise checks.conflict(f"{label}: more than {DEEPEST} elements inside one another")
        style = element.get("style", "").replace(" ", "")
        hidden = element.get("display") == "none" or element.get("visibility") == "hidden"
        if kind in NO_OUTLINE or hidden or "display:none" in style or "visibility:hidden" in style:
            self.skipped[kind] += 1
            return
        matrix = matrix @ self._transform(element, label)
        if (kind == "svg" and depth == 0) or kind in GROUPS:
            for child in element:
                yield from self.strokes(child, matrix, depth + 1)
        elif kind == USES:
            target = self.named.get(element.get("href", "").removeprefix("#"))
            if target is None:
                raise checks.conflict(f"{label}: unknown element {element.get('href')!r}")
            moved = np.array([[1.0, 0.0, _user(element, "x")], [0.0, 1.0, _user(element, "y")], [0.0, 0.0, 1.0]])
            yield from self.strokes(target, matrix @ moved, depth + 1)
        else:
            yield from _samples(_path(element, label), matrix, label)

    def _transform(self, element: ET.Element, label: str) -> np.ndarray:
        from svgpathtools.parser import parse_transform

        text = element.get("transform", "")
        try:
            matrix = np.asarray(parse_transform(text), dtype=float)
        except (ValueError, IndexError, TypeError, AssertionError):
            matrix = np.full((3, 3), np.nan)
        # The parser skips what it does not know.
        if not TRANSFORMS.fullmatch(text) or not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-12:
            raise checks.refuse(f"{label}: transform", text, "an invertible transform")
        return matrix


def _path(element: ET.Element, label: str) -> str:
    """Return the path data of a shape."""
    from svgpathtools.svg_to_paths import ellipse2pathd, rect2pathd

    kind = element.tag
    if kind == "path":
        return element.get("d", "")
    if kind in ("polyline", "polygon"):
        numbers = [each for each in re.split(r"[\s,]+", element.get("points", "").strip()) if each]
        if len(numbers) < 4 or len(numbers) % 2:
            raise checks.refuse(f"{label}: points", element.get("points"), "at least two pairs of coordinates")
        return f"M {' '.join(numbers[:2])} L {' '.join(numbers[2:])}" + (" Z" if kind == "polygon" else "")
    if kind == "line":
        return "M {} {} L {} {}".format(*(_user(element, name) for name in ("x1", "y1", "x2", "y2")))
    if kind in ("circle", "ellipse"):
        x, y = _user(element, "cx"), _user(element, "cy")
        a, b = (_user(element, "r"),) * 2 if kind == "circle" else (_user(element, "rx"), _user(element, "ry"))
        if min(a, b) <= 0.0:
            raise checks.refuse(f"{label}: radius", min(a, b), "> 0")
        return ellipse2pathd({"cx": x, "cy": y, "rx": a, "ry": b})
    if kind == "rect":
        rect = {name: _user(element, name) for name in ("x", "y", "width", "height")}
        w, h = rect["width"], rect["height"]
        if min(w, h) <= 0.0:
            raise checks.refuse(f"{label}: size", f"{w:g} x {h:g}", "> 0")
        a, b = (_user(element, name, element.get(other, "0")) for name, other in (("rx", "ry"), ("ry", "rx")))
        return rect2pathd(rect | ({"rx": min(a, 0.5 * w), "ry": min(b, 0.5 * h)} if min(a, b) > 0.0 else {}))
    raise checks.conflict(f"{label}: elements of this type are not supported")


def _samples(data: str, matrix: np.ndarray, label: str) -> Iterator[Stroke]:
    """Yield the segments of path data."""
    from svgpathtools import Line, parse_path

    try:
        path = parse_path(data)
    except Exception as error:  # of a parser that expects valid data
        raise checks.refuse(f"{label}: d", str(error) or type(error).__name__, "path data") from None
    for segment in path:
        if isinstance(segment, Line) and abs(segment.end - segment.start) <= 1e-12 * abs(segment.end):
            continue  # closes a path at its beginning, or repeats a point
        straight = isinstance(segment, Line)
        t = np.linspace(0.0, 1.0, 2 if straight else SAMPLES // 4 + 1)
        z = np.asarray([segment.point(each) for each in t], dtype=np.complex128)
        points = (np.column_stack([np.real(z), np.imag(z)]) @ matrix[:2, :2].T) + matrix[:2, 2]
        if not np.isfinite(points).all():
            raise checks.conflict(f"{label} has coordinates that are not finite")
        yield Stroke(points, not straight, label)


assert math.isclose(USER["in"] / USER["mm"], UNITS["in"])
