"""Publish and verify: what is published comes out again, and what is falsified is found and named."""

import csv
import json
import shutil
from pathlib import Path

import pytest
import yaml

from agents import __main__ as command
from agents.provenance import digest
from tests.commands import files_in, fill_the_disk, refusal

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
        patch.setattr("agents.evaluation.report.page", lambda *_: "drawing takes most of the time")
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
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_what_is_shipped_comes_out_again(capsys):
    code, text, _ = verified(capsys, "--task", "Align", "--policy", "local_field")
    assert code == 0, text
    assert (
        text.endswith("\nverified\n")
        and "different: " not in text
        and "| Align | ideal | local_field | 100.0 %" in text
    )


def test_published_and_verified(folder, capsys):
    code, text, errors = verified(capsys, "out", "--output", "all")
    assert code == 0 and errors == ""
    assert "6 of 6 published episodes have the same metrics when played again" in text
    assert "apart: " not in text and "different: " not in text and "version: " not in text
    rows = list(csv.DictReader((folder / "all" / "verification.csv").open(newline="")))
    assert {row["study"] for row in rows} == {"report", "effects"} and {row["agrees"] for row in rows} == {"True"}
    assert f"{len(rows)} of {len(rows)} figures" in text
    record = json.loads((folder / "out" / "report.json").read_text())
    assert set(record["versions"]) >= {"python", "numpy", "numba", "vibgym"} and record["commit"]
    assert len(record["digests"]["policies"]) == 2
    assert len((folder / "out" / "episodes.csv").read_text().splitlines()) == 1 + 3 * 16


def test_a_policy_that_is_worse_than_published_lies_outside(folder, capsys):
    record = json.loads((folder / "out" / "report.json").read_text())
    policies = record["settings"]["policies"]
    policies[1] = {"name": "learned", "kind": "zero"}
    record["digests"]["settings"] = digest(json.dumps(record["settings"], sort_keys=True, separators=(",", ":")))
    (folder / "out" / "report.json").write_text(json.dumps(record))
    code, text, _ = verified(capsys, "out")
    assert code == 1 and text.endswith("\nnot verified\n")
    assert (
        "apart: Align, ideal, learned: success 0.0 % of 4 episodes, published 100.0 %, by chance with 2.1e-04" in text
    )
    assert "different: mine.yaml: other policies (learned) than published\n" in text
    assert "apart: effects, Align, noise, learned: success" in text


def falsified_figure(out):
    lines = (out / "figures.csv").read_text().splitlines(keepends=True)
    index = next(k for k, line in enumerate(lines) if line.startswith("report,Align,ideal,zero,success_rate,16,0.0,"))
    lines[index] = lines[index].replace(",16,0.0,", ",16,0.5,")
    (out / "figures.csv").write_text("".join(lines))
    return "out/figures.csv: Align, ideal, zero: success_rate is 0.5; 0 follows from the episodes"


def falsified_figure_and_digest(out):
    said = falsified_figure(out)
    record = json.loads((out / "report.json").read_text())
    record["digests"]["files"]["figures.csv"] = digest((out / "figures.csv").read_bytes())
    (out / "report.json").write_text(json.dumps(record))
    return said


def edited_episodes(out):
    rewritten(out / "episodes.csv", "report,Align,ideal,zero,8,0,0,", "report,Align,ideal,zero,8,1,0,")
    return "out/episodes.csv: edited since it was published"


def edited_settings(out):
    rewritten(out / "report.json", '"first_seed": 7', '"first_seed": 8')
    return "out/report.json: settings: edited since they were published"


def other_policy(out):
    rewritten(out.parent / "align.json", '"version": 2', '"version":  2')
    return "align.json: changed since results were published"


def other_tensors(out):
    path = next(out.parent.glob("align-*.safetensors"))
    path.write_bytes(path.read_bytes()[:-1] + b"\0")
    return f"{path.name}: changed since results were published"


def missing_policy(out):
    (out.parent / "align.json").unlink()
    return "align.json: missing since results were published"


def other_config(out):
    rewritten(out.parent / "mine.yaml", "episodes: 16", "episodes: 17")
    return "mine.yaml: other episodes than published"


@pytest.mark.parametrize(
    "spoil",
    [falsified_figure, falsified_figure_and_digest, edited_episodes, edited_settings]
    + [other_policy, other_tensors, missing_policy, other_config],
)
def test_what_is_changed_is_named(spoil, folder, capsys):
    said = spoil(folder / "out")
    code, text, errors = verified(capsys, "out", "--policy", "zero")
    assert code == 1 and errors == "" and text.endswith("\nnot verified\n")
    assert f"different: {said}\n" in text
    assert ("nothing was played" in text) == (spoil in (other_tensors, missing_policy))


def test_other_versions_are_named_and_no_fault(folder, capsys):
    record = json.loads((folder / "out" / "report.json").read_text())
    now, record["versions"]["numpy"] = record["versions"]["numpy"], "1.0"
    (folder / "out" / "report.json").write_text(json.dumps(record))
    code, text, _ = verified(capsys, "out", "--policy", "zero")
    assert code == 0 and f"version: numpy 1.0, here {now}\n" in text


BAD = {
    "nowhere": (None, ["nowhere"], ["nowhere/report.json", "No such file"]),
    "no JSON": (lambda out: (out / "report.json").write_text("{"), ["out"], ["out/report.json", "not JSON"]),
    "wrong version": (
        lambda out: rewritten(out / "report.json", '"version": 1', '"version": 2'),
        ["out"],
        ["out/report.json", "'version': 2", "version 1"],
    ),
    "no episodes": (lambda out: (out / "episodes.csv").unlink(), ["out"], ["out/episodes.csv", "No such file"]),
    "a cell that is no number": (
        lambda out: rewritten(out / "episodes.csv", "ideal,zero,8,0", "ideal,zero,8,no"),
        ["out"],
        ["out/episodes.csv, line 3: success", "'no'", "a number"],
    ),
    "a row too short": (
        lambda out: (out / "figures.csv").write_text((out / "figures.csv").read_text() + "report,Align\n"),
        ["out"],
        ["out/figures.csv, line", "cells"],
    ),
    "no columns": (lambda out: (out / "figures.csv").write_text("a,b\n1,2\n"), ["out"], ["figures.csv", "study"]),
    "no episode": (None, ["out", "--episodes", "0"], ["--episodes", "0", ">= 1"]),
    "less than none again": (None, ["out", "--again", "-1"], ["--again", "-1", ">= 0"]),
    "published seeds": (None, ["out", "--first-seed", "20"], ["--first-seed", "23", "20"]),
    "another task": (None, ["out", "--task", "Sort"], ["--task", "Sort", "Align"]),
    "another policy": (None, ["out", "--policy", "pid"], ["--policy", "pid", "learned"]),
    "no process": (None, ["out", "--processes", "0"], ["--processes", "0"]),
    "a place that is none": (None, ["out", "--output", "mine.yaml"], ["--output", "'mine.yaml'"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case, folder, capsys):
    spoil, arguments, words = BAD[case]
    if spoil is not None:
        spoil(folder / "out")
    line = refusal(capsys, command.main, "verify", *arguments)
    for word in words:
        assert word in line


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
