"""Ground under a part: plates at different heights, blended at their borders; in the frame that moves with the table."""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.physics.core.drive import clear_phasors, commands_equal, phasor_under
from vibgym.physics.core.records import grip_of
from vibgym.plugins.tilting.records import LIFT

ABYSS = -1.0
"""m, height without a plate."""

LEVEL = 1e-6
"""m, largest difference in height of level plates; it tilts a part by far less than 0.01 deg."""


@jit
def plate(rigid, world, row, column, node, after):
    """Return the height (m) of a plate ``node`` half steps after the period's start, and its velocity (m/s) ``after`` of them.

    The velocity of a step is that at its end, the mean from the middle of the step to the middle of the next, so that normal
    impulses and friction act at the same instant.
    """
    c, s = phasor_under(rigid.work.phasors, 0, rigid.drive, world, row, column)
    w = 2.0 * math.pi / rigid.table.period
    cosine, sine = rigid.scheme.cosine, rigid.scheme.sine
    return (c * cosine[node] - s * sine[node]) / (w * w), -(c * sine[after] + s * cosine[after]) / w


@jit
def write_plates(rigid, world, low_x, low_y, high_x, high_y, node, after):
    """Write heights, velocities and grip of the plates in a box of the table's frame (m), for :func:`ground`.

    The highest plates of each column and row and the largest speed are written as well.

    Args:
        node, after: see :func:`plate`.

    Returns:
        Height (m) of the highest plate; ``ABYSS`` without plates.
    """
    table, work, highest, fastest = rigid.table, rigid.work, ABYSS, 0.0
    size, mask = table.element_size, rigid.work.height.shape[1] - 1
    left, right = max(int(math.floor(low_x / size)), 0), min(int(math.floor(high_x / size)), table.columns - 1)
    bottom, top = max(int(math.floor(low_y / size)), 0), min(int(math.floor(high_y / size)), table.rows - 1)
    for column in range(left, right + 1):
        work.highest[0, column & mask] = ABYSS
    for row in range(bottom, top + 1):
        of_row = ABYSS
        for column in range(left, right + 1):
            height, rate = plate(rigid, world, row, column, node, after)
            i, j = row & mask, column & mask
            work.height[i, j], work.rate[i, j] = height, rate
            work.grip[i, j] = grip_of(rigid.state.patches[world], row, column)
            of_row, fastest = max(of_row, height), max(fastest, abs(rate))
            work.highest[0, j] = max(work.highest[0, j], height)
        work.highest[1, row & mask] = of_row
        highest = max(highest, of_row)
    work.motion[LIFT] = fastest
    return highest


@jit
def share_of_own(position, index, count, steepness):
    """Return the neighbour whose height is blended in along one axis, and its weight.

    Args:
        position: in the element, 0 to 1.
        index, count: of the element, and number of elements.
        steepness: decrease of the element's share per element length.

    Returns:
        The neighbour (the element itself where there is none), its share, and the derivative of the share by position.
    """
    upward = position > 0.5
    distance = 1.0 - position if upward else position
    other = index + 1 if upward else index - 1
    share = max(0.5 - steepness * distance, 0.0)
    slope = 0.0 if share == 0.0 else (steepness if upward else -steepness)
    return index if other < 0 or other >= count else other, share, slope


