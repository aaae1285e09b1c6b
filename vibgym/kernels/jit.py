"""Decorators that compile kernels.

``VIBGYM_CACHE=0`` disables the cache of compiled kernels; ``NUMBA_CACHE_DIR`` sets its folder.
"""

from __future__ import annotations

from functools import partial
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


def jit(function: Any = None, *, allocates: bool = False, inline: bool = False) -> Any:
    """Compile a function in nopython mode with the project's options.

    Args:
        allocates: the function makes arrays. Other kernels use arrays that their callers hold and count no references: counting
            is atomic and occurs at every use.
        inline: always inline into the caller, whose loop can be vectorised only then.
    """
    if function is None:
        return partial(jit, allocates=allocates, inline=inline)
    return kernel(function, **_options(allocates, inline))


def exact(function: Any = None, *, inline: bool = False) -> Any:
    """Compile as :func:`jit`, without fast-math: roundings are those of the source, on all processors."""
    if function is None:
        return partial(exact, inline=inline)
    return kernel(function, fastmath=False, **_options(False, inline))


def _options(allocates: bool, inline: bool) -> dict[str, bool]:
    return {"_nrt": allocates, **({"forceinline": True} if inline else {})}


__all__ = ["cache_folder", "collect", "exact", "jit", "prefetch", "use_all_processors"]
