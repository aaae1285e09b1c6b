"""The one decorator every kernel uses: how kernels are compiled, once and fast, and where the result is kept.

``jit`` compiles a function in nopython mode with the project's options (:mod:`vibgym.kernels.options`). ``borrowing`` is for
functions that only look at arrays which their callers hold, ``inlined`` for those that must be compiled into their caller's
loop so that it can be vectorised. ``exact`` and ``exact_inlined`` are for those that work on eight doubles at a time
(:mod:`vibgym.kernels.vector`). ``VIBGYM_CACHE=0`` switches the cache off, and ``NUMBA_CACHE_DIR`` says where it is.
"""

from __future__ import annotations

from vibgym.kernels.options import PLAIN

if PLAIN:
    from vibgym.kernels.plain import borrowing, cache_folder, collect, exact, exact_inlined, inlined, jit
else:
    from vibgym.kernels.compiler import borrowing, cache_folder, exact, exact_inlined, inlined, jit
    from vibgym.kernels.shipped import collect

__all__ = ["borrowing", "cache_folder", "collect", "exact", "exact_inlined", "inlined", "jit"]
