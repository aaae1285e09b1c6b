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

from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

import numba

from vibgym.kernels.jit import INTERPRETED, MODE, jit

if MODE == INTERPRETED:
    from vibgym.kernels.interpreted import Memory, is_given, reader, reference
else:
    from vibgym.kernels.pointers import Memory, reader, reference

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
        kind = numba.typeof(record)
        layout.record = layout.record or kind
        if kind != layout.record:
            raise TypeError(f"{layout.name}: got {kind}; allowed: {layout.record}")
        self._memory = Memory(layout, record)
        self.layout, self.record, self.address = layout, record, self._memory.address

    def put(self, record: Record) -> None:
        """Replace the record; fields that are the same object as before are not written again."""
        self._memory.replace(self.record, record)
        self.record, self.address = record, self._memory.address

    def __reduce__(self) -> Any:
        return Pinned, (self.layout, self.record)


def bound(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """Return a kernel with its first arguments, of pinned records their addresses, and keep these alive; not copyable."""
    call: Any = partial(kernel, *(each.address if isinstance(each, Pinned) else each for each in arguments))
    call.keeps = arguments
    return call


__all__ = ["Layout", "Pinned", "bound", "is_given", "reference"]
