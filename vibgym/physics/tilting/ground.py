"""The ground under a part: plates that stand at different heights, blended where one ends and the next begins.

In the table's own frame, which circles with it: borders between plates move with them.
"""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.core.drive import same_command
from vibgym.physics.core.records import grip_of
from vibgym.physics.planar.phasors import phasor_under

ABYSS = -1.0
"""m, height where there is no plate."""

LEVEL = 1e-6
"""m, difference between heights up to which plates count as one: about what a foil gives way under a part (0.03 um) and far
less than what tilts one by a hundredth of a degree."""


@borrowing
def plate(rigid, world, row, column, node, after):
    """Height (m) of a plate's surface ``node`` half steps after the period's start, and its velocity (m/s) ``after`` of them.

    In a step the velocity is that at its end: with which the plate goes on, in the mean, from the middle of the step to the
    middle of the next. So impulses stand where friction does.
    """
    c, s = phasor_under(rigid.work.phasors, 0, rigid.drive, world, row, column)
    w = 2.0 * math.pi / rigid.table.period
    cosine, sine = rigid.scheme.cosine, rigid.scheme.sine
    return (c * cosine[node] - s * sine[node]) / (w * w), -(c * sine[after] + s * cosine[after]) / w


@borrowing
def write_plates(rigid, world, low_x, low_y, high_x, high_y, node, after):
    """Write down heights, velocities and grip of the plates in a box of the table's frame (m), for :func:`ground`.

    Args:
        node, after: see :func:`plate`.

    Returns:
        Height (m) of the highest, or that of no plate if there is none.
    """
    table, work, highest = rigid.table, rigid.work, ABYSS
    size, mask = table.element_size, rigid.work.height.shape[1] - 1
    left, right = max(int(math.floor(low_x / size)), 0), min(int(math.floor(high_x / size)), table.columns - 1)
    bottom, top = max(int(math.floor(low_y / size)), 0), min(int(math.floor(high_y / size)), table.rows - 1)
    for row in range(bottom, top + 1):
        for column in range(left, right + 1):
            height, rate = plate(rigid, world, row, column, node, after)
            i, j = row & mask, column & mask
            work.height[i, j], work.rate[i, j] = height, rate
            work.grip[i, j] = grip_of(rigid.state.patches[world], row, column)
            highest = max(highest, height)
    return highest


@borrowing
def share_of_own(position, index, count, ramp):
    """Which neighbour's height is blended in along one axis, and the share of the element's own.

    Args:
        position: in the element, 0 to 1.
        index, count: of the element, and how many there are.
        ramp: on either side of a border, in elements.

    Returns:
        The neighbour (the element itself where there is none), and the share.
    """
    other, distance = index - 1, position
    if position > 0.5:
        other, distance = index + 1, 1.0 - position
    if distance >= ramp or other < 0 or other >= count:
        return index, 1.0
    return other, 0.5 + 0.5 * distance / ramp


@borrowing
def ground(rigid, x, y):
    """Height (m) and velocity (m/s) of the ground at a point of the table's frame, over plates that are written down."""
    table, ramp, heights, rates = rigid.table, rigid.scheme.blend, rigid.work.height, rigid.work.rate
    u, v = x * rigid.scheme.fineness, y * rigid.scheme.fineness
    if not (u >= 0.0 and v >= 0.0 and u <= table.columns and v <= table.rows):
        return ABYSS, 0.0
    mask = heights.shape[1] - 1
    column, row = min(int(u), table.columns - 1), min(int(v), table.rows - 1)
    height, rate = heights[row & mask, column & mask], rates[row & mask, column & mask]
    other_column, own_x = share_of_own(u - column, column, table.columns, ramp)
    other_row, own_y = share_of_own(v - row, row, table.rows, ramp)
    i, j = other_row & mask, other_column & mask
    if own_x < 1.0:
        height += (1.0 - own_x) * (heights[row & mask, j] - height)
        rate += (1.0 - own_x) * (rates[row & mask, j] - rate)
    if own_y < 1.0:
        beside, going = heights[i, column & mask], rates[i, column & mask]
        if own_x < 1.0:
            beside += (1.0 - own_x) * (heights[i, j] - beside)
            going += (1.0 - own_x) * (rates[i, j] - going)
        height, rate = height + (1.0 - own_y) * (beside - height), rate + (1.0 - own_y) * (going - rate)
    return height, rate


@borrowing
def grip_at(rigid, x, y):
    """Factor on friction of the plate at a point of the table's frame, of those that are written down."""
    table, grip = rigid.table, rigid.work.grip
    mask = grip.shape[1] - 1
    column = min(max(int(x * rigid.scheme.fineness), 0), table.columns - 1)
    return grip[min(max(int(y * rigid.scheme.fineness), 0), table.rows - 1) & mask, column & mask]


@borrowing
def is_level(rigid, world, x, y, reach):
    """Whether all plates within ``reach`` (m) of a point move alike, and none is missing."""
    table = rigid.table
    size = table.element_size
    left, bottom = math.floor((x - reach) / size), math.floor((y - reach) / size)
    right, top = math.floor((x + reach) / size), math.floor((y + reach) / size)
    if not (left >= 0.0 and bottom >= 0.0 and right < table.columns and top < table.rows):
        return False
    w = 2.0 * math.pi / table.period
    most = (LEVEL * w * w) ** 2
    first_row, first_column = int(bottom), int(left)
    c, s = phasor_under(rigid.work.phasors, 0, rigid.drive, world, first_row, first_column)
    for row in range(first_row, int(top) + 1):
        for column in range(first_column, int(right) + 1):
            if same_command(rigid.drive, world, row, column, first_row, first_column):
                continue
            real, imaginary = phasor_under(rigid.work.phasors, 0, rigid.drive, world, row, column)
            if not (real - c) * (real - c) + (imaginary - s) * (imaginary - s) <= most:
                return False
    return True
