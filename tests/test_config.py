"""Settings from mappings and files: units, unknown keys, clear errors."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Surface, checks
from vibgym.config import SurfaceSettings, load_yaml, parse, part_from, surface_from, to_si

FINE = {"shape": "rectangle", "length": 0.05, "width": 0.03, "friction": 0.5}


@given(st.floats(0.1, 1000))
def test_millimetres(value):
    assert to_si({"size_mm": value}, "here") == {"size": value * 1e-3}
    assert surface_from({"element_size_mm": value}).element_size == pytest.approx(value / 1000, rel=1e-15)


@given(st.floats(-720, 720), st.floats(0, 1e6))
def test_degrees_and_grams(angle, mass):
    got = to_si({"heading_deg": angle, "mass_g": mass, "plain": angle}, "here")
    assert got == pytest.approx({"heading": math.radians(angle), "mass": mass / 1000, "plain": angle}, rel=1e-14)


@given(st.recursive(st.floats(-1e3, 1e3), lambda inner: st.lists(inner, max_size=3), max_leaves=10))
def test_nested_lists_are_scaled_and_left_alone(values):
    def scaled(value):
        return [scaled(each) for each in value] if isinstance(value, list) else value * 1e-3

    before = repr(values)
    assert to_si({"vertices_mm": values}, "here") == {"vertices": scaled(values)}
    assert repr(values) == before


def test_surfaces():
    assert surface_from("prototype") == Surface() == surface_from({})
    surface = surface_from(
        {"rows": 4, "columns": 6, "element_size_mm": 20, "horizontal_amplitude_mm": 3, "frequency": 30}
    )
    assert surface == Surface(4, 6, 0.02, 0.003, 30.0)
    assert surface_from(surface) is surface


def test_parts():
    block = part_from("aluminium_block")
    assert (block.name, block.friction, block.mass) == ("aluminium_block", 0.58, 0.0945)
    assert part_from(block) is block
    rectangle = part_from({"shape": "rectangle", "length_mm": 50, "width_mm": 35, "friction": 0.58, "mass_g": 94.5})
    assert rectangle.outline == pytest.approx(block.outline) and rectangle.mass == pytest.approx(0.0945)
    disc = part_from({"shape": "disc", "radius_mm": 20, "friction": 0.4, "static_friction": 0.5, "name": "coin"})
    assert disc.area == pytest.approx(math.pi * 0.02**2) and disc.symmetry == 0
    assert (disc.static_friction, disc.name) == (0.5, "coin")
    corners = [[0, 0], [50, 0], [50, 20], [20, 20], [20, 40], [0, 40]]
    for given_as in (corners, [tuple(each) for each in corners]):
        angle = part_from({"shape": "polygon", "vertices_mm": given_as, "friction": 0.4})
        assert angle.area == pytest.approx(50e-3 * 20e-3 + 20e-3 * 20e-3)
    metres = part_from({"shape": "polygon", "vertices": [[x / 1000, y / 1000] for x, y in corners], "friction": 0.4})
    assert metres.outline == pytest.approx(angle.outline)


BAD_SURFACES = [
    ("table", "surface", "'prototype'"),
    (5, "surface", "a mapping with keys among rows, columns"),
    ([], "surface", "a mapping"),
    (None, "surface", "a mapping"),
    ({"colour": "red"}, "surface.colour", "keys among rows, columns, element_size"),
    ({3: 4}, "surface", "keys that are strings"),
    ({"rows": "8"}, "surface.rows", "integer"),
    ({"rows": True}, "surface.rows", "integer"),
    ({"rows": 8.0}, "surface.rows", "integer"),
    ({"rows": 0}, "rows", ">= 1"),
    ({"frequency": "fast"}, "surface.frequency", "number"),
    ({"frequency": True}, "surface.frequency", "number"),
    ({"frequency": None}, "surface.frequency", "number"),
    ({"frequency": 0}, "frequency", "> 0"),
    ({"frequency": math.inf}, "surface.frequency", "finite"),
    ({"frequency": 10**400}, "surface.frequency", "number"),
    ({"rows": 10**400}, "rows", "<= 1000000"),
    ({"rows": 2000, "columns": 2000}, "columns", "at most 1000000 elements"),
    ({"element_size_mm": 10**400}, "surface.element_size_mm", "a finite number"),
    ({"gravity": -9.81}, "gravity", "> 0"),
    ({"element_size": 0.026, "element_size_mm": 26}, "surface.element_size_mm", "'element_size' once, not in two units"),
    ({"element_size_mm": 26, "element_size": 0.026}, "surface.element_size", "'element_size' once, not in two units"),
    ({"element_size_mm": "26"}, "surface.element_size_mm", "a number"),
    ({"element_size_mm": None}, "surface.element_size_mm", "a number"),
    ({"element_size_mm": True}, "surface.element_size_mm", "a number"),
    ({"element_size_deg": [1, "x"]}, "surface.element_size_deg", "a number"),
    ({"max_amplitude": 1.0}, "max_amplitude", "<= 0.000397"),
]  # fmt: skip
BAD_PARTS = [
    ("gold", "parts", "'steel_block', 'aluminium_block'"),
    (3, "parts", "a mapping"),
    ({}, "parts.shape", "required"),
    ({**FINE, "shape": "cube"}, "parts.shape", "'rectangle', 'disc' or 'polygon'"),
    ({**FINE, "shape": None}, "parts.shape", "'rectangle', 'disc' or 'polygon'"),
    ({"shape": "rectangle", "length": 0.05, "width": 0.03}, "parts.friction", "required"),
    ({"shape": "rectangle", "length": 0.05, "friction": 0.5}, "parts.width", "needed for shape 'rectangle'"),
    ({"shape": "disc", "friction": 0.5}, "parts.radius", "needed for shape 'disc'"),
    ({"shape": "polygon", "friction": 0.5}, "parts.vertices", "needed for shape 'polygon'"),
    ({**FINE, "radius": 0.1}, "parts.radius", "not a field of shape 'rectangle'"),
    ({"shape": "disc", "radius": 0.1, "friction": 0.5, "vertices": []}, "parts.vertices", "not a field of shape 'disc'"),
    ({**FINE, "length_mm": 50}, "parts.length_mm", "once"),
    ({**FINE, "colour": "red"}, "parts.colour", "keys among shape"),
    ({**FINE, "name": 3}, "parts.name", "string"),
    ({**FINE, "name": ""}, "name", "non-empty"),
    ({**FINE, "name": "a\nb"}, "name", "printable"),
    ({**FINE, "name": "\ud800"}, "name", "printable"),
    ({**FINE, "name": "a" * 81}, "name", "at most 80"),
    ({**FINE, "friction": -0.1}, "friction", ">= 0"),
    ({**FINE, "friction": math.nan}, "parts.friction", "finite"),
    ({**FINE, "static_friction": 0.1}, "static_friction", ">= 0.5"),
    ({**FINE, "length": 0}, "length", ">= 1e-05"),
    ({**FINE, "restitution": 1.5}, "restitution", "<= 1"),
    ({"shape": "polygon", "vertices": 3, "friction": 0.5}, "parts.vertices", "list"),
    ({"shape": "polygon", "vertices": [[0, 0], [1]], "friction": 0.5}, "parts.vertices.1.1", "required"),
    ({"shape": "polygon", "vertices": [[0, 0, 0]] * 3, "friction": 0.5}, "parts.vertices.0", "2 items"),
    ({"shape": "polygon", "vertices": [[0, "x"]], "friction": 0.5}, "parts.vertices.0.1", "number"),
    ({"shape": "polygon", "vertices": [[0, 0], [1, 1]], "friction": 0.5}, "vertices", "three corners"),
    ({"shape": "polygon", "vertices": [[0, 0], [1, 1], [1, 0], [0, 1]], "friction": 0.5}, "vertices", "simple polygon"),
    ({"shape": "polygon", "vertices_mm": [["a", 0]], "friction": 0.5}, "parts.vertices_mm", "a number"),
]  # fmt: skip


def refused(error, field):
    text = str(error.value)
    assert "\n" not in text and len(text) < 500
    assert all(each in text for each in field.split(".")), text


@pytest.mark.parametrize("value, field, allowed", BAD_SURFACES, ids=lambda each: str(each)[:40])
def test_bad_surfaces(value, field, allowed):
    with pytest.raises(ValueError) as error:
        surface_from(value)
    refused(error, field)


@pytest.mark.parametrize("value, field, allowed", BAD_PARTS, ids=lambda each: str(each)[:40])
def test_bad_parts(value, field, allowed):
    with pytest.raises(ValueError) as error:
        part_from(value)
    refused(error, field)


anything = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=6,
)
keys = st.sampled_from(
    ["rows", "columns", "element_size", "element_size_mm", "frequency", "gravity", "max_amplitude", "max_amplitude_mm",
     "horizontal_amplitude", "shape", "friction", "length", "width", "radius", "radius_mm", "vertices", "mass_g", "name"]
)  # fmt: skip


@given(st.one_of(anything, st.dictionaries(keys | st.text(max_size=4), anything, max_size=4)))
def test_any_value_gives_an_object_or_a_one_line_error(value):
    for make, kind in ((surface_from, Surface), (part_from, Part)):
        try:
            assert isinstance(make(value), kind)
        except ValueError as error:
            assert re.fullmatch(r"[^\n]+", str(error)), error


def test_settings_cannot_be_changed_afterwards():
    settings = parse(SurfaceSettings, {"rows": 4}, "surface")
    with pytest.raises(ValueError, match="frozen"):
        settings.rows = 5


# -- files -------------------------------------------------------------------------------------------------------------


def written(tmp_path, text):
    path = tmp_path / "settings.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_yaml(tmp_path):
    assert load_yaml(written(tmp_path, "a: 1\nb: {c: [1, 2]}\n")) == {"a": 1, "b": {"c": [1, 2]}}
    assert load_yaml(str(written(tmp_path, "a: 1\n"))) == {"a": 1}


@pytest.mark.parametrize("text, reason", [
    ("a: [1,\nb: {", "valid YAML"), ("\t- a", "valid YAML"), (b"\xff\xfe\x00", "valid YAML"),
    ("a: !!python/object/apply:os.system ['true']", "valid YAML"),
    ("- a\n- b", "a mapping"), ("", "a mapping"), ("3", "a mapping"),
])  # fmt: skip
def test_bad_yaml_is_one_line_that_names_the_file(tmp_path, text, reason):
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=re.escape(reason)) as error:
        load_yaml(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} {{left}}{', '.join([f'*a{k - 1}'] * 9)}{{right}}\n" for k in range(1, 10)
)


@pytest.mark.parametrize("text, line", [
    ("a: 1\nb: 2\na: 3\n", 3), ("a:\n  x: 1\n  x: 2\n", 3), ("1: a\ntrue: b\n", 2), ("a: 1\n---\nb: 2\n", 2),
    ("a: !mine 1\n", 1), ("a: 1\nb: &b [1, *b]\n", None), ("&a x: 1\ny: &b {z: *b}\n", None),
    (BOMB.replace("{left}", "[").replace("{right}", "]"), None), ("x: 1\na: 2024-02-31\n", None),
    ("x: 1\na: " + "1" * 5000, None), ("x: 1\na: !!int ''\n", None), ("a: 1\nb: \0\n", None), (b"a: 1\nb: \xff\n", None),
    ('a: "\\UFFFFFFFF"\n', None), ("a: 1\nb: " + "[" * 100_000, None), ("- " * 100_000, None),
    ("a: " + "x" * 2_000_000, None),
], ids=lambda each: str(each)[:25])  # fmt: skip
def test_invalid_yaml_raises_one_line_with_file_and_line(tmp_path, text, line):
    path = written(tmp_path, text)
    with pytest.raises(checks.Refused) as error:
        load_yaml(path)
    message = str(error.value)
    assert message.startswith(str(path) if line is None else f"{path}, line {line} ")
    assert len(message) < 700 and "\n" not in message and message.isprintable()


def test_yaml_may_still_use_aliases_and_override_what_it_merges(tmp_path):
    text = "b: &b {x: 1}\na: &a {<<: *b, x: 2}\nc: {<<: *a, y: 1}\nd: [*b, *b]\n"
    assert load_yaml(written(tmp_path, text)) == {
        "b": {"x": 1}, "a": {"x": 2}, "c": {"x": 2, "y": 1}, "d": [{"x": 1}, {"x": 1}]
    }  # fmt: skip


def test_missing_files_and_folders(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(ValueError, match="a readable file") as error:
            load_yaml(path)
        assert path.name in str(error.value)
