"""The data sheet: figures against closed forms, one page of A4, and bad input in one line."""

import dataclasses
import math
import re

import pytest

from agents.__main__ import main
from agents.evaluation import datasheet, datasheet_page, part_limits
from agents.evaluation.datasheet import DatasheetSettings
from tests.browser import chromium, faults_at_all_sizes, watch
from tests.commands import refusal
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


def test_limits_follow_from_closed_forms_and_measured_rates_keep_them(sheet):
    limits = sheet.limits
    assert limits.acceleration == pytest.approx(0.5 * 0.58 * 9.81, rel=1e-9)
    assert limits.most_friction == pytest.approx(2.7e-3 * (50.0 * math.pi) ** 2 / (2.0 * 9.81), rel=1e-9)
    assert limits.circle == pytest.approx(0.58 * 9.81 / (50.0 * math.pi) ** 2, rel=1e-9)
    assert limits.tipping == pytest.approx(0.58 * 0.010 / 0.020, rel=1e-9)
    assert 0.040 / math.sqrt(5.0) < limits.gap < 0.020  # at crossings, at least that of the largest disc inside
    # A pulse at 0.1 mm (docs/control.md).
    assert limits.pulse == pytest.approx(0.1e-3 * 2.7e-3 * (50.0 * math.pi) ** 3 * 0.04 / 9.81, rel=1e-9)
    # The averages' own speed, within what they leave out (vibgym.simulation.plant).
    assert limits.top_speed == pytest.approx(0.71 * SURFACE.table_speed, rel=0.03)
    assert set(sheet.infos) == {"Transport", "Align", "Rotate"}
    assert all(sheet.played[task].success.all() for task in sheet.infos)
    assert (sheet.speed < limits.top_speed).all() and (sheet.speed > 0.05).all()
    position, heading = sheet.at_rest("position_error"), sheet.at_rest("heading_error")
    assert position.shape == heading.shape == (8,)
    assert position.max() < 1e-3 and heading.max() < math.radians(2.0)


def test_a_part_on_a_single_element_cannot_be_turned():
    scale = part_limits.smallest_scale(SURFACE, SQUARE, IDEAL)
    assert 26.0 < 40.0 * scale < 30.0  # mm: a little more than an element
    for factor, turns in ((0.95, False), (1.05, True)):
        part = Part.polygon(factor * scale * SQUARE.outline, friction=0.58)
        assert bool(part_limits.reach_of(SURFACE, part, IDEAL).min() >= part_limits.TURNABLE) is turns
    assert math.isnan(part_limits.smallest_scale(SURFACE, Part.rectangle(0.01, 0.01, friction=0.58), IDEAL))


def test_the_page_is_one_of_a4_without_scripts(sheet):
    written = datasheet_page.write(sheet)
    text = written.read_text(encoding="utf-8")
    assert "<script" not in text and "&lt;block&gt;" in text and "<block>" not in text
    assert all(src.startswith("data:image/png") for src in re.findall(r'src="([^"]*)"', text)) and len(text) < 200_000
    with chromium() as browser:
        page = browser.new_page()
        message = watch(page)
        page.goto(written.as_uri())
        data = page.pdf(prefer_css_page_size=True, print_background=True)
        assert faults_at_all_sizes(page) == [] and message == []
    assert len(re.findall(rb"/Type\s*/Page\b", data)) == 1
    (box,) = set(re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data))
    assert [round(float(number) / 72.0 * 25.4) for number in box] == [210, 297]


@pytest.mark.parametrize("content, arguments, named", [
    ("part: {shape: rectangle, length_mm: 40, width_mm: 40, friction: 5.0}", "", "friction 5"), ("colour: red", "", "colour"),
    ("episodes: 3", "", "datasheet.episodes"), ("surface: {rows: 0}", "", "rows"), ("actuators: magic", "", "actuators"),
    ("policy: {kind: trained, path: none.json}", "", "none.json"), ("model: [1]", "", "model"), (None, "", "mine.yaml"),
    ("{}", "--machine machine.yaml", "walls"), ("{}", "--part {", "--part"), ("{}", "--part a.dxf", "a.dxf"),
    ("{}", "--episodes 2", "--episodes"),
])  # fmt: skip
def test_bad_settings_and_arguments_are_one_line(tmp_path, monkeypatch, capsys, content, arguments, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "machine.yaml").write_text("walls: [left]", encoding="utf-8")
    if content is not None:
        (tmp_path / "mine.yaml").write_text(content, encoding="utf-8")
    line = refusal(capsys, main, "datasheet", "mine.yaml", "--output", "out", *arguments.split())
    assert named in line and ("mine.yaml" in line or arguments)


