"""The data sheet: figures against closed forms, one page of A4, and bad input in one line."""

import dataclasses
import math
import re

import pytest

from agents.__main__ import main
from agents.evaluation import datasheet
from agents.evaluation.datasheet import DatasheetSettings
from tests.browser import chromium, faults_at_all_sizes, watch
from vibgym import Part, Surface
from vibgym.actuators import DataSheet

SURFACE = Surface()
IDEAL = DataSheet(limit=SURFACE.max_amplitude)
SQUARE = Part.rectangle(0.04, 0.04, friction=0.58, height=0.02)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    """Of the prototype with a square part whose height is known."""
    part = {"shape": "rectangle", "length_mm": 40, "width_mm": 40, "friction": 0.58, "height_mm": 20, "name": "<block>"}
    output = str(tmp_path_factory.mktemp("datasheet"))
    return datasheet.measure(DatasheetSettings.checked({"part": part, "episodes": 8, "output": output}), quiet=True)


@pytest.fixture(scope="module")
def written(sheet):
    return datasheet.write(sheet)


def test_limits_follow_from_closed_forms(sheet):
    found = sheet.limits
    assert found.acceleration == pytest.approx(0.5 * 0.58 * 9.81, rel=1e-9)
    assert found.most_friction == pytest.approx(2.7e-3 * (50.0 * math.pi) ** 2 / (2.0 * 9.81), rel=1e-9)
    assert found.circle == pytest.approx(0.58 * 9.81 / (50.0 * math.pi) ** 2, rel=1e-9)
    assert found.tipping == pytest.approx(0.58 * 0.010 / 0.020, rel=1e-9)
    # The averages' own speed, within what they leave out (vibgym.scene.sliding).
    assert found.top_speed == pytest.approx(0.71 * SURFACE.table_speed, rel=0.03)


def test_measured_rates_keep_the_bounds(sheet):
    assert set(sheet.infos) == {"Transport", "Align", "Rotate"}
    assert all(sheet.played[task].success.all() for task in sheet.infos)
    assert (sheet.speed < sheet.limits.top_speed).all() and (sheet.speed > 0.05).all()
    position, heading = sheet.at_rest("position_error"), sheet.at_rest("heading_error")
    assert position.shape == heading.shape == (8,)
    assert position.max() < 1e-3 and heading.max() < math.radians(2.0) and sheet.lost == 0


def test_a_part_on_a_single_element_cannot_be_turned():
    scale = datasheet.smallest_scale(SURFACE, SQUARE, IDEAL)
    assert 26.0 < 40.0 * scale < 30.0  # mm: a little more than an element
    for factor, turns in ((0.95, False), (1.05, True)):
        part = Part.polygon(factor * scale * SQUARE.outline, friction=0.58)
        assert bool(datasheet.reach_of(SURFACE, part, IDEAL).min() >= datasheet.TURNABLE) is turns
    assert math.isnan(datasheet.smallest_scale(SURFACE, Part.rectangle(0.01, 0.01, friction=0.58), IDEAL))


def test_the_page_is_one_of_a4_without_scripts(written, tmp_path):
    text = written.read_text(encoding="utf-8")
    assert "<script" not in text and "&lt;block&gt;" in text and "<block>" not in text
    assert all(each.startswith("data:image/png") for each in re.findall(r'src="([^"]*)"', text)) and len(text) < 200_000
    with chromium() as browser:
        sheet = browser.new_page()
        said = watch(sheet)
        sheet.goto(written.as_uri())
        data = sheet.pdf(prefer_css_page_size=True, print_background=True)
        assert faults_at_all_sizes(sheet) == [] and said == []
    assert len(re.findall(rb"/Type\s*/Page\b", data)) == 1
    (box,) = set(re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data))
    assert [round(float(each) / 72.0 * 25.4) for each in box] == [210, 297]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("part: {shape: rectangle, length_mm: 40, width_mm: 40, friction: 5.0}", "friction 5"),
        ("colour: red", "colour"),
        ("episodes: 3", "datasheet.episodes"),
        ("surface: {rows: 0}", "rows"),
        ("actuators: magic", "actuators"),
        ("policy: {kind: trained, path: none.json}", "none.json"),
        ("model: [1]", "model"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capfd, content, said):
    config = tmp_path / "own.yaml"
    config.write_text(content, encoding="utf-8")
    assert main(["datasheet", str(config), "--output", str(tmp_path / "out"), "--quiet"]) == 2
    line = capfd.readouterr().err
    assert line.count("\n") == 1 and said in line and str(config) in line


def test_a_missing_file_is_one_line(tmp_path, capfd):
    assert main(["datasheet", str(tmp_path / "none.yaml")]) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert main(["datasheet", "--episodes", "2", "--output", str(tmp_path)]) == 2
    assert "--episodes" in capfd.readouterr().err


def test_a_disc_has_no_heading(tmp_path):
    part = {"shape": "disc", "radius_mm": 20, "friction": 0.5}
    settings = DatasheetSettings.checked({"part": part, "episodes": 8, "output": str(tmp_path)})
    found = datasheet.measure(settings, quiet=True)
    assert found.turn_speed is None and "Rotate" not in found.played
    text = datasheet.summary(found)
    assert (
        "Heading" not in text
        and "Rotation" not in text
        and "disc of 40 mm" in datasheet.write(found).read_text(encoding="utf-8")
    )


def test_stable_poses_of_a_mesh_are_on_the_sheet(sheet, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "box.stl"
    path.write_bytes(trimesh.creation.box([40.0, 30.0, 10.0]).export(file_type="stl"))
    poses = datasheet.poses_of({"file": str(path), "friction": 0.5, "tolerance_mm": 0.1})
    assert len(poses) == 6 and sum(each.probability for each in poses) == pytest.approx(1.0)
    lines = datasheet.groups(dataclasses.replace(sheet, poses=poses))["Stable poses"]
    assert [each.label for each in lines] == [f"Pose {k}" for k in range(6)]
    assert lines[0].value == f"{100 * poses[0].probability:.1f} %" and "10 mm high" in lines[0].note
    assert "Stable poses" not in datasheet.groups(sheet) and datasheet.poses_of("steel_block") == ()
