"""Counter-based random numbers: equal key and counter give equal numbers, independently of earlier draws.

A world's noise therefore does not depend on the number and order of worlds, or on threads, and a snapshot needs only key and
counter. The generator is Philox4x32-10 (J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw: Parallel
random numbers: as easy as 1, 2, 3. SC'11, 2011). Keys are drawn outside the kernels, from the world's generator.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import jit

WORD = 0xFFFFFFFF
_FIRST, _SECOND = 0xD2511F53, 0xCD9E8D57  # multipliers
_WEYL_FIRST, _WEYL_SECOND = 0x9E3779B9, 0xBB67AE85  # increments of the key in each round
_ROUNDS = 10
_STEP = 2.0**-32

KEY_DRAWS = 2
"""Uniform random numbers that :func:`keys_from` needs for a key."""


@jit
def philox(key, a, b, c, d):
    """Return four independent integers in [0, 2^32) for a key and a counter of four words.

    Args:
        key: (2,) int64, each in [0, 2^32).
        a, b, c, d: int64, of which the lower 32 bits count.
    """
    word = np.uint64(WORD)
    k0, k1 = np.uint64(key[0]) & word, np.uint64(key[1]) & word
    x0, x1, x2, x3 = np.uint64(a) & word, np.uint64(b) & word, np.uint64(c) & word, np.uint64(d) & word
    half = np.uint64(32)
    for _ in range(_ROUNDS):
        first, second = np.uint64(_FIRST) * x0, np.uint64(_SECOND) * x2
        x0, x1, x2, x3 = (second >> half) ^ x1 ^ k0, second & word, (first >> half) ^ x3 ^ k1, first & word
        k0, k1 = (k0 + np.uint64(_WEYL_FIRST)) & word, (k1 + np.uint64(_WEYL_SECOND)) & word
    return np.int64(x0), np.int64(x1), np.int64(x2), np.int64(x3)


@jit
def uniforms(key, a, b, c, d):
    """Return four independent uniform numbers in (0, 1), the centres of 2^32 equal intervals."""
    x0, x1, x2, x3 = philox(key, a, b, c, d)
    return (x0 + 0.5) * _STEP, (x1 + 0.5) * _STEP, (x2 + 0.5) * _STEP, (x3 + 0.5) * _STEP


@jit
def normals(key, a, b, c, d):
    """Return four independent standard normal numbers (Box-Muller transform), within 6.7 of zero."""
    u0, u1, u2, u3 = uniforms(key, a, b, c, d)
    r, s = math.sqrt(-2.0 * math.log(u0)), math.sqrt(-2.0 * math.log(u2))
    t, v = 2.0 * math.pi * u1, 2.0 * math.pi * u3
    return r * math.cos(t), r * math.sin(t), s * math.cos(v), s * math.sin(v)


def keys_from(uniform: np.ndarray) -> np.ndarray:
    """Convert uniform numbers (n, 2) in [0, 1) to keys (n, 2) int64."""
    return (uniform * 2.0**32).astype(np.int64)