def test_a_disc_has_no_heading(tmp_path):
    part = {"shape": "disc", "radius_mm": 20, "friction": 0.5}
    settings = DatasheetSettings.checked({"part": part, "episodes": 8, "output": str(tmp_path)})
    disc = datasheet.measure(settings, quiet=True)
    assert disc.turn_speed is None and "Rotate" not in disc.played
    text = datasheet_page.summary(disc)
    assert "Heading" not in text and "Rotation" not in text
    assert "disc of 40 mm" in datasheet_page.write(disc).read_text(encoding="utf-8")


def test_stable_poses_of_a_mesh_are_on_the_sheet(sheet, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "box.stl"
    path.write_bytes(trimesh.creation.box([40.0, 30.0, 10.0]).export(file_type="stl"))
    data = {"part": {"file": str(path), "friction": 0.5, "tolerance_mm": 0.1}}
    part, poses = datasheet.part_of(DatasheetSettings.checked(data))
    assert part.height == pytest.approx(0.010)
    assert len(poses) == 6 and sum(pose.probability for pose in poses) == pytest.approx(1.0)
    lines = datasheet_page.groups(dataclasses.replace(sheet, poses=poses))["Stable poses"]
    assert [label for label, _, _ in lines] == [f"Pose {k}" for k in range(datasheet_page.MAX_POSES)]
    assert lines[0][1] == f"{100 * poses[0].probability:.1f} %" and "10 mm high" in lines[0][2]
    assert "Stable poses" not in datasheet_page.groups(sheet)
    assert datasheet.part_of(DatasheetSettings.checked({"part": "steel_block"}))[1] == ()


def test_tasks_models_and_sticking_are_on_the_sheet(sheet):
    lines = {label: (value, note) for lines in datasheet_page.groups(sheet).values() for label, value, note in lines}
    assert lines["Parts lost"][0] == "0" and lines["Align, camera"][0].startswith("8 of 8")
    # Of 8: 98 % of 320 episodes succeed in this scene, and its motion is chaotic.
    assert int(lines["Align, rigid part"][0].split()[0]) >= 7
    assert "Align" in lines["Tasks"][1] and "Align" in lines["Learned agents"][1]
    assert "pose" in lines["Controllers of all these tasks"][1] and "zero" not in str(lines)
    assert "0.58" in lines["Sticking"][1] and lines["Gap between elements"][0].endswith("mm")
    held = datasheet_page.groups(dataclasses.replace(sheet, unfit={"Rigid part": "not convex"}))
    assert ("Align, rigid part", "–", "not convex") in held["Accuracy"]


MACHINE = """
surface: {frequency: 24.6, horizontal_amplitude: 0.0025}
actuators: {kind: prototype, gain: 0.9, elements: %s, compensate: true}
sensor: {kind: pose, noise: {position: 0.0002, heading: 0.003}}
parts: [{shape: rectangle, length: 0.05, width: 0.035, friction: 0.47, name: block}]
"""


def test_a_part_on_an_identified_machine(tmp_path, capsys):
    """One command with the two files; the part has the machine's friction."""
    pytest.importorskip("ezdxf")
    machine = tmp_path / "machine.yaml"
    machine.write_text(MACHINE % ([[[1.0, 0.1]] * 32] * 8), encoding="utf-8")
    options = ["--part", "configs/datasheets/bracket.dxf", "--episodes", "8", "--output", str(tmp_path), "--quiet"]
    assert main(["datasheet", "--machine", str(machine), *options]) == 0
    printed = capsys.readouterr().out
    assert "here 0.47" in printed and "Align, rigid part: –; parts must be convex" in printed
    page = (tmp_path / "datasheet.html").read_text(encoding="utf-8")
    assert "24.6 Hz" in page and "gain 1.00 to 1.00, phase 6 to 6 deg" in page and "estimator model" in page


def test_settings_of_a_machine_and_of_the_sheet(tmp_path):
    machine = tmp_path / "machine.yaml"
    machine.write_text(MACHINE % "null", encoding="utf-8")
    content = {"machine": str(machine), "sensor": "pose"}
    settings = DatasheetSettings.checked(content)
    assert settings.part["name"] == "block" and settings.sensor == "pose" and settings.actuators["gain"] == 0.9
    own = DatasheetSettings.checked({**content, "part": {"file": "a.dxf", "friction": 0.3}})
    assert own.part == {"file": "a.dxf", "friction": 0.3}
    assert DatasheetSettings.checked({**content, "part": "a.dxf"}).part == {"file": "a.dxf", "friction": 0.47}
