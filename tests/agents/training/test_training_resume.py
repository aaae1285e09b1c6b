"""A training that is stopped, anywhere and as often as you like, ends with the weights of one that never was."""

import csv
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
import yaml

from agents.training import checkpoint
from agents.training.ppo import algorithm
from agents.training.progress import Progress
from agents.training.train import train
from agents.training.trees import as_was, put_together, taken_apart
from vibgym.policies.trained.storage import load_set

PPO = {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8], "critic_net": [8], "target_kl": 0.02}
BASE = {"worlds": 8, "steps": 1024, "checkpoint_steps": 256, "judging": {"episodes": 3, "every": 200}}
MACHINE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}
LESSONS = {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 2, "steps": 20, "epochs": 2}

RUNS = {
    "raw actions, ideal": {"task": "Align", "environment": {"action": "patch"}, "ppo": PPO},
    "taught, with memory, on the prototype": {
        "task": "Align", "environment": {"action": "wrench", "randomize": {"dead": [0.0, 0.1]}, **MACHINE},
        "imitation": LESSONS, "ppo": {**PPO, "remembers": True, "turned": True, "critic_steps": 300},
    },
    "several parts, as many as are drawn": {
        "task": "Sort", "environment": {"action": "wrench", "randomize": {"parts": [2, 4]}}, "steps": 640, "worlds": 4,
        "ppo": {**PPO, "remembers": True}, "checkpoint_steps": 128,
    },
    "several scenes": {
        "task": "Rotate", "environment": {"action": "field"}, "scenes": [{}, {"parts": ["steel_block"]}], "ppo": PPO,
    },
    "a correction of a law that remembers": {
        "task": "Align", "environment": {"action": "wrench", **MACHINE}, "residual": {"base": {"kind": "pose"}}, "ppo": PPO,
        "steps": 768,
    },
    "a correction of the planner": {
        "task": "Sort", "environment": {"action": "wrench"}, "residual": {"base": {"kind": "planner", "law": "pose"}},
        "ppo": PPO, "steps": 384, "worlds": 4, "checkpoint_steps": 128,
    },
    "rollouts beside updates": {
        "task": "Sort", "environment": {"action": "field"}, "steps": 640, "worlds": 4, "checkpoint_steps": 128,
        "ppo": {**PPO, "overlap": True, "critic_steps": 100},
    },
    "in bfloat16, beside": {
        "task": "Align", "environment": {"action": "patch"}, "ppo": {**PPO, "overlap": True, "precision": "bfloat16"},
    },
    "images": {
        "task": "Transport", "environment": {"action": "wrench", "observation": "image"}, "steps": 96, "worlds": 4,
        "checkpoint_steps": 32, "ppo": {**PPO, "n_steps": 4, "network": "pixels"},
    },
}  # fmt: skip


pytestmark = pytest.mark.usefixtures("one_thread")


def everything(run):
    """Policy, checkpoint and learning curve of a run; of the latter without seconds."""
    policy, record = load_set(run / "checkpoint.json", checkpoint.KIND, checkpoint.VERSION)
    best, _ = load_set(run / "best.json", checkpoint.KIND)
    with (run / "curve.csv").open(newline="") as file:
        curve = [{key: value for key, value in row.items() if key != "seconds"} for row in csv.DictReader(file)]
    return policy, best, curve, record["steps"]


def assert_same(one, two):
    for mine, theirs in zip(one[:2], two[:2], strict=True):
        assert mine.keys() == theirs.keys()
        for name in mine:
            assert np.array_equal(mine[name], theirs[name]), name
    assert one[2:] == two[2:]


def stopped_and_unbroken(settings, folder, monkeypatch, seed):
    """Directories of one run that was stopped three times, after steps that may hit anything, and of one that was not."""
    config, broken = folder / "run.yaml", folder / "broken"
    config.write_text(yaml.safe_dump(settings))
    train(config, folder / "whole", quiet=True)
    stops = sorted(random.Random(seed).sample(range(settings["worlds"], settings["steps"]), 3))

    def step(self):
        if stops and self.num_timesteps >= stops[0]:
            stops.pop(0)
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(Progress, "_on_step", step)
    while not (broken / "policy.json").exists():
        try:
            train(config, broken, quiet=True)
        except KeyboardInterrupt:
            torch.manual_seed(random.randrange(2**30))  # what another process would not know
    assert not stops
    return broken, folder / "whole"


@pytest.mark.parametrize("case", RUNS)
def test_stopped_runs_end_as_unbroken_ones(tmp_path, monkeypatch, case):
    """Stopped after steps that hit checkpoints, updates and the middle of rollouts; each algorithm in tests/contracts."""
    monkeypatch.setattr(algorithm, "has_bfloat16", lambda: True)  # others can, slowly
    assert_same(*map(everything, stopped_and_unbroken({**BASE, **RUNS[case]}, tmp_path, monkeypatch, case)))


@pytest.mark.parametrize("overlap", [False, True])
def test_a_killed_run_ends_as_an_unbroken_one(tmp_path, overlap):
    """By SIGKILL, at a random instant once it has begun; ``python -m studies.benchmarks.kills`` does so many times."""
    config = tmp_path / "run.yaml"
    config.write_text(
        yaml.safe_dump({**BASE, **RUNS["raw actions, ideal"], "steps": 8192, "ppo": {**PPO, "overlap": overlap}})
    )
    train(config, tmp_path / "whole", quiet=True)
    run = tmp_path / "broken"
    command = [sys.executable, "-m", "agents", "train", str(config), "--output", str(run), "--quiet"]
    process = subprocess.Popen(command, env={**os.environ, "OMP_NUM_THREADS": "1"})
    deadline = time.monotonic() + 120
    while not (run / "checkpoint.json").exists():
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.3 * random.random())
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    train(config, run, quiet=True)
    assert_same(everything(tmp_path / "whole"), everything(run))


def test_trees_come_back_as_they_were():
    tree = {
        "a": np.arange(3),
        "b": [np.float64(0.1), None, True, "x", {"c": np.zeros((0, 2), bool)}],
        "d": np.array(2.5),
    }
    arrays, plain = taken_apart(tree, "t")
    back = put_together(plain, arrays)
    assert set(arrays) == {"t.a", "t.b.4.c", "t.d"} and back["b"][:4] == [0.1, None, True, "x"]
    assert back["a"] is tree["a"] and back["b"][4]["c"].shape == (0, 2)
    with pytest.raises(TypeError, match="^t.x: set"):
        taken_apart({"x": {1}}, "t")
    pattern = checkpoint_like = (np.zeros(2), (1, None))
    assert as_was(pattern, [np.ones(2), [3, None]])[1] == (3, None)
    with pytest.raises(ValueError, match="list of 2"):
        as_was(checkpoint_like, [np.ones(2)])
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        as_was(pattern, [np.ones(3), [1, None]])
