"""The planar kernel compared with that of an earlier commit: ``python -m studies.benchmarks.kernel [COMMIT]``.

Both run the same scenes in separate processes in turn: random fields under five parts for a second, default settings. Output:
time per period, ratio, and position error relative to a converged run of the earlier commit. Lower bound: the time of the
friction evaluations alone.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

from studies.accuracy.model_checks import friction_bound
from studies.benchmarks import common

START = "ace0233"  # the last commit before vectorisation over eight parts
ROUNDS = 9
TARGETS = {"aluminium block": 1.9, "60x60 mm L-shape": 2.2, "20 mm disc": 2.8}
EVALUATED = 20  # Runge-Kutta steps of the aluminium block per period

WORKER = r"""
import json, math, sys, time
import numpy as np
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

WORLDS, PERIODS, MARGIN = 64, 25, 0.1
surface, side, arm = Surface(), 0.060, 0.030
PARTS = {
    "aluminium block": shipped_part("aluminium_block"),
    "steel block": shipped_part("steel_block"),
    "60x60 mm L-shape": Part.polygon(
        [[0, 0], [side, 0], [side, arm], [arm, arm], [arm, side], [0, side]], friction=0.6
    ),
    "20 mm disc": Part.disc(0.010, friction=0.6),
    "100x20 mm bar": Part.rectangle(0.100, 0.020, friction=0.6),
}
rng = np.random.default_rng(1)
pose = np.empty((WORLDS, 1, 3))
for axis, elements in enumerate((surface.columns, surface.rows)):
    extent = elements * surface.element_size
    pose[:, 0, axis] = rng.uniform(min(MARGIN, 0.5 * extent), max(extent - MARGIN, 0.5 * extent), WORLDS)
pose[:, 0, 2] = rng.uniform(-math.pi, math.pi, WORLDS)
shape = (WORLDS, surface.rows, surface.columns)
amplitude, phase = rng.uniform(0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)

def play(part, **scheme):
    simulator = Simulator(surface, PARTS[part], worlds=WORLDS, threads=1, **scheme)
    simulator.reset(pose)
    began = time.thread_time()
    simulator.advance(amplitude, phase, PERIODS)
    return simulator, 1e6 * (time.thread_time() - began) / (WORLDS * PERIODS)

print(json.dumps(list(PARTS)), flush=True)
for line in sys.stdin:
    what, part = json.loads(line)
    if what == "time":
        answer = min(play(part)[1] for _ in range(3))
    elif what == "pose":
        answer = play(part)[0].pose[:, 0].tolist()
    else:
        answer = play(part, steps=128, substeps=2, pieces=6)[0].pose[:, 0].tolist()
    print(json.dumps(answer), flush=True)
"""


class Kernel:
    """Process that runs a version of the package.

    Attributes:
        parts: names of its scenes.
    """

    def __init__(self, folder: Path, cache: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(cache)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER], cwd=folder, env=environment, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )  # fmt: skip
        self.parts: list[str] = self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout
        return json.loads(self._process.stdout.readline())

    def ask(self, what: str, part: str) -> Any:
        """Send a request; return the answer."""
        assert self._process.stdin
        self._process.stdin.write(json.dumps([what, part]) + "\n")
        self._process.stdin.flush()
        return self._answer()


def position_errors(one: list[list[float]], other: list[list[float]]) -> tuple[float, float]:
    """Return median and 95th percentile of the distances of poses, mm."""
    away = sorted(1e3 * ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5 for a, b in zip(one, other, strict=True))
    return statistics.median(away), away[int(0.95 * len(away))]


def main() -> None:
    """Print the comparison."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("commit", nargs="?", default=START)
    commit = parser.parse_args().commit
    root = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as directory:
        there = Path(directory)
        archive = there / "commit.tar"
        subprocess.run(["git", "archive", "-o", str(archive), commit, "vibgym"], cwd=root, check=True)
        with tarfile.open(archive) as packed:
            packed.extractall(there / "then", filter="data")
        then, now = Kernel(there / "then", there / "a"), Kernel(root, there / "b")
        print(f"us per period and core at {commit} and now, median ratio of {ROUNDS} rounds; position error after 25")
        print("periods of random fields relative to a converged run, median and 95 %, mm")
        for part in then.parts:
            truth = then.ask("truth", part)
            before, after = (position_errors(each.ask("pose", part), truth) for each in (then, now))
            rounds = [(then.ask("time", part), now.ask("time", part)) for _ in range(ROUNDS)]
            cost = [min(each) for each in zip(*rounds, strict=True)]
            ratio = statistics.median(a / b for a, b in rounds)
            target = f"   (target {TARGETS[part]})" if part in TARGETS else ""
            print(
                f"  {part:18} {cost[0]:6.2f} {cost[1]:6.2f}   x {ratio:.2f}   {before[0]:.4f}, {before[1]:.4f}   "
                f"{after[0]:.4f}, {after[1]:.4f}{target}",
                flush=True,
            )
        alone = friction_bound(EVALUATED).period
        print(f"{4 * EVALUATED} friction evaluations alone, the block's, take {alone:.2f} us")


if __name__ == "__main__":
    main()
