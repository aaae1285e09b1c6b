"""Drawings in SVG, read as a viewer draws them; svgpathtools parses paths and transforms."""

from __future__ import annotations

import io
import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from vibgym import checks, extras
from vibgym.scene import outlines
from vibgym.scene.drawings.contours import SAMPLES, Stroke
from vibgym.scene.drawings.records import GAP, UNITS, factor_of

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

CONTAINERS = frozenset("a g svg switch symbol use".split())
SHAPES = frozenset("path rect circle ellipse line polyline polygon".split())
NOTES = frozenset("flowRoot foreignObject image text".split())
"""Elements that are drawn and are no outlines."""

DEFINITIONS = frozenset(
    "clipPath color-profile cursor defs desc filter font font-face linearGradient marker mask metadata pattern radialGradient "
    "script style symbol title view".split()
)
"""Elements that are not drawn."""

INHERITED = frozenset(
    "color fill fill-opacity fill-rule marker marker-end marker-mid marker-start stroke stroke-dasharray stroke-opacity "
    "stroke-width visibility".split()
)
OWN = frozenset("clip-path display filter mask opacity overflow transform-origin".split())
"""Properties that are attributes as well as styles."""

CHANGES = re.compile(
    r"(-webkit-)?(clip(-path)?|mask(-[a-z-]+)?|filter|transform(-[a-z]+)?|animation(-[a-z-]+)?)"
    r"|all|c?[xy]|r[xy]?|d|width|height|translate|rotate|scale|zoom|offset(-[a-z]+)?|content-visibility"
)
"""Properties of styles that hide, clip or move: what is drawn with them is refused."""

TESTS = frozenset(("requiredFeatures", "systemLanguage"))
"""Conditions on the viewer."""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

