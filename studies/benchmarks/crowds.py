"""Worlds with many parts: ``python -m studies.benchmarks.crowds [--pusht PYTHON]``.

1. Environment steps per second of the sorting environments, 256 worlds, against gym-pusht's PushT-v0 (state observations, one
   environment a core, each in a process of its own), measured in turn. gym-pusht needs an older pymunk, so it runs in an
   environment of its own, whose interpreter is ``--pusht`` (``make benchmark`` sets it up); without it this part is left out.
2. Time per part and period of worlds with six parts that never come near one another, against worlds with one part.
3. Time per part and period of one world with 32 and with 1000 parts, as far from one another at the start, walls all around:
   periods 20 to 120, in which more and more of them are in touch.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import subprocess
import time
from typing import Any

import gymnasium as gym
import numpy as np

import vibgym
from vibgym.scene.hulls import WALLS
from vibgym.scene.parts import shipped_part

WORLDS, STEPS, ROUNDS = 256, 60, 7
SCENES = (
    ("vibgym/Sort-v0", "element"),
    ("vibgym/Sort-v0", "field"),
    ("vibgym/SortCrowded-v0", "element"),
    ("vibgym/SortCrowded-v0", "field"),
)

PUSHT = r"""
import sys, time
import gymnasium as gym, gym_pusht
env = gym.make("gym_pusht/PushT-v0", obs_type="state")
env.action_space.seed(0)
actions = [env.action_space.sample() for _ in range(64)]
env.reset(seed=0)
for line in sys.stdin:
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < float(line):
        _, _, terminated, truncated, _ = env.step(actions[steps % 64])
        steps += 1
        if terminated or truncated:
            env.reset()
    print(steps / (time.perf_counter() - began), flush=True)
