"""numba's private interfaces compared with its public one: ``python -m studies.benchmarks.numba_interfaces [--rounds 7]``.

Kernels compiled by :mod:`vibgym.kernels.linking` and by ``numba.njit`` (``VIBGYM_PLAIN_NUMBA=1``), in separate processes in
turn: processor time until the end of the first step, with an empty cache and with the filled one, then the time of a step of a
batch and of a single environment, on one thread. Ratios are medians over the rounds of steps.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from typing import Any

from studies.benchmarks import common

MODES = {"private": "0", "public": "1"}
WORLDS = 1024

WORKER = """
import json, sys, time
import gymnasium, vibgym

def first(task):
    env = gymnasium.make(f"vibgym/{task}-v0")
    env.reset(seed=0)
    env.step(env.action_space.sample())

if sys.argv[1] == "first":
    first(sys.argv[2])
    print(json.dumps(time.process_time()))
else:
    one = gymnasium.make("vibgym/Rotate-v0", action="patch")
    many = gymnasium.make_vec("vibgym/Rotate-v0", num_envs=int(sys.argv[2]), action="patch")
    for env in (one, many):
        env.action_space.seed(0)
        env.reset(seed=0)
    actions = {env: [env.action_space.sample() for _ in range(8)] for env in (one, many)}

    def step(env, count):
        began = time.thread_time()
        for k in range(count):
            ended = env.step(actions[env][k % 8])[2:4]
            if env is one and any(ended):
                env.reset()
        return 1e6 * (time.thread_time() - began) / count

    step(one, 100), step(many, 20)
    for line in sys.stdin:
        found = [min(step(one, 500) for _ in range(5)), min(step(many, 10) for _ in range(5)) / int(sys.argv[2])]
        print(json.dumps(found), flush=True)
"""


def environment(mode: str, cache: str) -> dict[str, str]:
    """Return the environment variables of a process."""
    settings = {
        "VIBGYM_PLAIN_NUMBA": MODES[mode],
        "NUMBA_CACHE_DIR": cache,
        "VIBGYM_THREADS": "1",
    }
    return {**os.environ, **settings}


def first_step(task: str, mode: str, cache: str) -> float:
    """Return the processor time of a new process until the end of its first step, s."""
    command = [sys.executable, "-c", WORKER, "first", task]
    done = subprocess.run(
        command, env=environment(mode, cache), text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True
    )
    return json.loads(done.stdout)


def main() -> None:
    """Print the comparison."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    print(f"{'processor time of the first step, s':44}{'private':>10}{'public':>10}")
    with tempfile.TemporaryDirectory() as folder:
        caches = {mode: f"{folder}/{mode}" for mode in MODES}
        for task in ("Rotate", "Sort"):
            for kind in ("empty cache", "filled cache"):
                empty = {mode: f"{folder}/{task}-{mode}" for mode in MODES}
                took = [first_step(task, mode, empty[mode]) for mode in MODES]
                print(f"{task + ', ' + kind:44}{took[0]:10.1f}{took[1]:10.1f}", flush=True)
        for mode in MODES:
            first_step("Rotate", mode, caches[mode])
        pipe: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        command = [sys.executable, "-c", WORKER, "steps", str(WORLDS)]
        workers = [subprocess.Popen(command, env=environment(mode, caches[mode]), **pipe) for mode in MODES]
        found = []
        for _ in range(rounds):
            both = []
            for worker in workers:
                worker.stdin.write("\n")  # type: ignore[union-attr]
                worker.stdin.flush()  # type: ignore[union-attr]
                both.append(json.loads(worker.stdout.readline()))  # type: ignore[union-attr]
            found.append(both)
        for worker in workers:
            worker.communicate()
    for k, name in enumerate(("single environment, Rotate, patch", f"batch of {WORLDS}, Rotate, patch")):
        best = [min(both[m][k] for both in found) for m in range(2)]
        ratio = statistics.median(both[1][k] / both[0][k] for both in found)
        print(f"{'us per step, ' + name:44}{best[0]:10.2f}{best[1]:10.2f}   public / private {ratio:.3f}")


if __name__ == "__main__":
    main()
