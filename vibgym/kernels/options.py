"""Options of all compiled kernels, and the environment variables that change them; read once, at import.

``error_model="numpy"`` lets LLVM vectorise divisions. The fast-math flags allow contraction and reassociation; comparisons with
NaN and infinity keep their meaning. ``math.isfinite`` does not: it tests ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf`` instead. Kernels release the GIL, since the simulator runs
blocks of worlds on several threads.
"""

from __future__ import annotations

import functools
import logging
import os
from typing import Any

LOGGER = logging.getLogger("vibgym")

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"
"""Whether compiled kernels are cached on disk."""

BITCODE = os.environ.get("VIBGYM_BITCODE", "1") != "0"
"""Whether kernels come from the wheel's bitcode, if it has any for this Python, numba and platform."""

OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "arcp", "nsz", "afn"}, "nogil": True}


def processors() -> int:
    """Return the processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@functools.cache
def warn_about_cache(reason: str) -> None:
    """Warn that compiled kernels are not cached, once for each reason."""
    LOGGER.warning(
        "vibgym: compiled kernels cannot be kept (%s) and are compiled anew by every process; set NUMBA_CACHE_DIR to a folder "
        "that may be written",
        reason,
    )
