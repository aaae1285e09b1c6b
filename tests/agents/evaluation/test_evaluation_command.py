"""The command line: exit codes, and one line for bad input."""

import csv
import os
from pathlib import Path

import pytest

from agents import __main__ as command
from agents.locks import one_run
from tests.commands import file_at, fill_the_disk, folder_at, refusal, said_in_one_line, saved

GOOD = {
    "tasks": ["Rotate"],
    "policies": ["zero", {"name": "steered", "kind": "local_field"}],
    "episodes": 3,
    "first_seed": 7,
    "resamples": 100,
    "animations": False,
}

EFFECTS = {"task": "Rotate", "policies": ["zero"], "cases": {"none": {}}}

BAD = {
    "unknown key": ({"taks": ["Rotate"]}, ["taks"]),
    "unknown task": ({"tasks": ["Stack"]}, ["tasks.0", "Stack"]),
    "task twice": ({"tasks": ["Align", "Align"]}, ["tasks", "Align"]),
    "unknown policy": ({"policies": ["fuzzy"]}, ["policies (fuzzy on Rotate)", "fuzzy"]),
    "task that does not run": ({"policies": [{"kind": "zero", "tasks": ["Align"]}]}, ["policies.0.tasks", "Align"]),
    "policy that does not serve": (
        {"tasks": ["Rotate", "Sort"], "policies": ["zero", {"kind": "open_loop", "tasks": ["Sort"]}]},
        ["policies (open_loop on Sort)"],
    ),
    "policy that serves nothing": (
        {"tasks": ["Sort"], "policies": ["zero", "open_loop"]},
        ["open_loop", "Sort: ", "one part"],
    ),
    "task without a policy": (
        {"tasks": ["Rotate", "Sort"], "policies": [{"kind": "zero", "tasks": ["Rotate"]}]},
        ["evaluation.tasks", "Sort"],
    ),
    "object that is none": ({"policies": [{"policy": "zero"}]}, ["policies.0"]),
    "more episodes than seeds": (
        {"seeds": [1, 2], "episodes": None, "first_seed": None, "task_episodes": {"Rotate": 3}},
        ["task_episodes.Rotate", "3"],
    ),
    "unknown argument": ({"policies": [{"kind": "zero", "gain": 1}]}, ["gain"]),
    "name twice": ({"policies": ["zero", {"name": "zero", "kind": "random"}]}, ["policies.1.name", "zero"]),
    "missing weights": ({"policies": [{"kind": "trained", "path": "nowhere/{task}.json"}]}, ["nowhere/rotate.json"]),
    "too few": ({"episodes": 0}, ["episodes", "0"]),
    "seeds and episodes": ({"seeds": [1, 2]}, ["episodes", "seeds"]),
    "environment key": ({"environment": {"action": "patch"}}, ["environment", "action"]),
    "environment value": ({"environment": {"parts": ["brick"]}}, ["parts", "brick"]),
    "hardware of another key": ({"hardware": {"a": {"walls": []}}}, ["evaluation.hardware.a", "walls"]),
    "hardware that nothing runs on": (
        {"hardware": {"a": {}, "b": {}}, "policies": [{"kind": "zero", "hardware": ["a"]}]},
        ["evaluation.hardware.b"],
    ),
    "unknown hardware of a policy": (
        {"hardware": {"a": {}}, "policies": [{"kind": "zero", "hardware": ["ideal"]}]},
        ["policies.0.hardware", "ideal"],
    ),
    "effects on an unknown policy": (
        {"effects": {"task": "Rotate", "policies": ["learned"], "cases": {"none": {}}}},
        ["evaluation.effects.policies.0", "learned"],
    ),
    "an effect that no environment has": (
        {
            "effects": {
                "task": "Rotate",
                "policies": ["zero"],
                "cases": {"dust": {"actuators": {"kind": "prototype", "dust": 1}}},
            }
        },
        ["evaluation.effects.cases.dust", "dust"],
    ),
    "a sensor setting that no sensor has": (
        {"effects": {"task": "Rotate", "policies": [{"policy": "zero", "sensor": {"zoom": 2}}], "cases": {"none": {}}}},
        ["evaluation.effects", "zoom"],
    ),
    "confidence": ({"confidence": 95}, ["confidence", "95"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_settings(case, tmp_path, capsys):
    changes, words = BAD[case]
    path = saved(tmp_path, GOOD, **changes)
    line = refusal(capsys, command.main, "evaluate", str(path))
    assert line.startswith(f"{path}: ")
    for word in words:
        assert word in line
    assert not (tmp_path / "out").exists()


def test_bad_files(tmp_path, capsys):
    assert str(tmp_path / "none.yaml") in refusal(capsys, command.main, "evaluate", str(tmp_path / "none.yaml"))
    path = tmp_path / "bad.yaml"
    for content in ("tasks: [Rotate", "- a\n- list\n", "tasks: !!python/object/apply:os.getcwd []\n", "\x00"):
        path.write_text(content)
        assert str(path) in refusal(capsys, command.main, "evaluate", str(path))


def test_bad_arguments(tmp_path, capsys):
    path = str(saved(tmp_path, GOOD))
    assert "--episodes" in refusal(capsys, command.main, "evaluate", path, "--episodes", "0")
    assert "--gif TASK" in refusal(
        capsys, command.main, "evaluate", path, "--gif", "Align", "zero", str(tmp_path / "a.gif")
    )
    assert "--gif POLICY" in refusal(
        capsys, command.main, "evaluate", path, "--gif", "Rotate", "nobody", str(tmp_path / "a.gif")
    )
    film = ["--gif", "Rotate", "zero", str(tmp_path / "a.gif"), "--gif-hardware", "prototype"]
    assert "--gif-hardware" in refusal(capsys, command.main, "evaluate", path, *film)
    assert "--gif-hardware" in refusal(capsys, command.main, "evaluate", path, *film[-2:])
    (tmp_path / "file").write_text("")
    assert "output" in refusal(capsys, command.main, "evaluate", path, "--output", str(tmp_path / "file" / "below"))
    for arguments in ([], ["fly"], ["evaluate"], ["evaluate", path, "--episodes", "many"]):
        with pytest.raises(SystemExit) as stop:
            command.main(arguments)
        assert stop.value.code == 2


BAD_PLACES = {
    "a file": (lambda folder: ("--output", file_at(folder / "file")), "evaluation.output"),
    "NUL": (lambda folder: ("--output", folder / "a\0b"), "evaluation.output"),
    "a report that is a directory": (
        lambda folder: ("--output", folder_at(folder / "there" / "report.html").parent),
        "evaluation.output",
    ),
    "a film below a file": (lambda folder: ("--gif", file_at(folder / "file") / "a.gif"), "--gif PATH"),
    "a film for the report": (lambda folder: ("--gif", folder / "out" / "report.html"), "--gif PATH"),
}


@pytest.mark.parametrize("case", BAD_PLACES)
def test_bad_places(case, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("agents.evaluation.run.evaluate", lambda *_: pytest.fail("runs"))
    make, named = BAD_PLACES[case]
    path = saved(tmp_path, GOOD)
    option, place = make(tmp_path)
    arguments = [option, *(("Rotate", "zero") if option == "--gif" else ()), str(place)]
    line = refusal(capsys, command.main, "evaluate", str(path), *arguments)
    assert line.startswith(f"{path}: {named}") and len(line) < 500
    assert not (tmp_path / "file").exists() or (tmp_path / "file").read_text() == "mine"


def test_policies_that_are_no_files(tmp_path, capsys):
    folder_at(tmp_path / "policy.json")
    for place in (tmp_path / "policy.json", tmp_path / ("x" * 300 + ".json"), tmp_path / "a\0.json"):
        line = refusal(capsys, command.main, "evaluate", str(saved(tmp_path, GOOD, policies=[str(place)])))
        assert "policies" in line and str(tmp_path) in line


def test_a_second_evaluation_in_a_directory_is_refused(tmp_path, capsys):
    path = saved(tmp_path, GOOD)
    (tmp_path / "out").mkdir()
    with one_run(tmp_path / "out"):
        assert "evaluation.output" in refusal(capsys, command.main, "evaluate", str(path))
        assert f"process {os.getpid()} on host" in refusal(capsys, command.main, "evaluate", str(path))
    assert os.listdir(tmp_path / "out") == []


def test_a_full_disk_leaves_the_old_report_and_its_film(tmp_path, capsys, monkeypatch):
    from agents.evaluation import report

    path, film = saved(tmp_path, GOOD, policies=[{"name": "=still", "kind": "zero"}]), tmp_path / "film" / "hero.gif"
    arguments = ["evaluate", str(path), "--episodes", "2", "--gif", "Rotate", "=still", str(film), "--quiet"]
    monkeypatch.setattr(report, "page", lambda *_: "first")  # drawing takes most of the time
    assert command.main(arguments) == 0
    before = {each: each.read_bytes() for folder in ("out", "film") for each in (tmp_path / folder).iterdir()}
    assert len(before) == 5
    for name in ("results.csv", "episodes.csv"):
        with (tmp_path / "out" / name).open(newline="") as file:
            assert {row["policy"] for row in csv.DictReader(file)} == {"'=still"}
    assert '"policy": "=still"' in (tmp_path / "out" / "results.json").read_text()
    capsys.readouterr()

    def late(*_):
        fill_the_disk(monkeypatch, room=3)
        return "second"

    monkeypatch.setattr(report, "page", late)
    assert command.main(arguments) == 1
    assert "No space left" in said_in_one_line(capsys)
    assert {each: each.read_bytes() for folder in ("out", "film") for each in (tmp_path / folder).iterdir()} == before


def test_whole_command(tmp_path, capsys):
    path, gif = saved(tmp_path, GOOD), tmp_path / "film" / "hero.gif"
    arguments = ["--output", str(tmp_path / "there"), "--episodes", "2", "--gif", "Rotate", "steered", str(gif)]
    assert command.main(["evaluate", str(path), *arguments, "--quiet"]) == 0
    caught = capsys.readouterr()
    assert caught.err == ""
    assert "| Rotate | steered | 100.0 % (" in caught.out
    assert str(tmp_path / "there" / "report.html") in caught.out
    assert len((tmp_path / "there" / "episodes.csv").read_text().splitlines()) == 1 + 2 * 2
    assert gif.read_bytes().startswith(b"GIF89a")
    assert not (tmp_path / "out").exists()


def test_interruption(tmp_path, capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    for place in ("run.evaluate", "report.prepare"):
        monkeypatch.setattr(f"agents.evaluation.{place}", interrupted)
        assert command.main(["evaluate", str(saved(tmp_path, GOOD)), "--quiet"]) == 130
        line = capsys.readouterr().err
        assert line.startswith("interrupted") and line.count("\n") == 1


def test_shipped_settings_are_sound():
    from agents import evaluation

    for path in sorted(Path("configs/evaluations").glob("*.yaml")):
        settings = evaluation.load_settings(path)
        assert settings.seed_list()[0] in (100_000, 300_000)
