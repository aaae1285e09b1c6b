"""Records by reference: how kernels hand on, and keep, named tuples of arrays.

``reference(record)`` in a kernel is what it hands on to others instead of the record. ``Pinned(layout, record).address`` is
what kernels are given of a record that stays the same from call to call, and ``layout.at(address)`` makes a record of it in a
kernel. ``layout.none(record)`` is an address that stands for no record; ``is_given(address)`` asks for that in a kernel.
:func:`bound` is a kernel with its first arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from vibgym.kernels.jit import borrowing
from vibgym.kernels.options import PLAIN

if PLAIN:
    from vibgym.kernels.plain import Layout, Pinned, is_given, reference
else:
    from vibgym.kernels.by_reference import Layout, Pinned, reference

    @borrowing
    def is_given(address):
        """Whether a record is pinned there."""
        return address != 0


def bound(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """A kernel with its first arguments, which are kept with it: of pinned records the addresses. It cannot be copied."""
    call: Any = partial(kernel, *(each.address if isinstance(each, Pinned) else each for each in arguments))
    call.keeps = arguments
    return call


__all__ = ["Layout", "Pinned", "bound", "is_given", "reference"]
