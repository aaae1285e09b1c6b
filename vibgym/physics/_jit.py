"""The one decorator every kernel uses, and the switch of its cache.

``error_model="numpy"`` lets divisions vectorise. The fast-math flags allow contraction and reassociation but keep NaN and
infinity meaningful in comparisons. ``math.isfinite`` is no such guard: it looks at ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf``. Kernels release the GIL: the scene runs blocks of worlds
in threads.

The cache is switched off with ``VIBGYM_CACHE=0``. Numba does not notice edits in imported kernels, so whoever edits one
clears ``__pycache__`` (``make clean``); the tests use a fresh ``NUMBA_CACHE_DIR``.
"""

from __future__ import annotations

import os
from typing import Any

import numba

FAST_MATH = {"contract", "reassoc", "arcp", "nsz", "afn"}

OPTIONS: Any = {
    "error_model": "numpy",
    "fastmath": FAST_MATH,
    "nogil": True,
}

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"


def jit(function: Any) -> Any:
    """Compile ``function`` in nopython mode with the project's options."""
    return numba.njit(cache=CACHE, **OPTIONS)(function)
