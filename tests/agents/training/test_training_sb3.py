"""Algorithms of Stable-Baselines3: user-registered observations, what continues, damaged checkpoints, evaluation."""

import csv
import math
import os

import numpy as np
import pytest
import stable_baselines3
import torch
import yaml
from gymnasium import spaces

from agents import __main__ as command
from agents.failures import TrainingError
from agents.sb3 import SB3
from agents.train import train
from agents.training_file import load_settings
from tests.commands import files_in, refusal
from tests.policies.helpers import info_of
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs.observations import OBSERVATIONS, StateObservation
from vibgym.policies.foreign import ModelPolicy
from vibgym.policies.registry import CONTROLLERS, make_policy
from vibgym.policies.rollout import rollout

OFF_POLICY = {"policy_kwargs": {"net_arch": [8]}, "learning_starts": 64, "buffer_size": 500, "batch_size": 16}
SETTINGS = {
    "task": "Align", "environment": {"action": "field"}, "algorithm": "sb3.SAC", "worlds": 8, "steps": 256,
    "checkpoint_steps": 128, "judging": {"episodes": 3, "every": 128}, "sb3": OFF_POLICY,
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("one_thread")


def written(folder, **changes):
    path = folder / "run.yaml"
    path.write_text(yaml.safe_dump({**SETTINGS, **changes}))
    return path


class Halved(StateObservation):
    """The state, halved: another box than the built-in ones."""

    scale = 0.5

    @property
    def space(self):
        return spaces.Box(-0.5, 0.5, (self.layout.size,), np.float32)

    def observe(self, measurement, relations, episode):
        return (self.scale * super().observe(measurement, relations, episode)).astype(np.float32)

    def writers(self, measurement, relations, episode):
        (write,) = super().writers(measurement, relations, episode)

        def halved(worlds, array):
            write(worlds, array)
            array[worlds] *= self.scale

        return [halved]


@pytest.mark.parametrize("algorithm", ["SAC", "PPO"])
def test_a_user_registered_observation_is_trained_and_evaluated(tmp_path, monkeypatch, algorithm):
    monkeypatch.setitem(OBSERVATIONS._items, "halved", Halved)
    own = OFF_POLICY if algorithm == "SAC" else {"n_steps": 16, "batch_size": 32, "policy_kwargs": {"net_arch": [8]}}
    environment = {"action": "field", "observation": "halved"}
    config = written(tmp_path, algorithm=f"sb3.{algorithm}", environment=environment, sb3=own)
    path = train(config, tmp_path / "run", quiet=True)
    assert path == tmp_path / "run" / "policy.zip" and not path.with_suffix(".json").exists()
    rows = list(csv.DictReader((tmp_path / "run" / "curve.csv").open()))
    assert rows[-1]["steps"] == "256"
    model = getattr(stable_baselines3, algorithm).load(path, device="cpu")
    assert model.observation_space.high.max() == np.float32(0.5)
    found = rollout(model, "vibgym/Align-v0", seeds=range(3), max_episode_steps=5, **environment)
    assert (found.steps <= 5).all()
    with pytest.raises(ValueError, match="policy"):  # another shape
        rollout(model, "vibgym/Sort-v0", seeds=[0], action="field")


def test_files_of_stable_baselines3_are_loaded_by_its_own_load(tmp_path, monkeypatch):
    """As docs/learning.md describes."""
    own = {"n_steps": 16, "batch_size": 32, "policy_kwargs": {"net_arch": [8]}}
    path = train(written(tmp_path, algorithm="sb3.PPO", sb3=own), tmp_path / "run", quiet=True)
    for given in (path, str(path), {"kind": "trained", "path": str(path)}):
        with pytest.raises(ValueError, match="Stable-Baselines3") as error:
            make_policy(given, info_of("Align"))
        assert str(path) in str(error.value) and "\n" not in str(error.value)

    def load(info):
        return ModelPolicy(stable_baselines3.PPO.load(path, device="cpu"), info, action="field")

    monkeypatch.setitem(CONTROLLERS._items, "mine", load)
    settings = {"tasks": ["Align"], "policies": ["mine"], "episodes": 2, "animations": False}
    config = tmp_path / "evaluate.yaml"
    config.write_text(yaml.safe_dump(settings))
    assert command.main(["evaluate", str(config), "--output", str(tmp_path / "report"), "--quiet"]) == 0
    model = stable_baselines3.PPO.load(path, device="cpu")
    assert len(rollout(model, "vibgym/Align-v0", seeds=range(2), action="field").steps) == 2


def test_a_run_continues_with_everything_that_was_saved(tmp_path):
    config = written(tmp_path)
    train(config, tmp_path / "run", quiet=True)
    learner = SB3(load_settings(config))
    assert learner.load(tmp_path / "run") and learner.steps == 256
    model, saved = learner.model, stable_baselines3.SAC.load(tmp_path / "run" / "checkpoint.zip", device="cpu")
    weights = saved.policy.state_dict()
    assert all(torch.equal(each, weights[name]) for name, each in model.policy.state_dict().items())
    assert model.log_ent_coef.item() == saved.log_ent_coef.item() != 0.0 and model._n_updates == saved._n_updates > 0
    assert model.ent_coef_optimizer.param_groups[0]["params"][0] is model.log_ent_coef
    assert model.replay_buffer.size() * model.n_envs == 256
    learner.close()


@pytest.mark.parametrize("name", ["checkpoint.zip", "replay.pkl"])
def test_damaged_checkpoints_are_refused(tmp_path, capsys, name):
    run, config = tmp_path / "run", written(tmp_path, judging=None)
    train(config, run, quiet=True)
    path = run / name
    os.truncate(path, path.stat().st_size // 2)
    before = files_in(run)
    assert str(run) in refusal(capsys, command.main, "train", config, "--output", run)
    assert files_in(run) == before


def test_a_diverged_algorithm_is_one_error_and_keeps_the_checkpoint(tmp_path, monkeypatch):
    run = tmp_path / "run"
    train(written(tmp_path, judging=None), run, quiet=True)
    before = (run / "checkpoint.zip").read_bytes()
    original = SB3.learn

    def poisoned(self, until, report):
        with torch.no_grad():
            next(iter(self.model.policy.actor.parameters())).fill_(math.nan)
        original(self, until, report)

    monkeypatch.setattr(SB3, "learn", poisoned)
    with pytest.raises(TrainingError, match=str(run)):
        train(written(tmp_path, judging=None, steps=512), run, quiet=True)
    assert (run / "checkpoint.zip").read_bytes() == before


def test_hindsight_replay_is_selected_by_name(tmp_path):
    environment, own = (
        {"action": "field", "observation": "goal"},
        {**OFF_POLICY, "replay_buffer_class": "HerReplayBuffer"},
    )
    own |= {"learning_starts": 2100, "buffer_size": 20_000}  # an episode of every world is complete by then
    changes = {"environment": environment, "sb3": own, "judging": None, "checkpoint_steps": 2000}
    path = train(written(tmp_path, steps=2200, **changes), tmp_path / "run", quiet=True)
    train(written(tmp_path, steps=4400, **changes), tmp_path / "run", quiet=True)  # continues
    model = stable_baselines3.SAC.load(path, env=VecEnv("vibgym/Align-v0", num_envs=8, **environment), device="cpu")
    assert model.num_timesteps >= 4400 and model.replay_buffer_class is stable_baselines3.HerReplayBuffer
    assert len(rollout(model, "vibgym/Align-v0", seeds=range(2), **environment).steps) == 2
