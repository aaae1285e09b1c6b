"""Thread pool for blocks of worlds.

Kernels release the GIL, so threads run blocks of worlds in parallel. Results do not depend on the number of threads or on the
assignment of blocks. The pool is created on first use and per process: a fork (AsyncVectorEnv) starts without one.
"""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from vibgym import checks
from vibgym.kernels.vector import LANES

WORTH = 200.0
"""us of work per thread; with less, a further thread costs more time than it saves."""

USUAL_COST = 12.5
"""us, time of a world where it is not known."""

BLOCKS_PER_THREAD = 4
"""More blocks than threads, to balance the load when a thread is delayed."""

VARIABLE = "VIBGYM_THREADS"
"""Environment variable with the number of threads, for schedulers that do not set the CPU affinity, such as Ray."""

Tool = TypeVar("Tool")
Result = TypeVar("Result")


class Pool(Generic[Tool]):
    """Pool of working arrays or contact solvers, one per active thread, created on first use.

    Copies and pickles start empty.

    Attributes:
        make: creates a tool.
        free: unused tools.
    """

    def __init__(self, make: Callable[[], Tool]) -> None:
        self.make = make
        self.free = deque([make()])  # an invalid setting raises immediately

    def lend(self, work: Callable[..., Result], *more: Any) -> Result:
        """Return ``work(tool, *more)`` with a tool of the pool."""
        try:
            tool = self.free.pop()
        except IndexError:
            tool = self.make()
        try:
            return work(tool, *more)
        finally:
            self.free.append(tool)

    def __reduce__(self) -> Any:
        return Pool, (self.make,)


def available_threads() -> int:
    """Return the processors available to this process, at most ``VIBGYM_THREADS``."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    most = os.environ.get(VARIABLE, "")
    if not most:
        return available
    if not most.isdecimal() or int(most) < 1:
        raise checks.refuse(VARIABLE, most, "a whole number >= 1")
    return min(available, int(most))


class _Crew:
    """Worker threads of this process; with ``SimpleQueue`` a call takes half the time of an executor."""

    def __init__(self) -> None:
        self.process, self.threads = os.getpid(), 0
        self.jobs: SimpleQueue[tuple[Callable[[], None], SimpleQueue[BaseException | None]]] = SimpleQueue()

    def grow(self, threads: int) -> None:
        """Start threads up to this number."""
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
        del job, done  # release references while waiting


_crew = _Crew()


class Blocks:
    """Partition of worlds into blocks for threads, the same at every call.

    Args:
        worlds: how many.
        threads: most threads in use.
        cost: us, rough time of a world in a call, by which the number of threads in use is chosen.
        per_thread: blocks for each thread in use.

    Attributes:
        worlds: how many.
        edges: first world of each block, and the one after its last.
    """

    def __init__(
        self, worlds: int, threads: int, cost: float = USUAL_COST, per_thread: int = BLOCKS_PER_THREAD
    ) -> None:
        self.worlds = worlds
        self._threads = max(min(threads, worlds // max(LANES, math.ceil(WORTH / cost))), 1)
        count = min(self._threads * per_thread, worlds // LANES) if self._threads > 1 else 1
        # Multiples of LANES: other blocks would leave vector lanes empty.
        edges = [min(-(-worlds * k // count // LANES) * LANES, worlds) for k in range(count + 1)]
        self.edges = list(zip(edges, edges[1:]))

    def run(self, work: Callable[[int], None]) -> None:
        """Call ``work(k)`` for every block, by its number."""
        global _crew
        if self._threads == 1:
            work(0)
            return
        blocks = deque(range(len(self.edges)))

        def run() -> None:
            while True:
                try:
                    k = blocks.popleft()  # atomic, without the GIL too: each block goes to one thread
                except IndexError:
                    return
                work(k)

        crew = _crew
        if crew.process != os.getpid():
            crew = _crew = _Crew()
        crew.grow(self._threads - 1)
        done: SimpleQueue[BaseException | None] = SimpleQueue()
        for _ in range(self._threads - 1):
            crew.jobs.put((run, done))
        try:
            run()  # this thread works too
        finally:  # wait for all threads
            failures = [done.get() for _ in range(self._threads - 1)]
        for failure in failures:
            if failure is not None:
                raise failure


def share(work: Callable[[int, int], None], worlds: int, threads: int) -> None:
    """Call ``work(start, stop)`` so that its blocks cover ``range(worlds)``."""
    blocks = Blocks(worlds, threads)
    blocks.run(lambda k: work(*blocks.edges[k]))
