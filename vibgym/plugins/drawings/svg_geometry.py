"""Lengths, transforms, viewports and outlines of the elements of SVG drawings; svgpathtools parses paths and transforms."""

from __future__ import annotations

import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import numpy as np
from svgpathtools import Line, Path
from svgpathtools.parser import parse_transform
from svgpathtools.svg_to_paths import ellipse2pathd, rect2pathd

from vibgym import checks
from vibgym.plugins.drawings.contours import SAMPLES, Stroke
from vibgym.plugins.drawings.records import UNITS

USER = {unit: UNITS[unit] / UNITS["px"] for unit in ("px", "in", "cm", "mm", "pt")}
USER |= {"": 1.0, "q": 0.25 * USER["mm"], "pc": 12.0 * USER["pt"]}
"""Unit of a length -> user units (CSS Values and Units 3, section 6.2)."""

LENGTHS = {
    "line": ("x1", "y1", "x2", "y2"), "rect": ("x", "y", "width", "height", "rx", "ry"),
    "circle": ("cx", "cy", "r"), "ellipse": ("cx", "cy", "rx", "ry"),
}  # fmt: skip
"""Attributes of shapes that are lengths."""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def label_of(element: ET.Element) -> str:
    """Return the type and line of an element, for errors."""
    return f"{element.tag} in line {element.get('}line')}"


def _numbers(text: str, name: str) -> list[str]:
    """Return the numbers of a list, which commas, spaces or signs separate."""
    if re.sub(NUMBER, "", text).strip(", \t\r\n") or re.search(r",\s*,", text):
        raise checks.refuse(name, text, "a list of numbers")
    return re.findall(NUMBER, text)


def length(element: ET.Element, name: str, extent: float = math.nan, default: str = "0") -> tuple[float, str]:
    """Return a length in user units, and its unit.

    Args:
        element: with the attribute ``name``.
        name: of the attribute.
        extent: length of which percentages are.
        default: without the attribute, or where it is ``auto``.
    """
    text = element.get(name, "auto").strip()
    match = re.fullmatch(rf"({NUMBER})\s*(%|[a-zA-Z]*)", default if text == "auto" else text)
    unit = match[2].lower() if match else "?"
    scale = 0.01 * extent if unit == "%" else USER.get(unit, math.nan)
    if match is None or not math.isfinite(float(match[1]) * scale):
        raise checks.refuse(f"{label_of(element)}: {name}", text, "a length" + " of known size" * (unit == "%"))
    return float(match[1]) * scale, unit


def view_box(element: ET.Element) -> list[float]:
    """Return x, y, width and height of the coordinates inside a viewport; empty if they are not given."""
    text, name = element.get("viewBox", ""), f"{label_of(element)}: viewBox"
    box = [float(number) for number in _numbers(text, name)]
    if box and (len(box) != 4 or min(box[2:]) <= 0.0):
        raise checks.refuse(name, text, "x, y, width > 0, height > 0")
    return box


def viewport(element: ET.Element, width: float, height: float) -> tuple[np.ndarray, tuple[float, float]]:
    """Return the (3, 3) matrix from the coordinates inside a viewport to those of the viewport, and the size inside."""
    box = view_box(element)
    if not box:
        return np.eye(3), (width, height)
    aspect = element.get("preserveAspectRatio", "xMidYMid").strip()
    match = re.fullmatch(r"(?:none|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?", aspect)
    if match is None:
        raise checks.refuse(f"{label_of(element)}: preserveAspectRatio", aspect, "none or xMidYMid, ... meet or slice")
    scale = np.array([width, height]) / box[2:]
    if match[1]:
        scale[:] = scale.max() if match[3] == "slice" else scale.min()
    share = np.array([{"Min": 0.0, "Mid": 0.5, "Max": 1.0}[alignment or "Min"] for alignment in match.groups()[:2]])
    move = share * ([width, height] - scale * box[2:]) - scale * box[:2]
    return np.array([[scale[0], 0.0, move[0]], [0.0, scale[1], move[1]], [0.0, 0.0, 1.0]]), (box[2], box[3])


