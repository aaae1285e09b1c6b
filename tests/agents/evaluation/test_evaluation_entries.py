"""Entries of a suite: the ranking is what was played, and code of an entry does not reach it."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from agents.__main__ import main
from agents.evaluation import entry_process
from agents.evaluation.entries import load_entries
from agents.evaluation.run import Case
from agents.evaluation.settings import SuiteSettings
from agents.provenance import policy_sources
from tests.commands import rows_of
from vibgym.policies.trained.catalogue import SHIPPED

SUITE = {
    "tasks": ["Align", "Transport"],
    "policies": ["zero"],
    "first_seed": 300000,
    "episodes": 2,
    "training_steps": 1_000_000,
    "resamples": 200,
}
CODE = """
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import POLICIES

def mine(info):
    return make_policy("pose", info)

POLICIES.register("mine", mine)
"""
STEPS = json.loads((SHIPPED / "align.json").read_text())["training"]["steps"]
FAULTY = """
import time
from vibgym.policies.classical.open_loop import ZeroPolicy
from vibgym.policies.task_info import POLICIES

class Mine(ZeroPolicy):
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        action, state = super().predict(observation, state, episode_start, deterministic)
        {}

POLICIES.register("mine", Mine)
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """Work in a directory with a suite."""
    monkeypatch.chdir(tmp_path)
    Path("suite.yaml").write_text(yaml.safe_dump(SUITE))
    return tmp_path


def entry(name, policy, files=None, **more):
    """Write an entry; return its folder."""
    folder = Path("entries") / name
    folder.mkdir(parents=True)
    (folder / "entry.yaml").write_text(yaml.safe_dump({"policy": policy, "authors": "me", **more}))
    for file, content in (files or {}).items():
        (folder / file).write_text(content)
    return folder


def copy_agent(folder):
    """Copy the shipped agent of Align."""
    for path in policy_sources(str(SHIPPED / "align.json"), "Align")[1]:
        shutil.copy(path, folder)


def rank(*more, suite="suite.yaml"):
    return main(["score", suite, "--entries", "entries", "--output", "found", "--quiet", *more])


def ranking():
    return {row["entry"]: row for row in rows_of(Path("found/ranking.csv"))}


def refused(capsys, named, *more):
    assert rank(*more) == 2
    error = capsys.readouterr().err
    assert named in error and error.count("\n") == 1
    assert not Path("found/ranking.csv").exists()


@pytest.fixture
def played(monkeypatch):
    """List of the runs that are played."""
    runs, play = [], Case.play
    monkeypatch.setattr(Case, "play", lambda run, quiet: runs.append(run.place[1:]) or play(run, quiet))
    return runs


def test_entries_are_played_on_the_same_episodes_and_ranked(capsys, played):
    Path("mine.yaml").write_text("{kind: by_task, Align: pose, Transport: pose, training_steps: 10}")
    assert main(["score", "suite.yaml", "--policy", "mine.yaml", "--enter", "me", "--output", "out", "--quiet"]) == 0
    score = rows_of(Path("out/suite.csv"))[0]["score"]
    entry("still", "zero", training_steps=7)
    # An entry that serves one task scores 0 on the others, even if it claims more.
    claims = "task,hardware,seed,score\nTransport,ideal,300000,1.0\n"
    entry("one", {"kind": "by_task", "Align": "pose"}, {"episodes.csv": claims})
    played.clear()
    assert rank() == 0
    rows, text = ranking(), capsys.readouterr().out
    assert list(rows) == ["mine", "one", "still"] and len(played) == 5
    assert rows["mine"]["score"] == score and float(rows["mine"]["Align"]) > 0.5
    assert rows["one"]["Align"] == rows["mine"]["Align"] and float(rows["one"]["Transport"]) == 0.0
    assert float(rows["one"]["score"]) == float(rows["one"]["Align"]) / 2.0
    assert [row["episodes"] for row in rows.values()] == ["4", "2", "4"]
    assert [row["training_steps"] for row in rows.values()] == ["10", "0", "7"]
    assert "Episodes of each task: 2.\n" in text and "one, Transport, ideal: scores 0" in text
    assert rank() == 0 and len(played) == 5  # all are recorded
    capsys.readouterr()
    assert rank("--episodes", "1") == 0
    text = capsys.readouterr().out
    assert "Episodes of each task: 1; the protocol has 2." in text and text.count("(no interval)") == 3
    assert {row["score_low"] for row in ranking().values()} <= {"", "nan"}


