"""The whole way: files of several training seeds, learning curves, ladder and matrix; and one line for bad input."""

import csv
import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from agents import __main__ as command
from agents.evaluation import compare as comparison
from agents.evaluation.run import evaluate
from agents.evaluation.settings import ComparisonSettings
from agents.learning_curve import read_curve
from tests.commands import refusal
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
        own = {name: np.float32(strength if name.startswith("mean.") else 1.0) * each for name, each in tensors.items()}
        save_set(directory / f"transport-{seed}.json", KIND, own, kept, VERSION)
        (directory / f"curve-{seed}.csv").write_text(CURVE)
    return directory


def settings(runs, **changes):
    seeded = {"kind": "trained", "path": f"{runs}/{{task}}-{{seed}}.json", "training_seeds": [3, 4]}
    once = {"kind": "trained", "path": f"{runs}/transport-3.json", "curve": f"{runs}/curve-3.csv"}
    return {
        "tasks": ["Transport"],
        "policies": [
            {"name": "two <seeds>", **seeded, "curve": f"{runs}/curve-{{seed}}.csv"},
            {"name": "once", **once, "group": "hybrid"},
            "pose",
            "zero",
        ],
        "episodes": 6,
        "first_seed": 50,
        "resamples": 200,
        "generalisation": [
            {
                "name": "elsewhere",
                "task": "Transport",
                "episodes": 3,
                "policies": [{"policy": "two <seeds>", "trained_on": "one block"}, "pose"],
                "cases": {"none": {}, "another task": {"task": "Rotate"}},
            }
        ],
        "ladders": [{"name": "steps", "task": "Transport", "policies": ["two <seeds>", "once"]}],
        **changes,
    }


@pytest.fixture(scope="module")
def found(runs):
    prepared = comparison.prepare(ComparisonSettings.checked(settings(runs), output=str(runs / "out")))
    return evaluate(prepared, quiet=True)


@pytest.fixture(scope="module")
def files(found):
    return comparison.write(found).parent


def test_runs_stand_together_and_apart(found):
    rows = {(row["policy"], row["training_seed"]): SimpleNamespace(**row) for row in comparison.rows(found)}
    assert list(rows) == [
        ("two <seeds>", None), ("two <seeds>", 3), ("two <seeds>", 4), ("once", None), ("pose", None), ("zero", None)
    ]  # fmt: skip
    both = rows["two <seeds>", None]
    assert (both.runs, both.successes) == (2, sum(rows["two <seeds>", seed].successes for seed in (3, 4)))
    # The same file under two names does the same.
    same, once = rows["two <seeds>", 3], rows["once", None]
    assert (same.successes, same.time_iqm_s, same.over_bound_iqm) == (
        once.successes,
        once.time_iqm_s,
        once.over_bound_iqm,
    )
    assert rows["zero", None].success_rate == 0.0 and rows["zero", None].time_iqm_s == 10.0
    # The bound is one: nothing is faster, and the weaker pushes are slower.
    assert 1.0 <= min(rows["pose", None].over_bound_iqm, once.over_bound_iqm)
    assert once.over_bound_iqm < rows["two <seeds>", 4].over_bound_iqm


def test_learned_and_hybrid_policies_stand_against_the_best_classical_one(found):
    rows = comparison.rows(found)
    assert comparison.best_classical(rows) == {("Transport", "ideal"): "pose"}
    assert [(each["first"], each["second"], each["runs"]) for each in comparison.differences(found, rows)] == [
        ("two <seeds>", "pose", 2),
        ("once", "pose", 1),
    ]


def test_a_cell_says_what_was_found_or_why_nothing_was(found):
    (matrix,) = comparison.matrices(found)
    learned, refused, _, pose = matrix["results"]
    assert (learned["runs"], learned["episodes"], learned["refusal"]) == (2, 3, "")
    assert "rotate-3.json" in refused["refusal"] and np.isnan(refused["success_rate"])
    assert pose["success_rate"] == 1.0


def test_a_ladder_says_action_and_budget(found):
    (ladder,) = comparison.ladders(found, comparison.rows(found))
    assert [(step["policy"], step["action"], step["steps"]) for step in ladder["steps"]] == [
        ("two <seeds>", "wrench", [9000, 9000]),
        ("once", "wrench", [9000]),
    ]


def test_files(files, found):
    with (files / "compare.csv").open() as file:
        assert [row["policy"] for row in csv.DictReader(file)] == [row["policy"] for row in comparison.rows(found)]
    content = json.loads((files / "compare.json").read_text())
    assert [each["training_seed"] for each in content["curves"]] == [3, 4, None]
    assert content["settings"]["policies"]["two <seeds>"]["training_seeds"] == [3, 4]
    assert {row["action"] for row in content["ladders"][0]["steps"]} == {"wrench"}
    page = (files / "compare.html").read_text()
    assert "two &lt;seeds&gt;" in page and "<seeds>" not in page
    # It opens without a network.
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page) and page.count("data:image/png") == 2
    for said in ("best classical", "cannot act (1)", "training seed 4", "trained on one block"):
        assert said in page