def shift(x: float, y: float) -> np.ndarray:
    """Return the (3, 3) matrix of a translation."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def transform(element: ET.Element, label: str) -> np.ndarray:
    """Return the (3, 3) matrix of the transform of an element."""
    text, name = element.get("transform", ""), f"{label}: transform"
    spaced = re.sub(r"\(([^()]*)\)", lambda match: f"({' '.join(_numbers(match[1], name))})", text)
    try:
        matrix = np.asarray(parse_transform(spaced, strict=True), dtype=float)
    except (ValueError, IndexError, TypeError, AssertionError):
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-12:
        raise checks.refuse(name, text, "an invertible transform")
    return matrix


def curves(element: ET.Element, size: tuple[float, float], matrix: np.ndarray, label: str) -> Iterator[list[Stroke]]:
    """Yield the strokes of each subpath of a shape that has an extent.

    Args:
        element: the shape.
        size: of the viewport.
        matrix: (3, 3) to mm.
        label: of the element.
    """
    data = _path(element, size, label)
    if re.sub(rf"{NUMBER}|[MmZzLlHhVvCcSsQqTtAa]", "", data).strip(", \t\r\n") or not re.match(r"\s*([Mm]|$)", data):
        raise checks.refuse(f"{label}: d", data, "path data")
    try:
        with warnings.catch_warnings(action="ignore"):  # arcs without a radius are lines
            path: Any = Path(data)
    except Exception as error:  # of a parser that expects valid data
        raise checks.refuse(f"{label}: d", str(error) or type(error).__name__, "path data") from None
    pieces = list[list[Any]]()
    for segment in path:
        if not pieces or pieces[-1][-1].end == pieces[-1][0].start or segment.start != pieces[-1][-1].end:
            pieces.append([])
        pieces[-1].append(segment)
    for piece in pieces:
        strokes = []
        for segment in piece:
            straight = isinstance(segment, Line)
            if straight and abs(segment.end - segment.start) <= 1e-12 * abs(segment.end):
                continue  # closes a path at its beginning, or repeats a point
            z = np.array(
                [segment.point(t) for t in ((0.0, 1.0) if straight else np.linspace(0.0, 1.0, SAMPLES // 4 + 1))]
            )
            points = np.column_stack([np.real(z), np.imag(z)]) @ matrix[:2, :2].T + matrix[:2, 2]
            if not np.isfinite(points).all():
                raise checks.conflict(f"{label} has coordinates that are not finite")
            strokes.append(Stroke(points, label))
        if strokes:
            yield strokes


def _path(element: ET.Element, size: tuple[float, float], label: str) -> str:
    """Return the path data of a shape; empty if it has no extent."""
    kind = element.tag
    if kind == "path":
        return "" if element.get("d", "").strip() == "none" else element.get("d", "")
    if kind in ("polyline", "polygon"):
        numbers = _numbers(element.get("points", ""), f"{label}: points")
        if len(numbers) == 2 or len(numbers) % 2:
            raise checks.refuse(f"{label}: points", element.get("points"), "at least two pairs of coordinates")
        return f"M {' '.join(numbers)}" + (" Z" if kind == "polygon" else "") if numbers else ""
    width, height = size
    extents = {"width": width, "height": height, "r": math.hypot(width, height) / math.sqrt(2.0)}
    extents |= {name: width if "x" in name else height for name in LENGTHS[kind] if name not in extents}
    lengths = {name: length(element, name, extents[name])[0] for name in LENGTHS[kind]}
    if kind == "line":
        return "M {x1} {y1} L {x2} {y2}".format(**lengths)
    single = [name for name in ("rx", "ry") if name in lengths and element.get(name, "auto").strip() != "auto"]
    if kind == "ellipse" and len(single) == 1:
        raise checks.conflict(f"{label}: only one of rx and ry")
    sizes = {name: lengths[name] for name in ("width", "height", "r", "rx", "ry") if name in lengths}
    if min(sizes.values()) < 0.0:
        raise checks.refuse(f"{label}: {', '.join(sizes)}", [*sizes.values()], ">= 0")
    if kind != "rect":
        return ellipse2pathd(lengths) if min(sizes.values()) > 0.0 else ""
    x, y = (lengths[name] for name in (single * 2)[:2] or ("rx", "ry"))
    sharp = {name: lengths[name] for name in ("x", "y", "width", "height")}
    rounded = {"rx": min(x, 0.5 * lengths["width"]), "ry": min(y, 0.5 * lengths["height"])} if min(x, y) > 0.0 else {}
    return rect2pathd(sharp | rounded) if min(lengths["width"], lengths["height"]) > 0.0 else ""
