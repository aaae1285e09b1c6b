"""Kernels on numba's public interface alone: ``VIBGYM_PLAIN_NUMBA=1``.

The same kernels, but each is compiled by itself, records are handed on by value, and what is pinned is handed over anew by
every call from Python. That takes minutes to compile and is slower to run. Results differ in the last digits: the compiler
inlines and rounds differently.

Also with ``NUMBA_DISABLE_JIT=1``: then kernels are plain Python functions, through which a debugger can step.
"""

from __future__ import annotations

import ctypes
import logging
import os
from pathlib import Path
from typing import Any, Generic, TypeVar

import numba
import numba.experimental.function_type  # or a function that is handed over has no type before the first is compiled
from numba import types

from vibgym.kernels import options
from vibgym.kernels.sources import sources

logging.getLogger("vibgym").warning(
    "vibgym: VIBGYM_PLAIN_NUMBA is set: kernels take minutes to compile and are slower, for they lean on numba's public "
    "interface alone"
)

config: Any = numba.config  # type: ignore[attr-defined]

Record = TypeVar("Record")


def cache_folder() -> str | None:
    """Where kernels are kept once they are compiled, by default in this file's folder; None: nowhere."""
    folder = config.CACHE_DIR or str(Path(__file__).parent / "__pycache__")
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return None
    return folder if options.CACHE and os.access(folder, os.W_OK) else None


def collect(folder: Path) -> None:
    """Nothing can be shipped in this mode."""
    raise RuntimeError("VIBGYM_PLAIN_NUMBA is set: in this mode wheels hold no kernels")


def _compiled(function: Any, more: Any) -> Any:
    """numba looks for cached kernels by their file alone. So each state of what the file imports has a folder of its own."""
    settings = {**options.OPTIONS, **more}
    file, folder = function.__code__.co_filename, cache_folder()
    if folder is None and options.CACHE:
        options.warn_about_cache("no folder that may be written")
    if folder is None or not os.path.isfile(file):
        return numba.njit(**settings)(function)
    before = config.CACHE_DIR
    digest = sources(file, function.__module__)
    config.CACHE_DIR = os.path.join(folder, f"plain-{digest[:16]}")
    try:
        return numba.njit(cache=True, **settings)(function)
    finally:
        config.CACHE_DIR = before


def jit(function: Any) -> Any:
    """Compile ``function`` in nopython mode with the project's options."""
    return _compiled(function, {})


def exact(function: Any) -> Any:
    """Likewise without fast-math."""
    return _compiled(function, {"fastmath": False})


borrowing = inlined = jit
exact_inlined = exact


@jit
def reference(record):
    """The record itself."""
    return record


@jit
def _at(address):
    return address


@jit
def is_given(address):
    """Whether it stands for a record: one whose first array holds something."""
    return address[0].shape[0] > 0


class Layout(Generic[Record]):
    """What all pinned records of a kind look like; the first one says it.

    Args:
        name, module: where this object is found.

    Attributes:
        at: ``at(address)`` in a kernel is the record that is pinned there.
    """

    def __init__(self, name: str, module: str) -> None:
        self.name, self.__module__ = name, module
        self.record: Any = None  # its numba type
        self.at: Any = _at

    def none(self, record: Record) -> Any:
        """What stands for no record: one whose first array is empty."""
        return record

    def __reduce__(self) -> str:
        """Copies and pickles are this object: it stands under its name in its module."""
        return self.name


class Pinned(Generic[Record]):
    """A record that stays where it is in memory, with what its arrays hold.

    Attributes:
        record: itself, for Python.
        address: for kernels, see :attr:`Layout.at`; here the record again.
    """

    def __init__(self, layout: Layout[Record], record: Record) -> None:
        kind = numba.typeof(record)
        layout.record = layout.record or kind
        if kind != layout.record:
            raise TypeError(f"{layout.name}: got {kind}; allowed: {layout.record}")
        self.layout, self.record = layout, record

    def put(self, record: Record) -> None:
        """Let another record of the kind stand here."""
        if numba.typeof(record) != self.layout.record:
            raise TypeError(f"{self.layout.name}: got {numba.typeof(record)}; allowed: {self.layout.record}")
        self.record = record

    @property
    def address(self) -> Any:
        """For kernels."""
        return self.record


class _Foreign(types.WrapperAddressProtocol):
    """A compiled function of another library, as numba lets kernels take functions as arguments."""

    def __init__(self, address: int, arguments: tuple[str, ...]) -> None:
        self._address = address
        self._signature = types.void(*(getattr(types, each) for each in arguments))

    def __wrapper_address__(self) -> int:
        return self._address

    def __call__(self, *arguments: Any) -> None:
        """For Python."""
        kinds = (ctypes.c_double if isinstance(each, float) else ctypes.c_int64 for each in arguments)
        ctypes.CFUNCTYPE(None, *kinds)(self._address)(
            *(each.item() if hasattr(each, "item") else each for each in arguments)
        )

    def signature(self) -> Any:
        """Of the function."""
        return self._signature


def foreign(address: int, *arguments: str) -> Any:
    """What kernels call; see :mod:`vibgym.kernels.foreign`."""
    return _Foreign(address, arguments)


@jit
def call_foreign(function, arguments):
    """Call it, and throw its result away."""
    function(*arguments)
