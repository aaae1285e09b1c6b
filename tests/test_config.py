"""Settings from mappings and files: units, unknown keys, clear errors."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Surface, checks
from vibgym.config import load_yaml
from vibgym.scene.parts import part_from
from vibgym.scene.surface import surface_from

FINE = {"shape": "rectangle", "length": 0.05, "width": 0.03, "friction": 0.5}
BEYOND = {
    "length": 9e-6, "width": 1001.0, "friction": -1e-9, "height": 0.0, "mass": 1.1e9, "restitution": 1.001,
    "contact_friction": -1e-9, "coupling": 1.001,
}  # fmt: skip


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


BAD_SURFACES = [  # ranges, types and unknown names: see tests/contracts/test_settings.py
    ("table", "surface"), (5, "surface"), (None, "surface"), ({"rows": 10**400}, "surface.rows"),
    ({"rows": 2000, "columns": 2000}, "columns"), ({"element_size_mm": 10**400}, "surface.element_size_mm"),
    ({"max_amplitude": 1.0}, "max_amplitude"), ({"rows": 0}, "surface.rows"), ({"frequency": 0.0}, "surface.frequency"),
    ({"gravity": 0.0}, "surface.gravity"), ({"element_size": 0.0}, "surface.element_size"),
    ({"horizontal_amplitude": -1e-9}, "surface.horizontal_amplitude"),
]  # fmt: skip
BAD_PARTS = [
    *(({**FINE, name: value}, f"parts.{name}") for name, value in BEYOND.items()),
    ("gold", "parts"), (3, "parts"), ({}, "parts.shape"), ({**FINE, "shape": None}, "parts.shape"),
    ({**FINE, "shape": "cube"}, "parts.shape"), ({**FINE, "name": ""}, "name"), ({**FINE, "name": "a\nb"}, "name"),
    ({**FINE, "name": "a" * 81}, "name"), ({**FINE, "static_friction": 0.49}, "static_friction"),
    ({**FINE, "centre_height_mm": 10.1}, "centre_height"),
    ({"shape": "polygon", "vertices": [[0, 0], [1]], "friction": 0.5}, "parts.vertices[1]"),
    ({"shape": "polygon", "vertices_mm": [["a", 0]], "friction": 0.5}, "parts.vertices_mm"),
]  # fmt: skip


CASES = [(made, *each) for made, rows in ((surface_from, BAD_SURFACES), (part_from, BAD_PARTS)) for each in rows]


@pytest.mark.parametrize("make, value, field", CASES, ids=lambda each: getattr(each, "__name__", str(each))[:40])
def test_bad_surfaces_and_parts(make, value, field):
    with pytest.raises(ValueError) as error:
        make(value)
    text = str(error.value)
    assert "\n" not in text and len(text) < 500
    assert all(each in text for each in field.split(".")), text


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
