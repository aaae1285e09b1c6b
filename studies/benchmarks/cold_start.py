"""How long the first step takes: with nothing compiled, in a new process with everything compiled, and for a further action.

    python -m studies.benchmarks.cold_start            # this tree
    python -m studies.benchmarks.cold_start ../base # and another checkout, in turn, on the same machine

Times are from before ``gym.make`` to after the first step, without the imports. Processor time is given as well: it
depends less on what else the machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

TARGETS = {"Rotate": 10.0, "Sort": 20.0}
FURTHER = 1.0
"""s for the first step, and for that with a further action."""

PROBE = """
import json, sys, time
sys.path.insert(0, sys.argv[1])
import gymnasium, vibgym
assert vibgym.__file__.startswith(sys.argv[1])

def first_step(action):
    began, spent = time.perf_counter(), time.process_time()
    env = gymnasium.make(f"vibgym/{sys.argv[2]}-v0", action=action)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    return time.perf_counter() - began, time.process_time() - spent

print(json.dumps([first_step("element"), first_step("field")]))
"""


def probe(tree: Path, task: str, cache: str) -> list[list[float]]:
    """Wall and processor time, s, of the first step and of that with a further action, in a process of its own."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": str(tree)}
    done = subprocess.run(
        [sys.executable, "-c", PROBE, str(tree), task], cwd=tree, env=environment, text=True, check=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return json.loads(done.stdout)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tree", nargs="*", type=Path, help="other checkouts to compare with")
    trees = [Path(__file__).resolve().parents[2], *(each.resolve() for each in parser.parse_args().tree)]
    print(f"{'':24}{'nothing compiled':>20}{'further action':>20}{'everything compiled':>22}   wall (processor), s")
    for task, target in TARGETS.items():
        for tree in trees:
            with tempfile.TemporaryDirectory() as cache:
                cold, further = probe(tree, task, cache)
                warm, _ = probe(tree, task, cache)
            cells = (f"{wall:.2f} ({spent:.2f})" for wall, spent in (cold, further, warm))
            missed = "" if cold[0] <= target and further[0] <= FURTHER else "   missed"
            print(f"{task + ' ' + tree.name:24}" + "".join(f"{each:>20}" for each in cells) + missed, flush=True)
    print(f"targets: Rotate {TARGETS['Rotate']:.0f} s, Sort {TARGETS['Sort']:.0f} s, further action {FURTHER:.0f} s")


if __name__ == "__main__":
    main()
