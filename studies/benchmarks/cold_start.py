"""Time to the first step: from the start of Python to the end of the first ``env.step``.

    python -m studies.benchmarks.cold_start                      # this checkout
    python -m studies.benchmarks.cold_start ../base              # and another checkout, in turn, on the same host

Each run is a process: with an empty cache, then again with that cache; medians. "further action" is a second environment in the
first process.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from studies.benchmarks import common

ROOT = Path(__file__).resolve().parents[2]
SCENES = {
    "one part": "step('Rotate')",
    "several parts": "step('Sort')",
    "a rigid part": "step('Rotate', model='tilting')",
    "rigid parts": "step('Sort', model='tilting')",
    "play page": "play()",
}
"""First steps by name, see PROBE."""

PROBE = """
import json, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
import gymnasium, vibgym

action = "element"

def step(task, **settings):
    env = gymnasium.make(f"vibgym/{task}-v0", action=action, **settings)
    env.reset(seed=0)
    env.step(env.action_space.sample())

def play():
    from vibgym.plugins.play.choices import Settings
    from vibgym.plugins.play.session import Session
    session = Session(Settings("vibgym/Align-v0"), Path("."))
    session.step()
    session.shown()

exec(sys.argv[1])
finished, first = time.time(), time.process_time()
action = "field"
exec(sys.argv[1])
print(json.dumps([finished, first, time.time() - finished, time.process_time() - first]))
assert vibgym.__file__.startswith(sys.argv[2]), vibgym.__file__
"""


def probe(scene: str, cache: str, tree: Path) -> list[list[float]]:
    """Return wall and processor time, s, of the first step and of that with a further action, in a new process."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    began = time.time()
    done = subprocess.run(
        [sys.executable, "-c", PROBE, scene, str(tree)], cwd=cache, env=environment, text=True, check=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    finished, spent, *further = json.loads(done.stdout)
    return [[finished - began, spent], further]


def main() -> None:
    """Print the table."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("tree", nargs="*", type=Path, help="other checkouts to compare with")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    trees = [ROOT, *(each.resolve() for each in arguments.tree)]
    print(f"{'':30}{'empty cache':>20}{'further action':>20}{'second process':>20}   wall (processor), s")
    for scene, code in SCENES.items():
        runs: dict[Path, list[list[list[float]]]] = {tree: [] for tree in trees}
        for _ in range(arguments.rounds):
            for tree in trees:
                with tempfile.TemporaryDirectory() as cache:
                    runs[tree].append([*probe(code, cache, tree), probe(code, cache, tree)[0]])
        for tree, found in runs.items():
            cells = [[statistics.median(run[k][m] for run in found) for m in (0, 1)] for k in range(3)]
            name = f"{scene}, {tree.name}"
            print(f"{name:30}" + "".join(f"{f'{wall:.2f} ({spent:.2f})':>20}" for wall, spent in cells), flush=True)


if __name__ == "__main__":
    main()
