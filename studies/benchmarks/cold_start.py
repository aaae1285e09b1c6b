"""Time to the first step: from the start of Python to the end of the first ``env.step``.

    python -m studies.benchmarks.cold_start                      # wheel of this checkout, and the checkout
    python -m studies.benchmarks.cold_start ../base              # and another checkout, in turn, on the same host
    python -m studies.benchmarks.cold_start --wheel a.whl        # an existing wheel

The wheel is installed with the extra ``play``, in the versions of constraints.txt, into an empty environment, in which the
checkouts run as well. Each run is a process: with an empty cache, then again with that cache; medians. "further action" is a
second environment in the first process.
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
sys.path[:0] = sys.argv[2:]
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
assert vibgym.__file__.startswith(sys.argv[2] if sys.argv[2:] else sys.prefix), vibgym.__file__
"""


def probe(python: Path, scene: str, cache: str, *tree: Path) -> list[list[float]]:
    """Return wall and processor time, s, of the first step and of that with a further action, in a new process."""
    hidden = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "PYTHONHOME", "VIRTUAL_ENV")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment["NUMBA_CACHE_DIR"] = cache
    if tree:
        environment["PYTHONPYCACHEPREFIX"] = f"{python.parent}/pyc"
    began = time.time()
    done = subprocess.run(
        [python, "-c", PROBE, scene, *map(str, tree)], cwd=cache, env=environment, text=True, check=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    finished, spent, *further = json.loads(done.stdout)
    return [[finished - began, spent], further]


def installed(wheel: Path | None, folder: Path) -> Path:
    """Install a wheel, by default of this checkout, into an empty environment; return its interpreter."""
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    if wheel is None:
        subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", folder, ROOT], check=True)
        (wheel,) = folder.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "environment"], check=True)
    python = folder / "environment" / "bin" / "python"
    subprocess.run([*pip, "--python", python, "install", "-c", ROOT / "constraints.txt", f"{wheel}[play]"], check=True)
    return python


def main() -> None:
    """Print the table."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("tree", nargs="*", type=Path, help="other checkouts to compare with")
    parser.add_argument("--wheel", type=Path, help="existing wheel; default: built from this checkout")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    trees = [(), (ROOT,), *((each.resolve(),) for each in arguments.tree)]
    with tempfile.TemporaryDirectory() as folder:
        python = installed(arguments.wheel and arguments.wheel.resolve(), Path(folder))
        print(f"{'':30}{'empty cache':>20}{'further action':>20}{'second process':>20}   wall (processor), s")
        for scene, code in SCENES.items():
            runs: dict[tuple[Path, ...], list[list[list[float]]]] = {tree: [] for tree in trees}
            for each in range(arguments.rounds + 1):
                for tree in trees:
                    with tempfile.TemporaryDirectory() as cache:
                        found = [*probe(python, code, cache, *tree), probe(python, code, cache, *tree)[0]]
                    if each:  # the first compiles bytecode, as pip has for the wheel
                        runs[tree].append(found)
            for tree, found in runs.items():
                cells = [[statistics.median(run[k][m] for run in found) for m in (0, 1)] for k in range(3)]
                name = f"{scene}, {tree[0].name if tree else 'wheel'}"
                print(f"{name:30}" + "".join(f"{f'{wall:.2f} ({spent:.2f})':>20}" for wall, spent in cells), flush=True)


if __name__ == "__main__":
    main()