def test_the_shipped_comparison_runs(tmp_path, capsys):
    config = yaml.safe_load(Path("configs/comparisons/quick.yaml").read_text())
    config["processes"] = 1
    config["resamples"] = 100
    config["generalisation"][0]["episodes"] = 1
    path = tmp_path / "quick.yaml"
    path.write_text(yaml.safe_dump(config))
    asked = ["compare", str(path), "--episodes", "2", "--output", str(tmp_path / "out"), "--quiet"]
    assert command.main(asked) == 0
    printed = capsys.readouterr().out
    assert "| Rotate | learned (learned) |" in printed and "compare.html" in printed
    assert sorted(each.name for each in (tmp_path / "out").glob("compare.*")) == [
        "compare.csv",
        "compare.html",
        "compare.json",
    ]


POLICY = {"kind": "trained", "path": "runs/{seed}.json", "training_seeds": [1, 2]}
MATRIX = {"name": "m", "task": "Rotate", "policies": ["zero"], "cases": {"none": {}}}
LADDER = {"name": "l", "task": "Rotate", "policies": ["zero", "pose"]}

BAD = {
    "group": ({"policies": [{"kind": "zero", "group": "best"}]}, ["policies.0.group", "best", "hybrid"]),
    "one seed": ({"policies": [{**POLICY, "training_seeds": [1]}]}, ["policies.0.training_seeds", "at least 2"]),
    "seed twice": ({"policies": [{**POLICY, "training_seeds": [1, 1]}]}, ["training_seeds"]),
    "seed of wrong type": ({"policies": [{**POLICY, "training_seeds": [1, "b"]}]}, ["training_seeds", "'b'"]),
    "seeds of a law": ({"policies": [{"kind": "zero", "training_seeds": [1, 2]}]}, ["training_seeds", "classical"]),
    "path without its seed": ({"policies": [{**POLICY, "path": "a.json"}]}, ["policies.0 (policy)", "{seed}"]),
    "path with a seed too many": (
        {"policies": [{"kind": "trained", "path": "{seed}.json"}]},
        ["policies.0 (policy)"],
    ),
    "curve without its seed": ({"policies": [{**POLICY, "curve": "a.csv"}]}, ["policies.0 (curve)", "{seed}"]),
    "no curve": (
        {"policies": [{"kind": "zero", "curve": "nowhere.csv"}]},
        ["comparison.policies (zero).curve", "nowhere.csv"],
    ),
    "policy of a matrix": ({"generalisation": [{**MATRIX, "policies": ["pid"]}]}, ["generalisation.0.policies.0", "pid"]),
    "key of a case": (
        {"generalisation": [{**MATRIX, "cases": {"a": {"action": "patch"}}}]},
        ["generalisation.0.cases.a", "action", "randomize"],
    ),
    "policy that can act nowhere": (
        {"policies": ["zero", "open_loop"],
         "generalisation": [{**MATRIX, "policies": ["open_loop"], "cases": {"a": {"task": "Sort"}}}]},
        ["generalisation.0.policies", "open_loop"],
    ),
    "title twice": ({"generalisation": [MATRIX, MATRIX]}, ["name of a study", "'m'"]),
    "ladder without curves": ({"policies": ["zero", "pose"], "ladders": [LADDER]}, ["ladders.0.policies", "curve"]),
    "ladder of one": ({"ladders": [{**LADDER, "policies": ["zero"]}]}, ["ladders[0].policies", "2"]),
    "ladder of another task": ({"ladders": [{**LADDER, "task": "Align"}]}, ["ladders.0.task", "Align", "Rotate"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_nothing_runs(name, tmp_path, capsys):
    changes, words = BAD[name]
    path, output = tmp_path / "bad.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump({"tasks": ["Rotate"], "policies": ["zero"], "episodes": 2, **changes}))
    line = refusal(capsys, command.main, "compare", path, "--output", output)
    assert line.startswith(str(path)) and all(word in line for word in words), line
    assert not output.exists()


def test_a_curve_is_read(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("phase,steps,success,seconds,return_,time_to_goal\nppo,8,0.25,1.5,-2,3.25\n")
    curve = read_curve(path, "curve")
    assert (curve.steps.tolist(), curve.seconds.tolist(), curve.phase) == ([8], [1.5], ("ppo",))
    assert (curve.success.tolist(), curve.time_to_goal.tolist(), curve.return_.tolist()) == ([0.25], [3.25], [-2.0])


BAD_CURVES = {
    "nothing": ("", "line 1"),
    "no line": (HEAD, "line 1"),
    "another column": (CURVE.replace("return_", "reward"), "return_"),
    "a value too few": (HEAD + "1,2,ppo,0.5,2\n", "line 2"),
    "no number": (HEAD + "1,2,ppo,much,2,3\n", "line 2.success"),
    "more than all": (HEAD + "1,2,ppo,50,2,3\n", "line 2.success"),
    "infinite": (HEAD + "1,inf,ppo,0.5,2,3\n", "line 2.seconds"),
    "half a step": (HEAD + "1.5,2,ppo,0.5,2,3\n", "line 2.steps"),
    "steps that fall": (HEAD + "5,2,ppo,0.5,2,3\n4,3,ppo,0.5,2,3\n", "line 3: steps"),
    "success without a time": (HEAD + "5,2,ppo,0.5,,3\n", "line 2: missing field 'time_to_goal'"),
}


@pytest.mark.parametrize("name", BAD_CURVES)
def test_a_curve_that_is_none_is_refused(name, tmp_path):
    content, said = BAD_CURVES[name]
    path = tmp_path / "curve.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=re.escape(said)) as error:
        read_curve(path, "curve")
    assert str(path) in str(error.value) and "\n" not in str(error.value)
