"""Tiny trainings, and what they have written."""

import numpy as np
import yaml

from agents import checkpoint
from agents.train import train

PPO = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net": [8], "critic_net": [8]}
SETTINGS = {
    "task": "Align", "environment": {"action": "field"}, "worlds": 8, "steps": 256, "seed": 3, "checkpoint_steps": 128,
    "ppo": PPO,
}  # fmt: skip
SB3 = {"policy_kwargs": {"net_arch": [8]}, "learning_starts": 64, "buffer_size": 500, "batch_size": 16}
POSE = {"kind": "pose", "action": "wrench"}
DATA = "vibgym/align/pose-v0"


def written(folder, **changes):
    """Write a training file."""
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump({**SETTINGS, **changes}))
    return path


def trained(folder, name="run", **changes):
    """Train into ``folder / name``; return the path of the policy."""
    return train(written(folder, **changes), folder / name, quiet=True)


def flat(tree, name=""):
    """Return the values of nested mappings and lists by name."""
    if not isinstance(tree, dict | list):
        return {name: np.asarray(tree)}
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {key: value for part, branch in pairs for key, value in flat(branch, f"{name}.{part}").items()}


def same(one, two):
    """Return whether the checkpoints of two runs are equal bit for bit."""
    first, second = (flat(checkpoint.load(run)) for run in (one, two))
    return first.keys() == second.keys() and all(
        np.array_equal(first[name], second[name], equal_nan=first[name].dtype.kind == "f") for name in first
    )
