"""Count the operations of the planar kernel: ``python -m studies.benchmarks.operations`` prints JSON.

The kernel's source runs as Python, without the compiler, on values of eight lanes that count what is done with them. The counts
are therefore those of the source for one scene: a compiler can only omit operations whose result is not needed. A fused
multiplication and addition counts as two operations, and operations on lanes without a part count as well: the processor
executes them. Scalar operations (indices, elements read lane by lane) are not counted.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

WORLDS, PERIODS, MARGIN, LANES = 64, 25, 0.1, 8
LINE = 64
"""Bytes that a processor reads from memory at once."""

FLOATING = ("add", "multiply", "divide", "sqrt")
SETTINGS = {"NUMBA_DISABLE_JIT": "1"}

counts: Counter[str] = Counter()


def scene() -> tuple[Any, np.ndarray, np.ndarray]:
    """Return a simulator of aluminium blocks, one per world, and random amplitudes and phases."""
    from vibgym import Simulator, Surface
    from vibgym.scene.parts import shipped_part

    surface, rng = Surface(), np.random.default_rng(1)
    far = np.array([surface.columns, surface.rows]) * surface.element_size - MARGIN
    pose = rng.uniform([MARGIN, MARGIN, -math.pi], [*np.maximum(far, MARGIN), math.pi], (WORLDS, 1, 3))
    shape = (WORLDS, surface.rows, surface.columns)
    amplitude, phase = rng.uniform(0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
    simulator = Simulator(surface, shipped_part("aluminium_block"), worlds=WORLDS, threads=1)
    simulator.reset(pose)
    return simulator, amplitude, phase


def measured() -> dict[str, float]:
    """Return the counts per world and period, from a process in which kernels are Python functions.

    Returns:
        Numbers of operations by kind, ``flops`` (their sum over :data:`FLOATING`), ``cache_bytes`` (loads and stores of
        values), and ``memory_bytes``: the cache lines of amplitudes and phases that are read, and the state, read and written.
    """
    done = subprocess.run(
        [sys.executable, "-m", __spec__.name, "--here"], env={**os.environ, **SETTINGS}, text=True, check=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return json.loads(done.stdout)


class Counted:
    """Eight doubles, or eight truth values of a comparison. Operators count each of the lanes."""

    def __init__(self, lanes: Any) -> None:
        self.lanes = lanes


def _lanes(value: Any) -> Any:
    return value.lanes if isinstance(value, Counted) else value


def _counting(kind: str, compute: Callable[..., Any]) -> Callable[..., Counted]:
    def apply(*values: Any) -> Counted:
        counts[kind] += LANES
        return Counted(compute(*map(_lanes, values)))

    return apply


def _operators() -> None:
    kinds = {
        "add": ("add", np.add), "sub": ("add", np.subtract), "mul": ("multiply", np.multiply),
        "truediv": ("divide", np.divide), "lt": ("compare", np.less), "le": ("compare", np.less_equal),
        "gt": ("compare", np.greater), "ge": ("compare", np.greater_equal), "and": ("mask", np.logical_and),
        "or": ("mask", np.logical_or),
    }  # fmt: skip
    for name, (kind, compute) in kinds.items():
        operation = _counting(kind, compute)
        setattr(Counted, f"__{name}__", operation)
        if name in ("add", "sub", "mul", "truediv"):
            setattr(Counted, f"__r{name}__", lambda one, other, operation=operation: operation(other, one))
    Counted.__neg__ = _counting("sign", np.negative)  # type: ignore[attr-defined]


def _load(data: Any, at: int) -> Counted:
    counts["load"] += LANES
    counts["bytes"] += LANES * data.itemsize
    return Counted(np.array(data[at : at + LANES]))


def _store(data: Any, at: int, value: Counted) -> None:
    counts["store"] += LANES
    counts["bytes"] += LANES * data.itemsize
    data[at : at + LANES] = value.lanes


def _broadcast(number: Any) -> Counted:
    return Counted(np.full(LANES, float(number)))


def _mask(number: Any) -> Counted:
    return Counted(np.array([bool(int(number) >> lane & 1) for lane in range(LANES)]))


def _bits(mask: Counted) -> int:
    return int(sum(1 << lane for lane in range(LANES) if mask.lanes[lane]))


def _functions() -> dict[str, Any]:
    """Return all functions of :mod:`vibgym.kernels.vector` for values that count."""
    return {
        "LANES": LANES, "WIDTH": LANES, "load": _load, "load_register": _load, "load_mask": _load,
        "load_like": lambda _, data, at: _load(data, at), "store": _store, "store_mask": _store,
        "broadcast": _broadcast, "broadcast_register": _broadcast, "mask_of": _mask,
        "mask_register": _mask, "bits": _bits, "logical_not": _counting("mask", np.logical_not),
        "select": _counting("select", np.where), "minimum": _counting("select", np.minimum),
        "maximum": _counting("select", np.maximum), "floor": _counting("round", np.floor),
        "absolute": _counting("sign", np.abs), "copysign": _counting("sign", np.copysign),
        "sqrt": _counting("sqrt", np.sqrt), "lane_minimum": lambda value: float(np.min(value.lanes)),
        "lane_maximum": lambda value: float(np.max(value.lanes)), "lane_sum": lambda value: float(np.sum(value.lanes)),
    }  # fmt: skip


def count() -> tuple[dict[str, float], np.ndarray]:
    """Run the scene, for which kernels must be Python functions (:data:`SETTINGS`).

    Returns:
        The counts of :func:`measured`, and the final poses (worlds, 1, 3), m and rad.
    """
    from vibgym.kernels import vector

    _operators()
    counting = _functions()
    known = {name for name, value in vars(vector).items() if callable(value) and not name.startswith("_")}
    if known - counting.keys():  # they would compute with one lane, and be wrong
        raise NotImplementedError(f"functions of vibgym.kernels.vector that do not count: {known - counting.keys()}")
    for name, function in counting.items():
        setattr(vector, name, function)
    from vibgym.physics.core import drive

    read, lines = drive.element_phasor, set()

    def recorded(array: Any, world: int, row: int, column: int) -> Any:
        lines.add((world, row, column * 8 // LINE))
        return read(array, world, row, column)

    drive.element_phasor = recorded
    simulator, amplitude, phase = scene()
    counts.clear()
    touched = 0
    for _ in range(PERIODS):  # a command per period, as in a step of an environment
        simulator.advance(amplitude, phase, 1)
        touched += len(lines)
        lines.clear()
    share, bytes_moved = 1.0 / (WORLDS * PERIODS), counts.pop("bytes")
    state = 2 * 8 * simulator.pose.shape[-1] * 2  # pose and velocity, read and written
    totals = {
        **{kind: number * share for kind, number in sorted(counts.items())},
        "flops": sum(counts[kind] for kind in FLOATING) * share,
        "cache_bytes": bytes_moved * share,
        "memory_bytes": 2 * LINE * touched * share + state,
    }
    return totals, simulator.pose


def main() -> None:
    """Print the counts."""
    print(json.dumps(count()[0] if sys.argv[1:] == ["--here"] else measured(), indent=1))


if __name__ == "__main__":
    main()
