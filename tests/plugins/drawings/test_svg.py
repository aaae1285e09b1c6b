"""SVG as viewers draw it: what is hidden, clipped, moved or referred to, in tables and in random trees with known corners."""

import math
import random

import numpy as np
import pytest

from tests.plugins.drawings.helpers import page, read
from vibgym.plugins.drawings import svg
from vibgym.scene import outlines

pytest.importorskip("svgpathtools")
pytest.importorskip("cssselect2")

PAGE = 'width="100mm" height="80mm" viewBox="0 0 100 80"'
PLATE = '<rect id="plate" x="10" y="10" width="60" height="40"/>'
HOLE = '<circle cx="30" cy="30" r="5"/>'
DISC = 25 * math.pi


def area(drawing):
    return outlines.signed_area(drawing.rim) + sum(map(outlines.signed_area, drawing.holes))


def hidden(attributes="", style="", tag="g"):
    return f"<style>{style}</style>{PLATE}<{tag} {attributes}>{HOLE}</{tag}>"


@pytest.mark.parametrize(("inner", "expected"), [
    # hidden: the hole is not drawn
    *[(hidden(text), 2400) for text in (
        'display="none"', 'style="display : none"', 'visibility="hidden"', 'style="visibility:collapse;"', 'opacity="0"',
        'style="opacity:0%"', 'fill="none"', 'style="fill: transparent"', 'fill-opacity="0"', 'fill="#00000000"',
        'fill="rgba(0, 0, 0, 0)"', 'fill="none" stroke="#000" stroke-width="0"', 'requiredExtensions="http://x"',
        'fill="currentColor" color="transparent"')],
    *[(hidden('class="a b" id="c"', style), 2400) for style in (
        ".a{display:none}", "#c { visibility: hidden }", "circle{fill:none}", "g.a.b{display:none}", ".x, *.b{opacity:0}",
        "/*x*/.a{display:none}", "<![CDATA[.a{display:none}]]>", "@font-face{font-family:x} .a{display:none}",
        "g{display:inline} .a{display:none}", "#c{display:none} g.a.b{display:inline}", ".a{display:none!important}")],
    (hidden('class="a" style="display:inline"', ".a{display:none !important}"), 2400),
    *[(hidden('class="a" data-x="1"', style), 2400) for style in (
        "g.a circle{display:none}", "svg > g > circle{fill:none}", "[data-x]{display:none}", "[data-x='1'] *{opacity:0}",
        "rect + g{display:none}", "g:not(.b){display:none}", "circle:only-child{display:none}", "g:nth-child(3){opacity:0}",
        "g circle{fill:none} circle{fill:red}", r".\61{display:none}", ".a{display:none", ".a{display none;fill:none}",
        "@namespace 'x'; :is(.b, .a){display:none}")],
    # drawn
    *[(hidden(text, style), 2400 - DISC) for text, style in (
        ('class="a" style="display:inline"', ".a{display:none}"), ('class="a"', "#b{display:none}"),
        ('class="A"', ".a{display:none}"), ("", "svg > circle, [line], g[class], svg + g, g:not(g){display:none}"),
        ("", "g::before{display:none}"), ("", ".a:hover{font-size:3px}"), ("", "g{display:inline;display:}"),
        ('display="none" class="a"', ".a{display:inline}"), ('fill="none" stroke="red"', ""), ('opacity="0.5"', ""),
        ('stroke="none"', ""), ('class="a"', ".a text{font-size:3px}"), ('stroke-dasharray="2 1" stroke="red"', ""))],
    (f'{PLATE}<g visibility="hidden"><g visibility="visible">{HOLE}</g>{HOLE}</g>', 2400 - DISC),
    (f'{PLATE}<switch><g requiredExtensions="x"><text>a</text></g>{HOLE}<circle cx="50" cy="30" r="4"/></switch>', 2400 - DISC),
    (f"{PLATE}<a>{HOLE}</a><text>30</text><image/>", 2400 - DISC),
    # no extent
    *[(PLATE + text, 2400) for text in (
        '<rect width="0" height="5"/>', '<circle r="0"/>', '<ellipse rx="0" ry="3"/>', '<path d=""/>', '<path d="M 30 30"/>',
        '<polygon points=""/>', '<path d="M 20 20 L 30 30 Z"/>', '<line x1="20" y1="20" x2="30" y2="20"/>',
        '<rect x="200" width="5" height="5"/>',
        '<svg x="20" y="20" width="10" height="10"><circle cx="30" cy="5" r="3"/></svg>')],
    # references and viewports
    (f'<defs><symbol id="s" overflow="visible"><circle r="5"/></symbol></defs>{PLATE}<use xlink:href="#s" x="30" y="30"/>'
     '<use href="#s" x="50" y="30"/>', 2400 - 2 * DISC),
    (f'<symbol id="s" viewBox="0 0 10 10"><circle cx="5" cy="5" r="5"/></symbol>{PLATE}<use href="#s" x="20" y="20" width="20" '
     'height="20"/>', 2400 - 4 * DISC),
    (f'<symbol id="s" viewBox="0 0 10 10" preserveAspectRatio="none"><circle cx="5" cy="5" r="5"/></symbol>{PLATE}'
     '<use href="#s" x="20" y="20" width="20" height="10"/>', 2400 - 2 * DISC),
    (f'<g display="none"><circle id="h" class="x" cx="30" cy="30" r="5"/></g>{PLATE}<use href="#h"/>', 2400 - DISC),
    ('<svg x="10" y="10" width="50%" height="50%" viewBox="0 0 10 10"><rect width="100%" height="5"/></svg>', 40 * 20),
    ('<svg x="10" y="10" width="40" height="20" viewBox="0 0 10 10" preserveAspectRatio="xMaxYMin slice">'
     '<rect x="1" y="1" width="3" height="2"/></svg>', 12 * 8),
    ('<rect x="10%" y="10%" width="50%" height="50%"/>', 2000),
    # other namespaces
    (f'{PLATE}<x:circle xmlns:x="urn:x" cx="30" cy="30" r="5"/><g xmlns:x="urn:x" x:display="none">{HOLE}</g>', 2400 - DISC),
    # data without separators; arcs without a radius; a filled contour that runs the other way
    ('<g transform="translate(20-5.5)scale(2)"><polygon points="10,10 30 10,30.5.25e2"/></g>', 4 * 0.5 * 20 * 15),
    ('<path d="M10 10h40v30H10zm5 5v5h5v-5z"/>', 1200 - 25),
    ('<path d="M10 10h40v30A0 5 0 0110 40zM20 20h5v5h-5z" fill-rule="evenodd"/>', 1200 - 25),
    ('<path d="M10 10h40v30H10zm5 5h5v5h-5z" stroke="#000"/>', 1200 - 25),
])  # fmt: skip
def test_what_is_drawn_is_read(tmp_path, inner, expected):
    assert area(read(page(tmp_path / "part.svg", inner))) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("inner", "size", "area"), [
    ('<rect width="40" height="20"/>', 'width="200mm" viewBox="0 0 100 50"', 3200),
    ('<rect width="40mm" height="20mm"/>', 'width="200mm" height="100mm"', 800),
    ('<rect width="40" height="20"/>', 'width="2in" height="2in" viewBox="0 0 50.8 100"', 800 * 0.508**2),
    ('<rect width="40" height="20"/>', 'width="10cm" height="10cm" viewBox="0 0 100 50" preserveAspectRatio="none"', 1600),
    ('<rect width="40" height="20" rx="5"/>', 'width="100mm" viewBox="0 0 100 50"', 800 - 25 * (4 - math.pi)),
    ('<defs><g id="a"><circle r="5"/></g></defs><use href="#a" transform="scale(2)"/>',
     'width="100mm" viewBox="-50 -25 100 50"', 100 * math.pi),
    ('<g transform="rotate(30)"><g transform="skewX(20) scale(2 -1)"><path d="M0 0h10v10H0z"/></g></g>',
     'width="100mm" viewBox="-50 -25 100 50"', 200),
    ('<path d="M0 0 Q 15 20 30 0 Z"/><text>30</text>', 'width="100mm" viewBox="0 0 100 50"', 200),
])  # fmt: skip
def test_sizes_and_transforms(tmp_path, inner, size, area):
    drawing = read(page(tmp_path / "part.svg", inner, size))
    assert outlines.signed_area(drawing.rim) == pytest.approx(area, rel=1e-4)
    assert not drawing.holes


