"""Training runs: exact resume, curricula, several seeds, user-registered networks and algorithms."""

import json
import multiprocessing
import os
import random
import signal
import time

import numpy as np
import pytest

from agents import networks, tune
from agents.algorithms import ALGORITHMS
from agents.learning_curve import LearningCurve
from agents.networks import PartsActor, PartsCritic
from agents.train import BEST, BEST_KIND, Training, train, train_seeds
from agents.training_envs import Worlds
from agents.training_file import load_settings
from tests.agents.training.helpers import DATA, POSE, PPO, same, trained, written
from tests.commands import rows_of
from vibgym.policies.trained.networks import ACTING
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import CODINGS, KIND, VERSION
from vibgym.settings import BaseSettings

OWN = {**PPO, "n_epochs": 2, "target_kl": 0.02}
WRENCH = {"action": "wrench"}
LEARNED = {
    "dataset": DATA,
    "batch_size": 32,
    "net": [8],
    "turned": True,
    "history": True,
    "dropped_columns": ["position"],
}
RUNS = {
    "imitation": {
        "environment": WRENCH, "imitation": {"expert": POSE, "rounds": 2, "steps": 20, "epochs": 2},
        "ppo": {**OWN, "history": True, "turned": True},
    },
    "memory": {
        "environment": {"action": "field", "sensor": {"delay": 2, "dropout": 0.3, "kind": "ideal", "report": ["age"]}},
        "ppo": {**OWN, "turned": True, "history": 3, "history_columns": ["velocity", "age"]},
    },
    "noise": {
        "curriculum": [{"environment": {"max_episode_steps": 20}, "until": {"steps": 384}}],
        "ppo": {**OWN, "noise_correlation": 0.9, "averaging": 0.7},
    },
    "residual": {"environment": WRENCH, "residual": {"base": {"kind": "pose"}}},
    "iql": {"environment": WRENCH, "algorithm": "offline", "offline": {**LEARNED, "method": "iql", "critic_net": [8]}},
    "flow": {"environment": WRENCH, "algorithm": "flow", "flow": {**LEARNED, "network": "parts"}},
}  # fmt: skip
JUDGING = {"episodes": 3, "every": 200}
SERVER = multiprocessing.get_context("forkserver")


def curve_of(run):
    """Return the rows of a learning curve without their times."""
    return [{**row, "seconds": ""} for row in rows_of(run / "curve.csv")]


@pytest.mark.parametrize("name", RUNS)
def test_interrupted_runs_end_with_the_same_weights(tmp_path, monkeypatch, request, name):
    settings = {"ppo": OWN, "steps": 768, "checkpoint_steps": 256, "selection": JUDGING, **RUNS[name]}
    for algorithm in {"offline", "flow"} & settings.keys():
        settings[algorithm] = {**settings[algorithm], "directory": str(request.getfixturevalue("recorded"))}
    trained(tmp_path, "whole", **settings)
    between, stops = Training._between_updates, [300, 500]

    def interrupted(self, metrics):
        between(self, metrics)
        if stops and self.learner.steps >= stops[0]:
            stops.pop(0)
            raise KeyboardInterrupt

    monkeypatch.setattr(Training, "_between_updates", interrupted)
    while stops:
        with pytest.raises(KeyboardInterrupt):
            trained(tmp_path, "broken", **settings)
    trained(tmp_path, "broken", **settings)
    assert same(tmp_path / "whole", tmp_path / "broken")
    assert curve_of(tmp_path / "whole") == curve_of(tmp_path / "broken")


def started(config, run):
    """Start the training in a process; processes fork from one that has imported what they need."""
    SERVER.set_forkserver_preload(["agents.train"])
    process = SERVER.Process(target=train, args=(config, run), kwargs={"quiet": True}, daemon=True)
    process.start()
    return process


def stamps(run):
    return {path: path.stat().st_mtime_ns for path in run.glob("*.*") if path.suffix in (".json", ".pt")}


def kill_at_random(process, run):
    """Kill the process after a random number of changes of its directory, and a random time."""
    seen = stamps(run)
    for _ in range(random.randint(1, 8)):
        while process.is_alive():
            try:
                now = stamps(run)
            except FileNotFoundError:  # renamed between glob and stat
                continue
            if now != seen:
                seen = now
                break
            time.sleep(0.001)
    time.sleep(0.1 * random.random())
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL


@pytest.mark.full
@pytest.mark.skipif(os.name != "posix", reason="SIGKILL and forks")
def test_a_killed_run_ends_with_the_same_weights(tmp_path):
    """By SIGKILL at random instants, three times."""
    own, selection = {**OWN, "history": True}, {**JUDGING, "every": 2000}
    config = written(tmp_path, environment=WRENCH, steps=12_288, checkpoint_steps=256, selection=selection, ppo=own)
    train(config, tmp_path / "whole", quiet=True)
    for _ in range(3):
        kill_at_random(started(config, tmp_path / "killed"), tmp_path / "killed")
    assert len(list(tmp_path.glob("killed/log-from-*/progress.csv"))) > 1  # of killed sessions
    train(config, tmp_path / "killed", quiet=True)
    runs = [tmp_path / "whole", tmp_path / "killed"]
    one, two = (load_set(run / BEST, BEST_KIND)[0] for run in runs)
    assert curve_of(runs[0]) == curve_of(runs[1]) and same(*runs)
    assert one.keys() == two.keys() and all(np.array_equal(one[name], two[name]) for name in one)


