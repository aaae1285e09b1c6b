"""How hard a machine can push several parts at once, each in a direction of its own: ``results/rivals-push.csv``.

A linear programme: the largest share ``s`` of the full push such that all parts get it in their directions, on average over
time. Every machine has generators, pushes of all elements that it can do, in groups that cannot do more than one of them at a
time: the plate's strokes are one group, every cell of a conveyor is a group with one or two directions, every element of the
segmented surface one with directions all around. What the parts turn by is not asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.rivals.machines import MACHINES, Cells, Machine, Plate
from studies.rivals.policies import first_strokes, places
from vibgym.allocation import Allocator
from vibgym.envs.vector import batch_of, environment_id
from vibgym.policies.task_info import TaskInfo

COUNTS = (1, 2, 3, 6, 12)
"""Parts that want something."""

SAMPLES = 50
"""Scenes of parts, as SortTwelve begins, with directions drawn for each."""

AROUND = 32
"""Directions of an element of the segmented surface; between them it is taken for weaker, by half a percent at most."""

FAST = ("segmented", *MACHINES)


class Generators(NamedTuple):
    """Pushes that a machine can do."""

    push: np.ndarray  # (n, elements, 2) of the plate, or (n, 2) of one element each
    element: np.ndarray | None  # (n,) which; None: all
    group: np.ndarray  # (n,) int


def generators(name: str, info: TaskInfo) -> Generators:
    """Of a machine, see the module."""
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
    stroke = first_strokes(info.surface, machine, places(info.surface)).stroke
    push = machine.pushes(np.concatenate([stroke, -stroke])).reshape(2 * len(stroke), -1, 2)
    return Generators(push, None, np.zeros(len(push), dtype=np.int64))


def effects_of(generators: Generators, unit: np.ndarray) -> np.ndarray:
    """(2 parts, n) what parts get of the generators; ``unit`` (elements, 2, parts, 2) of elements' unit pushes."""
    if generators.element is None:
        given = np.einsum("nek,ekpi->npi", generators.push, unit)
    else:
        given = np.einsum("nk,nkpi->npi", generators.push, unit[generators.element])
    return given.reshape(len(given), -1).T


def share(effects: np.ndarray, group: np.ndarray, wanted: np.ndarray) -> float:
    """The largest share of the full push that all parts get in their directions.

    Args:
        effects: (2 parts, n).  group: (n,).
        wanted: (2 parts,) unit vectors, one behind the other.
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
    found = linprog(
        cost, limits, np.ones(len(groups)), equal, np.zeros(len(wanted)), bounds=(0.0, None), method="highs"
    )
    assert found.success, found.message
    return float(-found.fun)


def rows(samples: int = SAMPLES, counts: Sequence[int] = COUNTS, names: Sequence[str] = FAST) -> list[dict[str, Any]]:
    """Mean shares, and how often there is none, by machine and number of parts."""
    env: Any = batch_of(environment_id("SortTwelve"), num_envs=samples)
    env.reset(seed=list(range(samples)))
    info, pose = TaskInfo.of(env), env.unwrapped.truth.pose.copy()
    env.close()
    allocator, elements = Allocator(info.surface, info.parts, info.hardware), info.surface.rows * info.surface.columns
    each = np.eye(2 * elements).reshape(2 * elements, info.surface.rows, info.surface.columns, 2)
    angle = np.random.default_rng(27).uniform(-math.pi, math.pi, (samples, len(info.parts)))
    shares = {(name, count): np.zeros(samples) for name in names for count in counts}
    own = {name: generators(name, info) for name in names}
    for sample in range(samples):
        there = np.ones((len(each), len(info.parts)), dtype=bool)
        unit = allocator.effect(np.tile(pose[sample], (len(each), 1, 1)), there, each)[..., :2]
        unit = unit.reshape(elements, 2, len(info.parts), 2)
        wanted = np.stack([np.cos(angle[sample]), np.sin(angle[sample])], axis=-1)
        for name in names:
            effects = effects_of(own[name], unit)
            for count in counts:
                shares[name, count][sample] = share(effects[: 2 * count], own[name].group, wanted[:count].ravel())
    return [
        {"machine": name, "parts": count, "samples": samples, "share": float(values.mean()),
         "least": float(values.min()), "none": float((values < 1e-6).mean())}
        for (name, count), values in shares.items()
    ]  # fmt: skip
