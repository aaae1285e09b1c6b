"""The suite: nothing scores 0, the bound 1, interquartile means are those of closed forms, and a policy enters by one file."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from agents import __main__ as command
from agents.evaluation.run import Case
from agents.evaluation.settings import SuiteSettings
from agents.evaluation.statistics import episode_scores, suite_interval, suite_score

SMALL = {
    "tasks": ["Transport", "Align", "Feed"],
    "policies": ["zero", {"name": "straight", "kind": "by_task", "Transport": "pose", "Align": "pose"}],
    "episodes": 3,
    "task_episodes": {"Feed": 1},
    "first_seed": 390_000,
    "training_steps": 1000,
    "resamples": 200,
}


def written(folder, **changes):
    path = folder / "suite.yaml"
    path.write_text(yaml.safe_dump({**SMALL, "output": str(folder / "out"), **changes}))
    return path


def found(success, time, bound):
    none = np.full(len(success), np.nan)
    return SimpleNamespace(
        success=np.array(success), time_to_goal=np.array(time), bound=np.array(bound), rate_bound=none
    )


def test_the_shipped_protocol_is_sound():
    settings = SuiteSettings.load(Path("configs/suite/open.yaml"))
    assert settings.seed_list("Swap")[0] == 300_000 and set(settings.machines()) == {"ideal", "prototype"}
    entries = {entry.name: entry.content for entry in settings.policies}
    assert list(entries) == ["zero", "random", "classical", "planner", "mpc", "learned", "parallel_rollout"]
    assert len(settings.tasks) == 8
    for name in ("classical", "parallel_rollout"):
        assert set(entries[name]) - {"kind"} == set(settings.tasks)


def test_nothing_is_0_and_the_bound_is_1():
    at = found([False, True, True], [np.nan, 2.0, 4.0], [2.0, 2.0, 2.0])
    assert episode_scores(at).tolist() == [0.0, 1.0, 0.5]
    feeding = SimpleNamespace(rate_bound=np.array([300.0, 300.0]), rate_over_bound=np.array([0.0, 1.0]))
    assert episode_scores(feeding).tolist() == [0.0, 1.0]
    assert np.isnan(episode_scores(found([True], [2.0], [np.nan]))).all()


def test_episodes_above_the_limit_of_the_cost_score_0(tmp_path, capsys):
    free = {"tasks": ["SwapCrowded"], "policies": ["zero", "lanes"], "task_episodes": {}, "episodes": 4}
    scores = {}
    for limit in (None, 0.0005, 1e9):
        costs = {} if limit is None else {"environment": {"costs": {"impulse": 1.0}}, "cost_limit": limit}
        output = tmp_path / f"{limit}"
        assert command.main(["score", str(written(tmp_path, **free, **costs, output=str(output))), "--quiet"]) == 0
        scores[limit] = json.loads((output / "results.json").read_text())["results"][1]
        assert ("within the limit" in (output / "scores.md").read_text()) == (limit is not None)
    capsys.readouterr()
    assert scores[1e9]["score"] == scores[None]["score"] > 0.0 and scores[1e9]["within_limit"] == 1.0
    assert scores[0.0005]["cost_median"] == scores[1e9]["cost_median"] > 0.0005 and scores[None]["cost_median"] is None
    assert scores[0.0005]["score"] < scores[None]["score"] and scores[0.0005]["within_limit"] <= 0.5


def test_the_score_of_all_is_the_interquartile_mean_of_the_tasks():
    tasks = [np.full(5, share) for share in (0.0, 0.1, 0.4, 0.5, 0.7, 0.8, 0.9, 1.0)]
    assert suite_score(tasks) == pytest.approx((0.4 + 0.5 + 0.7 + 0.8) / 4)
    assert suite_score(tasks[::-1]) == suite_score(tasks) and suite_interval(tasks, 0.95, 200) is None
    assert suite_score([np.zeros(3)] * 8) == 0.0 and suite_score([np.ones(3)] * 8) == 1.0


def test_its_interval_is_that_of_the_episodes_of_each_task():
    random = np.random.default_rng(0)
    one = random.random(200)
    interval = suite_interval([one], 0.95, 4000)
    half = 1.96 * one.std() / np.sqrt(200)
    assert (interval.low, interval.high) == pytest.approx((one.mean() - half, one.mean() + half), abs=0.1 * half)
    # Of four tasks the middle two count: their mean varies less by sqrt(2).
    four = suite_interval([np.zeros(200), one, one[::-1].copy(), np.ones(200)], 0.95, 4000)
    assert four.high - four.low == pytest.approx((interval.high - interval.low) / np.sqrt(2.0), rel=0.1)


def test_the_command_scores_goes_on_and_lets_others_enter(tmp_path, capsys, monkeypatch):
    path = written(tmp_path)
    assert command.main(["score", str(path), "--quiet"]) == 0
    table = capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "results.json").read_text())
    scores = {(row["task"], row["policy"]): row for row in content["results"]}
    totals = {row["policy"]: row["score"] for row in content["suite"]}
    assert totals["zero"] == 0.0 and not any(scores[task, "zero"]["score"] for task in SMALL["tasks"])
    assert 0.8 < scores["Align", "straight"]["score"] <= 1.0
    assert scores["Feed", "straight"]["score"] == 0.0 and not scores["Feed", "straight"]["served"]
    of_tasks = [scores[task, "straight"]["score"] for task in SMALL["tasks"]]
    assert totals["straight"] == pytest.approx(np.mean(of_tasks))  # of three nothing is cut off
    assert "| straight |" in table and "| – |" in table
    for name in ("scores.csv", "suite.csv", "scores.md", "scores.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0

    def never(*_):
        raise AssertionError("played again")

    monkeypatch.setattr(Case, "play", never)
    assert command.main(["score", str(path), "--quiet"]) == 0  # all from the files of the first run
    assert capsys.readouterr().out == table
    monkeypatch.undo()
    own = tmp_path / "mine.yaml"
    own.write_text("{kind: pose, training_steps: 10}")
    assert command.main(["score", str(path), "--policy", str(own), "--episodes", "1", "--quiet"]) == 0
    assert "| mine |" in capsys.readouterr().out


@pytest.mark.parametrize(("changes", "said"), [
    ({"training_steps": 0}, "training_steps"),
    ({"tasks": ["Sort"], "task_episodes": {}}, "suite.tasks"),
    ({"policies": [{"kind": "pose", "training_steps": 2000}]}, "suite.policies.0.training_steps"),
    ({"policies": ["open_loop"], "tasks": ["Feed"]}, "open_loop"),
    ({"policies": [{"kind": "zero", "episodes": 0}]}, "suite.policies.0.episodes"),
    ({"cost_limit": 1.0}, "suite.cost_limit"),
    ({"cost_limit": -1.0, "environment": {"costs": {"effort": 1.0}}}, "suite.cost_limit"),
])  # fmt: skip
def test_bad_suites(tmp_path, capsys, changes, said):
    assert command.main(["score", str(written(tmp_path, **changes)), "--quiet"]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1


@pytest.mark.parametrize(("text", "said"), [("{colour: 1}", "kind"), ("{kind: magic}", "magic"), ("[1]", "mine.yaml")])
def test_bad_files_of_policies(tmp_path, capsys, text, said):
    own = tmp_path / "mine.yaml"
    own.write_text(text)
    assert command.main(["score", str(written(tmp_path)), "--policy", str(own), "--quiet"]) == 2
    assert said in capsys.readouterr().err
