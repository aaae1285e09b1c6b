"""Dynamic programming on a grid of two state variables: largest gain in a number of periods."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit


class Moves(NamedTuple):
    """Transitions of one period from every node of the grid.

    Attributes:
        gain: (n, m, controls) increase of the objective.
        reached: (n, m, controls, 2) resulting state, in grid indices.
        cyclic: whether the first axis is periodic.
    """

    gain: np.ndarray
    reached: np.ndarray
    cyclic: bool


@jit
def _weights(at):
    """Return the Lagrange weights of four nodes at -1, 0, 1, 2 for a position ``at`` in [0, 1]."""
    below, above, far = at + 1.0, 1.0 - at, 2.0 - at
    return -at * above * far / 6.0, below * above * far / 2.0, below * at * far / 2.0, -below * at * above / 6.0


@jit
def interpolated(value, cyclic, row, column):
    """Interpolate ``value`` (n, m) at fractional indices by cubics; indices beyond non-periodic edges are clamped."""
    n, m = value.shape
    if cyclic:
        low = math.floor(row)
        first, u = int(low) - 1, row - low
    else:
        inside = min(max(row, 0.0), n - 1.0)
        first = min(max(int(inside) - 1, 0), n - 4)
        u = inside - first - 1.0
    inside = min(max(column, 0.0), m - 1.0)
    left = min(max(int(inside) - 1, 0), m - 4)
    v0, v1, v2, v3 = _weights(inside - left - 1.0)
    w = _weights(u)
    total = 0.0
    for k in range(4):
        i = (first + k) % n
        total += w[k] * (
            v0 * value[i, left] + v1 * value[i, left + 1] + v2 * value[i, left + 2] + v3 * value[i, left + 3]
        )
    return total


@jit
def best(gain, reached, cyclic, sign, value, result):
    """Compute ``max over controls of sign * gain + value(reached)`` for every node.

    Args:
        gain, reached, cyclic: see :class:`Moves`.
        value: (n, m) value function.  result: (n, m), overwritten.
    """
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            most = -math.inf
            for k in range(gain.shape[2]):
                there = interpolated(value, cyclic, reached[i, j, k, 0], reached[i, j, k, 1])
                most = max(most, sign * gain[i, j, k] + there)
            result[i, j] = most


def overshoots(moves: Moves, instants: int, stride: int) -> np.ndarray:
    """Return the least overshoot before the state can be held, (n, m).

    Gains count at ``instants`` moments only, ``stride`` periods apart; the first one is now and counts as zero.
    """
    room = np.zeros(moves.gain.shape[:2])
    result = np.empty_like(room)
    for _ in range(instants - 1):
        for _ in range(stride):
            best(moves.gain, moves.reached, moves.cyclic, -1.0, room, result)
            room, result = result, room
        np.minimum(room, 0.0, out=room)
    return -room


def furthest(moves: Moves, overshoot: np.ndarray, allowed: float, price: float, periods: int) -> np.ndarray:
    """Return the largest gain in 0, 1, ..., ``periods`` periods before the state can be held within ``allowed``.

    The constraint on the overshoot is relaxed: each unit beyond ``allowed`` costs ``price``. For every price the result is
    therefore an upper bound of the constrained problem.

    Returns:
        (periods + 1, n, m) by initial state.
    """
    value = np.empty((periods + 1, *overshoot.shape))
    value[0] = -price * np.maximum(overshoot - allowed, 0.0)
    for k in range(periods):
        best(moves.gain, moves.reached, moves.cyclic, 1.0, value[k], value[k + 1])
    return value