@pytest.mark.parametrize(("inner", "named"), [
    *[(hidden(text), f"circle in line 2.*{text.partition('=')[0]}") for text in (
        'clip-path="url(#a)"', 'mask="url(#a)"', 'filter="url(#a)"', 'transform-origin="3 3"', 'systemLanguage="de"')],
    *[(hidden(f'style="{text}"'), f"circle in line 2.*{text.partition(':')[0]}") for text in (
        "transform:rotate(3deg)", "clip-path:circle()", "mask-image:url(a)", "display:var(--a)", "visibility:initial", "cx:3px",
        "opacity:calc(0)", "translate:3px")],
    *[(hidden('class="a"', text), "style in line 2") for text in (
        "@media print{.a{display:none}}", "@import 'a.css';", ".a:hover{opacity:0}", "g:not(:hover){opacity:0}",
        "g ~ g{fill:none}", "g:has(circle){fill:none}", "g:nth-child(1 of g){fill:none}", "a:link{fill:none}",
        "..a{fill:none}", "x|g{fill:none}", "[*|a]{fill:none}", ".a{g circle{fill:none}}", "} .a{fill:none}")],
    *[(f'<style>{style}</style><g class="a"><circle id="h" cx="30" cy="30" r="5"/></g>{PLATE}<use href="#h"/>',
       "circle in line 2 of use in line 2: .* around") for style in (".a circle{display:none}", "circle:not(.a *){opacity:0}")],
    (hidden('class="a"', ".a{r:3px}"), "circle in line 2.*r: 3px"),
    ('<style media="print">rect{fill:none}</style>' + PLATE, "style in line 2"),
    (PLATE + '<circle cx="30" cy="30" r="3"><set attributeName="display" to="none"/></circle>', "set in line 2"),
    (PLATE + '<circle cx="30" cy="30" r="3" fill="url(#a)"/>', "circle in line 2.*fill"),
    (PLATE + '<circle cx="30" cy="30" r="3" fill="none" stroke="red" stroke-dasharray="2,1"/>',
     "circle in line 2.*stroke-dasharray"),
    (PLATE + '<path d="M20 20h5v5z" marker-start="url(#a)"/>', "path in line 2.*marker-start"),
    (PLATE + '<path d="M20 20h5v5"/>', "path in line 2 is open"),
    ('<path d="M10 10h40v30H10zm5 5h5v5h-5z"/>', "path in line 2 fills"),
    ('<rect x="-5" y="5" width="20" height="20"/>', "rect in line 2 is clipped by the page"),
    (PLATE + f'<svg width="30" height="30">{HOLE}</svg>', "circle in line 2 is clipped by svg in line 2"),
    (PLATE + '<symbol id="s"><circle r="3"/></symbol><use href="#s" x="30" y="30"/>',
     "circle in line 2 of use in line 2 is clipped"),
    (PLATE + '<symbol id="s" width="3"/><use href="#t"/>', "use in line 2"),
    (PLATE + f'<switch><foreignObject/><g>{HOLE}</g></switch>', "circle in line 2.*the choice of switch"),
    (PLATE + '<rect x="20" y="20" width="-3" height="5"/>', "rect in line 2"),
    (PLATE + '<path d="M20 20 q 5 X"/>', "path in line 2"),
    *[(text, "in line 2") for text in (
        '<rect width="4" height="3" transform="rotate(a)"/>', '<rect width="4" height="3" transform="scale(0)"/>',
        '<circle r="-1"/>', '<polygon points="1 2 3"/>')],
    ("<g display='none'><rect/></g>", "no outline.*1 g not drawn"),
    ("<style>g rect{fill:red}</style>" + 3000 * "<g>" + PLATE + 3000 * "</g>", "too deeply"),
])  # fmt: skip
def test_what_is_undecided_is_refused_with_the_element(tmp_path, inner, named):
    with pytest.raises(ValueError, match=named):
        read(page(tmp_path / "part.svg", inner))


