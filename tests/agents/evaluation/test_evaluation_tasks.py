"""Tasks of other kinds: parts that come and go, goals that move, and a task that is registered from outside."""

import json

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation import ComparisonSettings, report
from agents.evaluation.rows import load_rows, rows, study_rows
from agents.evaluation.table import RATES, where
from tests.agents.evaluation.conftest import evaluated, rollouts
from tests.commands import rows_of
from vibgym.tasks import TASKS, PoseTask

FEEDING = {
    "tasks": ["Feed"],
    "policies": ["zero", "lanes"],
    "episodes": 2,
    "first_seed": 290_000,
    "resamples": 200,
    "animations": False,
    "under_load": {"task": "Feed", "policies": ["lanes"], "parts": [6, 2], "episodes": 1},
}


@pytest.fixture(scope="module")
def feeding(tmp_path_factory):
    results = evaluated(FEEDING, tmp_path_factory.mktemp("feeding"))
    path, tables = report.write(results, quiet=True)
    return results, path.parent, tables


def test_rates_replace_successes_where_parts_come_and_go(feeding):
    results, directory, _ = feeding
    run, episodes = rollouts(results)["Feed", "ideal", "lanes"], where(results.main, policy="lanes")
    row = next(row for row in rows(results) if row["policy"] == "lanes")
    assert row["successes"] == 0 and row["good_per_minute_mean"] == run.reported("good_per_minute").mean() > 200.0
    assert row["rate_over_bound_mean"] == pytest.approx(np.mean(run.reported("good_per_minute") / 300.0))
    assert episodes["score"].tolist() == episodes["rate_over_bound"].tolist()
    assert np.isnan(run.bound).all() and np.isnan(run.reported("coverage")).all()
    written = [row for row in rows_of(directory / "episodes.csv") if row["policy"] == "lanes"]
    for name in RATES:
        assert [float(row[name]) for row in written] == run.reported(name).tolist()
    assert all(row["coverage"] == row["position_error_m"] == row["heading_error_rad"] == "" for row in written)
    # A part that comes anew begins a path of its own: none is carried back from the gate to the inlet.
    steps = np.hypot(*np.moveaxis(np.diff(run.poses[..., :2], axis=1), -1, 0))
    assert np.nanmax(steps) < 0.04
    np.testing.assert_allclose(run.path_lengths, np.nansum(steps, axis=1), rtol=1e-3)
    there = np.isfinite(run.poses[..., 0])
    assert there[:, 0].sum() < 24 and there.any(axis=1).all() and not there.all(axis=1).any()


def test_load(feeding):
    results, directory, tables = feeding
    few, more = load_rows(results)
    assert (few["parts"], more["parts"], few["episodes"]) == (2, 6, 1)
    assert 0.0 < few["good"] < more["good"] and few["good"] <= few["bound"] == 50.0
    assert json.loads((directory / "results.json").read_text())["load"]["results"][0]["parts"] == 2
    text = (directory / "report.html").read_text()
    assert 'id="load"' in text and "good_per_minute" not in text
    lines = tables
    assert "| policy | parts | good |" in lines and "rate / bound" in lines and "success" not in lines


class Park(PoseTask):
    """Bring the part to the left end, whatever its heading."""

    position_tolerance = 0.010
    draws = 2

    def draw(self, uniform):
        """Starts anywhere without turning, goals at the left."""
        start = np.column_stack([self.somewhere(uniform), np.zeros(len(uniform))])
        return start, np.tile([0.06, 0.5 * self.surface.depth, 0.0], (len(uniform), 1))


def test_user_defined_tasks_are_evaluated_and_compared(tmp_path, monkeypatch):
    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Park": Park})
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    name, late = "mine/Park-v0", {"actuators": "prototype"}
    spec = gym.envs.registration.EnvSpec(name, max_episode_steps=250, kwargs={"task": "Park"}, **entry)
    monkeypatch.setitem(gym.registry, name, spec)
    study = {"task": name, "policies": ["local_field"], "cases": {"none": {}, "late": late, "there": {"task": "Align"}}}
    settings = {"tasks": [name, "Align"], "policies": ["zero", "local_field"], "episodes": 3, "resamples": 100}
    results = evaluated({**settings, "effects": study, "animations": False}, tmp_path)
    text = report.write(results, quiet=True)[0].read_text(encoding="utf-8")
    assert f'<h2 id="{name}">{name}</h2>' in text and "Bring the part to the left end" in text
    rates = {(row["task"], row["policy"]): row["success_rate"] for row in rows(results)}
    assert rates[name, "local_field"] == 1.0 > rates[name, "zero"]
    assert [cell["successes"] for cell in study_rows(results, "effects", results.settings.effects)] == [3, 3, 3]
    assert {row["task"] for row in rows_of(tmp_path / "episodes.csv")} == {name, "Align"}
    assert json.loads((tmp_path / "results.json").read_text())["tasks"][name]["name"] == "Park"
    compared = evaluated({**settings, "generalisation": [study]}, tmp_path, ComparisonSettings)
    assert "local_field" in report.write(compared, quiet=True)[0].read_text(encoding="utf-8")
    assert compared.main["success"].tolist() == results.main["success"].tolist()
