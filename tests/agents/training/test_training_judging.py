"""Learning curves: rows of a run, before and after an interruption."""

import csv

import numpy as np
import pytest

from agents.learning_curve import COLUMNS, RATE, LearningCurve, evaluation_environments, rank, without_hold
from agents.training_file import settings_from
from tests.envs.helpers import batch
from vibgym.policies.rollout import run
from vibgym.simulation.multibody import Multibody

SETTINGS = {
    "task": "Transport",
    "environment": {"action": "field", "max_episode_steps": 20},
    "steps": 100,
    "judging": {"episodes": 5, "first_seed": 400_070, "every": 10},
}


class Still:
    """Does nothing, and counts episodes."""

    action, observation = "field", "parts"

    def __init__(self, push=0.0):
        self.push = push

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert deterministic
        return np.full((len(observation["mask"]), 6), self.push, dtype=np.float32), state


def judge_in(folder, **changes):
    return LearningCurve(settings_from({**SETTINGS, **changes}), folder)


def rows_of(folder):
    with (folder / "curve.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_tell_what_the_policy_does(tmp_path):
    judge = judge_in(tmp_path)
    judge.begin(0)
    assert not judge.due(9) and judge.due(10)
    row = judge.measure(Still(), 10, 1.23, "imitation")
    assert tuple(row) == COLUMNS and not judge.due(19) and judge.due(20)
    judge.measure(Still(), 20, 4.56, "ppo")
    first, second = rows_of(tmp_path)
    assert (first["steps"], first["seconds"], first["phase"]) == ("10", "1.2", "imitation")
    assert (second["steps"], second["seconds"], second["phase"]) == ("20", "4.6", "ppo")
    env = batch("Transport", 5, action="field", max_episode_steps=20, observation="parts", autoreset_mode="Disabled")
    found = run(Still(), env, range(400_070, 400_075), "Transport")
    assert np.isnan(found.fact(RATE)).all() and first["rate"] == ""
    assert not found.success.any() and (found.steps == 20).all() and len(set(found.returns.round(9))) > 1
    for each in (first, second):  # the same seeds every time
        assert (each["success"], each["time_to_goal"]) == ("0.0", "")
        assert float(each["mean_time"]) == pytest.approx(20 * env.step_time)  # the limit, of episodes that fail
        assert float(each["return_"]) == pytest.approx(np.median(found.returns), abs=1e-4)


def test_a_run_that_goes_on_keeps_the_rows_up_to_its_checkpoint(tmp_path):
    judge = judge_in(tmp_path)
    judge.begin(0)
    for steps in (10, 20, 30):
        judge.measure(Still(), steps, 1.0, "ppo")
    again = judge_in(tmp_path)
    again.begin(25)  # steps after it were lost
    assert [row["steps"] for row in rows_of(tmp_path)] == ["10", "20"] and not again.due(29) and again.due(30)
    again.measure(Still(), 35, 2.0, "ppo")
    assert [row["steps"] for row in rows_of(tmp_path)] == ["10", "20", "35"]
    judge_in(tmp_path).begin(0)  # a run from its beginning has a curve of its own
    assert rows_of(tmp_path) == []


def test_episodes_are_dealt_out_to_scenes(tmp_path):
    scenes = [{"max_episode_steps": 10}, {"max_episode_steps": 15}, {"max_episode_steps": 20}]
    judge = judge_in(tmp_path, scenes=scenes)
    judge.begin(0)
    judge.measure(Still(), 10, 1.0, "ppo")
    assert [(env.num_envs, env.unwrapped.max_episode_steps, first) for env, first in judge._envs] == [
        (2, 10, 400_070), (2, 15, 400_072), (1, 20, 400_074),
    ]  # fmt: skip


def test_own_tasks_are_judged_where_episodes_end(tmp_path, monkeypatch):
    import gymnasium as gym

    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("mine/Align-v0", kwargs={"task": "Align"}, **entry)
    monkeypatch.setitem(gym.registry, "mine/Align-v0", spec)
    with pytest.raises(ValueError, match="judging"):
        judge_in(tmp_path, task="mine/Align-v0")
    assert not list(tmp_path.iterdir())
    spec.max_episode_steps = 30
    judge = judge_in(tmp_path, task="mine/Align-v0")
    assert judge.measure(Still(), 10, 1.0, "ppo")["success"] == 0.0 and judge.path.exists()


class Straight:
    """Pushes the part to the right."""

    action, observation = "wrench", "parts"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.tile(np.float32([1.0, 0.0, 0.0]), (len(observation["mask"]), 1)), state


def test_where_parts_come_and_go_the_rate_ranks(tmp_path):
    disc = [{"name": "puck", "shape": "disc", "radius": 0.02, "friction": 0.6}]
    scene = {"action": "wrench", "parts": disc, "max_episode_steps": 150, "task_settings": {"warm_up": 0.0}}
    judge = judge_in(tmp_path, task="Feed", environment=scene, judging={"episodes": 2, "every": 10})
    judge.begin(0)
    row = judge.measure(Straight(), 10, 1.0, "ppo")
    assert row["rate"] > 0.0 and row["success"] == 0.0 and row["time_to_goal"] == ""
    worse = {**row, "rate": row["rate"] - 1.0}
    assert rank(row) < rank(worse) and judge.is_best(row) and not judge.is_best(worse)


def test_rows_without_rates_rank_by_successes_and_then_by_time():
    rows = [
        {"success": "1.0", "time_to_goal": "2.0"},
        {"success": "1.0", "time_to_goal": "3.0", "rate": ""},
        {"success": "0.9", "time_to_goal": "1.0", "rate": ""},
        {"success": "0.0", "time_to_goal": ""},
    ]
    assert sorted([rows[k] for k in (2, 0, 3, 1)], key=rank) == rows


def test_training_with_fast_contacts_is_evaluated_with_certified_ones(tmp_path):
    """In the environment and in scenes; other settings of the model stay."""
    fast = {"kind": "planar", "contacts": "fast", "steps": 6}
    settings = settings_from(
        {
            "task": "Pack",
            "environment": {"action": "field", "model": fast, "max_episode_steps": 3},
            "steps": 100,
            "scenes": [{}, {"slots": 12, "model": {"kind": "planar", "contacts": "fast"}}],
            "judging": {"episodes": 2, "every": 10},
        }
    )
    models = [each["model"] for each in evaluation_environments(settings)]
    assert models == [{"kind": "planar", "steps": 6}, {"kind": "planar"}]
    assert [each["model"]["contacts"] for each in without_hold(settings)] == ["fast", "fast"]
    judge = LearningCurve(settings, tmp_path)
    judge.begin(0)
    judge.measure(StillParts(), 10, 1.0, "ppo")
    assert [type(env.unwrapped.core.simulator._model) for env, _ in judge._envs] == [Multibody, Multibody]


class StillParts(Still):
    """Does nothing with several parts."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        worlds, parts = observation["mask"].shape
        return np.zeros((worlds, 6 * parts), dtype=np.float32), state
