"""A short training of a custom action through the command line, and the policy that it writes."""

import numpy as np
import pytest
import yaml

from agents.__main__ import main
from vibgym.envs import ACTIONS, Action, Wrench
from vibgym.policies import rollout

pytest.importorskip("torch")

SETTINGS = {
    "task": "Sort", "environment": {"action": "halved"}, "worlds": 4, "steps": 64,
    "selection": {"episodes": 2, "every": 64}, "ppo": {"n_steps": 8, "batch_size": 64, "n_epochs": 2, "net": [8]},
}  # fmt: skip


class Halved(Action):
    """An action with values per part: half the acceleration of ``"wrench"``, and no angular one."""

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


def test_ppo_trains_with_a_custom_action(tmp_path, monkeypatch):
    monkeypatch.setitem(ACTIONS._items, "halved", Halved)  # a name cannot be registered twice
    config, run = tmp_path / "ppo.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(SETTINGS))
    assert main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    policy, scene = str(run / "policy.json"), {"action": "halved", "max_episode_steps": 20}
    assert len(rollout(policy, "vibgym/Sort-v0", seeds=range(2), **scene).success) == 2
    # Networks in the frame of a part require an action of which it is known how it rotates.
    config.write_text(yaml.safe_dump({**SETTINGS, "ppo": {**SETTINGS["ppo"], "turned": True}}))
    assert main(["train", str(config), "--output", str(tmp_path / "other"), "--quiet"]) == 2
