"""DXF drawings: what a viewer shows is read, what it does not show is not, and what cannot be decided is refused."""

import math
import pickle
import random
import warnings

import numpy as np
import pytest

from tests.plugins.drawings import helpers
from tests.plugins.drawings.helpers import read
from vibgym import Part, checks
from vibgym.scene.parts import part_from

ezdxf = pytest.importorskip("ezdxf")

LAYERS = {"plate": "on", "cut": "on", "Bores": "on", "option": "frozen", "Spare": "off"}


def new(*, units=4):
    """Return a document with :data:`LAYERS`, and its model space with a plate of 200 x 100 mm."""
    document = ezdxf.new(units=units, setup=True)
    for name, state in LAYERS.items():
        layer = document.layers.add(name)
        if state != "on":
            getattr(layer, {"frozen": "freeze", "off": "off"}[state])()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (200, 0), (200, 100), (0, 100)], close=True, dxfattribs={"layer": "plate"})
    return document, space


def saved(document, folder):
    return helpers.saved(document, folder / "drawing.dxf")


class Campaign:
    """A plate with holes that are visible, hidden, or neither, in nested and transformed blocks; ``area`` of what is visible.

    ``undecided``: a hole of a visible layer in an insertion on a layer that is off, which viewers show differently.
    """

    def __init__(self, seed):
        self.draw = random.Random(seed)
        self.document, self.space = new()
        self.area, self.undecided = 200.0 * 100.0, False
        for k in range(8):
            self.hole(np.array([25.0 + 50 * (k % 4), 25.0 + 50 * (k // 4)]), f"B{seed}-{k}")

    def attributes(self):
        """Return the attributes of an entity: layer in any case, linetype, flag."""
        layer = self.draw.choice(["0", "0", *LAYERS])
        layer = self.draw.choice([layer, layer.upper(), layer.lower()])
        linetype = self.draw.choice(["BYLAYER", "BYLAYER", "BYBLOCK", "Continuous", "CENTER"])
        return {"layer": layer, "linetype": linetype, "invisible": int(self.draw.random() < 0.1)}

    def hole(self, target, name):
        """Add a hole about a point that all insertions leave in its place."""
        draw, chain, holder, stretch, factor = self.draw, [], self.space, 1.0, 1.0
        for level in range(draw.choice([0, 0, 1, 1, 2, 3])):
            block = self.document.blocks.new(f"{name}-{level}", base_point=target)
            scale = [draw.choice([-1, 1]) * draw.uniform(0.5, 2.0) for _ in range(2)]
            flip = -1 if draw.random() < 0.2 else 1  # in x, by an extrusion down
            style = {
                **self.attributes(), "xscale": scale[0], "yscale": scale[1], "zscale": draw.choice([1, 0, -2]),
                "rotation": draw.uniform(0, 360), "extrusion": (0, 0, flip),
            }  # fmt: skip
            holder.add_blockref(block.name, target * [flip, 1], dxfattribs=style)
            chain.append(style)
            stretch, factor = stretch * max(map(abs, scale)), factor * abs(scale[0] * scale[1])
            holder = block
        radius, style = draw.uniform(2.0, 12.0) / stretch, self.attributes()
        if draw.random() < 0.5:
            holder.add_circle(target, radius, dxfattribs=style)
        else:
            ends = [(*(target - [radius, 0]), 1), (*(target + [radius, 0]), 1)]
            holder.add_lwpolyline(ends, format="xyb", close=True, dxfattribs=style)
        self.evaluate(chain, style, factor * math.pi * radius**2)

    def evaluate(self, chain, entity, area):
        states = {name.lower(): state for name, state in LAYERS.items()} | {"0": "on"}
        layer, linetype, off = "0", "continuous", False
        for level in (*chain, entity):
            layer = layer if level["layer"] == "0" else level["layer"].lower()
            own = level["linetype"].lower()
            linetype = {"byblock": linetype, "bylayer": "continuous"}.get(own, own)
            if level["invisible"] or states[layer] == "frozen":
                return
            off = off or states[layer] == "off"
        if states[layer] == "on" and linetype == "continuous":
            self.undecided |= off
            self.area -= area


@pytest.mark.parametrize("seeds", [range(0, 25), range(25, 50)], ids=str)
def test_visible_geometry_alone_is_read(tmp_path, seeds):
    """Hidden, frozen, off, invisible, nested, turned, scaled and reflected content, against what the drawing was made of."""
    read_right = 0
    for seed in seeds:
        made = Campaign(seed)
        path = saved(made.document, tmp_path)
        if made.undecided:
            with pytest.raises(ValueError, match="is off"):
                read(path)
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            part = Part.from_file(path, friction=0.5)
        assert 1e6 * part.area == pytest.approx(made.area, rel=2e-4), seed
        read_right += 1
    assert read_right > 10


def with_tags(folder, entity, document, old, new):
    """Save a document with tags of one entity replaced in the file."""
    path = saved(document, folder)
    text = path.read_text()
    begin = text.index(f"{entity.dxftype()}\n  5\n{entity.dxf.handle}\n")
    end = text.index("\n  0\n", begin)
    assert old in text[begin:end]
    path.write_text(text[:begin] + text[begin:end].replace(old, new) + text[end:])
    return path


@pytest.mark.parametrize(("add", "old", "new", "fault"), [
    ("circle", "\n 40\n3.0", "", "CIRCLE .* has no radius"),
    ("line", "\n 11\n20.0\n 21\n10.0\n 31\n0.0", "", "LINE .* has no end"),
    ("ellipse", "\n 11\n5.0", "\n 11\n0.0", "Removed ELLIPSE"),
    ("blockref", "\n  2\nB\n", "\n  2\nQ\n", "Deleted entity INSERT"),
    ("open_spline", "\n 40\n1.0", "", "Removed SPLINE"), ("circle", "100\nAcDbCircle\n", "100\nAcDbCircle\n 62\n999\n", None),
    ("circle", "100\nAcDbCircle\n", "  6\nUNKNOWN\n100\nAcDbCircle\n", None),
    ("circle", "CIRCLE\n", "CIRCEL\n", "CIRCEL .* are not outlines"),
])  # fmt: skip
def test_damage_is_refused_with_the_handle_if_it_loses_geometry(tmp_path, add, old, new, fault):
    document = ezdxf.new(units=4)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (60, 0), (60, 40), (0, 40)], close=True)
    document.blocks.new("B").add_circle((10, 10), 3)
    arguments = {
        "circle": [(10, 10), 3], "line": [(10, 10), (20, 10)], "ellipse": [(20, 20), (5, 0), 0.5], "blockref": ["B", (5, 5)],
        "open_spline": [[(10, 10), (20, 10), (20, 20), (10, 20), (10, 10)]],
    }  # fmt: skip
    entity = getattr(space, f"add_{add}")(*arguments[add])
    path = with_tags(tmp_path, entity, document, old, new)
    if fault is None:
        assert len(read(path).holes) == 1
    else:
        with pytest.raises(ValueError, match=fault) as error:
            read(path)
        assert entity.dxf.handle in str(error.value)


def hidden_in_block(document, space):
    document.blocks.new("B").add_circle((0, 0), 3, dxfattribs={"invisible": 1})
    space.add_blockref("B", (20, 20))


def repeated(document, space):
    document.blocks.new("B").add_circle((0, 0), 3)
    space.add_blockref("B", (20, 20)).grid((2, 3), (10, 10))


def outside(document, space):
    document.blocks.new("B").block.dxf.flags = 4  # an external reference
    space.add_blockref("B", (20, 20))


def dashed_layer(document, space):
    document.layers.add("bend", linetype="PHANTOM")
    space.add_line((50, 0), (50, 100), dxfattribs={"layer": "BEND"})


@pytest.mark.parametrize(("add", "options", "holes", "skipped"), [
    (lambda document, space: space.add_circle((20, 20), 3, dxfattribs={"layer": "DEFPOINTS"}), {}, 0,
     {"CIRCLE on hidden layer 'DEFPOINTS'": 1}),
    (hidden_in_block, {}, 0, {"CIRCLE that is invisible": 1}), (repeated, {}, 6, {}),
    (outside, {}, "INSERT .* in another file", None),
    (dashed_layer, {}, 0, {"LINE with linetype 'phantom'": 1}),
    (lambda document, space: space.add_line((50, 0), (50, 100), dxfattribs={"linetype": "HIDDEN2"}), {}, 0,
     {"LINE with linetype 'hidden2'": 1}),
    (lambda document, space: space.add_line((50, 0), (50, 100), dxfattribs={"linetype": "Dashed-own"}), {}, 0,
     {"LINE with linetype 'dashed-own'": 1}),  # without a definition
    (lambda document, space: document.layout("Layout1").add_circle((0, 0), 5), {}, 0, {"CIRCLE in paper space 'Layout1'": 1}),
    (lambda document, space: [space.add_line((0, 0), (50, 0), dxfattribs={"layer": "bend"}) for _ in range(2)],
     {"without_layers": ["Bend"]}, 0, {"LINE on layer 'bend', which is not selected": 2}),
    (lambda document, space: [space.add_circle((20, 20), 3, dxfattribs={"layer": "x"}) for _ in range(3)],
     {"layer": ["PLATE", "X"]}, 1, {"CIRCLE drawn twice": 2}),
    (lambda document, space: space.add_circle((20, 20), 3), {"layer": ["cuts"]}, "unknown layer 'cuts'.* 'cut'", None),
    (lambda document, space: space.add_lwpolyline([(9, 9, 1, 1), (20, 9, 1, 1), (20, 20, 1, 1)], close=True), {}, 1,
     {"LWPOLYLINE with a width, of which the centre line is read": 1}),
])  # fmt: skip
def test_what_is_read_and_what_is_skipped(tmp_path, add, options, holes, skipped):
    document, space = new()
    add(document, space)
    path = saved(document, tmp_path)
    if skipped is None:
        with pytest.raises(ValueError, match=holes):
            read(path, **options)
        return
    drawing = read(path, **options)
    assert (len(drawing.holes), drawing.skipped) == (holes, skipped)


def test_a_part_lists_what_its_drawing_has_beyond_it(tmp_path):
    document, space = new()
    space.add_text("plate")
    path = saved(document, tmp_path)
    with pytest.warns(UserWarning, match="part 'drawing': skipped 1 TEXT"):
        part = Part.from_file(path, friction=0.5)
    assert part.skipped == {"TEXT": 1} == pickle.loads(pickle.dumps(part)).skipped
    assert part.same_as(part_from(part.to_dict())) and Part.disc(0.02, friction=0.5).skipped == {}
    with pytest.warns(UserWarning, match="skipped"):
        by_path = part_from(str(path))
    assert by_path.same_as(part)  # a path alone, with the default friction


def lines(folder, *chains, closed=True):
    """Save lines through the points of each chain."""
    document = ezdxf.new(units=4)
    for chain in chains:
        for a, b in zip(chain, (*chain[1:], *chain[:1]) if closed else chain[1:], strict=False):
            document.modelspace().add_line(a, b)
    return saved(document, folder)


ARC = [(20 * math.cos(k), 20 * math.sin(k)) for k in np.linspace(0, math.pi, 40)]


@pytest.mark.parametrize(("chain", "options", "area"), [
    ([(0, 0), (50, 0), (50, 30), (0, 30), (4e-7, 0)], {}, 1500),  # a segment of 0.4 nm closes the contour
    ([(0, 0), (50, 0), (50.00003, 0), (50, 30), (0, 30), (0, 29.99997)], {}, 1500),  # two such segments
    ([(0, 0), (50, 0), (50, 0), (50, 30), (0, 30)], {}, 1500),  # a line without length
    ([(0, 0), (50, 0), (50.003, 0), (50, 30), (0, 30)], {}, 1500),  # a corner is passed, and returned to
    ([(0, 0), (20, 0), *((20 + 0.002 * k, 0) for k in range(1, 30)), (50, 0), (50, 30), (0, 30)], {}, 1500),  # many short lines
    (ARC, {"gap_mm": 3.0}, 200 * math.pi),  # segments of 1.6 mm, shorter than the gap that may be closed
])  # fmt: skip
def test_short_segments_are_joined(tmp_path, chain, options, area):
    drawing = read(lines(tmp_path, chain), **options)
    assert 1e6 * Part.polygon(1e-3 * drawing.rim, friction=0.5).area == pytest.approx(area, rel=2e-3)
    assert drawing.skipped == {}


@pytest.mark.parametrize(("end", "area"), [
    ((0.0, 0.15), 1500), ((0.0, -0.15), 1500),  # before and beyond the corner
    ((0.15, 0.0), 1500 - 0.15 * 15), ((-0.1, 0.1), 1501.505),
])  # fmt: skip
def test_gaps_are_closed_and_reported(tmp_path, end, area):
    """Two lines are joined at their intersection."""
    chain = [(0, 0), (50, 0), (50, 30), (0, 30), end]
    path = lines(tmp_path, chain, closed=False)
    with pytest.raises(ValueError, match=r"open contour: LINE .* 0.1\S* mm from the next end.*gap_mm= joins"):
        read(path)
    drawing = read(path, gap_mm=0.2)
    assert [name.split()[:2] for name in drawing.skipped] == [["gap", "of"]]
    assert 1e6 * Part.polygon(1e-3 * drawing.rim, friction=0.5).area == pytest.approx(area, rel=1e-4)
    forked = lines(tmp_path, chain, [(0.0, 0.1), (-20, 0.1)], closed=False)
    with pytest.raises(ValueError, match="3 ends meet"):
        read(forked, gap_mm=0.2)


def test_parts_are_listed_and_selected(tmp_path):
    """The largest is 0; an island in a hole is a part as well."""
    document = ezdxf.new(units=4)
    space = document.modelspace()
    for at, radius in (((0, 0), 10.0), ((0, 0), 6.0), ((0, 0), 3.0), ((40, 0), 12.0)):
        space.add_circle(at, radius)
    path = saved(document, tmp_path)
    with pytest.raises(ValueError, match=r"3 parts .* part=: 0: 24\S* x 24\S* mm, 452.4 .*; 2: 6\S* x .*, in a hole"):
        read(path)
    holes = [read(path, part=k) for k in range(3)]
    assert [len(hole.holes) for hole in holes] == [0, 1, 0] and holes[0].skipped == {"parts that are not selected": 2}
    assert [hole.radius and round(hole.radius, 3) for hole in holes] == [12.0, None, 3.0]
    with pytest.raises(ValueError, match="part must be"):
        read(path, part=3)


def test_all_faults_of_a_file_are_reported_at_once(tmp_path):
    document, space = new()
    solid = space.add_solid([(0, 0), (5, 0), (0, 5), (5, 5)])
    tilted = space.add_circle((20, 20, 5), 3)
    line = space.add_line((100, 20), (150, 20))
    crossing = space.add_circle((200, 50), 5)
    with pytest.raises(checks.Refused, match=f"SOLID {solid.dxf.handle}.*; and 4 other faults") as error:
        read(saved(document, tmp_path))
    texts = [fault.text for fault in error.value.faults]
    assert len(texts) == 5 and "\n" not in str(error.value)
    for entity, place in ((tilted, (20, 20)), (line, (100, 20)), (line, (150, 20)), (crossing, (200, 50))):
        fault = next(own for own in error.value.faults if entity.dxf.handle in own.text.split() and
                     np.hypot(*(own.place - place)) < 6)  # fmt: skip
        assert fault.place is not None
    with pytest.raises(ValueError, match="SOLID"):
        part_from({"file": str(tmp_path / "drawing.dxf")})
