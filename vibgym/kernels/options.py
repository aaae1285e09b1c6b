"""What kernels are compiled with, in every mode, and what the environment variables say. Read once, at import.

``error_model="numpy"`` lets divisions vectorise. The fast-math flags allow contraction and reassociation but keep NaN and
infinity meaningful in comparisons. ``math.isfinite`` is no such guard: it looks at ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf``. Kernels release the GIL: the simulator runs blocks of worlds
in threads.
"""

from __future__ import annotations

import functools
import logging
import os
from typing import Any

LOGGER = logging.getLogger("vibgym")

PLAIN = os.environ.get("VIBGYM_PLAIN_NUMBA", "0") not in ("", "0")
"""Whether kernels lean on numba's public interface alone (:mod:`vibgym.kernels.plain`): slower, for a numba that is too new."""

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"
"""Whether compiled kernels are kept."""

FAST_MATH = {"contract", "reassoc", "arcp", "nsz", "afn"}

OPTIONS: Any = {"error_model": "numpy", "fastmath": FAST_MATH, "nogil": True}

FIRST_STEP = "10 to 40 s"
"""What the kernels of an environment take to compile (studies/benchmarks/cold_start.py)."""


@functools.cache
def warn_about_cache(reason: str) -> None:
    """Say once for each reason why nothing is kept."""
    LOGGER.warning(
        "vibgym: compiled kernels cannot be kept (%s) and are compiled anew by every process; set NUMBA_CACHE_DIR to a folder "
        "that may be written",
        reason,
    )
