"""Impulses of a step: of a tilted part by Gauss-Seidel sweeps over its contacts, and of a part that lies flat.

A part that has landed on level ground lies flat for the rest of the period, under even pressure as in the planar model.
Contacts at the corners would decelerate its spin three times as fast as even pressure. Four points of equal load with the
second moments of the outline are accurate to second order in the change of slip across the part.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.physics.core.records import grip_of
from vibgym.plugins.tilting.attitude import spin_up
from vibgym.plugins.tilting.ground import plate
from vibgym.plugins.tilting.records import (
    BEFORE,
    CX,
    CY,
    CZ,
    EAST_X,
    EAST_Y,
    EAST_Z,
    GIVE,
    GOAL,
    GRIP,
    LX,
    LY,
    LZ,
    MXX,
    MXY,
    MXZ,
    MYY,
    MYZ,
    MZZ,
    NORTH_X,
    NORTH_Y,
    NORTH_Z,
    PN,
    PX,
    PY,
    RATE,
    RX,
    RY,
    RZ,
    SLIDE,
    SLIP_X,
    SLIP_Y,
    UP_X,
    UP_Y,
    UP_Z,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
)

ENOUGH = 3e-7
"""m/s, largest change in the last sweep."""

MOST_SWEEPS = 60

IMPACT = 0.01
"""m/s, approach velocity above which contacts rebound."""

NO_GAIN = 1e-7
"""J/kg, energy that counts as zero: a fall of ten nanometres."""

SOFTER = 4
"""Most reductions of rebounds that add energy: each halves them, the last one removes them."""

POINTS = 4
"""Contacts of a part that lies flat."""


@jit
def rubbed(contact, k, friction, slip_x, slip_y):
    """Return the impulse over mass (m/s) of friction at a contact that reduces its slip (m/s) within the friction cone."""
    px, py = contact[k, PX] - slip_x * contact[k, SLIDE], contact[k, PY] - slip_y * contact[k, SLIDE]
    limit = friction * contact[k, GRIP] * contact[k, PN]
    if px * px + py * py > limit * limit:  # opposite to the mean slip of the step, so that friction never adds energy
        mean_x, mean_y = slip_x + contact[k, SLIP_X], slip_y + contact[k, SLIP_Y]
        scale = -limit / max(math.sqrt(mean_x * mean_x + mean_y * mean_y), 1e-12)
        px, py = scale * mean_x, scale * mean_y
    return px, py


@jit
def apply_impulses(motion, contact, n, sign):
    """Add the impulses of ``n`` contacts to velocity and angular velocity, or subtract them (``sign`` -1)."""
    for k in range(n):
        pn, px, py = sign * contact[k, PN], sign * contact[k, PX], sign * contact[k, PY]
        motion[VX] += px
        motion[VY] += py
        motion[VZ] += pn
        motion[WX] += pn * contact[k, UP_X] + px * contact[k, EAST_X] + py * contact[k, NORTH_X]
        motion[WY] += pn * contact[k, UP_Y] + px * contact[k, EAST_Y] + py * contact[k, NORTH_Y]
        motion[WZ] += pn * contact[k, UP_Z] + px * contact[k, EAST_Z] + py * contact[k, NORTH_Z]


@jit
def write_levers(motion, contact, n):
    """Write the angular velocities by unit impulses over mass at ``n`` contacts, upward and along x and y."""
    xx, yy, zz, xy, xz, yz = motion[MXX], motion[MYY], motion[MZZ], motion[MXY], motion[MXZ], motion[MYZ]
    for k in range(n):
        rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
        contact[k, UP_X], contact[k, UP_Y], contact[k, UP_Z] = xx * ry - xy * rx, xy * ry - yy * rx, xz * ry - yz * rx
        contact[k, EAST_X], contact[k, EAST_Y] = xy * rz - xz * ry, yy * rz - yz * ry
        contact[k, EAST_Z] = yz * rz - zz * ry
        contact[k, NORTH_X], contact[k, NORTH_Y] = xz * rx - xx * rz, yz * rx - xy * rz
        contact[k, NORTH_Z] = zz * rx - xz * rz


@jit
def settle_contacts(motion, contact, n, friction, table_x, table_y):
    """Iterate over ``n`` contacts to convergence, at most ``MOST_SWEEPS`` times: normal impulse, then friction of each.

    Velocity and angular velocity change, angular momentum does not.
    """
    vx, vy, vz, wx, wy, wz = motion[VX], motion[VY], motion[VZ], motion[WX], motion[WY], motion[WZ]
    most, sweeps = math.inf, 0
    while sweeps < MOST_SWEEPS and most > ENOUGH:
        most = 0.0
        sweeps += 1
        for k in range(n):
            rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
            old = contact[k, PN]
            u = vz + wx * ry - wy * rx - contact[k, RATE]
            normal = max(0.0, old + (contact[k, GOAL] - u) * contact[k, GIVE])
            if normal == 0.0 and old == 0.0:
                continue
            change = normal - old
            contact[k, PN] = normal
            vz += change
            wx += change * contact[k, UP_X]
            wy += change * contact[k, UP_Y]
            wz += change * contact[k, UP_Z]
            slip_x, slip_y = vx + wy * rz - wz * ry - table_x, vy + wz * rx - wx * rz - table_y
            old_x, old_y = contact[k, PX], contact[k, PY]
            px, py = rubbed(contact, k, friction, slip_x, slip_y)
            contact[k, PX], contact[k, PY] = px, py
            dx, dy = px - old_x, py - old_y
            vx += dx
            vy += dy
            wx += dx * contact[k, EAST_X] + dy * contact[k, NORTH_X]
            wy += dx * contact[k, EAST_Y] + dy * contact[k, NORTH_Y]
            wz += dx * contact[k, EAST_Z] + dy * contact[k, NORTH_Z]
            most = max(most, max(abs(change), max(abs(dx), abs(dy))))
    motion[VX], motion[VY], motion[VZ], motion[WX], motion[WY], motion[WZ] = vx, vy, vz, wx, wy, wz


@jit
def gain(motion, contact, n, table_x, table_y):
    """Return the energy over mass (J/kg) that ``n`` contacts add beyond the work of plates and table.

    That is the sum of impulses times the mean of the relative velocities before and after.
    """
    total = 0.0
    for k in range(n):
        rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
        u = motion[VZ] + motion[WX] * ry - motion[WY] * rx - contact[k, RATE]
        slip_x = motion[VX] + motion[WY] * rz - motion[WZ] * ry - table_x
        slip_y = motion[VY] + motion[WZ] * rx - motion[WX] * rz - table_y
        total += contact[k, PN] * (u + contact[k, BEFORE]) + contact[k, PX] * (slip_x + contact[k, SLIP_X])
        total += contact[k, PY] * (slip_y + contact[k, SLIP_Y])
    return 0.5 * total


@jit
def soften(motion, contact, n, scale):
    """Undo the impulses of ``n`` contacts, and reduce the velocities of their rebounds."""
    apply_impulses(motion, contact, n, -1.0)
    for k in range(n):
        contact[k, PN] = contact[k, PX] = contact[k, PY] = 0.0
        contact[k, GOAL] = min(contact[k, GOAL], scale * contact[k, GOAL])


@jit
def keep_impulses(work, n):
    """Add the angular momentum of the impulses of ``n`` contacts, and store them for the next step."""
    motion, contact, warm, kept = work.motion, work.contact, work.warm, 0
    for k in range(n):
        rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
        pn, px, py = contact[k, PN], contact[k, PX], contact[k, PY]
        motion[LX] += ry * pn - rz * py
        motion[LY] += rz * px - rx * pn
        motion[LZ] += rx * py - ry * px
        if pn > 0.0:
            warm[kept, 0], warm[kept, 1] = motion[CX] + rx, motion[CY] + ry
            warm[kept, 2], warm[kept, 3], warm[kept, 4] = pn, px, py
            kept += 1
    work.kept[0] = kept


@jit
def resolve_contacts(work, n, friction, table_x, table_y):
    """Apply the impulses of ``n`` contacts in a step.

    Newton's restitution at several contacts with friction may add energy. Then all rebounds are reduced.

    Args:
        table_x, table_y: m/s, velocity of the table.
    """
    motion, contact, knocks = work.motion, work.contact, False
    for k in range(n):
        knocks = knocks or contact[k, BEFORE] < -IMPACT
    write_levers(motion, contact, n)
    apply_impulses(motion, contact, n, 1.0)
    settle_contacts(motion, contact, n, friction, table_x, table_y)
    tries = 0
    while knocks and tries < SOFTER and gain(motion, contact, n, table_x, table_y) > NO_GAIN:
        tries += 1
        soften(motion, contact, n, 0.5 if tries < SOFTER else 0.0)
        settle_contacts(motion, contact, n, friction, table_x, table_y)
    keep_impulses(work, n)
    spin_up(motion)


@jit
def begin_flat(motion):
    """Set the motion of a part that has almost landed to flat."""
    motion[WX] = motion[WY] = motion[LX] = motion[LY] = 0.0


@jit
def slide_flat(rigid, world, kind, friction, heading, turn):
    """Advance a part that lies flat on plates with equal motion by a step.

    Args:
        heading: rad, at the start of the step.

    Returns:
        The heading at its end.
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
