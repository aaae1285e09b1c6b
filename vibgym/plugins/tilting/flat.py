"""The rest of a period of a part that has landed on level ground: flat, under even pressure, as the planar model will go on.

Corners alone would brake its spin three times as fast as even pressure does. Four points of equal load that have the outline's
second moments brake it as they should, to second order in the change of slip across the part.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing
from vibgym.physics.core.records import grip_of
from vibgym.plugins.tilting.ground import plate
from vibgym.plugins.tilting.impulses import ENOUGH, MOST_SWEEPS, rubbed
from vibgym.plugins.tilting.records import (
    CX,
    CY,
    CZ,
    GRIP,
    LX,
    LY,
    LZ,
    PN,
    PX,
    PY,
    RX,
    RY,
    RZ,
    SLIDE,
    SLIP_X,
    SLIP_Y,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
)

POINTS = 4


@borrowing
def begin_flat(motion):
    """Let a part that has all but landed lie flat."""
    motion[WX] = motion[WY] = motion[LX] = motion[LY] = 0.0


@borrowing
def slide_flat(rigid, world, kind, friction, heading, turn):
    """Take one step of a part that lies flat on plates that move alike.

    Args:
        heading: rad, at the step's start.

    Returns:
        That at its end.
    """
    table, scheme, motion, contact = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.contact
    step, node, gyration = table.period / scheme.steps, 2 * turn + 1, rigid.bodies.gyration[kind]
    motion[CX] += 0.5 * step * motion[VX]
    motion[CY] += 0.5 * step * motion[VY]
    heading += 0.5 * step * motion[WZ]
    column = min(max(int(motion[CX] / table.element_size), 0), table.columns - 1)
    row = min(max(int(motion[CY] / table.element_size), 0), table.rows - 1)
    _, before = plate(rigid, world, row, column, node, node - 1)
    height, after = plate(rigid, world, row, column, node + 1, node + 1)
    motion[CZ], motion[VZ] = height + rigid.solids.centre_height[kind], after
    normal = max(after - before + step * table.gravity, 0.0)
    motion[VX] += step * rigid.state.incline[world, 0]
    motion[VY] += step * rigid.state.incline[world, 1]
    table_x, table_y = -table.speed * scheme.sine[node], table.speed * scheme.cosine[node]
    cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(POINTS):
        u, v = rigid.solids.cross[kind, k, 0], rigid.solids.cross[kind, k, 1]
        rx, ry = cosine * u - sine * v, sine * u + cosine * v
        contact[k, RX], contact[k, RY], contact[k, RZ] = rx, ry, 0.0
        contact[k, PN], contact[k, PX], contact[k, PY] = 0.25 * normal, 0.0, 0.0
        over = min(max(int((motion[CX] + rx) / table.element_size), 0), table.columns - 1)
        beside = min(max(int((motion[CY] + ry) / table.element_size), 0), table.rows - 1)
        contact[k, GRIP] = grip_of(rigid.state.patches[world], beside, over)
        contact[k, SLIP_X], contact[k, SLIP_Y] = (
            motion[VX] - motion[WZ] * ry - table_x,
            motion[VY] + motion[WZ] * rx - table_y,
        )
        contact[k, SLIDE] = 1.0 / (1.0 + (rx * rx + ry * ry) / gyration)
    sweeps, most = 0, math.inf
    while sweeps < MOST_SWEEPS and most > ENOUGH:
        most = 0.0
        for k in range(POINTS):
            rx, ry = contact[k, RX], contact[k, RY]
            old_x, old_y = contact[k, PX], contact[k, PY]
            slip_x, slip_y = motion[VX] - motion[WZ] * ry - table_x, motion[VY] + motion[WZ] * rx - table_y
            px, py = rubbed(contact, k, friction, slip_x, slip_y)
            contact[k, PX], contact[k, PY] = px, py
            motion[VX] += px - old_x
            motion[VY] += py - old_y
            motion[WZ] += (rx * (py - old_y) - ry * (px - old_x)) / gyration
            most = max(most, max(abs(px - old_x), abs(py - old_y)))
        sweeps += 1
    motion[LZ] = gyration * motion[WZ]
    motion[CX] += 0.5 * step * motion[VX]
    motion[CY] += 0.5 * step * motion[VY]
    return heading + 0.5 * step * motion[WZ]
