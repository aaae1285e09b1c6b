"""Records by reference: how kernels hand on, and keep, named tuples of arrays.

``reference(record)`` in a kernel is what it hands on to others instead of the record. ``Pinned(layout, record).address`` is
what kernels are given of a record that stays the same from call to call, and ``layout.at(address)`` makes a record of it in a
kernel. ``layout.none(record)`` is an address that stands for no record; ``is_given(address)`` asks for that in a kernel.
"""

from __future__ import annotations

from vibgym._numba.jit import borrowing
from vibgym._numba.options import PLAIN

if PLAIN:
    from vibgym._numba.plain import Layout, Pinned, is_given, reference
else:
    from vibgym._numba.by_reference import Layout, Pinned, reference

    @borrowing
    def is_given(address):
        """Whether a record is pinned there."""
        return address != 0


__all__ = ["Layout", "Pinned", "is_given", "reference"]
