"""Kernels compiled by ``numba.njit``, see :mod:`vibgym.kernels.interfaces`.

numba compiles each kernel separately, so compilation takes longer. Results may differ in the last bits: LLVM inlines otherwise.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numba

from vibgym.kernels import options
from vibgym.kernels.interfaces import REASON
from vibgym.kernels.sources import sources
from vibgym.kernels.vec8 import WIDTH

config: Any = numba.config  # type: ignore[attr-defined]


def cache_folder() -> str | None:
    """Return the folder of the kernel cache, by default next to this file; None if kernels are not cached."""
    folder = config.CACHE_DIR or str(Path(__file__).parent / "__pycache__")
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return None
    return folder if options.CACHE and os.access(folder, os.W_OK) else None


def collect(folder: Path) -> None:
    """Raise RuntimeError: wheels cannot contain kernels of this mode."""
    raise RuntimeError(f"{REASON}: with numba's public interface wheels hold no kernels")


def kernel(function: Any, **more: Any) -> Any:
    """Compile a function in nopython mode with the project's options; of ``more``, only ``fastmath`` is public.

    Each state of the sources, and width of registers, has its own cache folder, since numba checks a kernel's own file only.
    """
    settings = {**options.OPTIONS, **({"fastmath": more["fastmath"]} if "fastmath" in more else {})}
    file, folder = function.__code__.co_filename, cache_folder()
    if folder is None and options.CACHE:
        options.warn_about_cache("no folder that may be written")
    if folder is None or not os.path.isfile(file):
        return numba.njit(**settings)(function)
    before = config.CACHE_DIR
    config.CACHE_DIR = os.path.join(folder, f"public-{sources(file, function.__module__)[:16]}-{WIDTH}")
    try:
        return numba.njit(cache=True, **settings)(function)
    finally:
        config.CACHE_DIR = before
