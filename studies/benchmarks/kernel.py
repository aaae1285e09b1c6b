"""The planar kernel against an earlier commit's: ``python -m studies.benchmarks.kernel [COMMIT]``.

Both run the same scenes in processes of their own that take turns: random fields under the aluminium block (position error
after a second, against a converged run) and the steady velocity at full amplitude. Of the settings that keep 0.05 mm in the
median and 0.1 % on every steady velocity, each kernel's cheapest is compared. Beside it stands the bound: the same number of
friction evaluations and nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

START = "fa145e4"  # the commit at which the present kernel's design began
SETTINGS = [(4, 2), (4, 3), (4, 4), (4, 5), (5, 2), (5, 3), (5, 4), (6, 2), (6, 3)]
ROUNDS = 9
TARGET_MM, TARGET_PERCENT = 0.05, 0.1

WORKER = r"""
import json, math, sys, time
import numpy as np
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

WORLDS, PERIODS = 64, 25
surface, part = Surface(), shipped_part("aluminium_block")
rng = np.random.default_rng(1)
pose = np.empty((WORLDS, 1, 3))
pose[:, 0, 0] = rng.uniform(0.1, surface.width - 0.1, WORLDS)
pose[:, 0, 1] = rng.uniform(0.1, surface.depth - 0.1, WORLDS)
pose[:, 0, 2] = rng.uniform(-math.pi, math.pi, WORLDS)
shape = (WORLDS, surface.rows, surface.columns)
amplitude, phase = rng.uniform(0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
wide = Surface(rows=60, columns=200)
STEADY = {0.3: (0.30485, 4.96), 0.6: (0.30438, 9.93), 0.9: (0.30359, 14.94)}

def play(**scheme):
    simulator = Simulator(surface, part, worlds=WORLDS, threads=1, **scheme)
    simulator.reset(pose)
    began = time.perf_counter()
    simulator.advance(amplitude, phase, PERIODS)
    return simulator, 1e6 * (time.perf_counter() - began) / (WORLDS * PERIODS)

def steady(**scheme):
    worst = 0.0
    for friction, (speed, _) in STEADY.items():
        simulator = Simulator(wide, Part.rectangle(0.05, 0.035, friction=friction), **scheme)
        simulator.reset([0.3, 0.3, 0.4])
        simulator.advance(wide.max_amplitude, 1.5 * math.pi, 250)
        worst = max(worst, abs(np.hypot(*simulator.mean_velocity[0, 0, :2]) / speed - 1.0))
    return 100.0 * worst

truth = None
for line in sys.stdin:
    what, scheme = json.loads(line)
    scheme = dict(zip(("steps", "substeps"), scheme))
    if what == "time":
        answer = min(play(**scheme)[1] for _ in range(5))
    elif what == "position":
        simulator, _ = play(**scheme)
        answer = simulator.pose[:, 0].tolist()
    elif what == "truth":
        answer = play(steps=128, substeps=2, pieces=6)[0].pose[:, 0].tolist()
    else:
        answer = steady(**scheme)
    print(json.dumps(answer), flush=True)
"""


class Kernel:
    """One version of the package in a process of its own."""

    def __init__(self, folder: Path, cache: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(cache)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER],
            cwd=folder,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def ask(self, what: str, scheme: tuple[int, int] = (1, 1)) -> Any:
        """The worker's answer."""
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps([what, scheme]) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


def position_error(one: list[list[float]], other: list[list[float]]) -> float:
    """Median distance of the poses, mm."""
    return 1e3 * statistics.median(
        ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5 for a, b in zip(one, other, strict=True)
    )


def bound(evaluations: int) -> float:
    """Microseconds that as many friction evaluations take by themselves, for one world of a bundle."""
    import time

    import numpy as np

    from vibgym._numba.jit import jit
    from vibgym.physics.planar.pressure_moments import LANES, MOMENT_ROWS
    from vibgym.physics.planar.wrench import expanded_wrench

    @jit
    def evaluate(moments, velocity, times, lanes):
        for _ in range(times):
            for j in range(lanes):
                fx, fy, torque, _, _ = expanded_wrench(
                    moments, j, 5.9, -0.4, 0.3, 0.3 - velocity[j], 0.2 - velocity[LANES + j], velocity[2 * LANES + j]
                )
                velocity[j] += 1e-9 * fx
                velocity[LANES + j] += 1e-9 * fy
                velocity[2 * LANES + j] += 1e-9 * torque

    rng = np.random.default_rng(0)
    moments, velocity, times = 0.01 * rng.standard_normal(MOMENT_ROWS * LANES), np.zeros(3 * LANES), 20_000
    evaluate(moments, velocity, 1, LANES)
    best = 1e9
    for _ in range(ROUNDS):
        began = time.perf_counter()
        evaluate(moments, velocity, times, LANES)
        best = min(best, time.perf_counter() - began)
    return 1e6 * best / (times * LANES) * evaluations


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", nargs="?", default=START)
    commit = parser.parse_args().commit
    root = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as directory:
        there = Path(directory)
        archive = there / "commit.tar"
        subprocess.run(["git", "archive", "-o", str(archive), commit, "vibgym"], cwd=root, check=True)
        with tarfile.open(archive) as packed:
            packed.extractall(there / "then", filter="data")
        kernels = {f"at {commit}": Kernel(there / "then", there / "a"), "now": Kernel(root, there / "b")}
        truth = kernels["now"].ask("truth")
        cheapest: dict[str, tuple[int, int]] = {}
        print(
            f"Position error after 25 periods of random fields (median, target {TARGET_MM} mm), worst steady speed error"
        )
        print(f"(target {TARGET_PERCENT} %), us per period and core")
        for name, kernel in kernels.items():
            cost: dict[tuple[int, int], float] = {}
            for scheme in SETTINGS:
                error, off = position_error(kernel.ask("position", scheme), truth), kernel.ask("steady", scheme)
                spent = kernel.ask("time", scheme)
                meets = error <= TARGET_MM and off <= TARGET_PERCENT
                if meets:
                    cost[scheme] = spent
                print(f"  {name:12} steps={scheme[0]} substeps={scheme[1]}   {error:7.4f} mm   {off:7.4f} %   {spent:6.2f} us"
                      f"{'   meets both' if meets else ''}")  # fmt: skip
            cheapest[name] = min(cost, key=lambda scheme: cost[scheme])
        for label, pair in (
            ("cheapest that meets both", cheapest),
            ("defaults", dict(zip(kernels, ((6, 3), (5, 4)), strict=True))),
        ):
            rounds = [[kernel.ask("time", pair[name]) for name, kernel in kernels.items()] for _ in range(ROUNDS)]
            then, now = (statistics.median(each) for each in zip(*rounds, strict=True))
            ratio = statistics.median(a / b for a, b in rounds)
            evaluations = 4 * pair["now"][0] * pair["now"][1]
            print(
                f"{label}: {then:.2f} us {pair[f'at {commit}']} against {now:.2f} us {pair['now']}: {ratio:.2f} times faster "
                f"(target 2); {evaluations} friction evaluations alone take {bound(evaluations):.2f} us"
            )


if __name__ == "__main__":
    main()