def test_styles_of_other_files_are_refused(tmp_path):
    path = page(tmp_path / "part.svg", PLATE)
    path.write_text('<?xml-stylesheet href="a.css"?>' + path.read_text())
    with pytest.raises(ValueError, match="xml-stylesheet in line 1"):
        read(path)


@pytest.mark.parametrize(("size", "units", "expected"), [
    ('width="96" height="96"', "px", 25.4**2), ('width="192px" height="192px" viewBox="0 0 96 96"', "px", 50.8**2),
    ('viewBox="0 0 96 96"', "px", 25.4**2), ('viewBox="0 0 96 96"', "pt", (96 * 25.4 / 72) ** 2),
    ('width="72pt" viewBox="0 0 96 96"', None, 25.4**2), ('width="100%" viewBox="0 0 96 96"', "mm", 96**2),
    ('viewBox="0 0 96 96"', None, "px, pt"),
])  # fmt: skip
def test_units(tmp_path, size, units, expected):
    path = page(tmp_path / "part.svg", '<rect width="96" height="96"/>', size)
    if isinstance(expected, str):
        with pytest.raises(ValueError, match=expected):
            read(path, units=units)
    else:
        assert area(read(path, units=units)) == pytest.approx(expected)


LAYERS = (
    f'<g inkscape:label="cut">{PLATE}</g><g id="engrave"><rect x="12" y="12" width="50" height="30" stroke="#f00"/></g>'
    '<g stroke="blue" fill="none"><circle cx="30" cy="30" r="5"/></g>'
)


