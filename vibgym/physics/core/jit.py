"""The one decorator every kernel uses, and its cache.

``error_model="numpy"`` lets divisions vectorise. The fast-math flags allow contraction and reassociation but keep NaN and
infinity meaningful in comparisons. ``math.isfinite`` is no such guard: it looks at ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf``. Kernels release the GIL: the scene runs blocks of worlds
in threads.

numba caches a compiled kernel by the file that holds it and does not notice when a kernel that it calls has changed in
another file: it would go on with the old physics. So the version of every cached kernel also holds a digest of all files
of this folder. ``VIBGYM_CACHE=0`` switches the cache off.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import numba

FAST_MATH = {"contract", "reassoc", "arcp", "nsz", "afn"}

OPTIONS: Any = {
    "error_model": "numpy",
    "fastmath": FAST_MATH,
    "nogil": True,
}

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"

SOURCES = hashlib.sha256(
    b"".join(path.read_bytes() for path in sorted(Path(__file__).parents[1].rglob("*.py")))
).hexdigest()


def inlined(function: Any) -> Any:
    """Like :func:`jit`, for functions that must be compiled into their caller's loop so that it can be vectorised."""
    return numba.njit(forceinline=True, **OPTIONS)(function)


def borrowing(function: Any) -> Any:
    """Like :func:`jit`, for small functions that only look at arrays which their callers hold: without reference counts.

    Atomic counts would take longer than the functions themselves. Such a function must not make, keep or return arrays, nor
    call one that returns arrays.
    """
    options: Any = {**OPTIONS, "_nrt": False}
    return numba.njit(**options)(function)


def jit(function: Any) -> Any:
    """Compile ``function`` in nopython mode with the project's options."""
    kernel: Any = numba.njit(**OPTIONS)(function)
    if CACHE:
        kernel.enable_caching()
        # numba has no public way to say what else a kernel depends on. Were this name to change, the error says so here.
        index = kernel._cache._cache_file
        # The version is looked at before anything else is read, which may no longer be readable.
        index._version = f"{index._version} {SOURCES}"
    return kernel
