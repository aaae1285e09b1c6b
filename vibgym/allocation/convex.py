"""Projections without a smallest amplitude: phasors with a wanted effect, of elements that move up to a largest amplitude.

The feasible phasors are then a convex set, so one start suffices: the phasors of least norm. They are shortened to the limit,
and the phasors of least norm with the missing effect are added to the target, as in :mod:`vibgym.allocation.projections`. The
target thus remains a field of least norm, a uniform push and a rotation of each part, so that only its strengths are iterated.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import exact, jit
from vibgym.kernels.vector import LANES, bits, broadcast, lane_sum, load, maximum, sqrt, store

CLIPS, RELAXATION = 5, 2.0
"""Most projections, and the factor on the missing effect that is added after each but the first. For random effects, most of
them beyond the limit, the root of the expected error has a median of 1.02 times the least one for a part alone and 1.05 for
parts that share elements; with a factor of 1, eight projections give the same."""


@exact
def clip_alone(most, work, n):
    """Compute the effect that the fields of :func:`project` lack, for one part, and the pushes under its pieces.

    Returns:
        The expected error squared, and whether any push was shortened to ``most``.
    """
    a_, ax_, ay_, push_x, push_y = work.lever[0], work.lever[1], work.lever[2], work.push[0], work.push[1]
    for i in range(n, -(-n // LANES) * LANES):
        a_[i], ax_[i], ay_[i], work.weight[i], work.variance[i] = 0.0, 0.0, 0.0, 0.0, 0.0
    along_x, along_y, turn = work.strength[0, 0], work.strength[0, 1], work.strength[0, 2]
    zero = broadcast(0.0)
    x_sum, y_sum, torque, error, clipped = zero, zero, zero, zero, 0
    for i in range(0, n, LANES):
        a, ax, ay, weight = load(a_, i), load(ax_, i), load(ay_, i), load(work.weight, i)
        x, y = weight * (along_x * a - turn * ay), weight * (along_y * a + turn * ax)
        length = sqrt(x * x + y * y)
        clipped |= bits(length > most)
        scale = most / maximum(length, most)
        x, y = scale * x, scale * y
        store(push_x, i, x)
        store(push_y, i, y)
        x_sum, y_sum, torque = x_sum + a * x, y_sum + a * y, torque + (ax * y - ay * x)
        error = error + load(work.variance, i) * (x * x + y * y)
    x, y, z = work.wanted[0] - lane_sum(x_sum), work.wanted[1] - lane_sum(y_sum), work.wanted[2] - lane_sum(torque)
    work.missing[0, 0], work.missing[1, 0], work.missing[2, 0] = x, y, z
    return lane_sum(error) + (x * x + y * y + z * z), clipped != 0


@jit
def clip_group(most, work, parts, elements, n):
    """Compute what :func:`clip_alone` computes, for parts that share elements; the pushes are those of the elements."""
    lever, push, strength, missing = work.lever, work.push, work.strength, work.missing
    for j in range(elements):
        push[0, j], push[1, j] = 0.0, 0.0
    for i in range(n):
        p, j, weight = work.part_index[i], work.element_index[i], work.weight[i]
        push[0, j] += weight * (strength[0, p] * lever[0, i] - strength[0, p + 2] * lever[2, i])
        push[1, j] += weight * (strength[0, p + 1] * lever[0, i] + strength[0, p + 2] * lever[1, i])
    clipped = 0
    for j in range(elements):
        square = push[0, j] * push[0, j] + push[1, j] * push[1, j]
        clipped |= square > most * most
        scale = most / math.sqrt(max(square, most * most))
        push[0, j], push[1, j] = scale * push[0, j], scale * push[1, j]
    expected = 0.0
    for k in range(3 * parts):
        missing[k, 0] = work.wanted[k]
    for i in range(n):
        x, y = push[0, work.element_index[i]], push[1, work.element_index[i]]
        p, a, ax, ay = work.part_index[i], lever[0, i], lever[1, i], lever[2, i]
        missing[p, 0] -= a * x
        missing[p + 1, 0] -= a * y
        missing[p + 2, 0] -= ax * y - ay * x
        expected += work.variance[i] * (x * x + y * y)
    for k in range(3 * parts):
        expected += missing[k, 0] * missing[k, 0]
    return expected, clipped != 0


@jit
def clip(most, work, parts, elements, n):
    """Call :func:`clip_alone` or :func:`clip_group`."""
    return clip_alone(most, work, n) if elements == n else clip_group(most, work, parts, elements, n)


@jit
def project(limits, work, parts, elements, n):
    """Compute phasors of a group, ``work.push``.

    Args:
        limits, work, parts, elements, n: see :func:`vibgym.allocation.projections.gather`, which must have run.
    """
    strength, missing = work.strength, work.missing
    for k in range(3 * parts):
        strength[0, k], missing[k, 0] = 0.0, work.wanted[k]
    least, best = math.inf, 0
    for turn in range(CLIPS):
        factor = 1.0 if turn == 0 else RELAXATION
        for k in range(3 * parts):
            for j in range(3 * parts):
                strength[0, k] += factor * work.inverse[k, j] * missing[j, 0]
        expected, clipped = clip(limits.most, work, parts, elements, n)
        if turn == 0 or expected < least:
            least, best = expected, turn
            for k in range(3 * parts):
                strength[1, k] = strength[0, k]
        if not clipped:
            break
    if best != turn:
        for k in range(3 * parts):
            strength[0, k] = strength[1, k]
        clip(limits.most, work, parts, elements, n)
