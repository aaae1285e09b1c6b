"""The study of demonstrations at small size: data are recorded once, and finished runs are not trained again."""

import sys

import yaml

from agents.offline import DataLearner
from studies.benchmarks import demonstrations


def test_the_study_runs_and_goes_on(tmp_path, monkeypatch, capsys):
    small = {**yaml.safe_load(demonstrations.RECORDINGS["Push"].read_text()), "episodes": 4}
    recording = tmp_path / "push.yaml"
    recording.write_text(yaml.safe_dump(small))
    monkeypatch.setitem(demonstrations.RECORDINGS, "Push", recording)
    counted = {name: each._replace(counts=(4, 2)) for name, each in demonstrations.METHODS["Push"].items()}
    monkeypatch.setitem(demonstrations.METHODS, "Push", counted)
    steps = []
    update = DataLearner._update
    monkeypatch.setattr(DataLearner, "_update", lambda self, step: steps.append(step) or update(self, step))
    asked = [
        "--tasks", "Push", "--methods", "cloned", "flow", "--seeds", "1", "--steps", "3", "--episodes", "2", "--output",
        str(tmp_path / "out"),
    ]  # fmt: skip
    for more in (["--counts", "2"], []):
        monkeypatch.setattr(sys, "argv", ["demonstrations", *asked, *more])
        demonstrations.main()
    lines = capsys.readouterr().out.splitlines()
    table = [line for line in lines if line.startswith("| ")]
    assert len(table) == 2 + 3 + 2 + 5 and any("flow matching" in line and "| 4 |" in line for line in table)
    # The first call trains two runs, the second one finds them and trains two more.
    assert sorted(steps) == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert len(list((tmp_path / "out" / "data").rglob("main_data.hdf5"))) == 1
