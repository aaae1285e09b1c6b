"""Kernels as plain Python functions, which a debugger can step through: ``NUMBA_DISABLE_JIT=1``.

Records are passed as they are, and a vector has one lane. Results agree with those of compiled kernels to rounding.
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np

# -- records -----------------------------------------------------------------------------------------------------------


def reference(record: Any) -> Any:
    """Return the record itself."""
    return record


def reader(layout: Any) -> Any:
    """Return the function that returns the record of an address: itself."""
    return reference


def is_given(address: Any) -> bool:
    """Return whether a record is not that of ``Layout.none``, whose first array is empty."""
    return address[0].shape[0] > 0


class Memory:
    """A pinned record; its address is the record."""

    def __init__(self, layout: Any, record: Any) -> None:
        self.address = record

    def replace(self, before: Any, record: Any) -> None:
        """Replace the record."""
        self.address = record


# -- vectors of one lane, see vibgym.kernels.vector ---------------------------------------------------------------------

LANES = WIDTH = 1


absolute, copysign, floor, sqrt = abs, math.copysign, np.floor, math.sqrt
logical_not = operator.not_


def broadcast(number):
    """Return the number as a float."""
    return float(number)


def load(data, at):
    """Return an item of a flat array."""
    return data[at]


def store(data, at, value):
    """Write an item of a flat array."""
    data[at] = value


def bits(mask):
    """Return 1 or 0."""
    return 1 if mask else 0


def mask_of(number):
    """Return whether the number is not zero."""
    return number != 0


def select(mask, one, other):
    """Return ``one`` where the mask holds, else ``other``."""
    return one if mask else other


def minimum(one, other):
    """Return the smaller one; the second if either is NaN."""
    return one if one < other else other


def maximum(one, other):
    """Return the larger one; the second if either is NaN."""
    return one if one > other else other


def _identity(value):
    return value


lane_minimum = lane_maximum = lane_sum = _identity
load_register = load_mask = load
store_mask = store
broadcast_register = broadcast
mask_register = mask_of
