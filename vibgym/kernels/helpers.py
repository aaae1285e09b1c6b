"""Processes that compile kernels while this one compiles others, into the same cache.

A job is a kernel with types of arguments. :func:`submit` announces one that this process will need: kernels that a new scene
calls (:func:`vibgym.kernels.jit.prefetch`), and units that a kernel under compilation calls. A helper process takes the first
waiting job, compiles it and stores it in the cache; it reports units that the job calls, which become jobs themselves. A kernel
that is called here before a helper has taken its job is compiled here. While a helper compiles it, this process works on
other jobs.

Helpers need the cache. There are as many as further processors, at most ``LIMIT``; none in processes that ``multiprocessing``
has started, where others compile at the same time. They end after ``IDLE`` s without work, with this process, or when it is
killed. A job whose helper fails or dies is done here; the error of a helper is logged at level DEBUG. ``VIBGYM_HELPERS=0``
disables them, another number sets the limit.
"""

from __future__ import annotations

import atexit
import bisect
import contextlib
import importlib
import logging
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

from numba.core.serialize import dumps

from vibgym.kernels.options import processors

LOGGER = logging.getLogger("vibgym")

Job = tuple[str, str, tuple[Any, ...]]
"""Module and name of a kernel, and types of its arguments."""

LIMIT = int(os.environ.get("VIBGYM_HELPERS") or 3)
PATIENCE = 120.0
"""s after which a job that a helper compiles is done here."""

IDLE = 30.0
"""s without a job after which a helper ends."""

WAITING, RUNNING, DONE, HERE = "waiting", "running", "done", "here"

_START = "import sys; sys.path[:] = {path!r}; from vibgym.kernels.helpers import serve; serve()"


class Helpers:
    """The helper processes of this process, and the state of all jobs."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._change = threading.Condition()
        self._state: dict[Job, str] = {}
        self._queue: list[tuple[float, Job, bytes]] = []  # smallest first
        self._processes: list[subprocess.Popen[bytes]] = []
        self._idle = 0

    def submit(self, job: Job, size: float, pickled: bytes) -> None:
        """Add a job that is not known yet, and start a helper for it unless one is idle."""
        with self._change:
            if job in self._state:
                return
            self._state[job] = WAITING  # counts for the announced time, with and without helpers
            if not self.limit or not pickled:
                return
            bisect.insort(self._queue, (size, job, pickled), key=lambda each: each[0])
            self._change.notify_all()
            if len(self._queue) <= self._idle or len(self._processes) >= self.limit:
                return
            try:
                process = _process()
            except OSError:
                self.limit = 0
                return
            self._processes.append(process)
            self._idle += 1
        threading.Thread(target=self._feed, args=(process,), daemon=True).start()

    def waiting(self) -> list[Job]:
        """Return the jobs that are not done."""
        with self._change:
            return [job for job, state in self._state.items() if state in (WAITING, RUNNING)]

    def claim(self, job: Job, compile_here: Callable[[Job], None]) -> None:
        """Return when this process should compile a job, or load it from the cache; do others while a helper compiles it."""
        until = time.monotonic() + PATIENCE
        while True:
            with self._change:
                state = self._state.get(job)
                if state == RUNNING and not self._queue and time.monotonic() < until:
                    self._change.wait(1.0)
                    continue
                if state != RUNNING or time.monotonic() >= until:
                    if state != DONE:
                        self._take(job)
                    return
                _, other, _ = self._queue.pop(0)
                self._state[other] = HERE
            compile_here(other)

    def _take(self, job: Job) -> None:
        self._state[job] = HERE
        self._queue = [each for each in self._queue if each[1] != job]

    def _feed(self, process: Any) -> None:
        """Give jobs to a helper, the largest one first, as long as it lives."""
        job = None
        try:
            _read(process.stdout)  # it has started
            while True:
                with self._change:
                    while not self._queue:
                        if not self._change.wait(IDLE) and not self._queue:
                            self._processes.remove(process)
                            self._idle -= 1
                            break
                    else:
                        _, job, pickled = self._queue.pop()
                        self._state[job] = RUNNING
                        self._idle -= 1
                if job is None:
                    process.stdin.close()
                    process.wait()
                    return
                _write(process.stdin, pickled)
                while (answer := _read(process.stdout)) is not None:
                    found, size, more = pickle.loads(answer)
                    if found is None:
                        LOGGER.debug("vibgym: a helper could not compile %s:\n%s", ".".join(job[:2]), more)
                    else:
                        self.submit(found, size, answer)
                with self._change:
                    self._state[job] = DONE
                    self._idle += 1
                    job = None
                    self._change.notify_all()
        except (OSError, EOFError, ValueError):  # the helper is gone
            with self._change:
                if process in self._processes:
                    self._processes.remove(process)
                if job is None:
                    self._idle -= 1
                else:
                    self._state.pop(job)
                self.limit = 0 if not self._processes else self.limit
                self._change.notify_all()

    def stop(self) -> None:
        """End all helpers."""
        with self._change:
            self.limit = 0
            for process in self._processes:
                process.kill()

    def forget(self) -> None:
        """After a fork: leave the helpers to the parent, which the child's copies of the pipes must not keep alive."""
        for process in self._processes:
            process.returncode = 0  # unknown here, and no reason to warn
            for pipe in (process.stdin, process.stdout):
                pipe.raw.close()  # type: ignore[union-attr]  # the pipe's own lock may be held by a thread of the parent


