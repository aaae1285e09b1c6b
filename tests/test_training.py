"""A short training through the command line, and the policy that it writes."""

import gymnasium as gym
import yaml

from agents.__main__ import main
from vibgym.policies import rollout


def test_ppo_trains_and_its_policy_acts(tmp_path, capsys):
    settings = {
        "task": "Align", "environment": {"action": "wrench"}, "worlds": 4, "steps": 320,
        "judging": {"episodes": 3, "every": 320}, "ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8]},
    }  # fmt: skip
    config, run = tmp_path / "ppo.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(settings))
    assert main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    env = gym.make("vibgym/Align-v0", action="wrench")
    found = rollout(str(run / "policy.json"), "vibgym/Align-v0", seeds=range(4), action="wrench")
    assert env.action_space.shape == (3,) and len(found.success) == 4
