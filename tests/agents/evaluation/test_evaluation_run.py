"""Cases are played once, however often and by however many processes; what is written holds nothing of the host."""

import json
import shutil
import sys
from pathlib import Path

import pandas as pd
import pytest

from agents import __main__ as command
from agents.evaluation import ComparisonSettings, EvaluationSettings, SuiteSettings, cases, report, run, table
from agents.evaluation.published import written_settings
from agents.evaluation.run import KEPT, Case
from agents.evaluation.table import TIMING
from agents.provenance import policy_files, policy_sources, portable
from tests.agents.evaluation.conftest import Pusher, evaluated
from tests.commands import files_in, fill_the_disk, rows_of, said_in_one_line, saved
from vibgym.policies.rollout import rollout
from vibgym.policies.trained.catalogue import shipped_agents

GOOD = {"tasks": ["Rotate"], "policies": ["zero", {"name": "=steered", "kind": "local_field"}], "episodes": 2}
MIXED = {
    "tasks": ["Rotate", "Sort"],
    "policies": ["random", {"name": "pusher", "policy": Pusher(), "tasks": ["Rotate"]}],
    "episodes": 3,
    "first_seed": 9,
    "resamples": 100,
    "effects": {"task": "Rotate", "policies": ["random", "pusher"], "cases": {"none": {}, "noise": {"sensor": "pose"}}},
}


@pytest.fixture
def plays(monkeypatch):
    """List of the places of all cases that are played in this process."""
    played, play = [], Case.play
    monkeypatch.setattr(Case, "play", lambda case, quiet: played.append(case.place) or play(case, quiet))
    return played


def assert_same(one, other):
    """Compare results and their files, except times."""
    pd.testing.assert_frame_equal(*(results.episodes.drop(columns=list(TIMING)) for results in (one, other)))
    assert one.pictures == other.pictures and sum(len(picture) for picture in one.pictures.values()) == 6
    first, second = (report.write(results, quiet=True)[0].parent for results in (one, other))
    assert (first / "episodes.csv").read_bytes() == (second / "episodes.csv").read_bytes()
    for rows in zip(*(rows_of(episodes / "results.csv") for episodes in (first, second)), strict=True):
        without = [{key: value for key, value in row.items() if "steps_per_second" not in key} for row in rows]
        assert without[0] == without[1]


def test_an_interrupted_evaluation_continues_and_processes_change_only_times(tmp_path, plays, monkeypatch):
    whole, places = evaluated(MIXED, tmp_path / "whole"), list(plays)
    assert len(places) == 7
    play = Case.play
    with monkeypatch.context() as patch:

        def interrupted(case, quiet):
            if case.place == places[2]:
                raise KeyboardInterrupt
            return play(case, quiet)

        patch.setattr(Case, "play", interrupted)
        with pytest.raises(KeyboardInterrupt):
            evaluated(MIXED, tmp_path / "parts")
    kept = list((tmp_path / "parts" / KEPT).glob("*.csv"))
    assert [len(rows_of(path)) for path in kept] == [3]  # of the first policy; those of an object are not recorded
    plays.clear()
    continued = evaluated(MIXED, tmp_path / "parts")
    assert plays == places[1:]
    assert_same(whole, continued)
    plays.clear()
    again = evaluated(MIXED, tmp_path / "parts")
    assert {place.policy for place in plays} == {"pusher"}
    assert_same(whole, again)
    plays.clear()
    monkeypatch.setattr("agents.parallel.available_threads", lambda: 2)
    two = evaluated({**MIXED, "processes": 2}, tmp_path / "two")
    assert {place.policy for place in plays} == {"pusher"}  # the others are played by workers
    assert_same(whole, two)


def test_recorded_episodes_depend_on_the_agents_and_policies_of_their_task_alone(tmp_path, monkeypatch):
    agents = [agent for agent in shipped_agents() if agent.path.stem in ("rotate", "align")]
    for agent in agents:
        for path in policy_sources(str(agent.path), "")[1]:
            shutil.copy(path, tmp_path)
    moved = [agent._replace(path=tmp_path / agent.path.name) for agent in agents]

    def files(of_rotate, of_align="learned"):
        settings = {
            "tasks": ["Rotate", "Align"],
            "policies": [{"kind": "by_task", "Rotate": of_rotate, "Align": of_align}],
        }
        return {case.task: case.file(tmp_path) for case in cases(EvaluationSettings.checked({**GOOD, **settings}))}

    module = sys.modules[Case.__module__]
    monkeypatch.setattr(module, "shipped_agents", lambda: agents)
    here = files("learned")
    monkeypatch.setattr(module, "shipped_agents", lambda: moved)
    assert files("learned") == here  # wherever the package is installed
    other = files("zero")
    assert other["Align"] == here["Align"] and other["Rotate"] != here["Rotate"]
    (tmp_path / "align.json").write_text((tmp_path / "align.json").read_text() + "\n")
    changed = files("learned")
    assert changed["Rotate"] == here["Rotate"] and changed["Align"] != here["Align"]


