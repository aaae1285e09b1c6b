"""The suite: a task that is not served scores 0, costs are limited, and a policy is scored by one file."""

import json
from pathlib import Path

import numpy as np
import pytest

from agents import __main__ as command
from agents.evaluation import SuiteSettings, score
from agents.evaluation.run import Case
from agents.evaluation.score import rows, write
from tests.agents.evaluation.conftest import evaluated
from tests.commands import saved

SMALL = {
    "tasks": ["Transport", "Align", "Feed"],
    "policies": ["zero", {"name": "straight", "kind": "by_task", "Transport": "pose", "Align": "pose"}],
    "episodes": 3,
    "task_episodes": {"Feed": 1},
    "first_seed": 390_000,
    "training_steps": 1000,
    "resamples": 200,
}


def test_the_shipped_protocol_is_sound():
    settings = SuiteSettings.load(Path("configs/suite/open.yaml"))
    assert settings.seed_list("Swap")[0] == 300_000 and set(settings.machines()) == {"ideal", "prototype"}
    entries = {entry.name: entry.content for entry in settings.policies}
    assert list(entries) == ["zero", "random", "classical", "planner", "mpc", "learned", "parallel_rollout"]
    for name in ("classical", "parallel_rollout"):
        assert len(settings.tasks) == 8 and set(entries[name]) - {"kind"} == set(settings.tasks)


def test_episodes_above_the_limit_of_the_cost_score_0(tmp_path):
    tasks = {"tasks": ["SwapCrowded"], "policies": ["zero", "lanes"], "episodes": 4, "task_episodes": {}}
    free = evaluated({**SMALL, **tasks}, tmp_path / "free", SuiteSettings)
    costs = {"environment": {"costs": {"impulse": 1.0}}, "cost_limit": 0.0005}
    found = evaluated({**SMALL, **tasks, **costs}, tmp_path / "costs", SuiteSettings)
    scores = [score(found.main, ["SwapCrowded"], cost_limit=limit)["score"].tolist() for limit in (None, 1e9, 0.0005)]
    assert scores[0] == scores[1] == score(free.main, ["SwapCrowded"])["score"].tolist()
    assert scores[0][1] > scores[2][1] and scores[0][0] == scores[2][0] == 0.0
    lanes, unlimited = (rows(results)[0][1] for results in (found, free))
    costs = found.main.loc[found.main["policy"] == "lanes", "cost"]
    assert lanes["cost_median"] == costs.median() > 0.0005 and np.isnan(unlimited["cost_median"])
    assert lanes["within_limit"] == (costs <= 0.0005).mean() <= 0.5 and lanes["score"] == scores[2][1]
    for results, shown in ((found, True), (free, False)):
        assert ("within the limit" in write(results)[0].with_name("scores.md").read_text()) is shown


def test_the_command_scores_and_goes_on(tmp_path, capsys, monkeypatch):
    path = saved(tmp_path, SMALL)
    assert command.main(["score", str(path), "--quiet"]) == 0
    table, out = capsys.readouterr().out, tmp_path / "out"
    content = json.loads((out / "results.json").read_text())
    scores = {(row["task"], row["policy"]): row for row in content["results"]}
    totals = {row["policy"]: row["score"] for row in content["suite"]}
    assert totals["zero"] == 0.0 and not any(scores[task, "zero"]["score"] for task in SMALL["tasks"])
    assert 0.8 < scores["Align", "straight"]["score"] <= 1.0
    assert scores["Feed", "straight"]["score"] == 0.0 and not scores["Feed", "straight"]["served"]
    of_tasks = [scores[task, "straight"]["score"] for task in SMALL["tasks"]]
    assert totals["straight"] == pytest.approx(np.mean(of_tasks))  # of three nothing is cut off
    assert "| straight |" in table and "| – |" in table
    assert all((out / name).stat().st_size > 0 for name in ("scores.csv", "suite.csv", "scores.md", "scores.html"))
    with monkeypatch.context() as patch:
        patch.setattr(Case, "play", lambda *_: pytest.fail("played again"))
        assert command.main(["score", str(path), "--quiet"]) == 0  # all from the files of the first run
        assert capsys.readouterr().out == table
    own = tmp_path / "own.yaml"
    own.write_text("{kind: pose, training_steps: 10}")
    assert command.main(["score", str(path), "--policy", str(own), "--episodes", "1", "--quiet"]) == 0
    assert "| own |" in capsys.readouterr().out
