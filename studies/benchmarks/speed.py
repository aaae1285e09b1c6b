"""Speed of the import, and of the first step with a warm cache: ``python -m studies.benchmarks.speed``.

Environments beside others': :mod:`studies.benchmarks.peers`; training: :mod:`studies.benchmarks.training`.
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys

import vibgym


def in_fresh_process(code: str, rounds: int = 5) -> float:
    """Median seconds that ``code`` says it took (it prints them), each in a process of its own."""
    run = [sys.executable, "-c", code]
    return statistics.median(float(subprocess.check_output(run, text=True)) for _ in range(rounds))


TIMED = "import time; began = time.perf_counter(); {}; print(time.perf_counter() - began)"
FIRST_STEP = "env = gymnasium.make('vibgym/Rotate-v0'); env.reset(seed=0); env.step(env.action_space.sample())"


def start() -> None:
    """Import time and the first step with a warm cache."""
    base = in_fresh_process(TIMED.format("import numba, gymnasium"))
    ours = in_fresh_process(TIMED.format("import vibgym"))
    both = "import gymnasium, vibgym; " + TIMED.format(FIRST_STEP)
    in_fresh_process(both, 1)
    print(
        f"  import vibgym: {ours:.2f} s, numba and gymnasium alone: {base:.2f} s, {ours / base:.2f} times (target <= 1.5)"
    )
    print(f"  first step with a warm cache: {in_fresh_process(both, 3):.2f} s (target <= 1)")


def main() -> None:
    """Print the table."""
    print(f"vibgym {vibgym.__version__}, Python {platform.python_version()}, {os.cpu_count()} processors")
    start()


if __name__ == "__main__":
    main()
