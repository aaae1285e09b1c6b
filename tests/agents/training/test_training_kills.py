"""A training killed by SIGKILL at random instants ends with the weights of an uninterrupted one."""

import csv
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml

from agents.train import BEST, BEST_KIND
from tests.agents.training.checkpoints import same
from vibgym.policies.trained.storage import load_set

SETTINGS = {
    "task": "Align", "environment": {"action": "wrench"}, "worlds": 8, "steps": 16_384, "checkpoint_steps": 256,
    "judging": {"episodes": 3, "every": 2000},
    "ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8], "critic_net": [8], "remembers": True},
}  # fmt: skip
KILLS = 5


def started(config, run):
    command = [sys.executable, "-m", "agents", "train", str(config), "--output", str(run), "--quiet"]
    return subprocess.Popen(command, env={**os.environ, "OMP_NUM_THREADS": "1"})


def stamps(run):
    return {path: path.stat().st_mtime_ns for path in run.glob("*.*") if path.suffix in (".json", ".pt")}


def kill_at_random(process, run):
    """Kill the process after a random number of changes of its directory, and a random time."""
    seen = stamps(run)
    for _ in range(random.randint(1, 8)):
        while process.poll() is None:
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
    assert process.wait() == -signal.SIGKILL


def results(run):
    with (run / "curve.csv").open(newline="") as file:
        curve = [{**row, "seconds": None} for row in csv.DictReader(file)]
    return load_set(run / BEST, BEST_KIND)[0], curve


@pytest.mark.full
@pytest.mark.skipif(os.name != "posix", reason="SIGKILL")
def test_a_killed_run_ends_with_the_same_weights(tmp_path):
    config = tmp_path / "run.yaml"
    config.write_text(yaml.safe_dump(SETTINGS))
    assert started(config, tmp_path / "whole").wait() == 0
    for _ in range(KILLS):
        kill_at_random(started(config, tmp_path / "killed"), tmp_path / "killed")
    assert len(list(tmp_path.glob("killed/log-from-*/progress.csv"))) > 1  # of killed sessions
    assert started(config, tmp_path / "killed").wait() == 0
    (one, curve), (two, other) = results(tmp_path / "whole"), results(tmp_path / "killed")
    assert curve == other and same(tmp_path / "whole", tmp_path / "killed")
    assert one.keys() == two.keys() and all(np.array_equal(one[name], two[name]) for name in one)
