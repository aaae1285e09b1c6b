"""The scalar form of :mod:`vibgym.kernels.vector`: a value is one double, and a mask is one truth value."""

from __future__ import annotations

import math

from vibgym.kernels.plain import exact

LANES = WIDTH = 1
"""Doubles of a value."""


@exact
def spread(number):
    """The number."""
    return float(number)


@exact
def load(data, at):
    """The number of a flat array at a place."""
    return data[at]


@exact
def store(data, at, value):
    """Write the number into a flat array at a place."""
    data[at] = value


load_register = load_mask = load
store_mask = store
spread_register = spread


@exact
def bits(mask):
    """1 or 0."""
    return 1 if mask else 0


@exact
def mask_of(number):
    """Whether the number is 1."""
    return number != 0


mask_register = mask_of


@exact
def no(mask):
    """Whether it does not hold."""
    return not mask


@exact
def select(mask, one, other):
    """One value where the mask holds, else the other."""
    return one if mask else other


@exact
def minimum(one, other):
    """The smaller one."""
    return one if one < other else other


@exact
def maximum(one, other):
    """The larger one."""
    return one if one > other else other


@exact
def floor(value):
    """The whole number below."""
    return float(math.floor(value))


@exact
def magnitude(value):
    """Without its sign."""
    return abs(value)


@exact
def copysign(value, sign):
    """The one with the other's sign."""
    return math.copysign(value, sign)


@exact
def root(value):
    """The root."""
    return math.sqrt(value)


@exact
def least(value):
    """The number."""
    return value


@exact
def greatest(value):
    """The number."""
    return value
