"""References to records (named tuples of arrays): how kernels pass them on, and how Python passes them to kernels.

numba passes a named tuple by value: at every call it unpacks all arrays into pointers, shapes and strides, several hundred
values for the working arrays of the friction stepper. Compiling that takes longer than compiling the kernels themselves.

- ``reference(record)`` in a kernel is a pointer with the record's fields, to be passed to other kernels.
- ``Pinned(layout, record)`` stores a record in memory. Python passes its ``address`` to kernels.
- ``layout.at(address)`` in a kernel is a reference to that record; ``is_given(address)`` tests for ``layout.none(record)``.
- :func:`bound` is a kernel with its first arguments.

Without compilation (``NUMBA_DISABLE_JIT=1``) a reference or address is the record itself.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np
from numba import typeof, types

from vibgym.kernels.jit import INTERPRETED, MODE, jit

if MODE == INTERPRETED:

    def reference(record: Any) -> Any:
        """Return the record itself."""
        return record

    def reader(layout: Any) -> Any:
        """Return the function that returns the record of an address: itself."""
        return reference

    def is_given(address: Any) -> bool:  # type: ignore[no-redef]
        """Return whether a record is not that of ``Layout.none``, whose first array is empty."""
        return address[0].shape[0] > 0

else:
    from vibgym.kernels.pointers import reader, reference

    @jit
    def is_given(address):
        """Return whether an address is that of a record."""
        return address != 0


Record = TypeVar("Record")


class Layout(Generic[Record]):
    """Types of the fields of a kind of pinned record; the first one that is pinned determines them.

    Args:
        name, module: where this object is defined; copies and pickles refer to it.

    Attributes:
        at: ``at(address)`` in a kernel is a reference to the record at an address.
        record: numba type.
    """

    def __init__(self, name: str, module: str) -> None:
        self.name, self.__module__ = name, module
        self.record: Any = None
        self.at: Any = reader(self)

    def none(self, record: Record) -> Any:
        """Return the address that stands for no record; without compilation a record whose first array is empty."""
        return record if MODE == INTERPRETED else 0

    def __reduce__(self) -> str:
        return self.name


class Pinned(Generic[Record]):
    """A record of integers, floats, arrays and such records at a fixed place in memory.

    Raises:
        TypeError: the record does not have the layout's types.

    Attributes:
        record: for Python.
        address: for kernels, see :attr:`Layout.at`; valid as long as this object exists.
    """

    def __init__(self, layout: Layout[Record], record: Record) -> None:
        kinds = typeof(record)
        layout.record = layout.record or kinds
        if kinds != layout.record:
            raise TypeError(f"{layout.name}: got {kinds}; allowed: {layout.record}")
        self.layout, self.record = layout, record
        fields = [_packed(layout.record[k], value) for k, value in enumerate(record)]  # type: ignore[arg-type]
        self._words = np.frombuffer(bytearray(b"".join(fields)), dtype=np.int64)
        self._offsets = np.cumsum([0, *(len(field) // 8 for field in fields)]).tolist()
        self.address: Any = record if MODE == INTERPRETED else self._words.ctypes.data

    def put(self, record: Record) -> None:
        """Replace the record; fields that are the same object as before are not written again."""
        if MODE == INTERPRETED:
            self.address = record
        else:
            for k, (value, old) in enumerate(zip(record, self.record, strict=True)):  # type: ignore[call-overload]
                if value is not old:
                    self._write(k, value, old)
        self.record = record

    def _write(self, k: int, value: Any, old: Any) -> None:
        at, kind = self._offsets[k], self.layout.record[k]
        if isinstance(value, np.ndarray) and value.shape == old.shape and value.dtype == old.dtype:
            if value.flags.carray and kind.layout == "C":  # only the pointer differs
                self._words[at + _DATA] = value.__array_interface__["data"][0]
                return
        if typeof(value) != kind:
            raise TypeError(f"{self.layout.name}: got {typeof(value)}; allowed: {kind}")
        self._words[at : self._offsets[k + 1]] = np.frombuffer(_packed(kind, value), dtype=np.int64)

    def __reduce__(self) -> Any:
        return Pinned, (self.layout, self.record)


_DATA = 4
"""Index of the pointer to the data among the eight-byte words of an array's struct, see :func:`_packed`."""


def _packed(kind: Any, value: Any) -> bytes:
    """Return a value's representation in memory, a multiple of eight bytes."""
    if isinstance(kind, types.BaseNamedTuple):
        return b"".join(_packed(kind[k], field) for k, field in enumerate(value))  # type: ignore[index]
    if isinstance(kind, types.Array):
        numbers = (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
        return struct.pack(f"={len(numbers)}q", *numbers)
    if kind == types.int64:
        return struct.pack("=q", value)
    if kind == types.float64:
        return struct.pack("=d", value)
    raise TypeError(f"pinned records hold int64, float64, arrays and records; got {kind}")


def bound(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """Return a kernel with its first arguments, of pinned records their addresses, and keep these alive; not copyable."""
    call: Any = partial(kernel, *(arg.address if isinstance(arg, Pinned) else arg for arg in arguments))
    call.keeps = arguments
    return call


__all__ = ["Layout", "Pinned", "bound", "is_given", "reference"]