DEEPEST = 60
"""Most elements inside one another."""


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
        clips: of the viewports.
        undecided: why it is not known how a viewer draws the element; empty if it is.
        selected: whether it is inside one of the elements to read.
        within: addition to labels, of the ``use`` that contains the element.
        used: width and height of the ``use`` that refers to the element; None outside of one.
        depth: of the element.
    """

    matrix: np.ndarray
    size: tuple[float, float]
    style: dict[str, str]
    clips: tuple[_Clip, ...] = ()
    undecided: str = ""
    selected: bool = False
    within: str = ""
    used: dict[str, str] | None = None
    depth: int = 0


def read(
    content: bytes, flat: float, units: str | None, layers: tuple[str, ...] | None = None, without: tuple[str, ...] = ()
) -> tuple[list[Stroke], Counter[str]]:
    """Return the strokes of an SVG file, whose y axis points down, and the numbers of elements that are no outlines.

    Args:
        content: of the file.
        flat: mm, gap that is closed.
        units: see :func:`vibgym.scene.drawings.drawing.read`.
        layers, without: ids, labels of groups or colours of strokes, which are read alone, or left out.

    Raises:
        ValueError: content that is not supported, or of which it cannot be decided how a viewer draws it.
    """
    extras.require("cad", "svgpathtools")
    root = _tree(content)
    reader = _Reader(root, flat, layers, without)
    strokes = list(reader.page(root, units))
    for name in (*(layers or ()), *without):
        if _colour(name) not in reader.names and name not in reader.names:
            raise checks.unknown("layer", name, reader.names)
    if not strokes and reader.skipped:
        parts = ", ".join(f"{number} {kind}" for kind, number in reader.skipped.items())
        raise checks.conflict(f"the drawing has no outline: nothing is left without {parts}")
    return strokes, reader.skipped


def _tree(content: bytes) -> ET.Element:
    """Return the root.

    Elements have the number of their line as attribute ``line``, and the label of Inkscape as ``label``; names of elements and
    attributes of the document's namespace have no prefix, other attributes are left out.
    """
    parser = expat.ParserCreate(namespace_separator="}")
    builder = ET.TreeBuilder()
    space: list[str] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        space.append(name.rpartition("}")[0])
        plain = {key: value for key, value in attributes.items() if "}" not in key}
        for key, value in attributes.items():
            if key.endswith("/xlink}href") or key.endswith("/inkscape}label"):
                plain.setdefault(key.rpartition("}")[2], value)
        builder.start(_local(name), {**plain, "line": str(parser.CurrentLineNumber)})

    def _local(name: str) -> str:
        return name.rpartition("}")[2] if name.rpartition("}")[0] == space[0] else name

    def instruction(target: str, data: str) -> None:
        if target == "xml-stylesheet":
            raise checks.conflict(f"{target} in line {parser.CurrentLineNumber}: styles of other files")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: builder.end(_local(name)) and None
    parser.CharacterDataHandler = builder.data
    parser.ProcessingInstructionHandler = instruction
    try:
        parser.ParseFile(io.BytesIO(content))
    except expat.ExpatError as error:
        raise checks.refuse("file", str(error), "well-formed XML") from None
    root = builder.close()
    if root.tag != "svg" or space[0] not in ("", "http://www.w3.org/2000/svg"):
        raise checks.refuse("file", f"element {root.tag!r}", "an SVG document")
    return root


def _label(element: ET.Element) -> str:
    return f"{element.tag} in line {element.get('line')}"


def _numbers(text: str, name: str) -> list[str]:
    """Return the numbers of a list, which commas, spaces or signs separate."""
    if re.sub(NUMBER, "", text).strip(", \t\r\n") or re.search(r",\s*,", text):
        raise checks.refuse(name, text, "a list of numbers")
    return re.findall(NUMBER, text)


def _length(element: ET.Element, name: str, extent: float = math.nan, default: str = "0") -> tuple[float, str]:
    """Return a length in user units, and its unit.

    Args:
        element: with the attribute ``name``.
        name: of the attribute.
        extent: length of which percentages are.
        default: without the attribute, or where it is ``auto``.
    """
    text = element.get(name, "auto").strip()
    found = re.fullmatch(rf"({NUMBER})\s*(%|[a-zA-Z]*)", default if text == "auto" else text)
    unit = found[2].lower() if found else "?"
    scale = 0.01 * extent if unit == "%" else USER.get(unit, math.nan)
    if found is None or not math.isfinite(float(found[1]) * scale):
        raise checks.refuse(f"{_label(element)}: {name}", text, "a length" + " of known size" * (unit == "%"))
    return float(found[1]) * scale, unit


def _into(element: ET.Element, width: float, height: float) -> tuple[np.ndarray, tuple[float, float]]:
    """Return the (3, 3) matrix from the coordinates inside a viewport to those of the viewport, and the size inside."""
    box = [float(each) for each in _numbers(element.get("viewBox", ""), f"{_label(element)}: viewBox")]
    if not box:
        return np.eye(3), (width, height)
    if len(box) != 4 or min(box[2:]) <= 0.0:
        raise checks.refuse(f"{_label(element)}: viewBox", element.get("viewBox"), "x, y, width > 0, height > 0")
    aspect = element.get("preserveAspectRatio", "xMidYMid").strip()
    found = re.fullmatch(r"(?:none|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?", aspect)
    if found is None:
        raise checks.refuse(f"{_label(element)}: preserveAspectRatio", aspect, "none or xMidYMid, ... meet or slice")
    scale = np.array([width, height]) / box[2:]
    if found[1]:
        scale[:] = scale.max() if found[3] == "slice" else scale.min()
    share = np.array([{"Min": 0.0, "Mid": 0.5, "Max": 1.0}[each or "Min"] for each in found.groups()[:2]])
    move = share * ([width, height] - scale * box[2:]) - scale * box[:2]
    return np.array([[scale[0], 0.0, move[0]], [0.0, scale[1], move[1]], [0.0, 0.0, 1.0]]), (box[2], box[3])


def _shift(x: float, y: float) -> np.ndarray:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _declarations(text: str) -> Iterator[tuple[bool, str, str]]:
    """Yield importance, name and value of the declarations of a style."""
    for each in re.split(r";(?![^()]*\))", re.sub(r"/\*.*?\*/", "", text, flags=re.S)):
        name, _, value = each.partition(":")
        value, important, _ = value.partition("!")
        if value.strip():
            yield bool(important), name.strip().lower(), value.strip()


def _rules(root: ET.Element) -> Iterator[tuple[tuple[int, int, int], str, list[str], str]]:
    """Yield the rules of style sheets: specificity, type ("" or "*": any), ids and classes as in selectors, and declarations.

    Raises:
        ValueError: what cannot be decided here: media, imports and other at-rules; other selectors of a property that matters.
    """
    for sheet in root.iter("style"):
        text = re.sub(r"/\*.*?\*/|<!--|-->", "", "".join(sheet.itertext()), flags=re.S)
        text = re.sub(r"@(charset|namespace)\b[^;{}]*;|@(font-face|page)\b[^{}]*\{[^{}]*\}", "", text)
        if sheet.get("type", "text/css") != "text/css" or sheet.get("media", "all") not in ("all", "screen"):
            raise checks.conflict(f"{_label(sheet)}: only text/css for all media is supported")
        if re.sub(r"[^@{}\\]*\{[^@{}\\]*\}", "", text).strip():
            what = re.search(r"@[\w-]+", text)
            raise checks.conflict(f"{_label(sheet)}: {what[0] if what else 'syntax'} that is not supported")
        for selectors, block in re.findall(r"([^{}]*)\{([^{}]*)\}", text):
            for selector in map(str.strip, selectors.split(",")):
                found = re.fullmatch(r"(\*|[\w-]*)((?:[.#][\w-]+)*)", selector)
                if found and selector:
                    names = re.findall(r"[.#][\w-]+", found[2])
                    ids = sum(each[0] == "#" for each in names)
                    yield (ids, len(names) - ids, found[1] not in ("", "*")), found[1], names, block
                elif any(name in INHERITED | OWN or CHANGES.fullmatch(name) for _, name, _ in _declarations(block)):
                    raise checks.conflict(f"{_label(sheet)}: selector {selector!r}, other than type, class and id")


def _colour(value: str) -> str:
    value = "".join(value.lower().split())
    return "#" + "".join(2 * each for each in value[1:]) if re.fullmatch("#[0-9a-f]{3}", value) else value


def _zero(value: str) -> bool:
    """Return whether a value begins with a number of at most 0."""
    found = re.match(NUMBER, value)
    return found is not None and float(found[0]) <= 0.0


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
        self.rules = list(_rules(root))
        self.targets: dict[str, list[ET.Element]] = {}
        for each in root.iter():
            self.targets.setdefault(each.get("id", ""), []).append(each)
            if each.tag in ("animate", "animateMotion", "animateTransform", "discard", "set"):
                raise checks.conflict(f"{_label(each)}: animations are not supported")
        self.names = dict.fromkeys(each.get(name, "") for name in ("label", "id") for each in root.iter())
        self.names.pop("", None)

    def page(self, root: ET.Element, units: str | None) -> Iterator[Stroke]:
        """Yield the strokes of the document, in mm; the origin is that of its coordinates."""
        sizes, named = [math.nan, math.nan], list[str]()
        for k, name in enumerate(("width", "height")):
            if not root.get(name, "auto").strip().endswith(("%", "auto")):
                sizes[k], unit = _length(root, name)
                named.append(unit or "px")
                if sizes[k] <= 0.0:
                    raise checks.refuse(f"{_label(root)}: {name}", root.get(name), "> 0")
        box = [float(each) for each in _numbers(root.get("viewBox", ""), f"{_label(root)}: viewBox")]
        if len(box) == 4:
            scale = np.nanmin([sizes[0] / box[2], sizes[1] / box[3]]) if named and min(box[2:]) > 0.0 else 1.0
            sizes = [extent * scale if math.isnan(size) else size for size, extent in zip(sizes, box[2:], strict=True)]
        width, height = (math.inf if math.isnan(size) else size for size in sizes)
        inside, size = _into(root, width, height)
        unit = next((each for each in named if each != "px" or units == "px"), None)
        if unit is None:
            missing = "the width and height of the svg element have no physical unit"
            scale = factor_of(None, units, missing) / inside[0, 0]
        else:
            scale = UNITS["px"] * factor_of(unit, units, "") / UNITS[unit] if unit in UNITS else UNITS["px"]
        matrix = np.diag([scale, -scale, 1.0]) @ _shift(*-inside[:2, 2])
        clip = _Clip(np.linalg.inv(matrix), width, height, "the page")
        yield from self.strokes(root, _State(matrix @ inside, size, {}, (clip,), selected=self.layers is None))

    def strokes(self, element: ET.Element, state: _State) -> Iterator[Stroke]:
        """Yield the strokes of an element.

        Raises:
            ValueError: an element that is not supported, or invalid.
        """
        kind, label = element.tag, _label(element) + state.within
        if (kind in DEFINITIONS and (kind != "symbol" or state.used is None)) or "}" in kind:
            return
        if state.depth > DEEPEST:
            raise checks.conflict(f"{label}: more than {DEEPEST} elements inside one another")
        style, undecided = self._style(element, state.style, label)
        state = state._replace(
            style={name: value for name, value in style.items() if name in INHERITED},
            undecided=state.undecided or undecided,
            depth=state.depth + 1,
        )
        names = {element.get("id"), element.get("label")} - {None}
        if names & set(self.without):
            self.skipped[f"{kind} left out"] += 1
        elif (
            _zero(style.get("opacity", "1")) or style.get("display") == "none" or "requiredExtensions" in element.keys()
        ):
            self.skipped[f"{kind} not drawn"] += 1
        elif kind in NOTES:
            self.skipped[kind] += 1
        else:
            state = state._replace(selected=state.selected or bool(names & set(self.layers or ())))
            if kind not in ("svg", "symbol"):
                state = state._replace(used=None)
            if kind in SHAPES:
                yield from self._shape(element, self._moved(element, state, label), label)
            else:
                yield from self._container(element, state, style, label)

    def _style(self, element: ET.Element, inherited: dict[str, str], label: str) -> tuple[dict[str, str], str]:
        """Return the properties of an element, and why its drawing is undecided, if it is."""
        found = [((False, 0, (0, 0, 0)), name, element.get(name, "")) for name in INHERITED | OWN if element.get(name)]
        names = {"#" + element.get("id", ""), *("." + each for each in element.get("class", "").split())}
        for specificity, kind, needed, block in self.rules:
            if kind in ("", "*", element.tag) and names.issuperset(needed):
                found += [((important, 1, specificity), *each) for important, *each in _declarations(block)]
        found += [((important, 2, (0, 0, 0)), *each) for important, *each in _declarations(element.get("style", ""))]
        found.sort(key=lambda each: each[0])
        style, own = dict(inherited), {name: value.strip() for _, name, value in found}
        tests = TESTS.intersection(element.keys())
        undecided = f"{min(tests)} of {label}" if tests else ""
        for name, value in own.items():
            word, matters = value.lower(), name in INHERITED | OWN
            if word == "inherit":
                continue
            if word == "currentcolor" and name != "color":
                word = own.get("color", inherited.get("color", "black")).lower()
            if (
                (CHANGES.fullmatch(name) and word not in ("none", "auto", "normal"))
                or (matters and re.search(r"\b(initial|unset|revert|contents)\b|\b(var|env|calc)\(|\\", word))
                or (name == "visibility" and word not in ("visible", "hidden", "collapse"))
                or (matters and name.endswith("opacity") and not re.match(NUMBER, word))
            ):
                undecided = f"{name}: {value} of {label}"
            if matters:
                style[name] = word
        return style, undecided

    def _moved(self, element: ET.Element, state: _State, label: str) -> _State:
        """Return the state inside the transform of an element."""
        from svgpathtools.parser import parse_transform

        text = element.get("transform", "")
        name = f"{label}: transform"
        spaced = re.sub(r"\(([^()]*)\)", lambda each: f"({' '.join(_numbers(each[1], name))})", text)
        try:
            matrix = np.asarray(parse_transform(spaced, strict=True), dtype=float)
        except (ValueError, IndexError, TypeError, AssertionError):
            matrix = np.full((3, 3), np.nan)
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-12:
            raise checks.refuse(name, text, "an invertible transform")
        return state._replace(matrix=state.matrix @ matrix)

    def _container(self, element: ET.Element, state: _State, style: dict[str, str], label: str) -> Iterator[Stroke]:
        """Yield the strokes inside a group, a viewport, or what ``use`` refers to."""
        kind, children = element.tag, list(element)
        if kind in ("svg", "symbol"):
            inner = self._viewport(element, state, style, label) if state.depth > 1 else state
            if inner is None:
                self.skipped[f"{kind} not drawn"] += 1
                return
            state = inner._replace(used=None)
        else:
            state = self._moved(element, state, label)
        if kind == "use":
            href = element.get("href", "")
            children = self.targets.get(href[1:], []) if href.startswith("#") else []
            if len(children) != 1:
                raise checks.conflict(f"{label}: {len(children) or 'unknown'} elements {href!r}")
            x, y = (_length(element, *each)[0] for each in zip("xy", state.size, strict=True))
            sizes = {name: value for name, value in element.attrib.items() if name in ("width", "height")}
            state = state._replace(matrix=state.matrix @ _shift(x, y), within=f" of {_label(element)}", used=sizes)
        elif kind == "switch":
            children = [each for each in children if "}" not in each.tag and "requiredExtensions" not in each.keys()]
            plain = CONTAINERS | SHAPES | {"image", "text"}
            if children and (children[0].tag not in plain or not TESTS.isdisjoint(children[0].keys())):
                state = state._replace(undecided=state.undecided or f"the choice of {label}")
            else:
                children = children[:1]
        elif kind not in CONTAINERS:
            raise checks.conflict(f"{label}: elements of this type are not supported")
        for child in children:
            yield from self.strokes(child, state)

    def _viewport(self, element: ET.Element, state: _State, style: dict[str, str], label: str) -> _State | None:
        """Return the state inside a nested ``svg`` or a ``symbol``; None if it has no area."""
        changes = {"transform", "refX", "refY", *(("x", "y", "width", "height") if element.tag == "symbol" else ())}
        if changed := changes.intersection(element.keys()):
            state = state._replace(undecided=state.undecided or f"{min(changed)} of {label}")
        sized = ET.Element(element.tag, {**element.attrib, **(state.used or {})})
        x, y = (_length(sized, *each)[0] for each in zip("xy", state.size, strict=True))
        width, height = (_length(sized, *each, "100%")[0] for each in zip(("width", "height"), state.size, strict=True))
        if min(width, height) < 0.0:
            raise checks.refuse(f"{label}: size", f"{width:g} x {height:g}", ">= 0")
        if min(width, height) == 0.0:
            return None
        inside, size = _into(sized, width, height)
        matrix = state.matrix @ _shift(x, y)
        clip = _Clip(np.linalg.inv(matrix), width, height, label, {"width", "height"}.issubset(sized.keys()))
        if element.tag == "symbol":  # of which viewers take percentages differently
            size = (math.nan, math.nan)
        visible = style.get("overflow") in ("visible", "auto")
        return state._replace(matrix=matrix @ inside, size=size, clips=state.clips + (() if visible else (clip,)))

    def _shape(self, element: ET.Element, state: _State, label: str) -> Iterator[Stroke]:
        """Yield the strokes of a shape, if it is drawn."""
        kind, style = element.tag, state.style
        fill, stroke = _painted(style, "fill", "black"), _painted(style, "stroke", "none")
        stroke = stroke if not _zero(style.get("stroke-width", "1")) else False
        colour = _colour(style.get("stroke", "none"))
        if stroke:
            self.names.setdefault(colour)
        if style.get("visibility") in ("hidden", "collapse") or (fill is False and stroke is False):
            self.skipped[f"{kind} not drawn"] += 1
            return
        if stroke and colour in map(_colour, self.without):
            self.skipped[f"{kind} left out"] += 1
            return
        if not (state.selected or (stroke and colour in map(_colour, self.layers or ()))):
            self.skipped[f"{kind} not selected"] += 1
            return
        dashes = style.get("stroke-dasharray", "none")
        marker = next((name for name in style if name.startswith("marker") and style[name] != "none"), "")
        why = state.undecided
        if not why and not (fill or stroke):
            why = f"{'stroke' if stroke is None else 'fill'}: url() of {label}"
        elif not why and marker and kind in ("path", "line", "polyline", "polygon"):
            why = f"{marker} of {label}"
        elif not why and not fill and re.search("[1-9]", dashes):
            why = f"stroke-dasharray of {label}, a line or an outline,"
        if why:
            raise checks.conflict(f"{label}: {why} is not supported: remove it, or draw it plainly")
        paths = [_samples(path, state.matrix, label) for path in _subpaths(element, state.size, label)]
        paths = [path for path in paths if path and (stroke or _width(path) > self.flat)]
        if not paths:
            self.skipped[f"{kind} not drawn"] += 1
            return
        points = [np.concatenate([each.points for each in path]) for path in paths]
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
        yield from (each for path in paths for each in path)

    def _check_filled(self, rings: list[np.ndarray], rule: str, label: str) -> None:
        """Refuse what a fill without stroke draws otherwise than its contours: open ones, and those inside the filled area."""
        for ring in rings:
            if np.hypot(*(ring[-1] - ring[0])) > self.flat:
                raise checks.conflict(f"{label} is open, and filled without a stroke: close it")
        signs = [np.sign(outlines.signed_area(each)) for each in rings]
        for k, ring in enumerate(rings) if rule != "evenodd" else ():
            around = sum(signs[j] for j, each in enumerate(rings) if j != k and outlines.contains(each, ring[:1])[0])
            if around and around + signs[k]:
                raise checks.conflict(f"{label} fills a contour inside another (fill-rule nonzero): a hole, or none?")


def _width(strokes: list[Stroke]) -> float:
    """Return a measure of the width of strokes, 0 if they are on a line."""
    points = np.concatenate([each.points for each in strokes])
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1])


def _painted(style: dict[str, str], name: str, default: str) -> bool | None:
    """Return whether a fill or stroke is visible; None if that depends on another element."""
    paint = style.get(name, default)
    if re.match(r"context|(?!rgb|hsl)[a-z-]+\(", paint):
        return None
    channels = re.findall(NUMBER, paint) if paint.startswith(("rgb", "hsl")) else []
    clear = len(channels) == 4 and _zero(channels[3])
    if paint in ("none", "transparent") or clear or re.fullmatch("#([0-9a-f]{3}0|[0-9a-f]{6}00)", paint):
        return False
    return not _zero(style.get(f"{name}-opacity", "1"))


def _subpaths(element: ET.Element, size: tuple[float, float], label: str) -> Iterator[Iterable[Any]]:
    """Yield the segments of each subpath of a shape."""
    from svgpathtools import parse_path

    data, begin, end = _path(element, size, label), 0j, 0j
    if re.sub(rf"{NUMBER}|[MmZzLlHhVvCcSsQqTtAa]", "", data).strip(", \t\r\n") or not re.match(r"\s*([Mm]|$)", data):
        raise checks.refuse(f"{label}: d", data, "path data")
    for piece in re.split(r"(?=[Mm])|(?<=[Zz])(?=[\s,]*[^Mm\s,])", data):
        if not piece.strip():
            continue
        if piece.lstrip()[0] not in "Mm":
            piece = f"M {begin.real!r} {begin.imag!r} {piece}"
        try:
            with warnings.catch_warnings(action="ignore"):  # arcs without a radius are lines
                path: Any = parse_path(piece + " h 0", current_pos=end)  # ends where the next piece begins
        except Exception as error:  # of a parser that expects valid data
            raise checks.refuse(f"{label}: d", str(error) or type(error).__name__, "path data") from None
        begin, end = path[0].start, path[-1].end
        yield path[:-1]


def _path(element: ET.Element, size: tuple[float, float], label: str) -> str:
    """Return the path data of a shape; empty if it has no extent."""
    from svgpathtools.svg_to_paths import ellipse2pathd, rect2pathd

    (width, height), kind = size, element.tag

    def user(name: str, extent: float) -> float:
        return _length(element, name, extent)[0]

    if kind == "path":
        return "" if element.get("d", "").strip() == "none" else element.get("d", "")
    if kind in ("polyline", "polygon"):
        numbers = _numbers(element.get("points", ""), f"{label}: points")
        if len(numbers) == 2 or len(numbers) % 2:
            raise checks.refuse(f"{label}: points", element.get("points"), "at least two pairs of coordinates")
        return f"M {' '.join(numbers)}" + (" Z" if kind == "polygon" else "") if numbers else ""
    if kind == "line":
        return f"M {user('x1', width)} {user('y1', height)} L {user('x2', width)} {user('y2', height)}"
    if kind in ("circle", "ellipse"):
        x, y, a, b = user("cx", width), user("cy", height), user("rx", width), user("ry", height)
        if kind == "circle":
            a = b = user("r", math.hypot(width, height) / math.sqrt(2.0))
        elif len({"rx", "ry"}.intersection(element.keys())) == 1:
            raise checks.conflict(f"{label}: only one of rx and ry")
        if min(a, b) < 0.0:
            raise checks.refuse(f"{label}: radius", min(a, b), ">= 0")
        return ellipse2pathd({"cx": x, "cy": y, "rx": a, "ry": b}) if min(a, b) > 0.0 else ""
    x, y, w, h = user("x", width), user("y", height), user("width", width), user("height", height)
    given = [each for each in ("rx", "ry") if element.get(each, "auto").strip() != "auto"]
    a, b = (user(each, width if each == "rx" else height) for each in (given * 2)[:2] or ("rx", "ry"))
    if min(w, h, a, b) < 0.0:
        raise checks.refuse(f"{label}: size", f"{w:g} x {h:g}", ">= 0, also of the radii")
    if min(w, h) == 0.0:
        return ""
    rounded = {"rx": min(a, 0.5 * w), "ry": min(b, 0.5 * h)} if min(a, b) > 0.0 else {}
    return rect2pathd({"x": x, "y": y, "width": w, "height": h} | rounded)


def _samples(path: Iterable[Any], matrix: np.ndarray, label: str) -> list[Stroke]:
    """Return the strokes of segments."""
    from svgpathtools import Line

    strokes = []
    for segment in path:
        straight = isinstance(segment, Line)
        if straight and abs(segment.end - segment.start) <= 1e-12 * abs(segment.end):
            continue  # closes a path at its beginning, or repeats a point
        t = np.linspace(0.0, 1.0, 2 if straight else SAMPLES // 4 + 1)
        z = np.asarray([segment.point(each) for each in t], dtype=np.complex128)
        points = (np.column_stack([np.real(z), np.imag(z)]) @ matrix[:2, :2].T) + matrix[:2, 2]
        if not np.isfinite(points).all():
            raise checks.conflict(f"{label} has coordinates that are not finite")
        strokes.append(Stroke(points, not straight, label))
    return strokes


assert math.isclose(USER["in"] / USER["mm"], UNITS["in"])
