"""Trainings that are killed again and again end as one that never was: ``python -m studies.benchmarks.kills``.

One run of PPO is trained whole. Then the same command is started anew, over and over, and killed by SIGKILL
after a random time, until it has been killed so many times as asked for; the last session runs to the end. Weights, optimizers
and worlds have to be the same, bit for bit. After every kill every file that the run has written has to load.
"""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from agents import checkpoint
from agents.train import BEST, BEST_KIND
from studies.benchmarks import common
from vibgym.policies.trained.storage import load_set

COMMON = {"judging": {"episodes": 4, "every": 20_000}, "checkpoint_steps": 4000}
RUNS = {
    "ppo": {
        "task": "Align",
        "environment": {"action": "wrench", "actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
        "worlds": 32,
        "imitation": {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 2, "steps": 30, "epochs": 2},
        "ppo": {
            "n_steps": 16,
            "batch_size": 256,
            "remembers": True,
            "turned": True,
            "target_kl": 0.02,
            "net": [64, 64],
        },
    },
}
STEPS_PER_SESSION = {"ppo": 6000}
"""About as many as a session of a second or two comes to: so many kills need so many steps."""


def digest(run: Path) -> str:
    """Of all tensors of the last checkpoint and of the best actor; both have to load."""
    found = hashlib.sha256()
    for name, kind, version in ((checkpoint.FILE, checkpoint.KIND, checkpoint.VERSION), (BEST, BEST_KIND, 1)):
        if (run / name).exists():
            tensors, _ = load_set(run / name, kind, version)
            for key in sorted(tensors):
                if (
                    key != checkpoint.STATE
                ):  # plain numbers, among them episodes' returns: compared by what follows from them
                    found.update(key.encode() + np.ascontiguousarray(tensors[key]).tobytes())
    return found.hexdigest()


def session(config: Path, run: Path) -> subprocess.Popen[bytes]:
    """The command, in a group of its own."""
    command = [sys.executable, "-m", "agents", "train", str(config), "--output", str(run), "--quiet"]
    return subprocess.Popen(command, env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True)


def until_done(process: subprocess.Popen[bytes]) -> None:
    """Wait for a session that is not killed."""
    if process.wait() != 0:
        raise SystemExit(f"the training ended with {process.returncode}")


def kills(name: str, count: int, folder: Path, generator: random.Random) -> tuple[bool, int]:
    """Whether the broken run ended as the whole one, and how many kills hit it at work."""
    config = folder / f"{name}.yaml"
    config.write_text(yaml.safe_dump({**COMMON, **RUNS[name], "steps": STEPS_PER_SESSION[name] * count}))
    whole, broken = folder / f"{name}-whole", folder / f"{name}-broken"
    began = time.perf_counter()
    until_done(session(config, whole))
    seconds = time.perf_counter() - began
    hit = 0
    for number in range(count):
        process = session(config, broken)
        # From before the first import to well into the training: a start takes about 5 s.
        time.sleep(generator.uniform(0.0, 8.0))
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            hit += 1
        elif process.returncode != 0:
            raise SystemExit(f"{name}: the training ended with {process.returncode} after {number} kills")
        digest(broken)
    until_done(session(config, broken))
    same = digest(whole) == digest(broken)
    print(f"{name}: {count} kills, {hit} at work; the whole run took {seconds:.0f} s; same weights: {same}", flush=True)
    return same, hit


def main() -> None:
    """Kill, and compare."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", nargs="+", default=list(RUNS), choices=list(RUNS))
    asked = parser.parse_args()
    generator = random.Random(asked.seed)
    with tempfile.TemporaryDirectory() as folder:
        fine = [kills(name, asked.kills, Path(folder), generator)[0] for name in asked.runs]
    raise SystemExit(0 if all(fine) else 1)


if __name__ == "__main__":
    main()
