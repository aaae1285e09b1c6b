"""Properties of the elements of SVG drawings; tinycss2 parses style sheets, cssselect2 matches their selectors."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import tinycss2
from cssselect2 import ElementWrapper, Matcher, compile_selector_list
from tinycss2.color4 import parse_color

from vibgym import checks
from vibgym.plugins.drawings.svg_geometry import NUMBER, label_of

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

IGNORED = frozenset(("charset", "font-face", "namespace", "page"))
"""Rules that do not change what is drawn."""

UNDECIDED = re.compile(
    r"(?<![\\:]):(?!(empty|is|not|root|where|(first|last|only|nth|nth-last)-(child|of-type))\b)[\w-]|~(?!=)|\sof\s"
)
"""Selectors of states of the viewer; and of all siblings before, for which cssselect2 needs the square of their number."""

Style = dict[str, str]
"""Name -> value of properties."""

Declaration = tuple[bool, str, str]
"""Importance, name and value of a property."""


class Styles:
    """Properties of the elements of a document.

    Raises:
        ValueError: what cannot be decided here: media, imports and other at-rules; selectors of a state, or invalid ones, of a
            property that matters.
    """

    def __init__(self, root: ET.Element) -> None:
        self._root, self._matcher = root, Matcher()
        self._matches: dict[ET.Element, dict[ET.Element, list[Declaration]]] = {}
        for sheet in root.iter("style"):
            for selector, declarations in _rules(sheet):
                self._matcher.add_selector(selector, declarations)

    def _matched(self, element: ET.Element, top: ET.Element) -> list[Declaration]:
        """Return the declarations of style sheets for an element, as if ``top`` were the root."""
        if top not in self._matches:
            self._matches[top] = {
                node.etree_element: [declaration for *_, block in self._matcher.match(node) for declaration in block]
                for node in ElementWrapper.from_xml_root(top).iter_subtree()
            }
        return self._matches[top][element]

    def of(self, element: ET.Element, top: ET.Element, inherited: Style, label: str) -> tuple[Style, str]:
        """Return the properties of an element, and why its drawing is undecided, if it is.

        ``top`` is the root, or what the ``use`` around the element refers to: selectors see all elements around in SVG 1.1, and
        those inside of ``top`` in SVG 2.
        """
        matched = self._matched(element, self._root)
        if matched != self._matched(element, top):
            raise checks.conflict(f"{label}: viewers differ in selectors that depend on what is around the element")
        declarations = [(False, name, element.get(name, "").strip()) for name in INHERITED | OWN if element.get(name)]
        declarations += matched + _declarations(element.get("style", ""), label)
        own = {name: value for _, name, value in sorted(declarations, key=lambda declaration: declaration[0])}
        tests = TESTS.intersection(element.keys())
        style, undecided = dict(inherited), f"{min(tests)} of {label}" if tests else ""
        for name, value in own.items():
            word, known = value.lower(), name in INHERITED | OWN
            if word == "inherit":
                continue
            if word == "currentcolor" and name != "color":
                word = own.get("color", inherited.get("color", "black")).lower()
            if (
                (CHANGES.fullmatch(name) and word not in ("none", "auto", "normal"))
                or (known and re.search(r"\b(initial|unset|revert|contents)\b|\b(var|env|calc)\(|\\", word))
                or (name == "visibility" and word not in ("visible", "hidden", "collapse"))
                or (known and name.endswith("opacity") and not re.match(NUMBER, word))
            ):
                undecided = f"{name}: {value} of {label}"
            if known:
                style[name] = word
        return style, undecided


def _rules(sheet: ET.Element) -> Iterator[tuple[Any, list[Declaration]]]:
    """Yield the compiled selectors of a style sheet, and their declarations."""
    label = label_of(sheet)
    if sheet.get("type", "text/css") != "text/css" or sheet.get("media", "all") not in ("all", "screen"):
        raise checks.conflict(f"{label}: only text/css for all media is supported")
    rules: Any = tinycss2.parse_stylesheet("".join(sheet.itertext()), skip_comments=True, skip_whitespace=True)
    for rule in rules:
        if rule.type == "at-rule" and rule.lower_at_keyword in IGNORED:
            continue
        if rule.type != "qualified-rule":
            what = rule.message if rule.type == "error" else f"@{rule.at_keyword}"
            raise checks.conflict(f"{label}: {what} is not supported")
        text = tinycss2.serialize(rule.prelude).strip()
        declarations = _declarations(rule.content, f"{label}: {text}")
        if not declarations:
            continue
        try:
            selectors = compile_selector_list(rule.prelude)
        except Exception:  # of a compiler that expects valid selectors
            selectors = []
        if not selectors or UNDECIDED.search(text):
            raise checks.conflict(f"{label}: selector {text!r} is invalid, or depends on the viewer")
        yield from ((selector, declarations) for selector in selectors if selector.pseudo_element is None)


def _declarations(block: Any, label: str) -> list[Declaration]:
    """Return the declarations of properties that matter; invalid ones do not count."""
    nodes: Any = tinycss2.parse_blocks_contents(block, skip_comments=True, skip_whitespace=True)
    declarations = []
    for node in nodes:
        if node.type in ("at-rule", "qualified-rule"):
            raise checks.conflict(f"{label}: rules inside of others are not supported")
        if node.type == "declaration" and (node.lower_name in INHERITED | OWN or CHANGES.fullmatch(node.lower_name)):
            declarations.append((node.important, node.lower_name, tinycss2.serialize(node.value).strip()))
    return [declaration for declaration in declarations if declaration[2]]


def colour_of(value: str) -> str:
    """Return a colour without spaces, in lower case and with six digits."""
    value = "".join(value.lower().split())
    return "#" + "".join(2 * digit for digit in value[1:]) if re.fullmatch("#[0-9a-f]{3}", value) else value


def zero(value: str) -> bool:
    """Return whether a value begins with a number of at most 0."""
    match = re.match(NUMBER, value)
    return match is not None and float(match[0]) <= 0.0


def painted(style: Style, name: str, default: str) -> bool | None:
    """Return whether a fill or stroke is visible; None if that depends on another element, or is unknown."""
    paint = style.get(name, default)
    if paint == "none":
        return False
    alpha = getattr(parse_color(paint), "alpha", None)
    return None if alpha is None else alpha > 0.0 and not zero(style.get(f"{name}-opacity", "1"))
