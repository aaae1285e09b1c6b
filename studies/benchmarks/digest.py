"""Digests of poses, velocities, rewards, ``info`` and observations of 50 scenes, to detect any changed bit.

    python -m studies.benchmarks.digest write   # writes studies/benchmarks/digest.json
    python -m studies.benchmarks.digest check   # prints the scenes and columns that differ from it

Digests depend on the type of processor and the version of numba. On another host, write the file at a reference commit first.
The message of a commit that changes results has the changed rows and the reason.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numba
import numpy as np

import vibgym
from studies import common
from vibgym import Part, Simulator, Surface

FILE = Path(__file__).with_name("digest.json")
INFO = ("is_success", "position_error", "heading_error", "fallen", "diverged", "clearance", "touching", "parts_done")
"""Entries of ``info``; a task may lack some."""

L_SHAPE = [[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]]
WALLS = ["left", "right", "bottom", "top"]
DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "disc"}
ANGLE = {"shape": "polygon", "vertices": L_SHAPE, "friction": 0.5, "name": "angle"}


def parts() -> dict[str, Part]:
    """Return the parts by name."""
    return {
        "steel": Part.rectangle(0.050, 0.040, friction=0.64, height=0.004),
        "aluminium": Part.rectangle(0.050, 0.035, friction=0.58, height=0.020, mass=0.0945),
        "disc": Part.disc(0.010, friction=0.6),
        "angle": Part.polygon(L_SHAPE, friction=0.5),
        "bar": Part.rectangle(0.100, 0.020, friction=0.4, static_friction=0.5),
        "bouncy": Part.rectangle(0.040, 0.040, friction=0.3, restitution=0.9, contact_friction=0.1),
        "heavy": Part.disc(0.025, friction=0.6, mass=20.0),
    }


def hashed(*arrays: Any) -> str:
    """Return the first 16 digits of the SHA-256 of arrays' shapes, types and bytes."""
    digest = hashlib.sha256()
    for array in arrays:
        values = np.ascontiguousarray(array)
        digest.update(f"{values.shape} {values.dtype}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()[:16]


def simulated(
    simulator: Simulator, pose: Any, velocity: Any, calls: int, periods: int, scale: float, seed: int
) -> dict:
    """Run a simulator with random elements; return the digests of all states."""
    surface = simulator.surface
    random = np.random.default_rng(seed)
    simulator.reset(pose, velocity)
    record = []
    for _ in range(calls):
        shape = (simulator.worlds, surface.rows, surface.columns)
        amplitude = scale * surface.max_amplitude * random.random(shape)
        simulator.advance(amplitude, random.uniform(-np.pi, np.pi, shape), periods)
        record.append((simulator.pose, simulator.velocity, simulator.mean_velocity))
    flags = (simulator.fallen, simulator.sticking, simulator.doubtful, simulator.diverged)
    return {
        "pose": hashed(*(state[0] for state in record)),
        "velocity": hashed(*(state[1] for state in record)),
        "mean_velocity": hashed(*(state[2] for state in record)),
        "flags": hashed(*flags),
        "statistics": json.dumps(simulator.statistics),
        "sum": repr(float(np.abs(record[-1][0]).sum())),
    }


def alone(
    name: str,
    seed: int,
    surface: Surface | None = None,
    calls: int = 12,
    periods: int = 2,
    scale: float = 1.0,
    **settings: Any,
) -> Callable[[], dict]:
    """Return a function that runs a scene with one part per world."""

    def run() -> dict:
        table, random, worlds = surface or Surface(), np.random.default_rng(seed), 24
        pose = np.empty((worlds, 1, 3))
        pose[..., 0] = random.uniform(0.1, 0.9, (worlds, 1)) * table.width
        pose[..., 1] = random.uniform(0.1, 0.9, (worlds, 1)) * table.depth
        pose[..., 2] = random.uniform(-np.pi, np.pi, (worlds, 1))
        velocity = random.normal(0.0, 1.0, (worlds, 1, 3)) * [0.1, 0.1, 3.0]
        simulator = Simulator(table, parts()[name], worlds=worlds, **settings)
        return simulated(simulator, pose, velocity, calls, periods, scale, seed)

    return run


def together(
    names: list[str], seed: int, spacing: float, surface: Surface | None = None, calls: int = 8, **settings: Any
) -> Callable[[], dict]:
    """Return a function that runs a scene with several parts per world, near the points of a grid."""

    def run() -> dict:
        table, random, worlds, n = surface or Surface(), np.random.default_rng(seed), 12, len(names)
        across, k = int(np.ceil(np.sqrt(n))), np.arange(n)
        pose = np.empty((worlds, n, 3))
        pose[..., 0] = 0.5 * table.width + (k % across - 0.5 * (across - 1)) * spacing
        pose[..., 1] = 0.5 * table.depth + (k // across - 0.5 * (across - 1)) * spacing
        pose[..., 2] = random.uniform(-0.05, 0.05, (worlds, n))
        pose[..., :2] += random.uniform(-0.001, 0.001, (worlds, n, 2))
        velocity = random.normal(0.0, 1.0, (worlds, n, 3)) * [0.2, 0.2, 2.0]
        simulator = Simulator(table, [parts()[name] for name in names], worlds=worlds, **settings)
        return simulated(simulator, pose, velocity, calls, 2, 1.0, seed)

    return run


def played(task: str, seed: int, steps: int = 50, worlds: int = 10, limit: int = 20, hold: int = 5, **settings: Any):
    """Return a function that runs a batch of environments with random actions, held for some steps, and resets."""

    def run() -> dict:
        env: Any = gym.make_vec(
            f"vibgym/{task}-v0", num_envs=worlds, autoreset_mode="SameStep", max_episode_steps=limit, **settings
        )
        observation, info = env.reset(seed=seed)
        random = np.random.default_rng(seed)
        shape = (worlds, *env.unwrapped.core.action.shape)
        simulator = env.unwrapped.core.simulator
        seen, states, rewards, infos, terms, ends = [observation], [], [], [], [], []
        action = np.zeros(shape, np.float32)
        for step in range(steps):
            if step % hold == 0:
                action = random.uniform(-1.2, 1.2, shape).astype(np.float32)
            observation, reward, terminated, truncated, info = env.step(action)
            seen.append(observation)
            states.append((simulator.pose, simulator.velocity))
            rewards.append(reward)
            ends.append((terminated, truncated))
            infos += [np.asarray(info[name]) for name in INFO if name in info]
            terms += [np.asarray(value) for name, value in info["reward_terms"].items() if not name.startswith("_")]
        env.close()
        flat = [obs[key] for obs in seen for key in sorted(obs)] if isinstance(seen[0], dict) else seen
        return {
            "pose": hashed(*(state[0] for state in states)),
            "velocity": hashed(*(state[1] for state in states)),
            "reward": hashed(*rewards),
            "terms": hashed(*terms),
            "ends": hashed(*ends),
            "info": hashed(*infos),
            "observation": hashed(*flat),
            "sum": repr(float(np.sum(rewards))),
        }

    return run


SMALL = {"rows": 3, "columns": 4}
SLOW = Surface(frequency=9.0)
CROWD = ["steel", "aluminium", "disc", "angle", "bouncy", "bar"]

SCENES: dict[str, Callable[[], dict]] = {
    "steel, planar": alone("steel", 1),
    "aluminium, planar, long calls": alone("aluminium", 2, calls=4, periods=10),
    "small disc, planar": alone("disc", 3),
    "angle, planar": alone("angle", 4),
    "bar, planar": alone("bar", 5),
    "aluminium, 12 x 3": alone("aluminium", 6, steps=12, substeps=3),
    "angle by points": alone("angle", 7, calls=6, pieces=3),
    "falling off a small table": alone("steel", 8, surface=Surface(rows=3, columns=4), calls=30),
    "one element": alone("steel", 9, surface=Surface(rows=1, columns=1, element_size=0.5)),
    "still table": alone("angle", 10, surface=Surface(horizontal_amplitude=0.0), scale=0.0),
    "sticking and slipping, slow table": alone("steel", 11, surface=SLOW, scale=0.4),
    "sticking and slipping, static friction": alone("bar", 12, surface=Surface(frequency=7.0), scale=0.5),
    "averaged, second order": alone("aluminium", 13, model="averaged"),
    "averaged, first order, stride": alone("angle", 14, model="averaged", order=1, stride=2, calls=6, periods=5),
    "averaged, finer steps": alone("disc", 15, model="averaged", steps=3),
    "auto": alone("steel", 16, model="auto", tolerance=5e-4, periods_per_call=2),
    "auto, planar": alone("aluminium", 17, model="auto", tolerance=3e-5),
    "six apart": together(CROWD, 18, 0.12, surface=Surface(rows=24, columns=32)),
    "six near": together(CROWD, 19, 0.075),
    "heap of blocks": together(["steel", "aluminium"] * 4, 20, 0.0545),
    "heap of mixed parts": together(CROWD, 21, 0.11, surface=Surface(rows=16, columns=16), calls=25),
    "heavy and light": together(["heavy", "disc", "disc", "heavy"], 22, 0.0505),
    "one part and walls": together(["steel"], 23, 0.0, surface=Surface(rows=3, columns=4), calls=15, walls=WALLS),
    "corner": together(["steel", "disc", "bouncy"], 24, 0.06, surface=Surface(rows=6, columns=6), calls=15, walls=["left",
    "top"]), "heap, finer coupling": together(["aluminium"] * 4, 25, 0.0545, contact_steps=40),
    "heap, sticking": together(["steel", "bar", "disc"], 26, 0.105, surface=Surface(rows=16, columns=16, frequency=9.0)),
    "heap, auto": together(["steel"] * 3, 27, 0.0545, model="auto"),
    "Rotate, element": played("Rotate", 31),
    "Rotate, phasor, steel": played("Rotate", 32, action="phasor", parts=["steel_block"]),
    "Rotate, patch, image": played("Rotate", 33, action="patch", observation="image"),
    "Rotate, field, goal": played("Rotate", 34, action="field", observation="goal"),
    "Align, element, small table": played("Align", 35, surface=SMALL),
    "Align, patch, goal": played("Align", 36, action="patch", observation="goal"),
    "Align, field, disc": played("Align", 37, action="field", parts=[DISC]),
    "Align, field, image": played("Align", 38, action="field", observation="image"),
    "Align, averaged": played("Align", 39, action="field", model="averaged"),
    "Transport, phasor": played("Transport", 40, action="phasor"),
    "Transport, patch, angle": played("Transport", 41, action="patch", parts=[ANGLE]),
    "Transport, element, slow table": played("Transport", 42, surface={"frequency": 8.0}),
    "Transport, field, two periods": played("Transport", 43, action="field", periods_per_step=2),
    "Sort, element": played("Sort", 44),
    "Sort, field": played("Sort", 45, action="field"),
    "Sort, patch, image": played("Sort", 46, action="patch", observation="image"),
    "Sort, phasor, walls, varying parts": played("Sort", 47, action="phasor", walls=["left", "top"], randomize={"parts": [2,
    6]}, slots=8), "SortTwelve, field": played("SortTwelve", 48, action="field", steps=25),
    "SortThreeKinds, field": played("SortThreeKinds", 49, action="field"),
    "SortCrowded, element": played("SortCrowded", 50),
    "SortCrowded, patch, image": played("SortCrowded", 51, action="patch", observation="image", steps=30),
    "Singulate, field": played("Singulate", 52, action="field"),
    "Singulate, patch, walls": played("Singulate", 53, action="patch", walls=["bottom"]),
}  # fmt: skip


def measure(chosen: str = "") -> dict[str, dict]:
    """Return the rows of all scenes whose names contain ``chosen``."""
    return {name: run() for name, run in SCENES.items() if chosen in name}


def host() -> dict[str, str]:
    """Return processor and versions, on which the digests depend."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line for line in lines if line.startswith("model name")), "").partition(":")[2].strip()
    return {"processor": model or platform.processor(), "numba": numba.__version__, "numpy": np.__version__}


def check(chosen: str, path: Path) -> int:
    """Compare with the file; return the number of scenes that differ."""
    stored = json.loads(path.read_text(encoding="utf-8"))
    if stored["host"] != host():
        print(f"written on another host: {stored['host']}, here {host()}", file=sys.stderr)
    differing = 0
    digests = measure(chosen)
    for name, row in digests.items():
        then = stored["scenes"].get(name, {})
        columns = [key for key in row if then.get(key) != row[key]]
        if columns:
            differing += 1
            print(f"{name}: {', '.join(columns)}   sum {then.get('sum')} -> {row['sum']}")
    print(f"{len(digests) - differing} of {len(digests)} scenes have the same bits")
    return differing


def main() -> int:
    """Run the command line; return the exit code."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("command", choices=("write", "check"))
    parser.add_argument("--only", default="", help="scenes whose names contain this text")
    parser.add_argument("--file", type=Path, default=FILE)
    parser.add_argument("--warm", action="store_true", help="use cached kernels instead of an empty cache")
    arguments = parser.parse_args()
    if not arguments.warm:
        # The last bit can depend on which kernels are compiled and which are loaded, so one process compiles all.
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, "-m", "studies.benchmarks.digest", *sys.argv[1:], "--warm"]
            return subprocess.run(command, env={**os.environ, "NUMBA_CACHE_DIR": cache}).returncode
    if arguments.command == "check":
        return 1 if check(arguments.only, arguments.file) else 0
    content = {"vibgym": vibgym.__version__, "host": host(), "scenes": measure(arguments.only)}
    arguments.file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(f"{arguments.file}: {len(content['scenes'])} scenes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
