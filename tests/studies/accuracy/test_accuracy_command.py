"""The command: exit codes, one line for bad input, and a whole small report."""

import csv
import json
import os
from pathlib import Path

import pytest

from agents import locks
from studies.accuracy import __main__ as command
from studies.accuracy import mujoco_scene, report, settings
from tests.commands import refusal, saved

GOOD = {
    "rounds": 2,
    "peer_worlds": 1,
    "orders": False,
    "hard_cases": False,
    "truth": {"steps": 32, "pieces": 2, "reference_worlds": 1, "reference_periods": 1, "reference_tolerance": 1e-6},
    "strong_tolerances": [1e-3, 1e-12],
    "models": [{"model": "planar"}, {"model": "planar", "steps": [4, 8]}, {"model": "averaged", "order": [1, 2]}],
    "peers": [{"peer": "point_sampling", "points": 4}, {"peer": "LSODA", "rtol": 1e-2}, {"peer": "mujoco"}],
    "scenes": [
        {"name": "fields <&>", "worlds": 8, "periods": 3, "drive": {"kind": "random"}},
        {
            "name": "stick",
            "worlds": 4,
            "periods": 2,
            "drive": {"kind": "random"},
            "surface": {"horizontal_amplitude": 3e-4},
        },
    ],
}

BAD = {
    "models": {"model": []},
    "report.scenes": {"scenes": []},
    "report.models": {"models": None},
    "models.0.model": {"models": [{"model": "exact"}]},
    "models.0": {"models": ["planar"]},
    "models.0.model.order": {"models": [{"model": "averaged", "order": [1, 3]}]},
    "peers.0.peer": {"peers": [{"peer": "bullet"}]},
    "'atol' of peers.0": {"peers": [{"peer": "LSODA", "atol": 1}]},
    "peers.0.rtol": {"peers": [{"peer": "LSODA", "rtol": 2.0}]},
    "report.strong_tolerances[0]": {"strong_tolerances": [0.0]},
    "truth.steps": {"truth": {"steps": 2}},
    "scenes.0.drive.kind": {"scenes": [{"name": "a", "drive": {"kind": "dance"}}]},
    "scenes.0": {"scenes": [{**GOOD["scenes"][0], "part": {"shape": "disc", "radius": 99.0, "friction": 0.5}}]},
    "report.rounds": {"rounds": "many"},
}
"""Name in the error -> the settings that cause it."""


@pytest.mark.parametrize("name", BAD)
def test_bad_settings(name, tmp_path, capsys):
    path = saved(tmp_path, GOOD, **BAD[name])
    line = refusal(capsys, command.main, str(path))
    assert line.startswith(f"{path}: ") and name in line
    assert not (tmp_path / "out").exists()


def test_bad_files_and_places(tmp_path, capsys, monkeypatch):
    """No file, no YAML, a file or another run in the place of the output directory: nothing is run or overwritten."""
    monkeypatch.setattr(report, "run", lambda *_: pytest.fail("runs"))
    assert str(tmp_path / "none.yaml") in refusal(capsys, command.main, str(tmp_path / "none.yaml"))
    path = tmp_path / "bad.yaml"
    for content in ("scenes: [a", "- a\n- list\n"):
        path.write_text(content)
        assert str(path) in refusal(capsys, command.main, str(path))
    (tmp_path / "file").write_text("mine")
    (tmp_path / "taken" / "results.csv").mkdir(parents=True)
    (tmp_path / "kept").mkdir()
    path = saved(tmp_path, GOOD)
    with locks.one_run(tmp_path / "kept"):
        for place in ("file", "file/below", "taken", "kept"):
            line = refusal(capsys, command.main, str(path), "--output", str(tmp_path / place))
            assert line.startswith(f"{path}: output") and (f"process {os.getpid()} on host" in line) == (
                place == "kept"
            )
    assert (tmp_path / "file").read_text() == "mine"


def test_shipped_settings_are_sound(tmp_path):
    for path in sorted(Path("configs/accuracy").glob("*.yaml")):
        prepared = report.prepare(settings.load_settings(path, str(tmp_path)))
        assert prepared.candidates and prepared.scenes
        assert any(not scene.slides for scene in prepared.scenes)
    assert len(prepared.scenes) >= 6  # the shipped set


def test_whole_report(tmp_path, capsys, monkeypatch):
    """Every candidate of every scene is in the files; what is missing is named with its reason."""

    def missing():
        raise ImportError("the MuJoCo scene needs MuJoCo: pip install vibgym[mujoco]")

    monkeypatch.setattr(mujoco_scene, "load_mujoco", missing)
    assert command.main([str(saved(tmp_path, GOOD)), "--output", str(tmp_path / "there"), "--quiet"]) == 0
    caught = capsys.readouterr()
    assert caught.err == "" and str(tmp_path / "there" / "report.html") in caught.out
    assert "| stick | 1.0 mm of trajectory | planar" in caught.out
    assert "| stick | 1.0e-09 mm of trajectory | no setting |" in caught.out
    assert not (tmp_path / "out").exists()

    rows = list(csv.DictReader((tmp_path / "there" / "results.csv").open()))
    assert len(rows) == 2 * 8
    for row in rows:
        assert bool(row["refused"]) != bool(row["cost_us"]), row
        if not row["refused"]:
            assert float(row["cost_us"]) > 0.0 and 0.0 < float(row["strong_median_m"]) <= float(row["strong_max_m"])
    refused = {(row["scene"], row["method"]): row["refused"] for row in rows if row["refused"]}
    assert "pip install vibgym[mujoco]" in refused["fields <&>", "MuJoCo"]
    assert "model='planar'" in refused["stick", "averaged, order 2"] and "static" in refused["stick", "SciPy LSODA"]

    results = json.loads((tmp_path / "there" / "results.json").read_text())
    assert list(results["truth"]) == ["fields <&>", "stick"]
    check = results["truth"]["fields <&>"]
    assert check["trouble"] == "" and check["gap"] < 1e-5 and check["estimate"] < 1e-5

    page = (tmp_path / "there" / "report.html").read_text()
    assert "fields &lt;&amp;&gt;" in page and "fields <&>" not in page
    assert "http://" not in page and "https://" not in page and page.count("data:image/png;base64,") == 2
    assert "pip install vibgym[mujoco]" in page and "What failed, and what was refused" in page
