"""The study of demonstrations at small size: data are recorded once, and finished runs are not trained again."""

import sys

import yaml

from studies.benchmarks import demonstrations


def test_the_study_runs_and_goes_on(tmp_path, monkeypatch, capsys):
    recording, output = tmp_path / "push.yaml", tmp_path / "out"
    recording.write_text(
        yaml.safe_dump({**yaml.safe_load(demonstrations.RECORDINGS["Push"].read_text()), "episodes": 4})
    )
    monkeypatch.setitem(demonstrations.RECORDINGS, "Push", recording)
    words = "--tasks Push --methods cloned --seeds 1 --steps 3 --episodes 2 --counts".split()
    trained = {}
    for counts in (["2"], ["4", "2"]):
        monkeypatch.setattr(sys, "argv", ["demonstrations", *words, *counts, "--output", str(output)])
        demonstrations.main()
        before = {path: path.stat().st_mtime_ns for path in trained}
        trained = {path: path.stat().st_mtime_ns for path in output.rglob("seed-0/*.safetensors")}
        assert before.items() <= trained.items()
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert len(lines) == 2 + 2 + 2 + 3 and any("cloning" in line and "| 4 |" in line for line in lines)
    assert len({path.parent for path in trained}) == 2
    assert len(list((output / "data").rglob("main_data.hdf5"))) == 1
