"""Impulses of a step: contacts push no farther than they must, and friction stops slip as far as it can (Gauss and Seidel)."""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.tilting.attitude import spin_up
from vibgym.physics.tilting.records import (
    BEFORE,
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
    ORIGIN,
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
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
)

ENOUGH = 1e-7
"""m/s, of change in a sweep below which it is the last."""

MOST_SWEEPS = 60

IMPACT = 0.01
"""m/s, above which contacts rebound."""

NO_GAIN = 1e-7
"""J/kg, of energy that counts as none: a fall of ten nanometres."""

SOFTER = 4
"""How often rebounds are halved where they would give energy; the last time they are left out."""


@borrowing
def push(motion, rx, ry, rz, px, py, pz):
    """Change the velocities by an impulse over mass (m/s) at an arm (m)."""
    motion[VX] += px
    motion[VY] += py
    motion[VZ] += pz
    lx, ly, lz = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
    motion[LX] += lx
    motion[LY] += ly
    motion[LZ] += lz
    motion[WX] += motion[MXX] * lx + motion[MXY] * ly + motion[MXZ] * lz
    motion[WY] += motion[MXY] * lx + motion[MYY] * ly + motion[MYZ] * lz
    motion[WZ] += motion[MXZ] * lx + motion[MYZ] * ly + motion[MZZ] * lz


@borrowing
def rub(motion, contact, k, friction, table_x, table_y):
    """Let friction of one contact stop its slip as far as it can; returns the largest change of its impulse over mass, m/s."""
    rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
    slip_x = motion[VX] + motion[WY] * rz - motion[WZ] * ry - table_x
    slip_y = motion[VY] + motion[WZ] * rx - motion[WX] * rz - table_y
    old_x, old_y = contact[k, PX], contact[k, PY]
    px, py = old_x - slip_x * contact[k, SLIDE], old_y - slip_y * contact[k, SLIDE]
    limit = friction * contact[k, GRIP] * contact[k, PN]
    if px * px + py * py > limit * limit:  # against the mean of slip before and after: so friction never gives energy
        mean_x, mean_y = slip_x + contact[k, SLIP_X], slip_y + contact[k, SLIP_Y]
        scale = -limit / max(math.sqrt(mean_x * mean_x + mean_y * mean_y), 1e-12)
        px, py = scale * mean_x, scale * mean_y
    contact[k, PX], contact[k, PY] = px, py
    push(motion, rx, ry, rz, px - old_x, py - old_y, 0.0)
    return max(abs(px - old_x), abs(py - old_y))


@borrowing
def sweep(motion, contact, n, friction, table_x, table_y):
    """Go through ``n`` contacts once; returns the largest change of an impulse over mass, m/s."""
    most = 0.0
    for k in range(n):
        rx, ry = contact[k, RX], contact[k, RY]
        u = motion[VZ] + motion[WX] * ry - motion[WY] * rx - contact[k, RATE]
        old = contact[k, PN]
        normal = max(0.0, old + (contact[k, GOAL] - u) * contact[k, GIVE])
        contact[k, PN] = normal
        push(motion, rx, ry, contact[k, RZ], 0.0, 0.0, normal - old)
        most = max(most, max(abs(normal - old), rub(motion, contact, k, friction, table_x, table_y)))
    return most


@borrowing
def settle_contacts(motion, contact, n, friction, table_x, table_y):
    """Sweep until nothing changes any more, or often enough."""
    sweeps = 0
    while sweeps < MOST_SWEEPS and sweep(motion, contact, n, friction, table_x, table_y) > ENOUGH:
        sweeps += 1


@borrowing
def gain(motion, contact, n, table_x, table_y):
    """Energy over mass (J/kg) that ``n`` contacts give besides what plates and table do: their impulses times the means of the
    relative velocities before and after."""
    total = 0.0
    for k in range(n):
        rx, ry, rz = contact[k, RX], contact[k, RY], contact[k, RZ]
        u = motion[VZ] + motion[WX] * ry - motion[WY] * rx - contact[k, RATE]
        slip_x = motion[VX] + motion[WY] * rz - motion[WZ] * ry - table_x
        slip_y = motion[VY] + motion[WZ] * rx - motion[WX] * rz - table_y
        total += contact[k, PN] * (u + contact[k, BEFORE]) + contact[k, PX] * (slip_x + contact[k, SLIP_X])
        total += contact[k, PY] * (slip_y + contact[k, SLIP_Y])
    return 0.5 * total


@borrowing
def soften(motion, contact, n, scale):
    """Take the impulses of ``n`` contacts back, and aim at slower rebounds."""
    for k in range(n):
        push(motion, contact[k, RX], contact[k, RY], contact[k, RZ], -contact[k, PX], -contact[k, PY], -contact[k, PN])
        contact[k, PN] = contact[k, PX] = contact[k, PY] = 0.0
        contact[k, GOAL] = min(contact[k, GOAL], scale * contact[k, GOAL])


@borrowing
def resolve_contacts(motion, contact, n, friction, table_x, table_y, warm):
    """Let ``n`` contacts push the part for a step.

    Newton's restitution at several contacts with friction may give energy: then all rebound more slowly, until they do not.

    Args:
        table_x, table_y: m/s, velocity of the table.
        warm: (corners, 3) impulses of the corners, overwritten.
    """
    knocks = False
    for k in range(n):
        push(motion, contact[k, RX], contact[k, RY], contact[k, RZ], contact[k, PX], contact[k, PY], contact[k, PN])
        knocks = knocks or contact[k, BEFORE] < -IMPACT
    settle_contacts(motion, contact, n, friction, table_x, table_y)
    tries = 0
    while knocks and tries < SOFTER and gain(motion, contact, n, table_x, table_y) > NO_GAIN:
        tries += 1
        soften(motion, contact, n, 0.5 if tries < SOFTER else 0.0)
        settle_contacts(motion, contact, n, friction, table_x, table_y)
    for k in range(warm.shape[0]):
        warm[k, 0] = warm[k, 1] = warm[k, 2] = 0.0
    for k in range(n):
        origin = int(contact[k, ORIGIN])
        if origin >= 0:
            warm[origin, 0], warm[origin, 1], warm[origin, 2] = contact[k, PN], contact[k, PX], contact[k, PY]
    spin_up(motion)
