"""Work side by side in processes of this machine, or one after the other here."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import current_process
from typing import Any, TypeVar

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from vibgym.imports import take_part, taking_part
from vibgym.simulation.threads import available_threads

Found = TypeVar("Found")
Submit = Callable[..., "Future[Any]"]

LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that say how many threads numerical libraries start."""

TRIES = 5
"""How often a piece of work is begun: where a process is killed all its pool begins again, whoever's fault it was."""


def usable(processes: int) -> int:
    """So many of ``processes`` as there are processors for."""
    return min(processes, available_threads())


@contextmanager
def side_by_side(processes: int) -> Iterator[Submit]:
    """Gives ``submit(function, *arguments)``, which returns a future; with one process all is done at once, and here.

    The processors are shared out, lest every process starts threads on all of them. Processes are started anew, not forked (by
    joblib's loky): a fork of a program with threads may hang. A piece of work whose process was killed begins again.
    """
    processes = usable(processes)
    if processes == 1:
        yield _at_once
        return
    pools = Pools(processes)
    try:
        yield pools.submit
    except BaseException:
        pools.kill()
        raise
    else:
        pools.close()


def on_one_thread(function: Callable[..., Found], *arguments: Any) -> Found:
    """What a function finds in a process of its own, in which no library has more than one thread."""
    pools = Pools(1, threads=1)
    try:
        return pools.submit(function, *arguments).result()
    finally:
        pools.kill()


class Pools:
    """A pool of processes, and another one whenever a process of it has been killed, which breaks the whole pool.

    Args:
        processes: of a pool.
        threads: of libraries in each; None: as many as its share of the processors.
    """

    def __init__(self, processes: int, threads: int | None = None) -> None:
        self.processes, self.threads = processes, threads or available_threads() // processes
        self._lock = threading.Lock()
        self._over = False
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        share = dict.fromkeys(LIBRARIES, str(self.threads))
        return ProcessPoolExecutor(
            self.processes, env=share, initializer=_settle, initargs=(self.processes, taking_part())
        )

    def submit(self, function: Callable[..., Found], *arguments: Any) -> Future[Found]:
        """See :func:`side_by_side`."""
        asked: Future[Found] = Future()
        self._begin(asked, TRIES, function, arguments)
        return asked

    def _begin(self, asked: Future[Any], tries: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        with self._lock:
            pool = self._pool

        def done(found: Future[Any]) -> None:
            error = None if found.cancelled() else found.exception()
            if isinstance(error, BrokenProcessPool) and tries > 1 and not self._over:
                with self._lock:
                    if self._pool is pool:  # the first of its pieces of work to come back
                        self._pool = self._started()
                self._begin(asked, tries - 1, function, arguments)
            elif found.cancelled():
                asked.cancel()
            elif error is not None:
                asked.set_exception(error)
            else:
                asked.set_result(found.result())

        with _held_back():  # here processes are started
            try:
                started = pool.submit(function, *arguments)
            except BrokenProcessPool as error:
                started = Future()
                started.set_exception(error)
        started.add_done_callback(done)

    def close(self) -> None:
        """Wait for all that has been asked for."""
        self._over = True
        self._pool.shutdown(wait=True)

    def kill(self) -> None:
        """End all processes, at once."""
        self._over = True
        self._pool.shutdown(wait=True, kill_workers=True)


def _at_once(function: Callable[..., Found], *arguments: Any) -> Future[Found]:
    future: Future[Found] = Future()
    future.set_result(function(*arguments))
    return future


@contextmanager
def _held_back() -> Iterator[None]:
    """Ctrl-C waits. Processes that are started meanwhile let it wait until :func:`_settle`, lest imports print tracebacks."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _settle(processes: int, modules: tuple[str, ...] = ()) -> None:
    """The beginning of a process: its share of the processors, and an end, quiet when the user interrupts, with its parent.

    ``modules``: a user's own, which take part here as they do there.
    """
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if hasattr(os, "sched_setaffinity"):
        number = int(current_process().name.rpartition("-")[2])  # loky counts its processes
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[number % processes :: processes])
    take_part(modules)


def _end_with(parent: int) -> None:
    """Whoever was killed shall be begun again, and no process of the old run then hold what it has to write."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