def test_a_stage_ends_with_its_success_or_its_steps_and_changes_the_environment(tmp_path):
    stages = [
        {"environment": {"task_settings": {"hold": 3}}, "until": {"success": 0.9}},
        {"environment": {"max_episode_steps": 7}, "until": {"success": 1.0, "steps": 100}},
    ]
    own = {"action": "field", "task_settings": {"weights": {"fallen": 9.0}}}
    settings = load_settings(written(tmp_path, environment=own, curriculum=stages))
    worlds = Worlds(settings, "parts")
    assert worlds.environment(0)["task_settings"] == {"weights": {"fallen": 9.0}, "hold": 3}
    won, lost = (1.0, 5, True, 0.0), (0.0, 5, False, 0.0)
    whole = 8 * worlds.env.env.unwrapped.max_episode_steps  # steps of an episode that fails in every world
    for steps, episodes, over in (
        (whole, [won] * 80 + [lost] * 20, False), (whole, [won] * 99, False), (whole - 1, [won] * 100, False),
        (whole, [won] * 100, True),
    ):  # fmt: skip
        worlds.episodes.clear()
        worlds.episodes.extend(episodes)
        assert worlds.is_over(steps) is over
    worlds.begin(whole)
    assert worlds.stage == 1 and not worlds.episodes and worlds.env.env.unwrapped.max_episode_steps == 7
    assert not worlds.is_over(whole + 99) and worlds.is_over(whole + 100)
    worlds.begin(whole + 100)
    assert worlds.stage == 2 and worlds.environment(2) == own and not worlds.is_over(10**6)
    worlds.env.close()


def test_the_policy_is_the_best_actor_of_the_learning_curve(tmp_path, monkeypatch):
    measure, successes = LearningCurve.measure, [0.9, 0.1]

    def measured(self, *args):
        row = measure(self, *args)
        row.update(success=successes.pop(0), time_to_goal=1.0)
        return row

    monkeypatch.setattr(LearningCurve, "measure", measured)
    path = trained(tmp_path, selection={"episodes": 3, "every": 128})
    policy, record = load_set(path, KIND, VERSION)
    best, _ = load_set(path.parent / BEST, BEST_KIND)
    assert not successes and record["training"]["kept_from_step"] == 128 < record["training"]["steps"]
    assert all(np.array_equal(policy[name], best[name]) for name in best)


def test_training_several_seeds_shows_the_progress_of_each(tmp_path, capfd):
    paths = train_seeds(written(tmp_path), [3, 4], tmp_path / "out")
    assert paths == [tmp_path / "out" / f"seed-{seed}" / "policy.json" for seed in (3, 4)]
    shown = capfd.readouterr().err
    assert all(f"seed {seed}" in shown for seed in (3, 4))


TUNED = {
    "task": "Transport", "environment": WRENCH, "steps": 256, "selection": {"episodes": 4, "every": 128},
    "ppo": {**PPO, "n_steps": 8},
    "tuning": {"trials": 3, "startup": 1, "space": {"ppo.learning_rate": {"low": 1.0e-4, "high": 1.0e-2, "log": True}}},
}  # fmt: skip


def test_an_interrupted_study_continues_and_is_the_same(tmp_path):
    config = written(tmp_path, **TUNED)
    whole, best = tune.tune(config, output=tmp_path / "whole", quiet=True, processes=1)
    tune.tune(config, trials=2, output=tmp_path / "parts", quiet=True, processes=1)
    parts, again = tune.tune(config, output=tmp_path / "parts", quiet=True, processes=1)
    assert whole.read_text() == parts.read_text() and best is not None
    assert (best.number, best.params, best.value) == (again.number, again.params, again.value)
    config = written(tmp_path, **TUNED, seed=5)
    with pytest.raises(ValueError, match="settings"):
        tune.tune(config, output=tmp_path / "whole", quiet=True, processes=1)


# -- registered by users -----------------------------------------------------------------------------------------------


def test_a_user_registered_network_is_trained(tmp_path, monkeypatch):
    for names in (networks.NETWORKS, ACTING, CODINGS):
        monkeypatch.delitem(names, "mine", raising=False)

    class Mine(PartsActor):
        """A network of the user's."""

    used = []

    def acting(*arguments):
        used.append(True)
        return ACTING["parts"](*arguments)

    networks.register_network("mine", Mine, PartsCritic, acting)
    path = trained(tmp_path, ppo={**PPO, "network": "mine"}, steps=128, selection={"episodes": 2, "every": 64})
    assert json.loads(path.read_text())["network"] == "mine" and used


class Counting:
    """An algorithm without torch: it stores how many steps it made."""

    class Settings(BaseSettings):
        """Settings of the algorithm."""

        scale: float = 1.0

    observation = "state"

    def __init__(self, settings):
        assert settings.own.scale == 2.0
        self.action, self.steps = settings.action, 0

    def learn(self, until, report):
        while self.steps < until:
            report({"loss": 0.0})
            self.steps += 8
        report({})

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 6), np.float32), state

    def save(self, directory):
        (directory / "mine.txt").write_text(str(self.steps))

    def load(self, directory):
        path = directory / "mine.txt"
        self.steps = int(path.read_text()) if path.exists() else 0
        return path.exists()


def test_a_user_registered_algorithm_is_trained_and_continues(tmp_path, monkeypatch):
    monkeypatch.setitem(ALGORITHMS._items, "mine", Counting)
    settings = {"algorithm": "mine", "mine": {"scale": 2.0}, "selection": {"episodes": 3, "every": 32}}
    for steps in (64, 128):
        trained(tmp_path, **settings, steps=steps)
    assert (tmp_path / "run" / "mine.txt").read_text() == "128"
    assert [row["steps"] for row in rows_of(tmp_path / "run" / "curve.csv")] == ["32", "64", "96", "128"]
