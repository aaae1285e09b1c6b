"""Largest simultaneous push of a machine on several parts in different directions: ``results/rivals-push.csv``.

A linear programme finds the largest share ``s`` of the full push that all parts get in their directions, as a mean over time.
Torques are free. A machine has generators (feasible pushes of all elements) in groups; within a group, one generator acts at a
time:

- plate: all strokes are one group;
- conveyor: every cell is a group with one or two directions;
- segmented surface: every element is a group with directions all around.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.rivals.machines import MACHINES, Cells, Machine, Plate
from studies.rivals.policies import element_positions, initial_strokes
from vibgym.allocation import Allocator
from vibgym.envs.vector import batch_of, environment_id
from vibgym.policies.task_info import TaskInfo

COUNTS = (1, 2, 3, 6, 12)
"""Numbers of parts that are pushed."""

SAMPLES = 50
"""Number of scenes: starts of SortTwelve with random directions."""

AROUND = 32
"""Number of directions of an element of the segmented surface; between them its push is underestimated by at most 0.5 %."""

NAMES = ("segmented", *MACHINES)


class Generators(NamedTuple):
    """Feasible pushes of a machine."""

    push: np.ndarray  # (n, elements, 2) of all elements, or (n, 2) of one element
    element: np.ndarray | None  # (n,) index of the element; None: all elements
    group: np.ndarray  # (n,) int


def generators(name: str, info: TaskInfo) -> Generators:
    """Return the generators of a machine, see the module."""
    elements = info.surface.rows * info.surface.columns
    if name == "segmented":
        angle = np.tile(2.0 * math.pi / AROUND * np.arange(AROUND), elements)
        element = np.repeat(np.arange(elements), AROUND)
        return Generators(np.stack([np.cos(angle), np.sin(angle)], axis=-1), element, element)
    machine: Machine = MACHINES[name](info.surface, info.parts)
    if isinstance(machine, Cells):
        signs = (1.0, -1.0) if machine.least < 0.0 else (1.0,)
        axis = machine.axis.reshape(-1, 2)
        element = np.tile(np.arange(elements), len(signs))
        return Generators(np.concatenate([sign * axis for sign in signs]), element, element)
    assert isinstance(machine, Plate)
    stroke = initial_strokes(info.surface, machine, element_positions(info.surface)).stroke
    push = machine.pushes(np.concatenate([stroke, -stroke])).reshape(2 * len(stroke), -1, 2)
    return Generators(push, None, np.zeros(len(push), dtype=np.int64))


def effects_of(generators: Generators, unit: np.ndarray) -> np.ndarray:
    """Return the pushes on parts (2 parts, n) by generator; ``unit`` (elements, 2, parts, 2): by unit push of an element."""
    if generators.element is None:
        effects = np.einsum("nek,ekpi->npi", generators.push, unit)
    else:
        effects = np.einsum("nk,nkpi->npi", generators.push, unit[generators.element])
    return effects.reshape(len(effects), -1).T


def share(effects: np.ndarray, group: np.ndarray, wanted: np.ndarray) -> float:
    """Return the largest share of the full push that all parts get in their directions.

    Args:
        effects: (2 parts, n).  group: (n,).
        wanted: (2 parts,) concatenated unit vectors.
    """
    from scipy.optimize import linprog
    from scipy.sparse import coo_matrix

    useful = np.abs(effects).max(axis=0) > 0.0
    effects, (groups, group) = effects[:, useful], np.unique(group[useful], return_inverse=True)
    n = effects.shape[1]
    if n == 0:
        return 0.0
    cost = np.append(np.zeros(n), -1.0)
    equal = np.concatenate([effects, -wanted[:, None]], axis=1)
    limits = coo_matrix((np.ones(n), (group, np.arange(n))), shape=(len(groups), n + 1)).tocsr()
    solution = linprog(
        cost, limits, np.ones(len(groups)), equal, np.zeros(len(wanted)), bounds=(0.0, None), method="highs"
    )
    assert solution.success, solution.message
    return float(-solution.fun)


def rows(samples: int = SAMPLES, counts: Sequence[int] = COUNTS, names: Sequence[str] = NAMES) -> list[dict[str, Any]]:
    """Return the mean and smallest share, and the frequency of zero, by machine and number of parts."""
    env: Any = batch_of(environment_id("SortTwelve"), num_envs=samples)
    env.reset(seed=list(range(samples)))
    info, pose = TaskInfo.of(env), env.unwrapped.truth.pose.copy()
    env.close()
    allocator, elements = Allocator(info.surface, info.parts, info.hardware), info.surface.rows * info.surface.columns
    drives = np.eye(2 * elements).reshape(2 * elements, info.surface.rows, info.surface.columns, 2)
    angle = np.random.default_rng(27).uniform(-math.pi, math.pi, (samples, len(info.parts)))
    shares = {(name, count): np.zeros(samples) for name in names for count in counts}
    available = {name: generators(name, info) for name in names}
    for sample in range(samples):
        present = np.ones((len(drives), len(info.parts)), dtype=bool)
        unit = allocator.effect(np.tile(pose[sample], (len(drives), 1, 1)), present, drives)[..., :2]
        unit = unit.reshape(elements, 2, len(info.parts), 2)
        wanted = np.stack([np.cos(angle[sample]), np.sin(angle[sample])], axis=-1)
        for name in names:
            effects = effects_of(available[name], unit)
            for count in counts:
                shares[name, count][sample] = share(effects[: 2 * count], available[name].group, wanted[:count].ravel())
    return [
        {"machine": name, "parts": count, "samples": samples, "share": float(values.mean()),
         "least": float(values.min()), "none": float((values < 1e-6).mean())}
        for (name, count), values in shares.items()
    ]  # fmt: skip
