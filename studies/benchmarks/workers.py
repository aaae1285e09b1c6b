"""Evaluations with one worker, two, and a Ray cluster: ``python -m studies.benchmarks.workers``.

Four policies on 16 machines that are drawn apart (the prototype with 16 seeds): 64 pieces of work, and their report.
``python -m agents evaluate`` does them in one process on one processor, in two processes, and on a Ray cluster of two
processors that is started for it; the clock runs from the command's start to its end, several times in turn. The same with
one episode on one machine says what starting costs. ``episodes.csv`` has to be the same, byte for byte.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import yaml

from studies.benchmarks import common
from vibgym.simulation.threads import available_threads

POLICIES: list[Any] = [
    "pose",
    "lqr",
    "local_field",
    {"name": "learned", "kind": "trained", "path": "vibgym/policies/trained/shipped/align-prototype.json"},
]
WAYS: dict[str, tuple[dict[str, Any], list[str], bool]] = {
    "one worker": ({"processes": 1}, [], True),
    "one process, threads on all": ({"processes": 1}, [], False),
    "two workers": ({"processes": 2}, [], False),
    "Ray, two processors": ({"processes": 2}, ["--ray", "local"], False),
}
"""Settings, arguments, and whether it is kept to one processor."""

TARGETS = {"two workers": 1.7, "Ray, two processors": 1.5}


def settings(episodes: int, machines: int) -> dict[str, Any]:
    """Of the evaluation."""
    estimated = {"kind": "pose", "estimator": "model"}
    return {
        "tasks": ["Align"],
        "policies": POLICIES,
        "episodes": episodes,
        "hardware": {
            f"machine {seed:02d}": {"actuators": {"kind": "prototype", "seed": seed}, "sensor": estimated}
            for seed in range(machines)
        },
        "animations": False,
    }


def evaluated(way: str, content: dict[str, Any], folder: Path) -> tuple[float, bytes]:
    """Seconds of the command, and what it says of the episodes."""
    more, arguments, pinned = WAYS[way]
    config = folder / "evaluation.yaml"
    config.write_text(yaml.safe_dump({**content, **more, "output": str(folder / "out")}))
    command = [sys.executable, "-m", "agents", "evaluate", str(config), "--quiet", *arguments]
    keep: Callable[[], None] | None = _to_one_processor if pinned else None
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, preexec_fn=keep)
    return time.perf_counter() - began, (folder / "out" / "episodes.csv").read_bytes()


def _to_one_processor() -> None:
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])


def main() -> None:
    """Measure and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=200, help="of each policy on each machine")
    parser.add_argument("--machines", type=int, default=16)
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=list(WAYS))
    asked = parser.parse_args()
    whole, hardly = settings(asked.episodes, asked.machines), settings(1, 1)
    times: dict[str, list[float]] = {way: [] for way in asked.ways}
    starts: dict[str, list[float]] = {way: [] for way in asked.ways}
    distinct: set[bytes] = set()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for way in asked.ways:  # kernels, the disk's cache
            evaluated(way, hardly, folder)
        for number in range(asked.rounds):
            for way in asked.ways:
                starts[way].append(evaluated(way, hardly, folder)[0])
                seconds, episodes = evaluated(way, whole, folder)
                times[way].append(seconds)
                distinct.add(episodes)
                print(f"round {number + 1}: {way}, {seconds:.1f} s, start {starts[way][-1]:.1f} s", flush=True)
    count = asked.machines * len(POLICIES)
    print(f"\n{available_threads()} processors; {count} pieces of {asked.episodes} episodes; medians of {asked.rounds}")
    print(f"{'':<28}{'whole':>9}{'ratio':>7}{'target':>8}{'start':>9}{'rest':>9}{'ratio':>7}")
    one, first = median(times[asked.ways[0]]), median(starts[asked.ways[0]])
    for way in asked.ways:
        total, start = median(times[way]), median(starts[way])
        print(
            f"{way:<28}{total:7.1f} s{one / total:7.2f}{TARGETS.get(way, ''):>8}{start:7.1f} s{total - start:7.1f} s"
            f"{(one - first) / (total - start):7.2f}"
        )
    print(f"same episodes: {len(distinct) == 1}")
    raise SystemExit(0 if len(distinct) == 1 else 1)


if __name__ == "__main__":
    main()
