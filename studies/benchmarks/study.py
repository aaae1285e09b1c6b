"""A study that is killed and continued is the study that never was: ``python -m studies.benchmarks.study``.

The same command tunes twice. The second time all its processes are killed by SIGKILL at instants drawn over the time that the
first one took, and the command is started again. Trials (parameters, states, values, learning curves), the best trial and
``trials.csv`` have to be the same.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import optuna

from agents.tune import NAME, RESULT, STUDY
from studies.benchmarks import common

DEFAULT = Path("configs/tuning/align.yaml")


def session(asked: argparse.Namespace, folder: Path) -> subprocess.Popen[bytes]:
    """The command, in a group of its own."""
    command = [sys.executable, "-m", "agents", "tune", str(asked.config), "--output", str(folder), "--quiet"]
    command += ["--processes", str(asked.processes)]
    if asked.trials is not None:
        command += ["--trials", str(asked.trials)]
    return subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)


def until_done(process: subprocess.Popen[bytes]) -> None:
    """Wait for a session that is not killed."""
    try:
        if process.wait() != 0:
            raise SystemExit(f"the tuning ended with {process.returncode}")
    except KeyboardInterrupt:
        killed(process)
        raise


def killed(process: subprocess.Popen[bytes]) -> bool:
    """Kill a session with all that it has started; False: it had ended."""
    if process.poll() is not None:
        return False
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:  # until the last worker is gone
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    raise SystemExit("workers of a killed tuning go on")


def found_in(folder: Path) -> dict[str, Any]:
    """All that a study has found; dates are all that is missing."""
    study = optuna.load_study(storage=f"sqlite:///{folder / STUDY}", study_name=NAME)
    names = ("number", "state", "values", "params", "distributions", "intermediate_values")
    whole = any(each.state == optuna.trial.TrialState.COMPLETE for each in study.trials)
    return {
        "trials": [{name: getattr(each, name) for name in names} for each in study.trials],
        "best trial": study.best_trial.number if whole else None,
        "trials.csv": (folder / "trials.csv").read_bytes(),
        "results": {path.parent.name: path.read_bytes() for path in sorted(folder.glob(f"trial-*/{RESULT}"))},
    }


def main() -> None:
    """Tune, tune and kill, compare."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--config", type=Path, default=DEFAULT)
    parser.add_argument("--trials", type=int, help="instead of the file's")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    parser.add_argument("--output", type=Path, help="directory that keeps both studies")
    asked = parser.parse_args()
    generator = random.Random(asked.seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.output or Path(temporary)
        whole, broken = folder / "whole", folder / "broken"
        for each in (whole, broken):
            if (each / STUDY).exists():
                raise SystemExit(f"{each}: holds a study; remove it")
        began = time.monotonic()
        until_done(session(asked, whole))
        seconds = time.monotonic() - began
        mine = found_in(whole)
        states = [each["state"].name for each in mine["trials"]]
        counted = ", ".join(f"{states.count(each)} {each.lower()}" for each in sorted(set(states)))
        print(
            f"unbroken: {seconds / 60:.1f} min, {len(states)} trials ({counted}), best {mine['best trial']}", flush=True
        )

        instants = sorted(generator.uniform(0.0, seconds) for _ in range(asked.kills))
        began, hit = time.monotonic(), 0
        for before, instant in zip([0.0, *instants], instants, strict=False):
            process = session(asked, broken)
            time.sleep(instant - before)
            hit += killed(process)
            done = len(list(broken.glob(f"trial-*/{RESULT}")))
            print(f"  killed after {(time.monotonic() - began) / 60:.1f} min: {done} trials done", flush=True)
        until_done(session(asked, broken))
        total = time.monotonic() - began
        print(
            f"killed {hit} times: {total / 60:.1f} min, of which {(total - seconds) / 60:.1f} were lost by it "
            f"(work since checkpoints, {hit} more starts)"
        )
        theirs = found_in(broken)
        differing = [name for name in mine if mine[name] != theirs[name]]
        for number, (one, other) in enumerate(zip(mine["trials"], theirs["trials"], strict=False)):
            for name in one:
                if one[name] != other[name]:
                    print(f"  trial {number}: {name} {one[name]} and {other[name]}")
        print(f"same study: {not differing}" + (f", but for {', '.join(differing)}" if differing else ""))
    raise SystemExit(0 if not differing and hit == asked.kills else 1)


if __name__ == "__main__":
    main()