@jit
def ground(rigid, x, y):
    """Return the ground at a point of the table's frame, by the plates of :func:`write_plates`.

    Returns:
        Height (m), velocity (m/s), and slope along x and y.
    """
    table, scheme, heights, rates = rigid.table, rigid.scheme, rigid.work.height, rigid.work.rate
    u, v = x * scheme.fineness, y * scheme.fineness
    if not (u >= 0.0 and v >= 0.0 and u <= table.columns and v <= table.rows):
        return ABYSS, 0.0, 0.0, 0.0
    mask = heights.shape[1] - 1
    column, row = min(int(u), table.columns - 1), min(int(v), table.rows - 1)
    other_column, share_x, slope_x = share_of_own(u - column, column, table.columns, scheme.steepness)
    other_row, share_y, slope_y = share_of_own(v - row, row, table.rows, scheme.steepness)
    # Branch-free. Plates outside the working arrays have weight 0.
    i, j, k, m = row & mask, column & mask, other_row & mask, other_column & mask
    own, along, across, both = heights[i, j], heights[i, m], heights[k, j], heights[k, m]
    near, far = own + share_x * (along - own), across + share_x * (both - across)
    rate, other_rate = rates[i, j], rates[k, j]
    rate, other_rate = rate + share_x * (rates[i, m] - rate), other_rate + share_x * (rates[k, m] - other_rate)
    climb_x = slope_x * (along - own + share_y * (both - across - along + own))
    return (
        near + share_y * (far - near), rate + share_y * (other_rate - rate),
        scheme.fineness * climb_x, scheme.fineness * (slope_y * (far - near)),
    )  # fmt: skip


@jit
def ground_on_line(rigid, axis, own, along, at):
    """Return the ground on a line across an axis at which a plate's ramp ends, by the plates of :func:`write_plates`.

    Args:
        own, along: indices of the plate along the axis and along the other.
        at: m, position along the other axis in the table's frame, over that plate.

    Returns:
        Height (m) and velocity (m/s).
    """
    table, scheme, heights, rates = rigid.table, rigid.scheme, rigid.work.height, rigid.work.rate
    mask = heights.shape[1] - 1
    count = table.rows if axis == 0 else table.columns
    other, share, _ = share_of_own(at * scheme.fineness - along, along, count, scheme.steepness)
    i, j = (along & mask, own & mask) if axis == 0 else (own & mask, along & mask)
    k, m = (other & mask, j) if axis == 0 else (i, other & mask)
    height, rate = heights[i, j], rates[i, j]
    return height + share * (heights[k, m] - height), rate + share * (rates[k, m] - rate)


@jit
def grip_at(rigid, x, y):
    """Return the factor on friction at a point of the table's frame, by the plates of :func:`write_plates`."""
    table, grip = rigid.table, rigid.work.grip
    mask = grip.shape[1] - 1
    column = min(max(int(x * rigid.scheme.fineness), 0), table.columns - 1)
    return grip[min(max(int(y * rigid.scheme.fineness), 0), table.rows - 1) & mask, column & mask]


@jit
def begin_reading(rigid, kind):
    """Reset the cached drive, for a part of this kind."""
    clear_phasors(rigid.work.phasors, 0)
    rigid.work.phasors.coupling[0] = rigid.bodies.coupling[kind]


@jit
def is_level(rigid, world, kind, x, y, reach):
    """Return whether all plates within ``reach`` (m) of a point have equal motion for a kind of parts, and none is missing."""
    table = rigid.table
    size = table.element_size
    left, bottom = math.floor((x - reach) / size), math.floor((y - reach) / size)
    right, top = math.floor((x + reach) / size), math.floor((y + reach) / size)
    if not (left >= 0.0 and bottom >= 0.0 and right < table.columns and top < table.rows):
        return False
    first_row, first_column = int(bottom), int(left)
    if commands_equal(rigid.drive, world, first_row, first_column, int(top), int(right)):
        return True
    w = 2.0 * math.pi / table.period
    most = (LEVEL * w * w) ** 2
    begin_reading(rigid, kind)
    c, s = phasor_under(rigid.work.phasors, 0, rigid.drive, world, first_row, first_column)
    for row in range(first_row, int(top) + 1):
        for column in range(first_column, int(right) + 1):
            real, imaginary = phasor_under(rigid.work.phasors, 0, rigid.drive, world, row, column)
            if not (real - c) * (real - c) + (imaginary - s) * (imaginary - s) <= most:
                return False
    return True
