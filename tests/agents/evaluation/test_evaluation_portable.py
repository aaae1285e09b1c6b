"""What is published says nothing of the machine that it comes from."""

import json
from pathlib import Path

import pytest

from agents import evaluation
from agents.evaluation.published import written_settings
from agents.provenance import policy_files, portable

SHIPPED = Path("vibgym/policies/trained/shipped/transport.json")


def settings(output, path):
    policies = ["zero", {"name": "own", "kind": "trained", "path": str(path), "tasks": ["Transport"]}]
    return evaluation.settings_from({"tasks": ["Transport"], "policies": policies, "output": str(output)})


def test_paths_below_the_current_directory_start_from_there(pytestconfig, monkeypatch, tmp_path):
    monkeypatch.chdir(pytestconfig.rootpath)
    found = settings(tmp_path / "report", SHIPPED.absolute())
    text = json.dumps(found.as_written())
    assert str(pytestconfig.rootpath) not in text and str(tmp_path) not in text
    assert found.as_written()["output"] == "report"
    assert found.as_written()["policies"]["own"]["policy"]["path"] == SHIPPED.as_posix()
    assert written_settings(found)["policies"][1]["path"] == SHIPPED.as_posix()
    assert SHIPPED.as_posix() in policy_files([({"kind": "trained", "path": str(SHIPPED.absolute())}, "Transport")])
    assert found.output == str(tmp_path / "report")  # where it really goes


def test_a_file_that_no_one_else_has_is_not_published(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    elsewhere = tmp_path.parent / "policy.json"
    with pytest.raises(ValueError, match=r"evaluation\.policies \(own\)\.path"):
        written_settings(settings("report", elsewhere))


def test_other_values_stay():
    values = {"a": [1, 2.5, None, "runs/x"], "/key": {"b": True}}
    assert portable(values) == values
