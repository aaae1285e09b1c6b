"""Limits of a core and the planar kernel between them, for :mod:`studies.benchmarks.costs`.

Measured on one core, in turn: multiplications and additions of eight lanes without loads, ``a = b + c d`` on arrays in the
first cache and on arrays larger than all caches, and the kernel. Its operations and bytes are those of
:mod:`studies.benchmarks.operations`. Every time is the smallest of the rounds, in processor time.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from studies import common
from studies.benchmarks import operations
from vibgym.kernels.jit import exact
from vibgym.kernels.vector import LANES, load, store

ROUNDS, WARM = 15, 2
CHAINS = 12
"""Independent chains of multiplications and additions: more than two units with a latency of four cycles need."""

LOOPS = 400_000
NEAR, FAR = 1_000, 8_000_000
"""Doubles of an array in the first cache (8 kB, three of them), and of one that no cache holds (64 MB)."""


@exact
def multiply_add(data, loops):
    """Multiply and add in :data:`CHAINS` chains of eight lanes; ``data`` is flat, the factor, the summand, then the chains."""
    factor, summand = load(data, 0), load(data, LANES)
    a, b, c, d = load(data, 2 * LANES), load(data, 3 * LANES), load(data, 4 * LANES), load(data, 5 * LANES)
    e, f, g, h = load(data, 6 * LANES), load(data, 7 * LANES), load(data, 8 * LANES), load(data, 9 * LANES)
    i, j, k, m = load(data, 10 * LANES), load(data, 11 * LANES), load(data, 12 * LANES), load(data, 13 * LANES)
    for _ in range(loops):
        a, b, c, d = a * factor + summand, b * factor + summand, c * factor + summand, d * factor + summand
        e, f, g, h = e * factor + summand, f * factor + summand, g * factor + summand, h * factor + summand
        i, j, k, m = i * factor + summand, j * factor + summand, k * factor + summand, m * factor + summand
    store(data, 2 * LANES, a + b + c + d + e + f + g + h + i + j + k + m)


@exact
def triad(a, b, c, factor, repeats):
    """Compute ``a = b + c factor`` for flat arrays whose size is a multiple of eight, ``repeats`` times."""
    for _ in range(repeats):
        for at in range(0, a.size, LANES):
            store(a, at, load(b, at) + load(c, at) * factor)


def measure(rounds: int = ROUNDS) -> dict[str, float]:
    """Return limits of a core (flop/s, bytes/s), the time of a period (s), and the counts of :func:`operations.measured`."""
    data = np.linspace(0.1, 0.9, (2 + CHAINS) * LANES)
    near, far = (np.ones((3, size)) for size in (NEAR, FAR))
    repeats = FAR // NEAR // 4
    simulator, amplitude, phase = operations.scene()
    start = simulator.pose.copy()

    def periods() -> None:
        simulator.reset(start)
        for _ in range(operations.PERIODS):
            simulator.advance(amplitude, phase, 1)

    calls: dict[str, Callable[[], object]] = {
        "peak": lambda: multiply_add(data, LOOPS),
        "cache": lambda: triad(near[0], near[1], near[2], 0.5, repeats),
        "memory": lambda: triad(far[0], far[1], far[2], 0.5, 1),
        "kernel": periods,
    }
    took = common.interleaved(calls, rounds, WARM, time.thread_time)
    best = {name: float(times.min()) for name, times in took.items()}
    return {
        "peak": 2 * LANES * CHAINS * LOOPS / best["peak"],
        "cache": 24 * NEAR * repeats / best["cache"],
        "memory": 24 * FAR / best["memory"],
        "period": best["kernel"] / (operations.WORLDS * operations.PERIODS),
        **operations.measured(),
    }
