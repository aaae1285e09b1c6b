"""Threads that share the worlds of one call.

Kernels release the GIL, so plain threads run blocks of worlds side by side. Each world is computed by the same scalar
code wherever it stands, so results do not depend on the number of threads or on who takes which block. The pool is made
on first use and per process: a fork (AsyncVectorEnv) starts without one.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from vibgym import checks
from vibgym.kernels.vector import LANES

SMALLEST_BLOCK = 16
"""Worlds below which a second thread costs more than it saves."""

BLOCKS_PER_THREAD = 4
"""More blocks than threads, so that a thread that is held up leaves its share to the others."""

MOST = "VIBGYM_THREADS"
"""Environment variable for schedulers that count processors and assign none, as Ray does."""

Tool = TypeVar("Tool")
Result = TypeVar("Result")


class Pool(Generic[Tool]):
    """As many tools (working arrays, contact solvers) as threads are at work at a time, made when they are first needed.

    Copies and pickles start empty.
    """

    def __init__(self, make: Callable[[], Tool]) -> None:
        self._make = make
        self._free = deque([make()])  # a bad setting shows at once

    def take(self) -> Tool:
        """A tool that nobody else uses, until it is given back; one that is lost to an error is made anew."""
        try:
            return self._free.pop()
        except IndexError:
            return self._make()

    def give(self, tool: Tool) -> None:
        """Give back what was taken."""
        self._free.append(tool)

    def lend(self, work: Callable[..., Result], *more: Any) -> Result:
        """What ``work(tool, *more)`` makes of a tool that nobody else uses meanwhile."""
        tool = self.take()
        try:
            return work(tool, *more)
        finally:
            self.give(tool)

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


class _Crew:
    """Threads of this process that wait for work. A queue of C code hands it over in half the time of an executor."""

    def __init__(self) -> None:
        self.process, self.threads = os.getpid(), 0
        self.jobs: SimpleQueue[tuple[Callable[[], None], SimpleQueue[BaseException | None]]] = SimpleQueue()

    def grow(self, threads: int) -> None:
        """Have at least so many."""
        while self.threads < threads:
            self.threads += 1
            threading.Thread(target=_serve, args=(self.jobs,), name=f"vibgym_{self.threads}", daemon=True).start()


def _serve(jobs: SimpleQueue[tuple[Callable[[], None], SimpleQueue[BaseException | None]]]) -> None:
    while True:
        job, done = jobs.get()
        try:
            job()
        except BaseException as error:
            done.put(error)
        else:
            done.put(None)
        del job, done  # or what they hold lives on until there is more work


_crew = _Crew()


class Blocks:
    """Shares worlds out to threads: in blocks that are the same at every call.

    Args:
        worlds: how many.
        threads: that may be at work.

    Attributes:
        worlds: how many.
        edges: first world of each block, and the one after its last.
    """

    def __init__(self, worlds: int, threads: int) -> None:
        self.worlds = worlds
        self._threads = max(min(threads, worlds // SMALLEST_BLOCK), 1)
        count = min(self._threads * BLOCKS_PER_THREAD, worlds // SMALLEST_BLOCK) if self._threads > 1 else 1
        # Whole bundles: a block that ends within one would leave lanes empty.
        edges = [min(-(-worlds * k // count // LANES) * LANES, worlds) for k in range(count + 1)]
        self.edges = list(zip(edges, edges[1:]))

    def run(self, work: Callable[[int], None]) -> None:
        """Call ``work(k)`` for every block, by its number."""
        global _crew
        if self._threads == 1:
            work(0)
            return
        blocks = iter(range(len(self.edges)))

        def run() -> None:
            for k in blocks:  # an iterator of C code hands each block to one thread only
                work(k)

        if _crew.process != os.getpid():
            _crew = _Crew()
        _crew.grow(self._threads - 1)
        done: SimpleQueue[BaseException | None] = SimpleQueue()
        for _ in range(self._threads - 1):
            _crew.jobs.put((run, done))
        try:
            run()  # this thread works too
        finally:  # nobody is to work on when this returns
            failures = [done.get() for _ in range(self._threads - 1)]
        for each in failures:
            if each is not None:
                raise each


def share(work: Callable[[int, int], None], worlds: int, threads: int) -> None:
    """Call ``work(start, stop)`` so that its blocks cover ``range(worlds)``."""
    blocks = Blocks(worlds, threads)
    blocks.run(lambda k: work(*blocks.edges[k]))
