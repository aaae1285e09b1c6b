"""A short training through the command line, and the policy that it writes."""

import gymnasium as gym
import numpy as np
import pytest
import yaml

from agents.__main__ import main
from vibgym.envs import ACTIONS, Action, Wrench
from vibgym.policies import rollout

pytest.importorskip("torch")


def test_ppo_trains_and_its_policy_acts(tmp_path, capsys):
    settings = {
        "task": "Align", "environment": {"action": "wrench"}, "worlds": 4, "steps": 320,
        "selection": {"episodes": 3, "every": 320}, "ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8]},
    }  # fmt: skip
    config, run = tmp_path / "ppo.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(settings))
    assert main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    env = gym.make("vibgym/Align-v0", action="wrench")
    found = rollout(str(run / "policy.json"), "vibgym/Align-v0", seeds=range(4), action="wrench")
    assert env.action_space.shape == (3,) and len(found.success) == 4


class Halved(Action):
    """A custom action with values per part: half the acceleration of ``"wrench"``, and no angular one."""

    by_part = True

    def __init__(self, surface, parts):
        super().__init__(surface, parts)
        self.shape = (len(parts), 2)
        self._wrench = Wrench(surface, parts)

    def resolve_limits(self, sheet, worlds):
        return self._wrench.resolve_limits(sheet, worlds)

    def command(self, values, measurement):
        wrench = np.zeros((len(values), len(self.parts), 3), dtype=np.float32)
        wrench[..., :2] = 0.5 * values.reshape(len(values), -1, 2)
        return self._wrench.command(wrench.reshape(len(values), -1), measurement)


@pytest.fixture
def halved(monkeypatch):
    monkeypatch.setitem(ACTIONS._items, "halved", Halved)  # a name cannot be registered twice
    return "halved"


def test_ppo_trains_with_a_custom_action(halved, tmp_path):
    settings = {
        "task": "Sort", "environment": {"action": halved}, "worlds": 4, "steps": 64,
        "ppo": {"n_steps": 8, "batch_size": 64, "n_epochs": 1, "net": [8]},
    }  # fmt: skip
    config, run = tmp_path / "ppo.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(settings))
    assert main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    found = rollout(str(run / "policy.json"), "vibgym/Sort-v0", seeds=range(2), action=halved, max_episode_steps=20)
    assert len(found.success) == 2
    settings["ppo"]["turned"] = True  # how it rotates is not known
    config.write_text(yaml.safe_dump(settings))
    assert main(["train", str(config), "--output", str(tmp_path / "other"), "--quiet"]) == 2