ALIGN = {**SUITE, "tasks": ["Align"], "episodes": 1}


def test_recorded_episodes_are_those_of_the_same_files_and_classes(monkeypatch, played):
    """Files of the entry, and a user module of ``--import``, that change are played again."""
    monkeypatch.syspath_prepend(".")
    monkeypatch.setattr("vibgym.imports._imported", [])  # other tests do not import the module
    Path("suite.yaml").write_text(yaml.safe_dump(ALIGN))
    Path("entered_module.py").write_text(CODE.replace('"mine"', '"entered_class"'))
    every = [{"kind": "trained", "path": "{entry}/align.json"}]
    folder = entry("trained", {"kind": "by_task", "Align": {"kind": "parallel_rollout", "policies": every}})
    copy_agent(folder)
    entry("class", "entered_class")
    arguments = ("--import", "entered_module")
    assert rank(*arguments) == rank(*arguments) == 0 and len(played) == 2
    trained = load_entries(Path("entries"), SuiteSettings.load(Path("suite.yaml")))["trained"]
    assert trained.training_steps == STEPS  # as its file states
    for number, path in enumerate((folder / "align.json", folder / "notes", folder / "notes")):
        path.write_text(path.read_text() + "\n" if path.exists() else "x")
        assert rank(*arguments) == 0 and len(played) == 3 + number
    assert [place[-1] for place in played[2:]] == ["trained"] * 3
    module = Path("entered_module.py")  # any policy may use it
    module.write_text(module.read_text() + "x = 1\n")
    assert rank(*arguments) == 0 and len(played) == 7


@pytest.mark.parametrize("text", ["", "[]", '{"task": "Align"}', "seed,success\n300000,0\n300001,0\n"])
def test_recorded_episodes_of_anything_else_are_refused(text, capsys):
    entry("still", "zero")
    assert rank() == 0
    Path("found/ranking.csv").unlink()
    next(Path("found/episodes").iterdir()).write_text(text)
    capsys.readouterr()
    refused(capsys, "recorded episodes")


def test_code_runs_in_a_process_that_does_not_reach_the_ranking(capsys, played):
    """Its actions are those of the same policy in this process."""
    harm = """
import pathlib, sys
import agents.evaluation.score as score, agents.evaluation.entries as entries, agents.evaluation.statistics as statistics
score.suite_score = statistics.suite_score = entries.rows = lambda *_: 1.0
print("| ideal | mine | 1.000 |")
"""
    entry("mine", {"kind": "by_task", "Align": "mine"}, {"policy.py": CODE + harm}, module="policy")
    entry("same", {"kind": "by_task", "Align": "pose"})
    refused(capsys, "--trust mine")
    refused(capsys, "'other'", "--trust", "other")
    assert not Path("found").exists()
    assert rank("--trust", "mine") == 0
    rows = ranking()
    assert 0.0 < float(rows["mine"]["score"]) < 0.6 and rows["mine"]["score"] == rows["same"]["score"]
    assert "1.000" not in capsys.readouterr().out
    assert rank("--trust", "mine") == 0
    assert [place[-1] for place in played] == ["mine", "same", "mine"]  # code is played again
    assert {path.name for path in Path("entries/mine").iterdir()} == {"entry.yaml", "policy.py"}


@pytest.mark.parametrize(("body", "message"), [
    ("raise KeyError('x')", "KeyError"),
    ("import os; os._exit(3)", "ends"),
    ("time.sleep(600)", "no answer within"),
    ("return action[:1], state", "2 x "),
    ("return action * float('nan'), state", "NaN"),
    ("return [0.0] * 10**6, state", "too much"),
])  # fmt: skip
def test_code_that_fails_scores_0(body, message, capsys, monkeypatch):
    Path("suite.yaml").write_text(yaml.safe_dump({**SUITE, "tasks": ["Transport"]}))
    if "sleep" in body:
        monkeypatch.setattr(entry_process, "ANSWER_SECONDS", 40.0)
    entry("mine", "mine", {"policy.py": FAULTY.format(body)}, module="policy")
    assert rank("--trust", "mine") == 0
    assert float(ranking()["mine"]["score"]) == 0.0
    assert message in capsys.readouterr().out