"""


class PushT:
    """One PushT-v0 a core, in processes that wait for their turn."""

    def __init__(self, python: str) -> None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        pipe: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._workers = [subprocess.Popen([python, "-c", PUSHT], **pipe) for _ in range(cores)]
        self.rate(0.5)

    def rate(self, seconds: float = 1.0) -> float:
        """Steps per second of all environments together."""
        for worker in self._workers:
            worker.stdin.write(f"{seconds}\n")  # type: ignore[union-attr]
            worker.stdin.flush()  # type: ignore[union-attr]
        return sum(float(worker.stdout.readline()) for worker in self._workers)  # type: ignore[union-attr]


class Sorting:
    """A vector environment under a few random actions, each held for five steps, resets included."""

    def __init__(self, name: str, action: str) -> None:
        self.name, self.action = name, action
        self._env = gym.make_vec(name, num_envs=WORLDS, action=action)
        self._env.action_space.seed(0)
        self._actions = [self._env.action_space.sample() for _ in range(8)]
        self._step = 0
        self._env.reset(seed=0)
        self.rate(5)

    def rate(self, steps: int = STEPS) -> float:
        """Environment steps per second of the whole batch."""
        began = time.perf_counter()
        for _ in range(steps):
            self._env.step(self._actions[self._step // 5 % 8])
            self._step += 1
        return steps * WORLDS / (time.perf_counter() - began)

    def contacts(self) -> float:
        """Share of the periods that were taken with contacts."""
        counts: dict[str, int] = self._env.unwrapped.core.simulator.statistics  # type: ignore[attr-defined]
        return counts["contact"] / sum(counts[name] for name in ("free", "near", "contact"))


def throughput(python: str) -> None:
    """Part 1."""
    pusht, scenes = PushT(python), [Sorting(*scene) for scene in SCENES]
    rates: list[list[float]] = [[] for _ in scenes]
    theirs: list[list[float]] = [[] for _ in scenes]
    for _ in range(ROUNDS):
        for k, scene in enumerate(scenes):
            rates[k].append(scene.rate())
            theirs[k].append(pusht.rate())
    print(f"\nSix parts, {WORLDS} worlds, against gym-pusht PushT-v0 (state, one environment a core)")
    print(f"  {'environment':34s} {'steps/s':>9s} {'PushT':>8s} {'ratio':>6s}  periods with contacts   (target >= 5)")
    for scene, ours, other in zip(scenes, rates, theirs):
        ratio = statistics.median(a / b for a, b in zip(ours, other))
        print(
            f"  {scene.name + ', ' + scene.action:34s} {statistics.median(ours):9.0f} {statistics.median(other):8.0f} "
            f"{ratio:6.1f}  {100 * scene.contacts():.0f} %"
        )


def apart() -> None:
    """Part 2."""
    surface = vibgym.Surface()
    part = shipped_part("aluminium_block")
    generator = np.random.default_rng(0)
    shape = (WORLDS, surface.rows, surface.columns)
    drives = [
        (generator.uniform(0.0, surface.lift_off_amplitude, shape), generator.uniform(-np.pi, np.pi, shape))
        for _ in range(4)
    ]
    pose = np.zeros((WORLDS, 6, 3))
    pose[:, :, 0] = np.linspace(0.07, surface.width - 0.07, 6)
    pose[:, :, 1] = 0.104
    pose += generator.uniform(-0.01, 0.01, pose.shape)
    six = vibgym.Simulator(surface, [part] * 6, worlds=WORLDS, threads=1)
    one = vibgym.Simulator(surface, part, worlds=WORLDS, threads=1)

    def per_part(simulator: vibgym.Simulator, start: np.ndarray) -> float:
        simulator.reset(start)
        began = time.perf_counter()
        for amplitude, phase in drives:
            simulator.advance(amplitude, phase)
        return (time.perf_counter() - began) / (len(drives) * WORLDS * start.shape[1])

    per_part(six, pose), per_part(one, pose[:, :1])
    pairs = [(per_part(six, pose), per_part(one, pose[:, k % 6 : k % 6 + 1])) for k in range(3 * ROUNDS)]
    ratio = statistics.median(b / a for a, b in pairs)
    together, alone = (1e6 * statistics.median(each) for each in zip(*pairs))
    print(f"\nSix parts that never come near one another, {WORLDS} worlds, one core: {six.statistics}")
    print(
        f"  {together:.2f} us per part and period, {alone:.2f} us in worlds with one part: "
        f"{ratio:.2f} of its speed (target >= 0.7)"
    )


PITCH, LARGE = 0.09, 115
"""m between the parts of a crowd at the start; elements along a side of the table that holds a thousand."""


def crowd(count: int) -> tuple[vibgym.Simulator, tuple[np.ndarray, np.ndarray]]:
    """One world with so many blocks on a square grid, on a table as full for any number, and its elements' motion."""
    side = math.ceil(math.sqrt(count))
    elements = math.ceil(LARGE * side / 32)
    surface, generator = vibgym.Surface(elements, elements), np.random.default_rng(0)
    k = np.arange(count)
    margin = 0.5 * (surface.width - (side - 1) * PITCH)
    pose = np.column_stack([margin + PITCH * (k % side), margin + PITCH * (k // side), generator.uniform(-3, 3, count)])
    simulator = vibgym.Simulator(surface, [shipped_part("aluminium_block")] * count, walls=WALLS)
    simulator.reset(pose)
    shape = (elements, elements)
    return simulator, (generator.uniform(0.0, 3e-4, shape), generator.uniform(-math.pi, math.pi, shape))


def crowds() -> None:
    """Part 3: thread time, the fewest of three rounds, in turn."""
    scenes = {count: crowd(count) for count in (32, 1000)}
    fewest, counts = dict.fromkeys(scenes, math.inf), {}
    for _ in range(3):
        for count, (simulator, drive) in scenes.items():
            simulator.reset(crowd(count)[0].pose)
            simulator.advance(*drive, 20)
            before, began = simulator.statistics["contact_steps"], time.thread_time()
            simulator.advance(*drive, 100)
            fewest[count] = min(fewest[count], (time.thread_time() - began) / (100 * count))
            counts[count] = (simulator.statistics["contact_steps"] - before) / (100 * count)
    print("\nOne world of blocks 90 mm apart, walls, elements of up to 0.3 mm, periods 20 to 120")
    for count, spent in fewest.items():
        print(
            f"  {count:4d} parts: {1e6 * spent:.2f} us a part and period, {counts[count]:.2f} calls of the solver, "
            f"deepest overlap {1e3 * scenes[count][0].deepest_overlap:.3f} mm"
        )
    print(f"  ratio {fewest[1000] / fewest[32]:.2f} (target <= 1.3)")


def main() -> None:
    """Print all parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pusht", metavar="PYTHON", help="interpreter of an environment with gym-pusht")
    arguments = parser.parse_args()
    if arguments.pusht:
        throughput(arguments.pusht)
    apart()
    crowds()


if __name__ == "__main__":
    main()
