"""A task of one's own, registered from outside, is evaluated and compared as those that are shipped."""

import csv
import json
import math

import gymnasium as gym
import numpy as np
import pytest

from agents import evaluation
from agents.evaluation import compare as comparison
from agents.evaluation import report
from agents.evaluation.settings import ComparisonSettings
from vibgym.tasks import TASKS, PoseTask

ENTRY = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}


class Park(PoseTask):
    """Bring the part to the left end, whatever its heading."""

    position_tolerance = 0.010
    FACTS = ("is_success", "position_error", "fallen", "diverged")
    draws = 2

    def draw(self, uniform):
        """Starts anywhere without turning, goals at the left."""
        start = np.column_stack([self.somewhere(uniform), np.zeros(len(uniform))])
        return start, np.tile([0.06, 0.5 * self.surface.depth, 0.0], (len(uniform), 1))


@pytest.fixture
def park(monkeypatch):
    """``mine/Park-v0`` and ``Park-v0``, for one test."""
    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Park": Park})
    for name in ("mine/Park-v0", "Park-v0"):
        spec = gym.envs.registration.EnvSpec(name, max_episode_steps=250, kwargs={"task": "Park"}, **ENTRY)
        monkeypatch.setitem(gym.registry, name, spec)


def asked(folder, **changes):
    common = {"policies": ["zero", "local_field"], "episodes": 3, "resamples": 100, "output": str(folder)}
    return {"tasks": ["mine/Park-v0", "Align"], **common, **changes}


def test_evaluated_with_effects_and_pages(park, tmp_path):
    effects = {
        "task": "mine/Park-v0",
        "policies": ["local_field"],
        "cases": {"none": {}, "late": {"actuators": "prototype"}},
    }
    settings = evaluation.settings_from(asked(tmp_path, effects=effects, animations=False))
    prepared = evaluation.prepare(settings)
    found = evaluation.evaluate(prepared, quiet=True)
    text = evaluation.write(found, quiet=True).read_text(encoding="utf-8")
    assert '<h2 id="mine/Park-v0">mine/Park-v0</h2>' in text and "Bring the part to the left end" in text
    rows = {(row["task"], row["policy"]): row["success_rate"] for row in report.rows(found)}
    assert rows["mine/Park-v0", "local_field"] == 1.0 > rows["mine/Park-v0", "zero"]
    assert [cell["successes"] for cell in report.effects_rows(found)] == [3, 3]
    with (tmp_path / "episodes.csv").open(newline="") as file:
        assert {row["task"] for row in csv.DictReader(file)} == {"mine/Park-v0", "Align"}
    assert json.loads((tmp_path / "results.json").read_text())["tasks"]["mine/Park-v0"]["name"] == "Park"


def test_compared(park, tmp_path):
    matrix = {
        "name": "elsewhere",
        "task": "Park-v0",
        "policies": ["local_field"],
        "cases": {"none": {}, "there": {"task": "Align"}},
    }
    settings = ComparisonSettings.checked(asked(tmp_path, tasks=["Park-v0"], generalisation=[matrix]))
    found = evaluation.evaluate(comparison.prepare(settings), quiet=True)
    comparison.write(found)
    rows = comparison.rows(found)
    assert [(row["policy"], row["success_rate"]) for row in rows] == [("zero", 0.0), ("local_field", 1.0)]
    assert [cell["success_rate"] for cell in comparison.matrices(found)[0]["results"]] == [1.0, 1.0]
    assert not math.isnan(rows[1]["time_iqm_s"])


def test_what_is_not_registered_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"evaluation.tasks.0"):
        evaluation.settings_from(asked(tmp_path))
    with pytest.raises(ValueError, match=r"evaluation.tasks.0"):
        evaluation.settings_from(asked(tmp_path, tasks=["CartPole-v1"]))
