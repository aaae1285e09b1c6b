"""Drawings in SVG, read as a viewer draws them."""

from __future__ import annotations

import io
import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from vibgym import checks
from vibgym.plugins.drawings.contours import Stroke
from vibgym.plugins.drawings.records import GAP, UNITS, Fault, factor_of
from vibgym.plugins.drawings.svg_geometry import curves, label_of, length, shift, transform, view_box, viewport
from vibgym.plugins.drawings.svg_style import INHERITED, TESTS, Style, Styles, colour_of, painted, zero
from vibgym.scene import outlines

CONTAINERS = frozenset("a g svg switch symbol use".split())
SHAPES = frozenset("path rect circle ellipse line polyline polygon".split())
NOTES = frozenset("flowRoot foreignObject image text".split())
"""Elements that are drawn and are no outlines."""

DEFINITIONS = frozenset(
    "clipPath color-profile cursor defs desc filter font font-face linearGradient marker mask metadata pattern radialGradient "
    "script style symbol title view".split()
)
"""Elements that are not drawn."""

HREF = "http://www.w3.org/1999/xlink}href"
LABEL = "http://www.inkscape.org/namespaces/inkscape}label"

DEEPEST = 60
"""Most elements inside one another."""

MAX = 20_000
"""Most elements that are drawn, with repetitions."""


class _Clip(NamedTuple):
    """A rectangle from the origin, outside of which nothing is drawn: ``inverse`` (3, 3) leads to its coordinates from mm."""

    inverse: np.ndarray
    width: float
    height: float
    label: str
    certain: bool = True  # viewers differ where width and height are not given


class _State(NamedTuple):
    """What an element inherits.

    Attributes:
        matrix: (3, 3) from the coordinates around the element to mm.
        size: width and height of the viewport, in these coordinates; percentages refer to them.
        style: inherited properties.
        top: the root, or what the innermost ``use`` around the element refers to.
        clips: of the viewports.
        undecided: why it is not known how a viewer draws the element; empty if it is.
        selected: whether it is inside one of the elements to read.
        within: addition to labels, of the ``use`` that contains the element.
        used: width and height of the ``use`` that refers to the element; None outside of one.
        depth: of the element.
    """

    matrix: np.ndarray
    size: tuple[float, float]
    style: Style
    top: ET.Element
    clips: tuple[_Clip, ...] = ()
    undecided: str = ""
    selected: bool = False
    within: str = ""
    used: dict[str, str] | None = None
    depth: int = 0


def read(
    content: bytes, flat: float, units: str | None, layers: tuple[str, ...] | None = None, without: tuple[str, ...] = ()
) -> tuple[list[Stroke], Counter[str], list[Fault]]:
    """Return the strokes of an SVG file, whose y axis points down; the numbers of elements that are no outlines; no faults.

    Args:
        content: of the file.
        flat: mm, gap that is closed.
        units: instead of those in the file.
        layers, without: ids, labels of groups or colours of strokes, which are read alone, or left out.

    Raises:
        ValueError: content that is not supported, or of which it cannot be decided how a viewer draws it.
    """
    root = _tree(content)
    try:
        reader = _Reader(root, flat, layers, without)
        strokes = list(reader.page(root, units))
    except RecursionError:
        raise checks.conflict("elements or styles are too deeply inside one another") from None
    for name in (*(layers or ()), *without):
        if colour_of(name) not in reader.names and name not in reader.names:
            raise checks.unknown("layer", name, reader.names)
    if not strokes and reader.skipped:
        parts = ", ".join(f"{number} {kind}" for kind, number in reader.skipped.items())
        raise checks.conflict(f"the drawing has no outline: nothing is left without {parts}")
    return strokes, reader.skipped, []


