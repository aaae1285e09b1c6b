"""Decorators that compile kernels.

``VIBGYM_CACHE=0`` disables the cache of compiled kernels; ``NUMBA_CACHE_DIR`` sets its folder.
"""

from __future__ import annotations

from typing import Any

from vibgym.kernels.interfaces import INTERPRETED, MODE, PRIVATE, PUBLIC

if MODE == INTERPRETED:
    from vibgym.kernels.interpreted import cache_folder, collect, kernel
elif MODE == PUBLIC:
    from vibgym.kernels.public import cache_folder, collect, kernel
else:
    from vibgym.kernels.cache import collect
    from vibgym.kernels.compiler import cache_folder, kernel, prefetch
    from vibgym.kernels.helpers import use_all_processors

if MODE != PRIVATE:

    def prefetch(function: Any, *arguments: Any, first: bool = False) -> None:
        """Do nothing: in this mode a kernel is compiled when it is called."""

    def use_all_processors() -> None:
        """Do nothing: in this mode no other process compiles."""


def jit(function: Any) -> Any:
    """Compile a function in nopython mode with the project's options."""
    return kernel(function)


def borrowing(function: Any) -> Any:
    """Compile a function that only uses arrays that its callers hold, without reference counts; it cannot allocate arrays.

    Without them compilation and execution are faster: counting is atomic and occurs at every use.
    """
    return kernel(function, _nrt=False)


def inlined(function: Any) -> Any:
    """Compile as :func:`borrowing`, and inline into the caller, whose loop can be vectorised only then."""
    return kernel(function, _nrt=False, forceinline=True)


def exact(function: Any) -> Any:
    """Compile as :func:`borrowing`, without fast-math: roundings are those of the source, on all processors."""
    return kernel(function, _nrt=False, fastmath=False)


def exact_inlined(function: Any) -> Any:
    """Compile as :func:`exact`, and inline into the caller."""
    return kernel(function, _nrt=False, fastmath=False, forceinline=True)


def unit(function: Any) -> Any:
    """Compile as :func:`borrowing`, by itself: kernels that call it share its machine code, and another process compiles it.

    It returns nothing, and is not called from Python. For large kernels that several others call, or that one calls rarely.
    """
    return kernel(function, unit=True, _nrt=False)


def exact_unit(function: Any) -> Any:
    """Compile as :func:`exact`, by itself, see :func:`unit`."""
    return kernel(function, unit=True, _nrt=False, fastmath=False)


__all__ = [
    "borrowing",
    "cache_folder",
    "collect",
    "exact",
    "exact_inlined",
    "exact_unit",
    "inlined",
    "jit",
    "prefetch",
    "unit",
    "use_all_processors",
]
