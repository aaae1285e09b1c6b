"""Eight doubles as one value of a kernel: one part per lane.

- Operators, ``minimum``, ``maximum``, ``floor``, ``absolute``, ``copysign`` and ``sqrt`` work lane by lane. A number stands for
  itself in every lane; ``broadcast(number)`` makes a value of it.
- Comparisons return masks, which ``&``, ``|`` and ``logical_not`` combine. ``select(mask, one, other)`` takes lanes of ``one``
  where the mask holds. ``bits(mask)`` and ``mask_of(number)`` convert a mask to an integer and back: bit k is lane k.
- ``load`` and ``store`` read and write flat arrays, ``load_mask`` and ``store_mask`` arrays of bool.
- ``lane_minimum``, ``lane_maximum`` and ``lane_sum`` return the smallest lane, the largest one, and the sum of all.
- ``load_register``, ``broadcast_register`` and ``mask_register`` make values of ``WIDTH`` lanes, as many as a register holds;
  ``load_like(value, ...)`` of as many as ``value`` has.

Kernels that use these functions are compiled by :func:`vibgym.kernels.jit.exact`. Without compilation there is one lane, and
values are numbers.
"""

from __future__ import annotations

import math
import operator

import numpy as np

from vibgym.kernels.jit import INTERPRETED, MODE

if MODE == INTERPRETED:
    LANES = WIDTH = 1

    absolute, copysign, floor, sqrt = abs, math.copysign, np.floor, math.sqrt
    logical_not = operator.not_

    def broadcast(number):
        """Return the number as a float."""
        return float(number)

    def load(data, at):
        """Return an item of a flat array."""
        return data[at]

    def load_like(value, data, at):
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
else:
    from vibgym.kernels.vec8 import *  # noqa: F403
