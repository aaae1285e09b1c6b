"""Threads that share the worlds of one call.

Kernels release the GIL, so plain threads run blocks of worlds side by side. Each world is computed by the same scalar
code wherever it stands, so results do not depend on the number of threads or on who takes which block. The pool is made
on first use and per process: a fork (AsyncVectorEnv) starts without one.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, TypeVar

from vibgym import checks
from vibgym.physics.planar.pressure_moments import LANES

SMALLEST_BLOCK = 16
"""Worlds below which a second thread costs more than it saves."""

BLOCKS_PER_THREAD = 4
"""More blocks than threads, so that a thread that is held up leaves its share to the others."""

MOST = "VIBGYM_THREADS"
"""Environment variable for schedulers that count processors and assign none, as Ray does."""

_pool: tuple[int, int, ThreadPoolExecutor] | None = None


Tool = TypeVar("Tool")
Result = TypeVar("Result")


class Pool(Generic[Tool]):
    """As many tools (working arrays, contact solvers) as threads are at work at a time, made when they are first needed.

    Copies and pickles start empty.
    """

    def __init__(self, make: Callable[[], Tool]) -> None:
        self._make = make
        self._free = deque([make()])  # a bad setting shows at once

    def lend(self, work: Callable[..., Result], *more: Any) -> Result:
        """What ``work(tool, *more)`` makes of a tool that nobody else uses meanwhile."""
        try:
            tool = self._free.pop()
        except IndexError:
            tool = self._make()
        try:
            return work(tool, *more)
        finally:
            self._free.append(tool)

    def __reduce__(self) -> Any:
        return Pool, (self._make,)


def available_threads() -> int:
    """Processors this process may use: those that the system gives it, at most so many as ``VIBGYM_THREADS`` says."""
    given = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    most = os.environ.get(MOST, "")
    if not most:
        return given
    if not most.isdecimal() or int(most) < 1:
        raise checks.refuse(MOST, most, "a whole number >= 1")
    return min(given, int(most))


def _executor(workers: int) -> ThreadPoolExecutor:
    global _pool
    if _pool is None or _pool[0] != os.getpid() or _pool[1] < workers:
        _pool = (os.getpid(), workers, ThreadPoolExecutor(workers, thread_name_prefix="vibgym"))
    return _pool[2]


def share(work: Callable[[int, int], None], worlds: int, threads: int) -> None:
    """Call ``work(start, stop)`` so that its blocks cover ``range(worlds)``."""
    threads = min(threads, worlds // SMALLEST_BLOCK)
    if threads <= 1:
        work(0, worlds)
        return
    count = min(threads * BLOCKS_PER_THREAD, worlds // SMALLEST_BLOCK)
    # Whole bundles: a block that ends within one would leave lanes empty.
    edges = [min(-(-worlds * k // count // LANES) * LANES, worlds) for k in range(count + 1)]
    blocks = iter(list(zip(edges, edges[1:])))

    def run() -> None:
        for start, stop in blocks:  # a list's iterator hands each block to one thread only
            work(start, stop)

    executor = _executor(threads - 1)
    others = [executor.submit(run) for _ in range(threads - 1)]
    run()  # this thread works too
    for each in others:
        each.result()
