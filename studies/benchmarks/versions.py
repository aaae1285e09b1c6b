"""Versions of vibgym measured in turn: ``python -m studies.benchmarks.versions [VERSION ...] [--measures kernel]``.

The first version is this checkout. Others are directories of checkouts, commits of this one, and ``plain``: this checkout with
numba's public interface (``VIBGYM_PLAIN_NUMBA=1``). Every version runs in processes of its own. Measures:

- ``first``: time from the start of Python to the end of the first step, and that of a further action in the same process; with
  an empty cache, then in a second process with that cache. Wall and processor time, medians.
- ``steps``: processor time of a step on one thread, of a single environment and per world of a batch.
- ``kernel``: the planar kernel on random fields for a second: time per period, and position error relative to a converged run
  of this checkout.

Ratios are medians over the rounds, relative to this checkout.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from studies import common
from studies.accuracy.model_checks import friction_bound
from studies.kept import show
from studies.worker import Worker
from vibgym import checks

ROOT = Path(__file__).resolve().parents[2]
EVALUATED = 20
"""Runge-Kutta steps of the aluminium block per period."""

SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "one part": ("Rotate", {}),
    "several parts": ("Sort", {}),
    "a rigid part": ("Rotate", {"model": "tilting"}),
    "rigid parts": ("Sort", {"model": "tilting"}),
}
"""First steps by name."""

WORKER = r"""
import json, math, sys, time
import numpy as np
import gymnasium, vibgym
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

WORLDS, PERIODS, MARGIN, SIDE, ARM = 64, 25, 0.1, 0.060, 0.030
CORNERS = [[0, 0], [SIDE, 0], [SIDE, ARM], [ARM, ARM], [ARM, SIDE], [0, SIDE]]

def first(task, settings):
    took = []
    for action in ("element", "field"):
        began = time.time(), time.process_time()
        env = gymnasium.make(f"vibgym/{task}-v0", action=action, **settings)
        env.reset(seed=0)
        env.step(env.action_space.sample())
        took.append([time.time() - began[0], time.process_time() - began[1]])
    return {"end": time.time() - took[1][0], "processor": time.process_time() - took[1][1], "further": took[1]}

envs = {}

def steps(worlds):
    single = worlds == 1
    if worlds not in envs:
        name = "vibgym/Rotate-v0"
        env = gymnasium.make(name, action="patch") if single else gymnasium.make_vec(name, num_envs=worlds, action="patch")
        env.action_space.seed(0)
        env.reset(seed=0)
        envs[worlds] = env, [env.action_space.sample() for _ in range(8)]
        steps(worlds)
    (env, actions), count, best = envs[worlds], 500 if single else 10, math.inf
    for _ in range(5):
        began = time.thread_time()
        for k in range(count):
            ended = env.step(actions[k % 8])[2:4]
            if single and any(ended):
                env.reset()
        best = min(best, 1e6 * (time.thread_time() - began) / count / worlds)
    return best

def parts():
    return {
        "aluminium block": shipped_part("aluminium_block"), "steel block": shipped_part("steel_block"),
        "60x60 mm L-shape": Part.polygon(CORNERS, friction=0.6), "20 mm disc": Part.disc(0.010, friction=0.6),
        "100x20 mm bar": Part.rectangle(0.100, 0.020, friction=0.6),
    }