@pytest.mark.parametrize(("layers", "without", "holes", "skipped"), [
    (None, (), 1, {"parts that are not selected": 1}), (("cut",), (), 0, {"rect not selected": 1, "circle not selected": 1}),
    (("cut", "blue"), (), 1, {"rect not selected": 1}), (None, "engrave", 1, {"g left out": 1}),
    (None, ("#FF0000", "blue"), 0, {"rect left out": 1, "circle left out": 1}),
    ("plate", (), 0, {"rect not selected": 1, "circle not selected": 1}),
])  # fmt: skip
def test_layers(tmp_path, layers, without, holes, skipped):
    path = page(tmp_path / "part.svg", LAYERS)
    drawing = read(path, layer=layers, without_layers=without, part=0)
    assert (len(drawing.holes), drawing.skipped) == (holes, skipped)
    for unknown in {"layer": "cutt"}, {"without_layers": "greeen"}:
        with pytest.raises(ValueError, match="unknown layer.*cut"):
            read(path, **unknown)


def affine(draw):
    """Return a transform as text, and its matrix."""
    a, b, x, y = draw.uniform(0.7, 1.2), draw.uniform(-0.3, 0.3), draw.uniform(-5, 5), draw.uniform(-5, 5)
    if draw.random() < 0.5:
        return f"matrix({a} {b} {-b} {a} {x},{y})", np.array([[a, -b, x], [b, a, y], [0, 0, 1]])
    return f"translate({x},{y})", np.array([[1, 0, x], [0, 1, y], [0, 0, 1]])


