"""Sine and cosine of eight angles at a time."""

from __future__ import annotations

import math

from vibgym.kernels.jit import exact_inlined
from vibgym.kernels.vector import floor, maximum, minimum, select

_PER_QUARTER = 2.0 / math.pi

# A quarter turn in three numbers, the first two of 33 bits: products with whole numbers of up to 20 bits are exact.
_HIGH, _MIDDLE, _LOW = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21

_WIDEST = 0.8
"""More than an eighth of a turn is left only of angles so large that their neighbours are farther away than that."""


@exact_inlined
def sincos(angle):
    """``(sin, cos)`` to 1e-16, for angles of up to 1e6 rad; for larger ones to the angle's own last digit.

    By the Taylor series up to the 16th order within an eighth of a turn, where its next terms are below 1e-16.
    """
    turns = floor(angle * _PER_QUARTER + 0.5)
    x = ((angle - turns * _HIGH) - turns * _MIDDLE) - turns * _LOW
    x = minimum(maximum(x, -_WIDEST), _WIDEST)
    quarter = turns - 4.0 * floor(0.25 * turns)
    square = x * x
    sine = -1.0 / 1307674368000.0
    sine = sine * square + 1.0 / 6227020800.0
    sine = sine * square - 1.0 / 39916800.0
    sine = sine * square + 1.0 / 362880.0
    sine = sine * square - 1.0 / 5040.0
    sine = sine * square + 1.0 / 120.0
    sine = sine * square - 1.0 / 6.0
    sine = x * square * sine + x
    cosine = 1.0 / 20922789888000.0
    cosine = cosine * square - 1.0 / 87178291200.0
    cosine = cosine * square + 1.0 / 479001600.0
    cosine = cosine * square - 1.0 / 3628800.0
    cosine = cosine * square + 1.0 / 40320.0
    cosine = cosine * square - 1.0 / 720.0
    cosine = cosine * square + 1.0 / 24.0
    cosine = cosine * square - 0.5
    cosine = cosine * square + 1.0
    odd = (quarter > 0.5) & (quarter < 1.5) | (quarter > 2.5)
    one, other = select(odd, cosine, sine), select(odd, sine, cosine)
    return select(quarter > 1.5, -one, one), select((quarter > 0.5) & (quarter < 2.5), -other, other)
