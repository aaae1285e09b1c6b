"""Comparisons: files of several training seeds, learning curves, ladder, matrix. Suites: scores, and limits of costs."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from agents import __main__ as command
from agents.evaluation import ComparisonSettings, SuiteSettings, score
from agents.evaluation.rows import best_classical, differences, ladders, rows, study_rows
from agents.evaluation.run import Case
from agents.evaluation.score import rows as score_rows
from agents.evaluation.score import write
from tests.agents.evaluation.conftest import evaluated
from tests.commands import rows_of, saved
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION

SHIPPED = Path("vibgym/policies/trained/shipped")
HEAD = "steps,seconds,phase,success,time_to_goal,return_\n"
CURVE = HEAD + "0,0,imitation,0,,-20\n1000,2.5,imitation,0.5,2.0,-3\n9000,10,ppo,1,1.5,4\n"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Directory with the policies and curves of two training seeds; the second policy pushes with half the strength."""
    directory = tmp_path_factory.mktemp("runs")
    tensors, record = load_set(SHIPPED / "transport.json", KIND, VERSION)
    kept = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    for seed, strength in ((3, 1.0), (4, 0.5)):
        own = {
            name: np.float32(strength if name.startswith("mean.") else 1.0) * tensor for name, tensor in tensors.items()
        }
        save_set(directory / f"transport-{seed}.json", KIND, own, kept, VERSION)
        (directory / f"curve-{seed}.csv").write_text(CURVE)
    return directory


@pytest.fixture(scope="module")
def settings(runs):
    seeded = {"kind": "trained", "path": f"{runs}/{{task}}-{{seed}}.json", "training_seeds": [3, 4]}
    once = {"kind": "trained", "path": f"{runs}/transport-3.json", "curve": f"{runs}/curve-3.csv"}
    study = {
        "name": "elsewhere", "task": "Transport", "episodes": 3,
        "policies": [{"policy": "two <seeds>", "trained_on": "one block"}, "pose"],
        "cases": {"none": {}, "another task": {"task": "Rotate"}},
    }  # fmt: skip
    policies = [
        {"name": "two <seeds>", **seeded, "curve": f"{runs}/curve-{{seed}}.csv"}, {"name": "once", **once, "group": "hybrid"},
        "pose", "zero",
    ]  # fmt: skip
    return {
        "tasks": ["Transport"], "policies": policies, "episodes": 6, "first_seed": 50, "resamples": 200,
        "generalisation": [study],
        "ladders": [{"name": "steps", "task": "Transport", "policies": ["two <seeds>", "once"]}],
    }  # fmt: skip


@pytest.fixture(scope="module")
def results(settings, runs):
    return evaluated(settings, runs / "out", ComparisonSettings)


def test_runs_stand_together_and_apart(results):
    every = rows(results)
    known = {(row["policy"], row["training_seed"]): row for row in every}
    both, first, second, once, pose, zero = known.values()
    assert list(known) == [
        ("two <seeds>", None), ("two <seeds>", 3), ("two <seeds>", 4), ("once", None), ("pose", None), ("zero", None)
    ]  # fmt: skip
    assert (both["runs"], both["successes"]) == (2, first["successes"] + second["successes"])
    # The same file under two names does the same.
    for name in ("successes", "time_iqm_s", "over_bound_iqm"):
        assert first[name] == once[name]
    assert (zero["success_rate"], zero["time_iqm_s"]) == (0.0, 10.0)
    # The bound is one: nothing is faster, and the weaker pushes are slower.
    assert 1.0 <= min(pose["over_bound_iqm"], once["over_bound_iqm"])
    assert once["over_bound_iqm"] < second["over_bound_iqm"]
    # Learned and hybrid policies stand against the best classical one.
    assert {place: row["policy"] for place, row in best_classical(every).items()} == {("Transport", "ideal"): "pose"}
    pairs = [(pair["first"], pair["second"], pair["runs"]) for pair in differences(results, every)]
    assert pairs == [("two <seeds>", "pose", 2), ("once", "pose", 1)]
    (ladder,) = ladders(results, every)
    steps = [(step["policy"], step["action"], step["steps"]) for step in ladder["steps"]]
    assert steps == [("two <seeds>", "wrench", [9000, 9000]), ("once", "wrench", [9000])]


def test_a_cell_holds_what_was_found_or_why_nothing_was(results):
    learned, pose, refused, _ = study_rows(results, "generalisation.0", results.settings.generalisation[0])
    assert (learned["runs"], learned["episodes"], learned["refusal"]) == (2, 3, "")
    assert "rotate-3.json" in refused["refusal"] and np.isnan(refused["success_rate"])
    assert pose["success_rate"] == 1.0


def test_the_command_writes_files(results, settings, runs, capsys):
    """From the recorded episodes."""
    assert command.main(["compare", str(saved(runs, settings)), "--quiet"]) == 0
    assert "| Transport | once (hybrid) |" in capsys.readouterr().out
    folder = runs / "out"
    assert {path.name for path in folder.glob("compare.*")} == {"compare.csv", "compare.html", "compare.json"}
    assert [row["policy"] for row in rows_of(folder / "compare.csv")] == [row["policy"] for row in rows(results)]
    content = json.loads((folder / "compare.json").read_text())
    assert [curve["training_seed"] for curve in content["curves"]] == [3, 4, None]
    assert content["settings"]["policies"]["two <seeds>"]["training_seeds"] == [3, 4]
    page = (folder / "compare.html").read_text()
    assert "two &lt;seeds&gt;" in page and "<seeds>" not in page
    # It opens without a network.
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page) and page.count("data:image/png") == 2
    for text in ("best classical", "cannot act (1)", "training seed 4", "trained on one block"):
        assert text in page


# -- suites ------------------------------------------------------------------------------------------------------------

SMALL = {
    "tasks": ["Transport", "Align", "Feed"],
    "policies": ["zero", {"name": "straight", "kind": "by_task", "Transport": "pose", "Align": "pose"}],
    "episodes": 3,
    "task_episodes": {"Feed": 1},
    "first_seed": 390_000,
    "training_steps": 1000,
    "resamples": 200,
}


def test_episodes_above_the_limit_of_the_cost_score_0(tmp_path):
    tasks = {"tasks": ["SwapCrowded"], "policies": ["zero", "lanes"], "episodes": 4, "task_episodes": {}}
    free = evaluated({**SMALL, **tasks}, tmp_path / "free", SuiteSettings)
    costs = {"environment": {"costs": {"impulse": 1.0}}, "cost_limit": 0.0005}
    costly = evaluated({**SMALL, **tasks, **costs}, tmp_path / "costs", SuiteSettings)
    scores = [score(costly.main, ["SwapCrowded"], cost_limit=limit)["score"].tolist() for limit in (None, 1e9, 0.0005)]
    assert scores[0] == scores[1] == score(free.main, ["SwapCrowded"])["score"].tolist()
    assert scores[0][1] > scores[2][1] and scores[0][0] == scores[2][0] == 0.0
    lanes, unlimited = (score_rows(results)[0][1] for results in (costly, free))
    costs = costly.main.loc[costly.main["policy"] == "lanes", "cost"]
    assert lanes["cost_median"] == costs.median() > 0.0005 and np.isnan(unlimited["cost_median"])
    assert lanes["within_limit"] == (costs <= 0.0005).mean() <= 0.5 and lanes["score"] == scores[2][1]
    for results, shown in ((costly, True), (free, False)):
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
