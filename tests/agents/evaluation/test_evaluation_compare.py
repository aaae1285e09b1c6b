"""The whole way: files of several training seeds, learning curves, ladder and matrix."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from agents import __main__ as command
from agents.evaluation import ComparisonSettings, report
from agents.evaluation.rows import best_classical, differences, ladders, rows, study_rows
from tests.agents.evaluation.conftest import evaluated, rows_of
from tests.commands import saved
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


@pytest.fixture(scope="module")
def found(runs):
    seeded = {"kind": "trained", "path": f"{runs}/{{task}}-{{seed}}.json", "training_seeds": [3, 4]}
    once = {"kind": "trained", "path": f"{runs}/transport-3.json", "curve": f"{runs}/curve-3.csv"}
    study = {
        "name": "elsewhere",
        "task": "Transport",
        "episodes": 3,
        "policies": [{"policy": "two <seeds>", "trained_on": "one block"}, "pose"],
        "cases": {"none": {}, "another task": {"task": "Rotate"}},
    }
    settings = {
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
        "generalisation": [study],
        "ladders": [{"name": "steps", "task": "Transport", "policies": ["two <seeds>", "once"]}],
    }
    return evaluated(settings, runs / "out", ComparisonSettings)


def test_runs_stand_together_and_apart(found):
    every = rows(found)
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
    assert (
        1.0 <= min(pose["over_bound_iqm"], once["over_bound_iqm"]) and once["over_bound_iqm"] < second["over_bound_iqm"]
    )
    # Learned and hybrid policies stand against the best classical one.
    assert {place: row["policy"] for place, row in best_classical(every).items()} == {("Transport", "ideal"): "pose"}
    pairs = [(each["first"], each["second"], each["runs"]) for each in differences(found, every)]
    assert pairs == [("two <seeds>", "pose", 2), ("once", "pose", 1)]


def test_a_cell_holds_what_was_found_or_why_nothing_was(found):
    learned, pose, refused, _ = study_rows(found, "generalisation.0", found.settings.generalisation[0])
    assert (learned["runs"], learned["episodes"], learned["refusal"]) == (2, 3, "")
    assert "rotate-3.json" in refused["refusal"] and np.isnan(refused["success_rate"])
    assert pose["success_rate"] == 1.0


def test_a_ladder_has_action_and_budget(found):
    (ladder,) = ladders(found, rows(found))
    steps = [(step["policy"], step["action"], step["steps"]) for step in ladder["steps"]]
    assert steps == [("two <seeds>", "wrench", [9000, 9000]), ("once", "wrench", [9000])]


def test_files(found):
    folder = report.write(found, quiet=True)[0].parent
    assert [row["policy"] for row in rows_of(folder / "compare.csv")] == [row["policy"] for row in rows(found)]
    content = json.loads((folder / "compare.json").read_text())
    assert [each["training_seed"] for each in content["curves"]] == [3, 4, None]
    assert content["settings"]["policies"]["two <seeds>"]["training_seeds"] == [3, 4]
    page = (folder / "compare.html").read_text()
    assert "two &lt;seeds&gt;" in page and "<seeds>" not in page
    # It opens without a network.
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page) and page.count("data:image/png") == 2
    for text in ("best classical", "cannot act (1)", "training seed 4", "trained on one block"):
        assert text in page


def test_the_shipped_comparison_runs(tmp_path, capsys):
    config = yaml.safe_load(Path("configs/comparisons/quick.yaml").read_text())
    config["generalisation"][0]["episodes"] = 1
    path = saved(tmp_path, config, processes=1, resamples=100)
    assert command.main(["compare", str(path), "--episodes", "2", "--quiet"]) == 0
    assert "| Rotate | learned (learned) |" in capsys.readouterr().out
    names = {each.name for each in (tmp_path / "out").glob("compare.*")}
    assert names == {"compare.csv", "compare.html", "compare.json"}