def test_cases_become_one_table():
    """Rows and columns are those of rollouts; nothing is written."""
    some = cases(EvaluationSettings.checked({**GOOD, "episodes": 4, "hardware": {"late": {"actuators": "prototype"}}}))
    episodes = run(some, quiet=True)
    assert episodes["policy"].tolist() == ["zero"] * 4 + ["=steered"] * 4
    alone = rollout(some[1].policy, "Rotate", seeds=some[1].seeds, actuators="prototype")
    assert episodes["success"][4:].tolist() == alone.success.tolist()
    assert episodes["position_error_m"][4:].tolist() == alone.position_error.tolist()
    shares = table(episodes, by=["hardware", "policy"])
    assert shares["hardware"].tolist() == ["late"] * 2
    assert shares["success_rate"].tolist() == [0.0, alone.success.mean()]


def test_whole_command(tmp_path, capsys):
    path, gif = saved(tmp_path, GOOD, animations=False), tmp_path / "film" / "hero.gif"
    arguments = ["--output", str(tmp_path / "there"), "--episodes", "1", "--gif", "Rotate", "=steered", str(gif)]
    for _ in range(2):  # the second time, all are recorded
        assert command.main(["evaluate", str(path), *arguments, "--quiet"]) == 0
        caught = capsys.readouterr()
        assert caught.err == "" and "| Rotate | =steered | 100.0 % (" in caught.out
        assert str(tmp_path / "there" / "report.html") in caught.out
        assert gif.read_bytes().startswith(b"GIF89a")
    for name in ("results.csv", "episodes.csv"):  # no spreadsheet reads a formula
        assert [row["policy"] for row in rows_of(tmp_path / "there" / name)] == ["zero", "'=steered"]
    assert '"policy": "=steered"' in (tmp_path / "there" / "results.json").read_text()
    assert not (tmp_path / "out").exists()


def test_a_full_disk_leaves_the_old_report_and_its_film(tmp_path, capsys, monkeypatch):
    path, film = saved(tmp_path, GOOD, animations=False), tmp_path / "film" / "hero.gif"
    arguments = ["evaluate", str(path), "--gif", "Rotate", "zero", str(film), "--quiet"]
    monkeypatch.setattr(report, "page", lambda *_: ("first", ""))  # drawing takes most of the time
    assert command.main(arguments) == 0
    before = files_in(tmp_path / "out") | files_in(tmp_path / "film")
    assert len(before) == 5 + 5  # two cases with a plot each, and one film
    capsys.readouterr()

    def late(*_):
        fill_the_disk(monkeypatch, room=3)
        return "second", ""

    monkeypatch.setattr(report, "page", late)
    assert command.main(arguments) == 1
    assert "No space left" in said_in_one_line(capsys)
    assert files_in(tmp_path / "out") | files_in(tmp_path / "film") == before


def test_shipped_settings_are_sound():
    for path in sorted(Path("configs/evaluations").glob("*.yaml")):
        assert EvaluationSettings.load(path).seed_list()[0] in (100_000, 300_000)
    for path in sorted(Path("configs/comparisons").glob("*.yaml")):
        assert ComparisonSettings.load(path).generalisation
    suite = SuiteSettings.load(Path("configs/suite/open.yaml"))
    assert suite.seed_list("Swap")[0] == 300_000 and set(suite.machines()) == {"ideal", "prototype"}
    entries = {entry.name: entry.content for entry in suite.policies}
    assert list(entries) == ["zero", "random", "classical", "planner", "mpc", "learned", "parallel_rollout"]
    for name in ("classical", "parallel_rollout"):
        assert len(suite.tasks) == 8 and set(entries[name]) - {"kind"} == set(suite.tasks)


SHIPPED = Path("vibgym/policies/trained/shipped/transport.json")


def with_path(output, path):
    policies = ["zero", {"name": "own", "kind": "trained", "path": str(path), "tasks": ["Transport"]}]
    return EvaluationSettings.checked({"tasks": ["Transport"], "policies": policies, "output": str(output)})


def test_paths_below_the_current_directory_start_from_there(pytestconfig, monkeypatch, tmp_path):
    monkeypatch.chdir(pytestconfig.rootpath)
    stored = with_path(tmp_path / "report", SHIPPED.absolute())
    content = stored.as_written()
    assert str(pytestconfig.rootpath) not in json.dumps(content) and str(tmp_path) not in json.dumps(content)
    assert (content["output"], stored.output) == ("report", str(tmp_path / "report"))
    assert content["policies"]["own"]["policy"]["path"] == SHIPPED.as_posix()
    assert written_settings(stored)["policies"][1]["path"] == SHIPPED.as_posix()
    assert SHIPPED.as_posix() in policy_files([({"kind": "trained", "path": str(SHIPPED.absolute())}, "Transport")])
    values = {"a": [1, 2.5, None, "runs/x"], "/key": {"b": True}}
    assert portable(values) == values


def test_a_file_that_no_one_else_has_is_not_published(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"evaluation\.policies \(own\)\.path"):
        written_settings(with_path("report", tmp_path.parent / "policy.json"))