def node(draw, depth, matrix, visible, shown, expected):
    """Return a random element; append the corners of drawn rectangles to ``expected``, by a second way to evaluate the tree."""
    text, own = affine(draw)
    kind = draw.choice(["rect", "g", "svg", "use", "symbol"]) if depth < 4 else "rect"
    way = draw.choice(["", "", "", 'display="none"', 'class="gone"', 'style="opacity:0"'])
    sight = draw.choice(["", "", 'visibility="hidden"', 'style="visibility:visible"' if not way else ""])
    shown = shown and not way
    visible = visible if not sight else "visible" in sight.partition("=")[2]
    mark = f"{way} {sight}"
    x, y, w, h = (round(draw.uniform(*pair), 3) for pair in ((20, 30), (20, 30), (5, 15), (5, 15)))
    if kind == "rect":
        corners = np.array([[x, y, 1], [x + w, y, 1], [x + w, y + h, 1], [x, y + h, 1]]) @ (matrix @ own).T
        if visible and shown:
            expected.append(corners[:, :2])
        return f'<rect x="{x}" y="{y}" width="{w}" height="{h}" transform="{text}" {mark}/>'
    if kind == "g":
        inner = "".join(node(draw, depth + 1, matrix @ own, visible, shown, expected) for _ in range(2))
        return f'<g transform="{text}" {mark}>{inner}</g>'
    # The viewport is w x h at (x, y); its box 2w x 2h at (1, 2), without and with distortion by h / 2h = w / 2w.
    into = np.array([[0.5, 0, x - 0.5], [0, 0.5, y - 1.0], [0, 0, 1]])
    box = f'viewBox="1 2 {2 * w} {2 * h}" overflow="visible"'
    if kind == "svg":
        inner = node(draw, depth + 1, matrix @ into, visible, shown, expected)
        return f'<svg x="{x}" y="{y}" width="{w}" height="{h}" {box} {mark}>{inner}</svg>'
    name = f"n{draw.random()}"
    if kind == "symbol":
        inner = node(draw, depth + 1, matrix @ own @ into, visible, shown, expected)
        return (
            f'<symbol id="{name}" {box}>{inner}</symbol>'
            f'<use href="#{name}" x="{x}" y="{y}" width="{w}" height="{h}" transform="{text}" {mark}/>'
        )
    shift = np.array([[1, 0, x - 25], [0, 1, y - 25], [0, 0, 1]])
    inner = node(draw, depth + 1, matrix @ own @ shift, visible, shown, expected)
    use = f'<use xlink:href="#{name}" x="{x - 25}" y="{y - 25}" transform="{text}" {mark}/>'
    return f'<defs><g id="{name}">{inner}</g></defs>{use}'


@pytest.mark.parametrize("seed", range(60))
def test_random_trees(tmp_path, seed):
    draw, expected = random.Random(seed), list[np.ndarray]()
    inner = "".join(node(draw, 0, np.eye(3), True, True, expected) for _ in range(4))
    content = page(
        tmp_path / "part.svg", "<style>.gone{display:none}</style>" + inner, 'width="400mm" viewBox="-200 -200 400 400"'
    )
    if not expected:
        with pytest.raises(ValueError, match="no outline"):
            svg.read(content.read_bytes(), 0.005, None)
        return
    strokes, *_ = svg.read(content.read_bytes(), 0.005, None)
    points = np.sort([complex(x, -y) for stroke in strokes for x, y in stroke.points[:1]])
    true = np.sort([complex(*corner) for contour in expected for corner in contour])
    assert points == pytest.approx(true, abs=1e-6)


def test_elements_without_namespace_are_not_drawn(tmp_path):
    path = tmp_path / "part.svg"
    inner = PLATE.replace("<rect", "<s:rect") + HOLE
    path.write_text(f'<s:svg xmlns:s="http://www.w3.org/2000/svg" {PAGE}>{inner}</s:svg>')
    assert area(read(path)) == pytest.approx(2400)


def test_exponential_references_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(svg, "MAX", 2000)
    inner = '<g id="n0"><rect width="3" height="3"/></g>'
    for k in range(20):
        inner += f'<g id="n{k + 1}"><use href="#n{k}"/><use href="#n{k}"/></g>'
    with pytest.raises(ValueError, match="in line 2 of use in line 2: more than 2000 elements"):
        read(page(tmp_path / "part.svg", inner))
