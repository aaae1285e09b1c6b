"""Speed relative to other environments: ``python -m studies.benchmarks.peers [--rounds 9] [--python .venv-peers/bin/python]``.

Compared with Gymnasium's CartPole-v1, single and by SyncVectorEnv, EnvPool's CartPole-v1, and gym-pusht's PushT-v0 (state
observations, a process per core). In every round vibgym and the other are measured consecutively, in alternating order, so that
drift cancels. Output: median, minimum and maximum of the ratios. CartPole has the number of worlds, and EnvPool the number of
threads, with the highest speed on the host. EnvPool and gym-pusht need a separate environment (``make peers``).
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

import vibgym
from studies.benchmarks import common
from vibgym import checks
from vibgym.simulation.threads import available_threads

SECONDS = 0.4
"""Duration of a measurement."""

WORKER = Path(__file__).with_name("peers_worker.py")
PYTHON = Path(f"{sys.prefix}-peers") / "bin" / "python"
"""Interpreter of the environment made by ``make peers``."""

Rate = Callable[[], float]
"""Function that measures steps per second."""


class Peer:
    """Another environment in idle processes that run on request; see ``peers_worker.py``."""

    def __init__(self, python: Path, *arguments: str, copies: int = 1) -> None:
        pipe: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        self._name = arguments[0]
        self._workers = [subprocess.Popen([python, WORKER, *arguments], **pipe) for _ in range(copies)]
        self()

    def __call__(self) -> float:
        """Return the steps per second of all processes together."""
        for worker in self._workers:
            worker.stdin.write(f"{SECONDS}\n")  # type: ignore[union-attr]
            worker.stdin.flush()  # type: ignore[union-attr]
        rates = [worker.stdout.readline() for worker in self._workers]  # type: ignore[union-attr]
        if not all(rates):
            raise RuntimeError(f"{self._name} ended: try {' '.join(map(str, self._workers[0].args))}")  # type: ignore[arg-type]
        return sum(map(float, rates))

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.communicate()


class Batch:
    """Vector environment with random actions, each held for ``hold`` steps, resets included."""

    def __init__(self, name: str, worlds: int, hold: int = 1, **settings: Any) -> None:
        self._env = gym.make_vec(name, num_envs=worlds, **settings)
        self._env.action_space.seed(0)
        self._actions = [self._env.action_space.sample() for _ in range(8)]
        self._hold, self._taken = hold, 0
        self._env.reset(seed=0)
        self()

    def __call__(self) -> float:
        """Return the steps per second of all worlds together."""
        before, began = self._taken, time.perf_counter()
        while time.perf_counter() - began < SECONDS:
            self._env.step(self._actions[self._taken // self._hold % 8])
            self._taken += 1
        return (self._taken - before) * self._env.num_envs / (time.perf_counter() - began)

    def contacts(self) -> float:
        """Return the share of periods with contacts; for vibgym only."""
        counts: dict[str, int] = self._env.unwrapped.core.simulator.statistics  # type: ignore[attr-defined]
        return counts["contact"] / max(sum(counts[name] for name in ("free", "near", "contact")), 1)


def single(name: str, **settings: Any) -> Rate:
    """Return a function that measures an environment of ``gym.make``, resets included."""
    env = gym.make(name, **settings)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)

    def measure() -> float:
        steps, began = 0, time.perf_counter()
        while time.perf_counter() - began < SECONDS:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            steps += len(actions)
        return steps / (time.perf_counter() - began)

    measure()
    return measure


class Row(NamedTuple):
    """Compared environments, and the target of their ratio: lower bound of rates, upper bound of times per step (``cost``)."""

    ours: str
    other: str
    target: float | None = None
    cost: bool = False


ELEMENT, PATCH = "Rotate, element, 1024 worlds", "Rotate, patch, 1024 worlds"
SINGLE, CARTPOLE = "Rotate, one gym.make step", "CartPole, one gym.make step"
SYNC, POOL, PUSHT = "CartPole, SyncVectorEnv", "CartPole, EnvPool", "PushT"
CROWDS = {
    f"{task}, {action}, 256 worlds": (task, action) for task in ("Sort", "SortCrowded") for action in ("element", "field")
}  # fmt: skip
OURS: dict[str, Callable[[], Rate]] = {
    ELEMENT: lambda: Batch("vibgym/Rotate-v0", 1024, action="element"),
    PATCH: lambda: Batch("vibgym/Rotate-v0", 1024, action="patch"),
    SINGLE: lambda: single("vibgym/Rotate-v0"),
    **{name: partial(Batch, f"vibgym/{task}-v0", 256, 5, action=action) for name, (task, action) in CROWDS.items()},
}
ROWS = (
    Row(ELEMENT, SYNC, 6.0),
    Row(PATCH, SYNC, 9.0),
    *(Row(ours, POOL, 0.8) for ours in (ELEMENT, PATCH)),
    Row(SINGLE, CARTPOLE, 3.0, cost=True),
    *(Row(name, PUSHT, target) for name, target in zip(CROWDS, (None, None, 5.0, 8.0), strict=True)),
)


def fastest(made: dict[str, Rate]) -> tuple[str, Rate]:
    """Return the fastest and its name; close the others."""
    best = max(made, key=lambda name: max(made[name]() for _ in range(3)))
    for name, each in made.items():
        if name != best and isinstance(each, Peer):
            each.close()
    return best, made[best]


def others(python: Path | None) -> dict[str, Rate]:
    """Return the other environments; without ``python``, those of Gymnasium only."""
    cores = available_threads()
    sync = {f"{n} worlds": Batch("CartPole-v1", n, vectorization_mode="sync") for n in (16, 64, 256, 1024)}
    size, best = fastest(sync)
    print(f"{SYNC}: {size}", end="", flush=True)
    found: dict[str, Rate] = {SYNC: best, CARTPOLE: single("CartPole-v1")}
    if python is not None:
        found[PUSHT] = Peer(python, "pusht", copies=cores)
        shapes = [(n, threads) for n in (256, 1024, 4096) for threads in sorted({1, cores})]
        size, found[POOL] = fastest(
            {f"{n} worlds, {t} threads": Peer(python, "envpool", str(n), str(t)) for n, t in shapes}
        )
        print(f"; {POOL}: {size}; {PUSHT}: {cores} processes", end="")
    print()
    return found


def main() -> None:
    """Measure and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument(
        "--python", type=Path, default=PYTHON, help=f"interpreter with EnvPool and gym-pusht; default: {PYTHON}"
    )
    asked = parser.parse_args()
    checks.count("--rounds", asked.rounds)
    python = asked.python if asked.python.exists() else None
    print(
        f"vibgym {vibgym.__version__}, Python {platform.python_version()}, {available_threads()} of {os.cpu_count()} processors"
    )
    if python is None:
        print(f"{asked.python} is missing: {POOL} and {PUSHT} are skipped; run make peers", file=sys.stderr)
    theirs = others(python)
    rows = [row for row in ROWS if row.other in theirs]
    ours = {name: OURS[name]() for name in dict.fromkeys(row.ours for row in rows)}
    pairs: dict[Row, list[tuple[float, float]]] = {row: [] for row in rows}
    for number in range(asked.rounds):
        for row, found in pairs.items():
            turn = (ours[row.ours], theirs[row.other])
            rates = [measure() for measure in (turn[::-1] if number % 2 else turn)]
            found.append((rates[number % 2], rates[1 - number % 2]))
    print(f"medians of {asked.rounds} rounds; lowest and highest ratio in brackets")
    for row, found in pairs.items():
        measured, contacts = ours[row.ours], ""
        if isinstance(measured, Batch) and row.ours in CROWDS:
            contacts = f", contacts in {measured.contacts():.0%} of periods"
        print(line(row, found) + contacts)


def line(row: Row, found: list[tuple[float, float]]) -> str:
    """Return a row of the table."""
    ratios = [b / a if row.cost else a / b for a, b in found]
    mine, other = (statistics.median(each) for each in zip(*found, strict=True))
    what = "cost" if row.cost else "rate"
    target = "" if row.target is None else f", target {'at most' if row.cost else 'at least'} {row.target:g}"
    spread = f"{statistics.median(ratios):5.2f} x its {what} [{min(ratios):.2f}, {max(ratios):.2f}]{target}"
    return f"{row.ours:34s}{mine:9.0f} steps/s   {row.other:26s}{other:9.0f} steps/s   {spread}"


if __name__ == "__main__":
    main()