def test_code_that_cannot_be_loaded_is_one_error(capsys):
    entry("mine", "mine", {"policy.py": "import nothing_of_this_name"}, module="policy")
    refused(capsys, "nothing_of_this_name", "--trust", "mine")


@pytest.mark.parametrize(("policy", "more", "message"), [
    ("zero", {"training_steps": 1_000_001}, "training_steps"),
    ("zero", {"authors": ""}, "authors"),
    ("zero", {"sha256": {}}, "sha256"),
    ("zero", {"episodes": 1}, "episodes"),
    ("zero", {"module": "../policy"}, "module"),
    ("zero", {"module": "policy"}, "module"),
    ({"kind": "zero", "name": "../evil"}, {}, "name"),
    ({"kind": "zero", "episodes": 1}, {}, "episodes"),
    ({"kind": "trained", "path": "{entry}/../align.json"}, {}, "align.json"),
    ({"kind": "trained", "path": "weights"}, {}, "weights"),
    ({"kind": "parallel_rollout", "policies": ["lanes", "/tmp/policy.json"]}, {}, "/tmp/policy.json"),
    ({"kind": "trained", "path": "{entry}/base.json"}, {}, "elsewhere"),
    ({"kind": "trained", "path": "{entry}/steps.json"}, {}, "steps"),
])  # fmt: skip
def test_a_bad_entry_is_one_error_before_anything_is_played(policy, more, message, capsys):
    Path("weights").write_text("x")
    files = {
        "base.json": json.dumps({"residual": {"base": {"kind": "trained", "path": "elsewhere/policy"}}}),
        "steps.json": json.dumps({"training": {"steps": 2_000_000}}),
    }
    entry("mine", policy, files, **more)
    refused(capsys, message)
    assert not Path("found").exists()


def test_links_are_refused(capsys):
    folder = entry("mine", "zero")
    Path("outside").mkdir()
    for link, target in ((folder / "link", "outside"), (folder / "file", "suite.yaml")):
        link.symlink_to(Path(target).absolute())
        refused(capsys, "link")
        link.unlink()
    folder.rename("outside/mine")
    folder.symlink_to(Path("outside/mine").absolute())
    refused(capsys, "link")


@pytest.mark.parametrize("name", ["../evil", "/tmp/evil", "a/b", "two words", "a.b", "x" * 200, ".hidden"])
def test_names_are_plain_words_and_entries_are_written_into_their_folder_only(name, place, capsys):
    if Path(name).name == name:
        entry(name, "zero")
        refused(capsys, "letters, digits")
    Path("mine.yaml").write_text(yaml.safe_dump({"kind": "zero", "name": name}))
    before = sorted(place.parent.rglob("*"))
    assert main(["score", "suite.yaml", "--policy", "mine.yaml", "--enter", "me", "--output", "out"]) == 2
    assert "at most 40" in capsys.readouterr().err and sorted(place.parent.rglob("*")) == before


def test_a_trained_policy_is_entered_with_its_files():
    copy_agent(".")
    arguments = ["score", "suite.yaml", "--policy", "align.json", "--enter", "me", "--output", "out", "--quiet"]
    assert main([*arguments, "--episodes", "1"]) == 0
    align = load_entries(Path("entries"), SuiteSettings.load(Path("suite.yaml")))["align"]
    assert align.training_steps == STEPS and len(list(Path("entries/align").iterdir())) == 3
    assert main(arguments) == 2  # the entry exists


@pytest.mark.parametrize("arguments", [
    "--entries none", "--entries entries --policy mine.yaml", "--enter me", "--trust mine",
])  # fmt: skip
def test_an_empty_directory_and_conflicting_options_are_refused(arguments):
    Path("none").mkdir()
    Path("mine.yaml").write_text("{kind: zero}")
    assert main(["score", "suite.yaml", *arguments.split(), "--output", "found"]) == 2
    assert not Path("found").exists()


def test_shipped_entries_are_valid(pytestconfig):
    settings = SuiteSettings.load(pytestconfig.rootpath / "configs/suite/open.yaml", None, None)
    shipped = load_entries(pytestconfig.rootpath / "entries", settings)
    assert {"classical", "learned", "parallel_rollout"} <= set(shipped)
    assert shipped["classical"].training_steps == 0 < shipped["learned"].training_steps
