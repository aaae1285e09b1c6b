"""Kernels on numba's public interface alone: ``VIBGYM_PLAIN_NUMBA=1``.

The same kernels, but numba compiles each of them separately, records are passed by value, and Python passes pinned records
anew at every call. Compilation takes minutes, and kernels are slower. Results agree to rounding: LLVM inlines differently.

With ``NUMBA_DISABLE_JIT=1`` as well, kernels are plain Python functions, which a debugger can step through.
"""

from __future__ import annotations

import ctypes
import logging
import math
import operator
import os
from pathlib import Path
from typing import Any

import numba
import numba.experimental.function_type  # without it a function as an argument has no type before the first compilation
import numpy as np
from numba import types

from vibgym.kernels import options
from vibgym.kernels.sources import sources

logging.getLogger("vibgym").warning(
    "vibgym: VIBGYM_PLAIN_NUMBA is set: with numba's public interface alone, kernels take minutes to compile and are slower"
)

config: Any = numba.config  # type: ignore[attr-defined]

# -- compilation -------------------------------------------------------------------------------------------------------


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
    raise RuntimeError("VIBGYM_PLAIN_NUMBA is set: in this mode wheels hold no kernels")


def kernel(function: Any, fastmath: Any = options.OPTIONS["fastmath"], **private: Any) -> Any:
    """Compile a function in nopython mode with the project's options; those that numba does not document have no effect.

    Each state of the sources has its own cache folder, since numba checks a kernel's own file only.
    """
    settings = {**options.OPTIONS, "fastmath": fastmath}
    file, folder = function.__code__.co_filename, cache_folder()
    if folder is None and options.CACHE:
        options.warn_about_cache("no folder that may be written")
    if folder is None or not os.path.isfile(file):
        return numba.njit(**settings)(function)
    before = config.CACHE_DIR
    config.CACHE_DIR = os.path.join(folder, f"plain-{sources(file, function.__module__)[:16]}")
    try:
        return numba.njit(cache=True, **settings)(function)
    finally:
        config.CACHE_DIR = before


# -- records -----------------------------------------------------------------------------------------------------------


@kernel
def reference(record):
    """Return the record itself."""
    return record


def reader(layout: Any) -> Any:
    """Return the function that returns the record of an address: itself."""
    return reference


@kernel
def is_given(address):
    """Return whether a record is not that of ``Layout.none``, whose first array is empty."""
    return address[0].shape[0] > 0


class Memory:
    """A pinned record; its address is the record."""

    def __init__(self, layout: Any, record: Any) -> None:
        self._layout, self.address = layout, record

    def replace(self, before: Any, record: Any) -> None:
        """Replace the record."""
        kind = numba.typeof(record)
        if kind != self._layout.record:
            raise TypeError(f"{self._layout.name}: got {kind}; allowed: {self._layout.record}")
        self.address = record


# -- functions of other libraries --------------------------------------------------------------------------------------


class _Foreign(types.WrapperAddressProtocol):
    """A function of another library as numba's first-class function."""

    def __init__(self, address: int, arguments: tuple[str, ...]) -> None:
        self._address = address
        self._signature = types.void(*(getattr(types, each) for each in arguments))

    def __wrapper_address__(self) -> int:
        return self._address

    def __call__(self, *arguments: Any) -> None:
        """Call the function from Python, as kernels do under ``NUMBA_DISABLE_JIT=1``."""
        kinds = (ctypes.c_double if isinstance(each, float) else ctypes.c_int64 for each in arguments)
        ctypes.CFUNCTYPE(None, *kinds)(self._address)(
            *(each.item() if hasattr(each, "item") else each for each in arguments)
        )

    def signature(self) -> Any:
        return self._signature


def foreign(address: int, *arguments: str) -> Any:
    """Return what kernels take for a function of another library."""
    return _Foreign(address, arguments)


@kernel
def call_foreign(function, arguments):
    """Call a function of another library and discard its result."""
    function(*arguments)


# -- vectors of one lane, see vibgym.kernels.vector ---------------------------------------------------------------------

LANES = WIDTH = 1


def exact(function: Any) -> Any:
    """Compile without fast-math."""
    return kernel(function, fastmath=False)


absolute, copysign, floor, sqrt = abs, math.copysign, np.floor, math.sqrt
logical_not = operator.not_


@exact
def broadcast(number):
    """Return the number as a float."""
    return float(number)


@exact
def load(data, at):
    """Return an item of a flat array."""
    return data[at]


@exact
def store(data, at, value):
    """Write an item of a flat array."""
    data[at] = value


@exact
def bits(mask):
    """Return 1 or 0."""
    return 1 if mask else 0


@exact
def mask_of(number):
    """Return whether the number is not zero."""
    return number != 0


@exact
def select(mask, one, other):
    """Return ``one`` where the mask holds, else ``other``."""
    return one if mask else other


@exact
def minimum(one, other):
    """Return the smaller one; the second if either is NaN."""
    return one if one < other else other


@exact
def maximum(one, other):
    """Return the larger one; the second if either is NaN."""
    return one if one > other else other


@exact
def _identity(value):
    return value


lane_minimum = lane_maximum = lane_sum = _identity
load_register = load_mask = load
store_mask = store
broadcast_register = broadcast
mask_register = mask_of
