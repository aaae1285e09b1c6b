"""Publish and verify: what is published comes out again, and what is falsified is found and named."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml

from agents import __main__ as command
from agents.evaluation import check
from agents.evaluation.published import canonical
from agents.provenance import digest
from tests.commands import files_in, fill_the_disk, refusal, rows_of

SHIPPED = Path("vibgym/policies/trained/shipped")
EFFECTS = {"task": "Align", "policies": ["learned"], "cases": {"noise": {"sensor": "pose"}}}
SMALL = ["--episodes", "4", "--again", "2", "--processes", "1", "--quiet"]


@pytest.fixture(scope="session")
def original(tmp_path_factory):
    """Directory with a small evaluation, its settings and policy, published in ``out``."""
    folder = tmp_path_factory.mktemp("published")
    for path in (SHIPPED / "align.json", *SHIPPED.glob("align-6*.safetensors")):
        shutil.copy(path, folder)
    settings = {
        "tasks": ["Align"],
        "policies": ["zero", {"name": "learned", "kind": "trained", "path": "{task}.json"}],
        "episodes": 16,
        "first_seed": 7,
        "resamples": 100,
        "animations": False,
        "effects": EFFECTS,
        "output": "run",
    }
    (folder / "mine.yaml").write_text(yaml.safe_dump(settings))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("agents.evaluation.report.page", lambda *_: ("drawing takes most of the time", ""))
        assert command.main(["evaluate", "mine.yaml", "--quiet"]) == 0
        assert command.main(["publish", "mine.yaml", "--output", "out"]) == 0
    return folder


@pytest.fixture
def folder(original, tmp_path, monkeypatch):
    """A copy of it, to be spoilt; the current directory."""
    shutil.copytree(original, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    return tmp_path / "copy"


def verified(capsys, *arguments):
    capsys.readouterr()
    code = command.main(["verify", *arguments, *SMALL])
    return code, *capsys.readouterr()


def rewritten(path, old, new):
    text = Path(path).read_text()
    assert old in text
    Path(path).write_text(text.replace(old, new))


def edited(folder, change):
    """Change the record of what was published."""
    record = json.loads((folder / "out" / "report.json").read_text())
    change(record)
    (folder / "out" / "report.json").write_text(json.dumps(record))


def test_shipped_results_are_reproduced(capsys):
    code, text, _ = verified(capsys, "--task", "Align", "--policy", "local_field")
    assert code == 0, text
    assert text.endswith("\nverified\n") and "different: " not in text
    assert "| Align | ideal | local_field | 100.0 %" in text


def test_published_and_verified(folder, capsys):
    """Also with another version of a package, which is named and no fault."""
    record = json.loads((folder / "out" / "report.json").read_text())
    assert set(record["versions"]) >= {"python", "numpy", "numba", "vibgym"} and record["commit"]
    assert len(record["digests"]["policies"]) == 2
    assert len((folder / "out" / "episodes.csv").read_text().splitlines()) == 1 + 3 * 16
    edited(folder, lambda record: record["versions"].update(numpy="1.0"))
    code, text, errors = verified(capsys, "out", "--output", "all")
    assert code == 0 and errors == ""
    assert "6 of 6 published episodes have the same metrics when played again" in text
    assert "apart: " not in text and "different: " not in text
    assert text.count("version: ") == 1 and "version: numpy 1.0, here " in text
    rows = rows_of(folder / "all" / "verification.csv")
    assert {row["study"] for row in rows} == {"report", "effects"} and {row["agrees"] for row in rows} == {"True"}
    assert f"{len(rows)} of {len(rows)} figures" in text


def test_a_policy_that_is_worse_than_published_lies_outside(folder, capsys):
    def worse(record):
        record["settings"]["policies"][1] = {"name": "learned", "kind": "zero"}
        record["digests"]["settings"] = digest(canonical(record["settings"]))

    edited(folder, worse)
    code, text, _ = verified(capsys, "out")
    assert code == 1 and text.endswith("\nnot verified\n")
    success = "success 0.0 % of 4 episodes, published 100.0 %, by chance with 2.1e-04"
    assert f"apart: Align, ideal, learned: {success}" in text
    assert "different: mine.yaml: other policies (learned) than published\n" in text
    assert "apart: effects, Align, noise, learned: success" in text


def test_episodes_against_published_ones(basic):
    """Without a command: the same distribution agrees, another one does not, place by place."""
    same = check(basic.main, basic.main)
    assert same["agrees"].all() and set(same["figure"]) >= {"success_rate", "time_to_goal_median_s"}
    many = pd.concat([basic.main] * 20)
    slower = many.assign(time_to_goal_s=2.0 * many["time_to_goal_s"])
    apart = check(many, slower)
    times = apart["figure"] == "time_to_goal_median_s"
    assert times.any() and not apart["agrees"][times].any() and apart["agrees"][~times].all()
    assert (apart["published"][times] == 2.0 * apart["found"][times]).all()


SPOILT = [  # file, change (None: the file is removed), and the line that names it
    ("out/figures.csv", (",zero,success_rate,16,0.0,", ",zero,success_rate,16,0.5,"),
     "out/figures.csv: Align, ideal, zero: success_rate is 0.5; 0 follows from the episodes"),
    ("out/episodes.csv", ("report,Align,ideal,zero,8,0,0,", "report,Align,ideal,zero,8,1,0,"),
     "out/episodes.csv: edited since it was published"),
    ("out/report.json", ('"first_seed": 7', '"first_seed": 8'), "out/report.json: settings: edited since they were published"),
    ("align.json", ('"version": 2', '"version":  2'), "align.json: changed since results were published"),
    ("align.json", None, "align.json: missing since results were published"),
    ("align-*.safetensors", "x", "safetensors: changed since results were published"),
    ("mine.yaml", ("episodes: 16", "episodes: 17"), "mine.yaml: other episodes than published"),
]  # fmt: skip


@pytest.mark.parametrize("name, change, message", SPOILT)
def test_changes_are_named(name, change, message, folder, capsys):
    (path,) = folder.glob(name)
    if change is None:
        path.unlink()
    elif change == "x":
        path.write_text(change)
    else:
        rewritten(path, *change)
    code, text, errors = verified(capsys, "out", "--policy", "zero")
    assert code == 1 and errors == "" and text.endswith("\nnot verified\n")
    assert any(line.startswith("different: ") and line.endswith(message) for line in text.splitlines())
    assert ("nothing was played" in text) == (change in (None, "x"))


def test_a_falsified_figure_is_found_with_its_digest_too(folder, capsys):
    name, change, message = SPOILT[0]
    rewritten(folder / name, *change)
    changed = digest((folder / name).read_bytes())
    edited(folder, lambda record: record["digests"]["files"].update({"figures.csv": changed}))
    code, text, _ = verified(capsys, "out", "--policy", "zero")
    assert code == 1 and f"different: {message}\n" in text and "edited" not in text


BAD = [
    (None, "nowhere", ["nowhere/report.json", "No such file"]),
    (("report.json", "{", "["), "out", ["out/report.json", "not JSON"]),
    (("report.json", '"version": 1', '"version": 2'), "out", ["out/report.json", "'version': 2", "version 1"]),
    (("episodes.csv", "study,", "stud,"), "out", ["out/episodes.csv", "study"]),
    (("episodes.csv", "zero,8,0", "zero,8,no"), "out", ["out/episodes.csv, line 3: success", "'no'", "a number"]),
    (("figures.csv", "report,Align,ideal,zero,fallen_rate", "zero"), "out", ["out/figures.csv, line", "cells"]),
    (None, "out --episodes 0", ["--episodes", "0", ">= 1"]),
    (None, "out --again -1", ["--again", "-1", ">= 0"]),
    (None, "out --first-seed 20", ["--first-seed", "23", "20"]),
    (None, "out --task Sort", ["--task", "Sort", "Align"]),
    (None, "out --policy pid", ["--policy", "pid", "learned"]),
    (None, "out --processes 0", ["--processes", "0"]),
    (None, "out --output mine.yaml", ["--output", "'mine.yaml'"]),
]


@pytest.mark.parametrize("spoil, arguments, words", BAD)
def test_bad_input(spoil, arguments, words, folder, capsys):
    if spoil is not None:
        rewritten(folder / "out" / spoil[0], *spoil[1:])
    line = refusal(capsys, command.main, "verify", *arguments.split())
    assert all(word in line for word in words), line


def test_only_a_run_of_the_same_settings_is_published(folder, capsys):
    before = files_in(folder / "out")
    rewritten(folder / "mine.yaml", "first_seed: 7", "first_seed: 8")
    for arguments, words in (
        ([], ["run/results.json", "first_seed", "a run of mine.yaml"]),
        (["--run", "nowhere"], ["nowhere/results.json", "No such file"]),
    ):
        line = refusal(capsys, command.main, "publish", "mine.yaml", "--output", "out", *arguments)
        assert all(word in line for word in words)
    assert files_in(folder / "out") == before


def test_a_full_disk_leaves_what_was_published(folder, capsys, monkeypatch):
    before = files_in(folder / "out")
    fill_the_disk(monkeypatch, room=5)
    assert command.main(["publish", "mine.yaml", "--output", "out"]) == 1
    assert "No space left" in capsys.readouterr().err and files_in(folder / "out") == before