def run(part, **scheme):
    surface, rng = Surface(), np.random.default_rng(1)
    pose = np.empty((WORLDS, 1, 3))
    for axis, elements in enumerate((surface.columns, surface.rows)):
        extent = elements * surface.element_size
        pose[:, 0, axis] = rng.uniform(min(MARGIN, 0.5 * extent), max(extent - MARGIN, 0.5 * extent), WORLDS)
    pose[:, 0, 2] = rng.uniform(-math.pi, math.pi, WORLDS)
    shape = (WORLDS, surface.rows, surface.columns)
    amplitude, phase = rng.uniform(0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
    simulator = Simulator(surface, parts()[part], worlds=WORLDS, threads=1, **scheme)
    simulator.reset(pose)
    began = time.thread_time()
    simulator.advance(amplitude, phase, PERIODS)
    return simulator.pose[:, 0, :2].tolist(), 1e6 * (time.thread_time() - began) / (WORLDS * PERIODS)

def period(part):
    return min(run(part)[1] for _ in range(3))

def place(part, scheme):
    return run(part, **scheme)[0]

def names():
    return list(parts())

for line in sys.stdin:
    name, *arguments = json.loads(line)
    print(json.dumps(globals()[name](*arguments)), flush=True)
"""


class Version(NamedTuple):
    """A version of vibgym."""

    name: str
    folder: Path
    variables: dict[str, str] = {}

    def process(self, cache: str | Path) -> Worker:
        """Start a process with this folder of compiled kernels."""
        variables = {"PYTHONPATH": str(self.folder), "NUMBA_CACHE_DIR": str(cache), **self.variables}
        return Worker(sys.executable, "-c", WORKER, cwd=self.folder, variables=variables)


def version(text: str, folder: Path) -> Version:
    """Return the version that an argument names; commits are unpacked in ``folder``."""
    if text == "plain":
        return Version(text, ROOT, {"VIBGYM_PLAIN_NUMBA": "1"})
    if Path(text).is_dir():
        return Version(Path(text).resolve().name, Path(text).resolve())
    archive = folder / "commit.tar"
    done = subprocess.run(["git", "archive", "-o", str(archive), text, "vibgym"], cwd=ROOT, capture_output=True)
    if done.returncode:
        raise SystemExit(str(checks.refuse("VERSION", text, "plain, a directory, or a commit")))
    with tarfile.open(archive) as packed:
        packed.extractall(folder / text, filter="data")
    return Version(text, folder / text)


def first(versions: list[Version], rounds: int, folder: Path) -> None:
    """Measure first steps."""
    lines = []
    for scene, arguments in SCENES.items():
        times: dict[str, list[list[Any]]] = {release.name: [] for release in versions}
        for _ in range(rounds):
            for release in versions:
                with tempfile.TemporaryDirectory(dir=folder) as cache:
                    row = []
                    for _ in range(2):
                        began = time.time()
                        with release.process(cache) as worker:
                            took = worker.ask("first", *arguments)
                        row += [[took["end"] - began, took["processor"]], took["further"]]
                times[release.name].append(row[:3])
        for name, rows in times.items():
            median = np.median(rows, axis=0)
            lines.append([scene, name, *(f"{wall:.2f} ({processor:.2f})" for wall, processor in median)])
    heads = ("wall (processor), s", "version", "empty cache", "further action", "second process")
    show("first", heads, lines)


def steps(versions: list[Version], rounds: int, folder: Path) -> None:
    """Measure steps."""
    workers = [release._replace(variables={**release.variables, "VIBGYM_THREADS": "1"}).process(folder / release.name)
               for release in versions]  # fmt: skip
    lines = []
    for worlds in (1, 1024):
        times = np.array([[worker.ask("steps", worlds) for worker in workers] for _ in range(rounds)])
        best, ratio = times.min(axis=0), np.median(times / times[:, :1], axis=0)
        what = "single environment" if worlds == 1 else f"batch of {worlds}, per world"
        lines.append([what, *(f"{us:.2f} us (x {share:.3f})" for us, share in zip(best, ratio, strict=True))])
    for worker in workers:
        worker.close()
    show("steps", ("step of Rotate, `patch`", *(release.name for release in versions)), lines)


def kernel(versions: list[Version], rounds: int, folder: Path) -> None:
    """Measure the planar kernel."""
    workers = [release.process(folder / release.name) for release in versions]
    lines = []
    for part in workers[0].ask("names"):
        truth = np.array(workers[0].ask("place", part, {"steps": 128, "substeps": 2, "pieces": 6}))
        times = np.array([[worker.ask("period", part) for worker in workers] for _ in range(rounds)])
        cells = []
        for k, worker in enumerate(workers):
            away = 1e3 * np.hypot(*(np.array(worker.ask("place", part, {})) - truth).T)
            cells.append(f"{times[:, k].min():.2f} us (x {np.median(times[:, k] / times[:, 0]):.2f})")
            cells.append("{:.4f}, {:.4f}".format(*np.quantile(away, (0.5, 0.95))))
        lines.append([part, *cells])
    for worker in workers:
        worker.close()
    heads = [head for release in versions for head in (release.name, "error: median, 95 %, mm")]
    show("kernel", ("per period and core", *heads), lines)
    print(f"{4 * EVALUATED} friction evaluations alone, the block's, take {friction_bound(EVALUATED).period:.2f} us")


MEASURES = {"first": first, "steps": steps, "kernel": kernel}


def main() -> None:
    """Measure and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("versions", nargs="*", metavar="VERSION", help="plain, a directory of a checkout, or a commit")
    parser.add_argument("--measures", nargs="+", choices=list(MEASURES), default=list(MEASURES))
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        versions = [Version("this checkout", ROOT), *(version(text, Path(folder)) for text in asked.versions)]
        for name in asked.measures:
            MEASURES[name](versions, checks.count("--rounds", asked.rounds), Path(folder))


if __name__ == "__main__":
    main()
