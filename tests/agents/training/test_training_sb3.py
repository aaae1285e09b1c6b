"""Algorithms of Stable-Baselines3: user-registered observations, what continues, damaged checkpoints, evaluation."""

import os
import shutil

import numpy as np
import pytest
import stable_baselines3
import torch
import yaml
from gymnasium import spaces

from agents import __main__ as command
from agents.sb3 import SB3
from agents.training_file import load_settings
from tests.agents.training import helpers
from tests.agents.training.helpers import trained, written
from tests.commands import files_in, refusal, rows_of
from tests.policies.helpers import info_of
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs.observations import OBSERVATIONS, StateObservation
from vibgym.policies.foreign import ModelPolicy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import POLICIES

SAC = {"algorithm": "sb3.SAC", "sb3": helpers.SB3}
PPO = {"algorithm": "sb3.PPO", "sb3": {"n_steps": 16, "batch_size": 32, "policy_kwargs": {"net_arch": [8]}}}


class Halved(StateObservation):
    """The state, halved: another box than the built-in ones."""

    @property
    def space(self):
        return spaces.Box(-0.5, 0.5, (self.layout.size,), np.float32)

    def observe(self, measurement, relations, episode):
        return (0.5 * super().observe(measurement, relations, episode)).astype(np.float32)

    def writers(self, measurement, relations, episode):
        (write,) = super().writers(measurement, relations, episode)

        def halved(worlds, array):
            write(worlds, array)
            array[worlds] *= 0.5

        return [halved]


def test_a_user_registered_observation_is_trained_and_evaluated(tmp_path, monkeypatch):
    monkeypatch.setitem(OBSERVATIONS._items, "halved", Halved)
    environment = {"action": "field", "observation": "halved"}
    path = trained(tmp_path, **PPO, environment=environment, selection={"episodes": 3, "every": 128})
    assert path == tmp_path / "run" / "policy.zip" and not path.with_suffix(".json").exists()
    assert rows_of(tmp_path / "run" / "curve.csv")[-1]["steps"] == "256"
    model = stable_baselines3.PPO.load(path, device="cpu")
    assert model.observation_space.high.max() == np.float32(0.5)
    episodes = rollout(model, "vibgym/Align-v0", seeds=range(3), max_episode_steps=5, **environment)
    assert (episodes.steps <= 5).all()
    with pytest.raises(ValueError, match="policy"):  # another shape
        rollout(model, "vibgym/Sort-v0", seeds=[0], action="field")


@pytest.fixture(scope="module")
def sac(tmp_path_factory):
    """Directory of a run of SAC."""
    return trained(tmp_path_factory.mktemp("sac"), **SAC).parent


def test_files_of_stable_baselines3_are_loaded_by_its_own_load(sac, tmp_path, monkeypatch):
    """As docs/learning.md describes."""
    path = sac / "policy.zip"
    for policy in (path, str(path), {"kind": "trained", "path": str(path)}):
        with pytest.raises(ValueError, match="Stable-Baselines3") as error:
            make_policy(policy, info_of("Align"))
        assert str(path) in str(error.value) and "\n" not in str(error.value)

    def load(info):
        return ModelPolicy(stable_baselines3.SAC.load(path, device="cpu"), info, action="field")

    monkeypatch.setitem(POLICIES._items, "mine", load)
    config = tmp_path / "evaluate.yaml"
    config.write_text(yaml.safe_dump({"tasks": ["Align"], "policies": ["mine"], "episodes": 2, "animations": False}))
    assert command.main(["evaluate", str(config), "--output", str(tmp_path / "report"), "--quiet"]) == 0


def test_a_run_continues_with_everything_that_was_saved(sac, tmp_path):
    learner = SB3(load_settings(written(tmp_path, **SAC)))
    assert learner.load(sac) and learner.steps == 256
    model, saved = learner.model, stable_baselines3.SAC.load(sac / "checkpoint.zip", device="cpu")
    weights = saved.policy.state_dict()
    assert all(torch.equal(values, weights[name]) for name, values in model.policy.state_dict().items())
    assert model.log_ent_coef.item() == saved.log_ent_coef.item() != 0.0 and model._n_updates == saved._n_updates > 0
    assert model.ent_coef_optimizer.param_groups[0]["params"][0] is model.log_ent_coef
    assert model.replay_buffer.size() * model.n_envs == 256
    learner.close()


@pytest.mark.parametrize("name", ["checkpoint.zip", "replay.pkl"])
def test_damaged_checkpoints_are_refused(sac, tmp_path, capsys, name):
    run = shutil.copytree(sac, tmp_path / "run")
    os.truncate(run / name, (run / name).stat().st_size // 2)
    before = files_in(run)
    assert str(run) in refusal(capsys, command.main, "train", written(tmp_path, **SAC), "--output", run)
    assert files_in(run) == before


def test_hindsight_replay_is_selected_by_name(tmp_path):
    environment = {"action": "field", "observation": "goal"}
    own = {**helpers.SB3, "replay_buffer_class": "HerReplayBuffer"}
    own |= {"learning_starts": 2100, "buffer_size": 20_000}  # an episode of every world is complete by then
    changes = {"algorithm": "sb3.SAC", "environment": environment, "sb3": own, "checkpoint_steps": 2000}
    for steps in (2200, 4400):  # the second continues
        path = trained(tmp_path, **changes, steps=steps)
    model = stable_baselines3.SAC.load(path, env=VecEnv("vibgym/Align-v0", num_envs=8, **environment), device="cpu")
    assert model.num_timesteps >= 4400 and model.replay_buffer_class is stable_baselines3.HerReplayBuffer
    assert len(rollout(model, "vibgym/Align-v0", seeds=range(2), **environment).steps) == 2