def _process() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", _START.format(path=sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def _write(pipe: Any, content: bytes) -> None:
    pipe.write(len(content).to_bytes(8, "little") + content)
    pipe.flush()


def _read(pipe: Any) -> bytes | None:
    """Return what the other side has written; None if it was empty.

    Raises:
        EOFError: the other side is gone.
    """
    length = pipe.read(8)
    if len(length) < 8:
        raise EOFError
    return pipe.read(int.from_bytes(length, "little")) or None


# -- in this process -----------------------------------------------------------------------------------------------------


def _new() -> Helpers:
    # A program that embeds Python names itself as the executable.
    python = "python" in os.path.basename(sys.executable or "").lower()
    allowed = python and multiprocessing.parent_process() is None
    return Helpers(min(LIMIT, processors() - 1) if allowed else 0)


_helpers = _new()


def _renew() -> None:
    global _helpers
    _helpers.forget()
    _helpers = Helpers(0)


atexit.register(lambda: _helpers.stop())
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)

_parent: Any = None
"""In a helper: the pipe to the process it works for."""


def is_helper() -> bool:
    """Return whether this process is a helper."""
    return _parent is not None


def submit(job: Job, size: float, layouts: list[Any] | None) -> None:
    """Announce a kernel that will be needed and is not in the cache.

    Args:
        job: the kernel.
        size: of its code, or infinity; helpers begin with the largest.
        layouts: layouts of pinned records with their types, which types of arguments do not contain; None: no helper can store
            the kernel, so that it is compiled here.
    """
    if job[0] == "__main__":  # a helper cannot import it
        return
    pickled = b"" if layouts is None else dumps((job, size, layouts))
    if _parent is not None and pickled:
        _write(_parent, pickled)
    else:
        _helpers.submit(job, size, pickled)


def waiting() -> list[Job]:
    """Return the announced jobs that are not done."""
    return _helpers.waiting()


def use_all_processors() -> None:
    """Remove the limit on helpers but the number of processors, unless ``VIBGYM_HELPERS`` sets one."""
    if "VIBGYM_HELPERS" not in os.environ and _helpers.limit:
        _helpers.limit = processors() - 1


def speedup() -> float:
    """Return how many times as fast as alone on an idle host this process and its helpers are expected to compile."""
    load = os.getloadavg()[0] / processors() if hasattr(os, "getloadavg") else 0.0
    return (1.0 + 0.6 * _helpers.limit) / max(1.0, load)


def claim(job: Job, compile_here: Callable[[Job], None]) -> None:
    """Return when this process should load or compile a kernel; meanwhile compile others."""
    if _parent is None:
        _helpers.claim(job, compile_here)


# -- in a helper ---------------------------------------------------------------------------------------------------------


def kernel_of(job: Job) -> Any:
    """Return the kernel of a job."""
    return getattr(importlib.import_module(job[0]), job[1])


def serve() -> None:
    """Compile jobs from standard input until it ends."""
    global _parent
    jobs, _parent = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what imported modules print
    _write(_parent, b"")
    with contextlib.suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        while (pickled := _read(jobs)) is not None:
            try:
                job, _, layouts = pickle.loads(pickled)
                for module, name, record in layouts:
                    layout = getattr(importlib.import_module(module), name)
                    layout.record = layout.record or record
                kernel_of(job).compile(job[2])
            except Exception:  # the other process compiles it, and raises the error
                _write(_parent, dumps((None, 0, traceback.format_exc())))
            _write(_parent, b"")
