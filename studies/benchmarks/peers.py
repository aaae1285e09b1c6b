"""Speed relative to other environments: ``python -m studies.benchmarks.peers [--rounds 9] [--python .venv-peers/bin/python]``.

Compared with Gymnasium's CartPole-v1, single and by SyncVectorEnv, EnvPool's CartPole-v1, and gym-pusht's PushT-v0 (state
observations, a process per core). In every round vibgym and the other are measured consecutively, in alternating order, so that
drift cancels. Output: median, minimum and maximum of the ratios. CartPole has the number of worlds, and EnvPool the number of
threads, with the highest speed on the host. EnvPool and gym-pusht need a separate environment (``make peers``).
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import vibgym
from studies import common
from studies.kept import show
from studies.worker import Worker
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
    """An environment of another package in idle processes that run on request, see ``peers_worker.py``."""

    def __init__(self, python: Path, *arguments: object, copies: int = 1) -> None:
        self._workers = [Worker(python, WORKER, *arguments) for _ in range(copies)]
        self()

    def __call__(self) -> float:
        """Return the steps per second of all processes together."""
        for worker in self._workers:
            worker.send("rate", SECONDS)
        return sum(worker.receive() for worker in self._workers)

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()


def rate(advance: Callable[[], int]) -> Rate:
    """Return a function that measures steps per second; ``advance`` returns the steps that it has taken."""

    def measure() -> float:
        steps, began = 0, time.perf_counter()
        while time.perf_counter() - began < SECONDS:
            steps += advance()
        return steps / (time.perf_counter() - began)

    measure()  # compiles kernels
    return measure


class Batch:
    """Vector environment with random actions, each held for ``hold`` steps, resets included; a call measures its rate."""

    def __init__(self, name: str, worlds: int, hold: int = 1, **settings: Any) -> None:
        self._env = gym.make_vec(name, num_envs=worlds, **settings)
        self._env.action_space.seed(0)
        self._actions = [self._env.action_space.sample() for _ in range(8)]
        self._hold, self._taken = hold, 0
        self._env.reset(seed=0)
        self._measure = rate(self._advance)

    def __call__(self) -> float:
        """Return the steps per second of all worlds together."""
        return self._measure()

    def _advance(self) -> int:
        self._env.step(self._actions[self._taken // self._hold % 8])
        self._taken += 1
        return self._env.num_envs

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

    def advance() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return len(actions)

    return rate(advance)


def in_pairs(pairs: Sequence[tuple[Rate, Rate]], rounds: int) -> np.ndarray:
    """Return rates (pairs, rounds, 2), measured consecutively, with the second of a pair first in every other round."""
    rates = np.empty((len(pairs), rounds, 2))
    for number in range(rounds):
        for k, pair in enumerate(pairs):
            for which in (1, 0) if number % 2 else (0, 1):
                rates[k, number, which] = pair[which]()
    return rates


def spread(ratios: np.ndarray, digits: int = 2) -> str:
    """Format the median, and minimum and maximum in brackets."""
    return f"{np.median(ratios):.{digits}f} [{ratios.min():.{digits}f}, {ratios.max():.{digits}f}]"


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


def fastest(title: str, made: dict[str, Rate]) -> Rate:
    """Return the fastest and print its name; close the others."""
    best = max(made, key=lambda name: max(made[name]() for _ in range(3)))
    for name, other in made.items():
        if name != best and isinstance(other, Peer):
            other.close()
    print(f"{title}: {best}", flush=True)
    return made[best]


def others(python: Path | None) -> dict[str, Rate]:
    """Return the other environments; without ``python``, those of Gymnasium only."""
    cores = available_threads()
    sync: dict[str, Rate] = {
        f"{n} worlds": Batch("CartPole-v1", n, vectorization_mode="sync") for n in (16, 64, 256, 1024)
    }
    peers: dict[str, Rate] = {SYNC: fastest(SYNC, sync), CARTPOLE: single("CartPole-v1")}
    if python is not None:
        peers[PUSHT] = Peer(python, "pusht", copies=cores)
        shapes = [(n, threads) for n in (256, 1024, 4096) for threads in sorted({1, cores})]
        pools: dict[str, Rate] = {f"{n} worlds, {t} threads": Peer(python, "envpool", n, t) for n, t in shapes}
        peers[POOL] = fastest(POOL, pools)
    return peers


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
    lines = []
    for row, rates in zip(
        rows, in_pairs([(ours[row.ours], theirs[row.other]) for row in rows], asked.rounds), strict=True
    ):
        ratios, measured = rates[:, 0] / rates[:, 1], ours[row.ours]
        text = f"{spread(1.0 / ratios)} x its cost" if row.cost else f"{spread(ratios)} x its rate"
        target = "" if row.target is None else f"{'at most' if row.cost else 'at least'} {row.target:g}"
        contacts = f"{measured.contacts():.0%}" if isinstance(measured, Batch) and row.ours in CROWDS else ""
        mine, other = np.median(rates, axis=0)
        lines.append([row.ours, contacts, f"{mine:.0f}", row.other, f"{other:.0f}", text, target])
    heads = (
        "vibgym",
        "periods with contacts",
        "steps/s",
        "compared with",
        "steps/s",
        f"{asked.rounds} rounds",
        "target",
    )
    show("peers", heads, lines)


if __name__ == "__main__":
    main()
