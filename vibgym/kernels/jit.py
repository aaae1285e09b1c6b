"""Decorators that compile kernels, and how kernels are compiled, decided at import.

===============  ======================================================================================================
``LINKED``       by :mod:`vibgym.kernels.linking`, which needs private interfaces of numba
``PLAIN``        by ``numba.njit(cache=True)``: compiles three times as long
``INTERPRETED``  not compiled (plain Python): slow, for a debugger; ``NUMBA_DISABLE_JIT=1``
===============  ======================================================================================================

``PLAIN`` is chosen with ``VIBGYM_PLAIN_NUMBA=1``, and where the installed numba is untested or lacks an interface; a warning
names the reason. ``VIBGYM_PLAIN_NUMBA=0`` tries the private interfaces of an untested numba.

``VIBGYM_CACHE=0`` disables the cache of compiled kernels; ``NUMBA_CACHE_DIR`` sets its folder.
"""

from __future__ import annotations

import importlib
import logging
import os
from functools import partial
from pathlib import Path
from typing import Any

import numba

from vibgym.kernels.cache import CACHE, sources, warn_about_cache

LOGGER = logging.getLogger("vibgym")

OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "arcp", "nsz", "afn"},
    "nogil": True,
}
"""Options of all kernels.

``error_model="numpy"`` lets LLVM vectorise divisions. The fast-math flags allow contraction and reassociation; comparisons with
NaN and infinity keep their meaning. ``math.isfinite`` does not: it tests ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf`` instead. Kernels release the GIL, since the simulator runs
blocks of worlds on several threads.
"""

LINKED, PLAIN, INTERPRETED = "linked", "plain", "interpreted"

SWITCH = "VIBGYM_PLAIN_NUMBA"

TESTED = (0, 61), (0, 68)
"""First and last version of numba whose private interfaces have been tested."""

config: Any = numba.config  # type: ignore[attr-defined]


def decide() -> tuple[str, str]:
    """Return how kernels are compiled, and why not by the private interfaces."""
    requested, version = os.environ.get(SWITCH, ""), numba.version_info.short  # type: ignore[attr-defined]
    if config.DISABLE_JIT:
        return INTERPRETED, "NUMBA_DISABLE_JIT is set"
    if requested not in ("", "0"):
        return PLAIN, f"{SWITCH} is set"
    if not requested and not TESTED[0] <= version <= TESTED[1]:
        return PLAIN, f"numba {numba.__version__} is untested; {SWITCH}=0 tries its private interfaces"
    try:
        importlib.import_module("vibgym.kernels.linking")
    except (ImportError, AttributeError) as error:
        return PLAIN, f"numba {numba.__version__}: {error}"
    return LINKED, ""


MODE, REASON = decide()

if MODE == PLAIN:
    LOGGER.warning(
        "vibgym: %s: kernels are compiled by numba's public interface, which takes three times as long, once",
        REASON,
    )
elif MODE == INTERPRETED:
    LOGGER.warning("vibgym: %s: kernels are not compiled, and slow", REASON)


def jit(function: Any = None, *, allocates: bool = False, inline: bool = False) -> Any:
    """Compile a function in nopython mode with the project's options.

    Args:
        allocates: the function makes arrays, or gets new ones from functions that it calls. Other kernels only use arrays that
            their callers hold and count no references: counting is atomic and occurs at every use.
        inline: always inline into the caller, whose loop can be vectorised only then.
    """
    if function is None:
        return partial(jit, allocates=allocates, inline=inline)
    return _compile(function, OPTIONS, _nrt=allocates, forceinline=inline)


def exact(function: Any = None, *, inline: bool = False) -> Any:
    """Compile as :func:`jit`, without fast-math: roundings are those of the source, on all processors."""
    if function is None:
        return partial(exact, inline=inline)
    return _compile(function, {**OPTIONS, "fastmath": False}, _nrt=False, forceinline=inline)


def _compile(function: Any, options: dict[str, Any], **private: bool) -> Any:
    if MODE == INTERPRETED:
        return function
    file, state = function.__code__.co_filename, ""
    if CACHE and os.path.isfile(file):  # not of text that was executed
        from vibgym.kernels.vec8 import WIDTH

        # A kernel for one width would write beyond arrays made for another.
        state = f"{sources(file, function.__module__)[:16]}-{WIDTH}"
    if MODE == PLAIN:
        return _plain(function, options, state)
    from vibgym.kernels.linking import kernel

    return kernel(function, {**options, **private}, state)


def _plain(function: Any, options: dict[str, Any], state: str) -> Any:
    """Compile by ``numba.njit``.

    Each state of the sources has its own cache folder, since numba checks a kernel's own file only.
    """
    folder = cache_folder() if state else None
    if folder is None:
        if state:
            warn_about_cache("no folder that may be written")
        return numba.njit(**options)(function)
    before = config.CACHE_DIR
    config.CACHE_DIR = os.path.join(folder, f"plain-{state}")
    try:
        return numba.njit(cache=True, **options)(function)
    finally:
        config.CACHE_DIR = before


def cache_folder() -> str | None:
    """Return the folder of the kernel cache, by default next to source files; None if kernels are not cached."""
    if MODE == INTERPRETED or not CACHE:
        return None
    if MODE == LINKED:
        from vibgym.kernels.linking import default_folder

        folder = default_folder()
        return folder and (config.CACHE_DIR or folder)
    folder = config.CACHE_DIR or str(Path(__file__).parent / "__pycache__")
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None
