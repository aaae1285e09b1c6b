"""Time of a step by action, hardware model, contacts and shape: ``python -m studies.benchmarks.steps TABLE ...``.

Batches under uniform random actions are measured in turn. Output: ratios to the first line, medians over the rounds, and time
per world and step; all tables but ``hardware-cost`` have processor times of one thread. Random wrenches spin parts fast, so
that their steps include more simulation. ``contacts-cost`` also has the cost of ``gym.make``. ``shapes-cost`` compares parts
that are drawn for each world with the part of Align, and with an environment for each world in ``SyncVectorEnv``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from studies import common
from studies.kept import show

Settings = Mapping[str, Any]


class Table(NamedTuple):
    """Batches that are compared."""

    head: str
    scenes: dict[str, tuple[str, int, Settings]]  # column -> task, worlds, settings
    rows: dict[str, Settings]
    steps: int  # of a measurement
    targets: dict[str, str] = {}  # row -> target
    alone: bool = True  # on one thread, in processor time
    made: bool = False  # whether ``gym.make`` is measured, in a line for each scene and row


POSE = {"actuators": "prototype", "sensor": "pose"}
TABLES = {
    "action-cost": Table(
        "action",
        {f"{task}, {worlds} worlds": (task, worlds, {})
         for task, worlds in (("Rotate", 1024), ("Sort", 256), ("Swap", 64), ("Pack", 64))},
        {f"`{name}`": {"action": name} for name in ("patch", "field", "wrench", "velocity", "target")},
        8,
    ),
    "hardware-cost": Table(
        "a step",
        {f"{task}, `{action}`, {worlds} worlds": (task, worlds, {"action": action})
         for task, action, worlds in (("Rotate", "element", 1024), ("Rotate", "patch", 1024), ("Sort", "patch", 128))},
        {
            "ideal": {},
            "prototype actuators": {"actuators": "prototype"},
            "prototype actuators, pose sensor": POSE,
            "and Kalman estimator": {**POSE, "sensor": {"kind": "pose", "estimator": "kalman"}},
            "and model estimator": {**POSE, "sensor": {"kind": "pose", "estimator": "model"}},
            "ideal actuators, statistical camera": {"sensor": {"kind": "camera", "statistical": True}},
        },
        20,
        {
            "prototype actuators, pose sensor": "1.33 x",
            "and model estimator": "one more simulation",
            "ideal actuators, statistical camera": "1.10 x",
        },
        alone=False,
    ),
    "contacts-cost": Table(
        "contacts",
        {task: (task, 64, {}) for task in ("Sort", "SortCrowded", "Swap")},
        {kind: {"model": {"kind": "planar", "contacts": kind}} for kind in ("certified", "pymunk", "fast")},
        60,
        made=True,
    ),
    "shapes-cost": Table(
        "batch of 1024",
        {f"`{action}`": ("Align", 1024, {"action": action}) for action in ("patch", "field", "velocity", "phasor", "element")},
        {
            "Align": {},
            "AlignShapes": {"task": "AlignShapes"},
            "AlignShapes, SyncVectorEnv": {"task": "AlignShapes", "vectorization_mode": "sync"},
        },
        2,
    ),
}  # fmt: skip


def batch(task: str, worlds: int, **settings: Any) -> gym.vector.VectorEnv:
    """Return a batch; ``task`` may be among the settings of a row, too."""
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, **settings)


def column(table: Table, task: str, worlds: int, scene: Settings, rounds: int, warm: int) -> list[list[str]]:
    """Return the cells of a column, a list a row."""
    clock: Callable[[], float] = time.thread_time if table.alone else time.perf_counter
    rows = {name: {"task": task, **scene, **settings} for name, settings in table.rows.items()}
    envs = {name: batch(worlds=worlds, **settings) for name, settings in rows.items()}
    cells = {name: [cost] for name, cost in common.step_costs(envs, table.steps, rounds, warm, clock).items()}
    for env in envs.values():
        env.close()
    if table.made:
        calls = {name: partial(gym.make, f"vibgym/{task}-v0", **settings) for name, settings in table.rows.items()}
        took = common.interleaved(calls, rounds, warm, clock)
        first = next(iter(took.values()))
        for name, times in took.items():
            cells[name].append(f"{np.median(times / first):.2f} x")
    return list(cells.values())


def main() -> None:
    """Measure every scene of the tables."""
    parser = common.parser(__doc__)
    parser.add_argument("tables", nargs="+", choices=list(TABLES), metavar="TABLE", help=", ".join(TABLES))
    parser.add_argument("--rounds", type=int, default=13)
    parser.add_argument("--warm", type=int, default=2, help="rounds without measurement before them")
    asked = parser.parse_args()
    for name in asked.tables:
        table = TABLES[name]
        if table.alone:
            os.environ["VIBGYM_THREADS"] = "1"
        else:
            os.environ.pop("VIBGYM_THREADS", None)
        columns = [column(table, *scene, asked.rounds, asked.warm) for scene in table.scenes.values()]
        if table.made:
            heads = ["task", table.head, "step", "`gym.make`"]
            cells = zip(table.scenes, columns, strict=True)
            rows = [[scene, row, *column[k]] for scene, column in cells for k, row in enumerate(table.rows)]
        else:
            heads = [table.head, *table.scenes, *(["target for Rotate"] if table.targets else [])]
            rows = [[row, *(column[k][0] for column in columns)] for k, row in enumerate(table.rows)]
            rows = [[*row, table.targets.get(row[0], "")] if table.targets else row for row in rows]
        show(name, heads, rows, asked.keep)


if __name__ == "__main__":
    main()
