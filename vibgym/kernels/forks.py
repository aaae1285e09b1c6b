"""A process that forks while another thread compiles: the fork waits until the kernel is done.

The child would inherit numba's and llvmlite's locks as they are, held by a thread that it does not have, and wait forever at
its first kernel. Python's own locks are dealt with in the same way (:mod:`logging`).
"""

from __future__ import annotations

import os

from llvmlite.binding import ffi
from numba.core.compiler_lock import global_compiler_lock


def _acquire() -> None:
    global_compiler_lock.acquire()
    ffi.lib._lock._lock.acquire()


def _release() -> None:
    ffi.lib._lock._lock.release()
    global_compiler_lock.release()


if hasattr(os, "register_at_fork"):  # not on Windows, where nothing forks
    os.register_at_fork(before=_acquire, after_in_parent=_release, after_in_child=_release)
