"""Phasors of the elements under a part, each read from the drive once a call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.physics.core.drive import element_phasor


class Phasors(NamedTuple):
    """What has been read for parts, a slot each.

    Size is a power of two and at least a part's extent in elements, and places go by row and column modulo size, so that no
    two elements under a part share one.
    """

    coupling: np.ndarray  # (slots,) share of the elements' vertical motion that reaches the part
    element: np.ndarray  # (slots, size, size) which element a place holds, -1: none
    c: np.ndarray  # (slots, size, size) m/s^2
    s: np.ndarray


def new_phasors(slots: int, across: int, coupling: float = 1.0) -> Phasors:
    """Places for parts that extend over up to ``across`` elements along an axis."""
    size = 1 << max(across - 1, 0).bit_length()
    shape = slots, size, size
    return Phasors(np.full(slots, coupling), np.full(shape, -1), np.zeros(shape), np.zeros(shape))


@borrowing
def forget_phasors(phasors, slot):
    """Forget what has been read for a part."""
    size = phasors.element.shape[1]
    for i in range(size):
        for j in range(size):
            phasors.element[slot, i, j] = -1


@borrowing
def phasor_under(phasors, slot, drive, world, row, column):
    """``(C, S)`` in m/s^2 of the element at ``(row, column)`` in ``world``, as it reaches the part of a slot."""
    mask = phasors.element.shape[1] - 1
    i, j = row & mask, column & mask
    element = row << 32 | column
    if phasors.element[slot, i, j] != element:
        phasors.element[slot, i, j] = element
        c, s = element_phasor(drive, world, row, column)
        phasors.c[slot, i, j], phasors.s[slot, i, j] = phasors.coupling[slot] * c, phasors.coupling[slot] * s
    return phasors.c[slot, i, j], phasors.s[slot, i, j]