def _tree(content: bytes) -> ET.Element:
    """Return the root; names in its namespace have no prefix, and elements have their line as attribute ``}line``."""
    parser = expat.ParserCreate(namespace_separator="}")
    builder = ET.TreeBuilder()

    def start(name: str, attributes: dict[str, str]) -> None:
        builder.start(name, attributes | {"}line": str(parser.CurrentLineNumber)})

    def instruction(target: str, data: str) -> None:
        if target == "xml-stylesheet":
            raise checks.conflict(f"{target} in line {parser.CurrentLineNumber}: styles of other files")

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.ProcessingInstructionHandler = instruction
    try:
        parser.ParseFile(io.BytesIO(content))
    except expat.ExpatError as error:
        raise checks.refuse("file", str(error), "well-formed XML") from None
    root = builder.close()
    space = root.tag.rpartition("}")[0]
    for node in root.iter():
        other, _, kind = node.tag.rpartition("}")
        node.tag = kind if other == space else f"{{{other}}}{kind}"
    if root.tag != "svg" or space not in ("", "http://www.w3.org/2000/svg"):
        raise checks.refuse("file", f"element {root.tag!r}", "an SVG document")
    return root


class _Reader:
    """Converter of elements to strokes.

    Args:
        root: of the document.
        flat: mm, gap that is closed.
        layers, without: see :func:`read`.

    Attributes:
        names: by which elements can be selected.
        skipped: numbers of elements that are no outlines.
    """

    def __init__(self, root: ET.Element, flat: float, layers: tuple[str, ...] | None, without: tuple[str, ...]) -> None:
        self.flat, self.layers, self.without = flat, layers, without
        self.skipped: Counter[str] = Counter()
        self.styles, self.drawn = Styles(root), 0
        self.targets: dict[str, list[ET.Element]] = {}
        for node in root.iter():
            self.targets.setdefault(node.get("id", ""), []).append(node)
            if node.tag in ("animate", "animateMotion", "animateTransform", "discard", "set"):
                raise checks.conflict(f"{label_of(node)}: animations are not supported")
        self.names = dict.fromkeys(node.get(name, "") for name in (LABEL, "id") for node in root.iter())
        self.names.pop("", None)

    def page(self, root: ET.Element, units: str | None) -> Iterator[Stroke]:
        """Yield the strokes of the document, in mm; the origin is that of its coordinates."""
        sizes, named = [math.nan, math.nan], list[str]()
        for k, name in enumerate(("width", "height")):
            if not root.get(name, "auto").strip().endswith(("%", "auto")):
                sizes[k], unit = length(root, name)
                named.append(unit or "px")
                if sizes[k] <= 0.0:
                    raise checks.refuse(f"{label_of(root)}: {name}", root.get(name), "> 0")
        if box := view_box(root):
            scale = np.nanmin([sizes[0] / box[2], sizes[1] / box[3]]) if named else 1.0
            sizes = [extent * scale if math.isnan(size) else size for size, extent in zip(sizes, box[2:], strict=True)]
        width, height = (math.inf if math.isnan(size) else size for size in sizes)
        inside, size = viewport(root, width, height)
        unit = next((name for name in named if name != "px" or units == "px"), None)
        if unit is None:
            missing = "the width and height of the svg element have no physical unit"
            scale = factor_of(None, units, missing) / inside[0, 0]
        else:
            scale = UNITS["px"] * factor_of(unit, units, "") / UNITS[unit] if unit in UNITS else UNITS["px"]
        matrix = np.diag([scale, -scale, 1.0]) @ shift(*-inside[:2, 2])
        clip = _Clip(np.linalg.inv(matrix), width, height, "the page")
        yield from self.strokes(root, _State(matrix @ inside, size, {}, root, (clip,), selected=self.layers is None))

    def strokes(self, element: ET.Element, state: _State) -> Iterator[Stroke]:
        """Yield the strokes of an element.

        Raises:
            ValueError: an element that is not supported, or invalid.
        """
        kind, label = element.tag, label_of(element) + state.within
        if (kind in DEFINITIONS and (kind != "symbol" or state.used is None)) or "}" in kind:
            return
        if state.depth > DEEPEST:
            raise checks.conflict(f"{label}: more than {DEEPEST} elements inside one another")
        self.drawn += 1
        if self.drawn > MAX:
            raise checks.conflict(f"{label}: more than {MAX} elements to draw")
        style, undecided = self.styles.of(element, state.top, state.style, label)
        state = state._replace(
            style={name: value for name, value in style.items() if name in INHERITED},
            undecided=state.undecided or undecided,
            depth=state.depth + 1,
        )
        names = {element.get("id"), element.get(LABEL)} - {None}
        if names & set(self.without):
            self.skipped[f"{kind} left out"] += 1
        elif (
            zero(style.get("opacity", "1")) or style.get("display") == "none" or "requiredExtensions" in element.keys()
        ):
            self.skipped[f"{kind} not drawn"] += 1
        elif kind in NOTES:
            self.skipped[kind] += 1
        else:
            state = state._replace(selected=state.selected or bool(names & set(self.layers or ())))
            if kind not in ("svg", "symbol"):
                state = state._replace(used=None, matrix=state.matrix @ transform(element, label))
            if kind in SHAPES:
                yield from self._shape(element, state, label)
            else:
                yield from self._container(element, state, style, label)

    def _container(self, element: ET.Element, state: _State, style: Style, label: str) -> Iterator[Stroke]:
        """Yield the strokes inside a group, a viewport, or what ``use`` refers to."""
        kind, children = element.tag, list(element)
        if kind in ("svg", "symbol") and state.depth > 1:
            inner = self._viewport(element, state, style, label)
            if inner is None:
                self.skipped[f"{kind} not drawn"] += 1
                return
            state = inner
        elif kind == "use":
            href = element.get("href", element.get(HREF, ""))
            children = self.targets.get(href[1:], []) if href.startswith("#") else []
            if len(children) != 1:
                raise checks.conflict(f"{label}: {len(children) or 'unknown'} elements {href!r}")
            x, y = (length(element, *pair)[0] for pair in zip("xy", state.size, strict=True))
            sizes = {name: value for name, value in element.attrib.items() if name in ("width", "height")}
            matrix, within = state.matrix @ shift(x, y), f" of {label_of(element)}"
            state = state._replace(matrix=matrix, within=within, used=sizes, top=children[0])
        elif kind == "switch":
            children = [node for node in children if "}" not in node.tag and "requiredExtensions" not in node.keys()]
            plain = CONTAINERS | SHAPES | {"image", "text"}
            if children and (children[0].tag not in plain or not TESTS.isdisjoint(children[0].keys())):
                state = state._replace(undecided=state.undecided or f"the choice of {label}")
            else:
                children = children[:1]
        elif kind not in CONTAINERS:
            raise checks.conflict(f"{label}: elements of this type are not supported")
        for child in children:
            yield from self.strokes(child, state)

    def _viewport(self, element: ET.Element, state: _State, style: Style, label: str) -> _State | None:
        """Return the state inside a nested ``svg`` or a ``symbol``; None if it has no area."""
        changes = {"transform", "refX", "refY", *(("x", "y", "width", "height") if element.tag == "symbol" else ())}
        if changed := changes.intersection(element.keys()):
            state = state._replace(undecided=state.undecided or f"{min(changed)} of {label}")
        sized = ET.Element(element.tag, {**element.attrib, **(state.used or {})})
        x, y = (length(sized, *pair)[0] for pair in zip("xy", state.size, strict=True))
        width, height = (length(sized, *pair, "100%")[0] for pair in zip(("width", "height"), state.size, strict=True))
        if min(width, height) < 0.0:
            raise checks.refuse(f"{label}: size", f"{width:g} x {height:g}", ">= 0")
        if min(width, height) == 0.0:
            return None
        inside, size = viewport(sized, width, height)
        matrix = state.matrix @ shift(x, y)
        clip = _Clip(np.linalg.inv(matrix), width, height, label, {"width", "height"}.issubset(sized.keys()))
        if element.tag == "symbol":  # of which viewers take percentages differently
            size = (math.nan, math.nan)
        visible = style.get("overflow") in ("visible", "auto")
        clips = state.clips if visible else (*state.clips, clip)
        return state._replace(matrix=matrix @ inside, size=size, clips=clips, used=None)

    def _shape(self, element: ET.Element, state: _State, label: str) -> Iterator[Stroke]:
        """Yield the strokes of a shape, if it is drawn."""
        kind, style = element.tag, state.style
        fill, stroke = painted(style, "fill", "black"), painted(style, "stroke", "none")
        stroke = stroke if not zero(style.get("stroke-width", "1")) else False
        colour = colour_of(style.get("stroke", "none"))
        if stroke:
            self.names.setdefault(colour)
        if style.get("visibility") in ("hidden", "collapse") or (fill is False and stroke is False):
            self.skipped[f"{kind} not drawn"] += 1
            return
        if stroke and colour in map(colour_of, self.without):
            self.skipped[f"{kind} left out"] += 1
            return
        if not (state.selected or (stroke and colour in map(colour_of, self.layers or ()))):
            self.skipped[f"{kind} not selected"] += 1
            return
        dashes = style.get("stroke-dasharray", "none")
        marker = next((name for name in style if name.startswith("marker") and style[name] != "none"), "")
        why = state.undecided
        if not why and not (fill or stroke):
            name = "stroke" if stroke is None else "fill"
            why = f"{name}: {style[name]} of {label}"
        elif not why and marker and kind in ("path", "line", "polyline", "polygon"):
            why = f"{marker} of {label}"
        elif not why and not fill and re.search("[1-9]", dashes):
            why = f"stroke-dasharray of {label}, a line or an outline,"
        if why:
            raise checks.conflict(f"{label}: {why} is not supported: remove it, or draw it plainly")
        paths = [
            path for path in curves(element, state.size, state.matrix, label) if stroke or _width(path) > self.flat
        ]
        if not paths:
            self.skipped[f"{kind} not drawn"] += 1
            return
        points = [np.concatenate([piece.points for piece in path]) for path in paths]
        for clip in state.clips:
            at = np.concatenate(points) @ clip.inverse[:2, :2].T + clip.inverse[:2, 2]
            margin = self.flat / GAP * math.sqrt(abs(np.linalg.det(clip.inverse)))
            low, high, size = at.min(axis=0) + margin, at.max(axis=0) - margin, np.array([clip.width, clip.height])
            if clip.certain and ((high < 0.0).any() or (low > size).any()):
                self.skipped[f"{kind} outside {clip.label}"] += 1
                return
            if (low < 0.0).any() or (high > size).any():
                raise checks.conflict(f"{label} is clipped by {clip.label}: enlarge that, or make its overflow visible")
        if not stroke:
            self._check_filled(points, style.get("fill-rule", "nonzero"), label)
        yield from (piece for path in paths for piece in path)

    def _check_filled(self, rings: list[np.ndarray], rule: str, label: str) -> None:
        """Refuse what a fill without stroke draws otherwise than its contours: open ones, and those inside the filled area."""
        for ring in rings:
            if np.hypot(*(ring[-1] - ring[0])) > self.flat:
                raise checks.conflict(f"{label} is open, and filled without a stroke: close it")
        signs = [np.sign(outlines.signed_area(ring)) for ring in rings]
        for k, ring in enumerate(rings) if rule != "evenodd" else ():
            around = sum(signs[j] for j, other in enumerate(rings) if j != k and outlines.contains(other, ring[:1])[0])
            if around and around + signs[k]:
                raise checks.conflict(f"{label} fills a contour inside another (fill-rule nonzero): a hole, or none?")


def _width(strokes: list[Stroke]) -> float:
    """Return a measure of the width of strokes, 0 if they are on a line."""
    points = np.concatenate([stroke.points for stroke in strokes])
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1])
