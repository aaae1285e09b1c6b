"""Evaluations of parts that come and go: rates instead of successes, a study of load, and no episode without an end."""

import csv
import json

import gymnasium as gym
import numpy as np
import pytest

from agents import evaluation
from agents.evaluation import report
from vibgym.tasks.episode import EVENTS

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
    directory = tmp_path_factory.mktemp("feeding") / "report"
    settings = evaluation.settings_from({**FEEDING, "output": str(directory)})
    found = evaluation.evaluate(evaluation.prepare(settings), quiet=True)
    return found, evaluation.write(found, quiet=True).parent


def test_rates_are_those_that_info_said_last(feeding):
    found, directory = feeding
    rollout = found.rollout("Feed", "ideal", "lanes")
    row = next(row for row in report.rows(found) if row["policy"] == "lanes")
    assert row["successes"] == 0 and row["good_per_minute_mean"] == rollout.fact("good_per_minute").mean() > 200.0
    assert row["rate_over_bound_mean"] == pytest.approx(np.mean(rollout.fact("good_per_minute") / 300.0))
    assert np.isnan(rollout.bound).all() and np.isnan(rollout.fact("coverage")).all()
    with (directory / "episodes.csv").open(newline="", encoding="utf-8") as file:
        written = [row for row in csv.DictReader(file) if row["policy"] == "lanes"]
    for event in EVENTS[1:]:
        name = f"{event}_per_minute"
        assert [float(each[name]) for each in written] == rollout.fact(name).tolist()
    assert all(each["coverage"] == each["position_error_m"] == each["heading_error_rad"] == "" for each in written)


def test_ways_of_parts_that_come_anew_are_ways_of_their_own(feeding):
    rollout = feeding[0].rollout("Feed", "ideal", "lanes")
    steps = np.hypot(*np.moveaxis(np.diff(rollout.poses[..., :2], axis=1), -1, 0))
    assert np.nanmax(steps) < 0.04  # nobody is carried back from the gate to the inlet
    np.testing.assert_allclose(rollout.path_lengths, np.nansum(steps, axis=1), rtol=1e-3)
    there = np.isfinite(rollout.poses[..., 0])
    assert there[:, 0].sum() < 24 and there.any(axis=1).all() and not there.all(axis=1).any()


def test_load(feeding):
    found, directory = feeding
    few, more = report.load_rows(found)
    assert (few["parts"], more["parts"], few["episodes"]) == (2, 6, 1)
    assert 0.0 < few["good"] < more["good"] and (few["bound"], few["good"] <= few["bound"]) == (50.0, True)
    content = json.loads((directory / "results.json").read_text())
    assert content["load"]["results"][0]["parts"] == 2
    text = (directory / "report.html").read_text()
    assert 'id="load"' in text and "good_per_minute" not in text
    table = evaluation.summary_table(found)
    assert "| policy | parts | good |" in table and "rate / bound" in table and "success" not in table


@pytest.mark.parametrize(("changes", "said"), [
    ({"task": "Sort"}, "evaluation.under_load.task"),
    ({"policies": ["magic"]}, "evaluation.under_load.policies"),
    ({"parts": [4, 4]}, "evaluation.under_load.parts"),
    ({"parts": [0]}, "evaluation.under_load.parts.0"),
    ({"episodes": 0}, "evaluation.under_load.episodes"),
])  # fmt: skip
def test_bad_studies_of_load(changes, said):
    with pytest.raises(ValueError, match=said):
        evaluation.settings_from({**FEEDING, "under_load": {**FEEDING["under_load"], **changes}})


def test_load_of_parts_that_stay_is_refused(tmp_path):
    settings = {**FEEDING, "tasks": ["Sort"], "policies": ["zero"], "output": str(tmp_path / "out")}
    settings["under_load"] = {"task": "Sort", "policies": ["zero"], "parts": [2]}
    with pytest.raises(ValueError, match="evaluation.under_load.task"):
        evaluation.prepare(evaluation.settings_from(settings))


def test_an_episode_without_an_end_is_refused(tmp_path):
    entry = "vibgym.envs:VibgymVectorEnv"
    gym.register(
        "endless/Feed-v0", entry_point="vibgym.envs:VibgymEnv", vector_entry_point=entry, kwargs={"task": "Feed"}
    )
    try:
        settings = {"tasks": ["endless/Feed-v0"], "policies": ["zero"], "output": str(tmp_path / "out")}
        with pytest.raises(ValueError, match="'endless/Feed-v0'"):
            evaluation.prepare(evaluation.settings_from(settings))
    finally:
        del gym.registry["endless/Feed-v0"]
