"""Settings from mappings and files: units, unknown keys, clear errors."""

import math

import pytest

from vibgym import Surface, checks
from vibgym.config import load_yaml
from vibgym.scene.parts import part_from
from vibgym.scene.surface import surface_from

FINE = {"shape": "rectangle", "length": 0.05, "width": 0.03, "friction": 0.5}


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
    for vertices in (corners, [tuple(corner) for corner in corners]):
        angle = part_from({"shape": "polygon", "vertices_mm": vertices, "friction": 0.4})
        assert angle.area == pytest.approx(50e-3 * 20e-3 + 20e-3 * 20e-3)
    metres = part_from({"shape": "polygon", "vertices": [[x / 1000, y / 1000] for x, y in corners], "friction": 0.4})
    assert metres.outline == pytest.approx(angle.outline)


BAD = [  # ranges, types and unknown names: see tests/contracts/test_settings.py; any value: tests/fuzz/test_calls.py
    *((surface_from, value, "surface") for value in ("table", 5, None)),
    (surface_from, {"rows": 2000, "columns": 2000}, "columns"),
    *((part_from, value, "parts") for value in ("gold", 3)),
    *((part_from, {**FINE, "shape": shape}, "parts.shape") for shape in (None, "cube")), (part_from, {}, "parts.shape"),
    *((part_from, {**FINE, "name": name}, "name") for name in ("", "a\nb", "a" * 81)),
    (part_from, {**FINE, "static_friction": 0.49}, "static_friction"),
    (part_from, {**FINE, "centre_height_mm": 10.1}, "centre_height"),
    (part_from, {"shape": "polygon", "vertices": [[0, 0], [1]], "friction": 0.5}, "parts.vertices[1]"),
    (part_from, {"shape": "polygon", "vertices_mm": [["a", 0]], "friction": 0.5}, "parts.vertices_mm"),
]  # fmt: skip


@pytest.mark.parametrize("make, value, field", BAD)
def test_bad_surfaces_and_parts(make, value, field):
    with pytest.raises(ValueError) as error:
        make(value)
    text = str(error.value)
    assert "\n" not in text and len(text) < 500
    assert all(name in text for name in field.split(".")), text


# -- files -------------------------------------------------------------------------------------------------------------


def written(tmp_path, text):
    path = tmp_path / "settings.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} {{left}}{', '.join([f'*a{k - 1}'] * 9)}{{right}}\n" for k in range(1, 10)
)


@pytest.mark.parametrize("text, line", [
    ("a: 1\nb: 2\na: 3\n", 3), ("a:\n  x: 1\n  x: 2\n", 3), ("1: a\ntrue: b\n", 2), ("a: 1\n---\nb: 2\n", 2),
    ("a: !mine 1\n", 1), ("a: !!python/object/apply:os.system ['true']", 1), ("a: [1,\nb: {", 2), ("\t- a", 1),
    ("a: 1\nb: &b [1, *b]\n", None), ("&a x: 1\ny: &b {z: *b}\n", None),
    (BOMB.replace("{left}", "[").replace("{right}", "]"), None), ("x: 1\na: 2024-02-31\n", None),
    ("x: 1\na: " + "1" * 5000, None), ("x: 1\na: !!int ''\n", None), ("a: 1\nb: \0\n", None), (b"a: 1\nb: \xff\n", None),
    ('a: "\\UFFFFFFFF"\n', None), ("a: 1\nb: " + "[" * 100_000, None), ("- " * 100_000, None),
    ("a: " + "x" * 2_000_000, None), ("- a\n- b", None), ("", None), ("3", None), (b"\xff\xfe\x00", None),
], ids=lambda case: str(case)[:25])  # fmt: skip
def test_invalid_yaml_raises_one_line_with_file_and_line(tmp_path, text, line):
    path = written(tmp_path, text)
    with pytest.raises(checks.Refused) as error:
        load_yaml(path)
    message = str(error.value)
    assert message.startswith(str(path) if line is None else f"{path}, line {line} ")
    assert len(message) < 700 and "\n" not in message and message.isprintable()


def test_yaml_may_use_aliases_and_override_what_it_merges(tmp_path):
    path = written(tmp_path, "b: &b {x: 1}\na: &a {<<: *b, x: 2}\nc: {<<: *a, y: 1}\nd: [*b, *b]\n")
    for name in (path, str(path)):
        assert load_yaml(name) == {"b": {"x": 1}, "a": {"x": 2}, "c": {"x": 2, "y": 1}, "d": [{"x": 1}, {"x": 1}]}


def test_missing_files_and_folders(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(ValueError, match="a readable file") as error:
            load_yaml(path)
        assert path.name in str(error.value)
