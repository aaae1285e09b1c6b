"""Work side by side in processes of its own, or one after the other here."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from vibgym.simulation.threads import available_threads

Found = TypeVar("Found")
Submit = Callable[..., "Future[Any]"]

LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that say how many threads numerical libraries start."""


def usable(processes: int) -> int:
    """So many of ``processes`` as there are processors for."""
    return min(processes, available_threads())


@contextmanager
def side_by_side(processes: int) -> Iterator[Submit]:
    """Gives ``submit(function, *arguments)``, which returns a future; with one process all is done at once, and here.

    The processors are shared out, lest every process starts threads on all of them. Processes are started anew, not forked:
    a fork of a program with threads may hang.
    """
    processes = usable(processes)
    if processes == 1:
        yield _at_once
        return
    context = multiprocessing.get_context("spawn")
    before = {name: os.environ.get(name) for name in LIBRARIES}
    os.environ.update(dict.fromkeys(LIBRARIES, str(available_threads() // processes)))  # read where processes start
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _settle, (context.Value("i", 0), processes))

    def submit(function: Callable[..., Found], *arguments: Any) -> Future[Found]:
        with _held_back():  # here processes are started
            return pool.submit(function, *arguments)

    try:
        yield submit
    except KeyboardInterrupt:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()  # those that it has not reached: of a signal to this process alone, and while they start
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


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


def _settle(started: Any, processes: int) -> None:
    """The beginning of a process: its share of the processors, and a quiet end when the user interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    with started.get_lock():
        number, started.value = started.value, started.value + 1
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[number % processes :: processes])
