"""A period of rigid parts on the plates: steps of drift, impulses at the midpoint, drift.

Friction and normal impulses act at the same instant, the middle of the step; half a step between them would change transport by
a hundredth. The numbers of steps and sweeps, and therefore the cost, are bounded.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import best_grip, friction_in, incline_size, kind_in, state_at
from vibgym.plugins.tilting.attitude import (
    enter_attitude,
    enter_spin,
    leave_attitude,
    rotate,
    write_frame,
    write_inverse_inertia,
)
from vibgym.plugins.tilting.contacts import (
    IMPACT,
    begin_flat,
    find_contacts,
    is_inside,
    on_bottom,
    place_corners,
    resolve_contacts,
    slide_flat,
)
from vibgym.plugins.tilting.ground import begin_reading, ground, is_level, plate, write_plates
from vibgym.plugins.tilting.records import (
    CX,
    CY,
    CZ,
    FLAT,
    LX,
    LY,
    LZ,
    QW,
    QX,
    QY,
    QZ,
    TILTED,
    TIPPED,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
    Rigid,
    fixed_tilting_at,
    tilt_at,
)

FLAT_COSINE = math.cos(math.radians(0.05))
"""Cosine of the tilt below which a part may count as flat."""

CALM_STEPS = 5
"""Consecutive calm steps after which a part on level ground counts as flat."""

MIN_RESTITUTION = 0.2
"""Lower bound of the restitution in the largest edge speed of a flat part, whose rebounds do not count as impacts."""


@jit
def reach_of(rigid, world, part, periods):
    """Return the radius (m), about a part's centre of mass, of the plates that it may touch within ``periods`` periods."""
    table, state, kind = rigid.table, rigid.state, kind_in(rigid.bodies, world, part)
    vx, vy = state.velocity[world, part, 0], state.velocity[world, part, 1]
    span = periods * table.period
    slope = incline_size(state, world)
    grip = best_grip(state.patches[world])
    pull = 2.0 * grip * friction_in(rigid.bodies, state, world, part) * table.gravity + slope
    speed = math.sqrt(vx * vx + vy * vy)
    way = speed * span + 0.5 * pull * span * span
    turning = abs(state.velocity[world, part, 2]) * rigid.bodies.radius[kind]
    fastest = (max(speed, table.speed) + turning) * span  # friction accelerates parts up to the table's speed
    return rigid.bodies.radius[kind] + rigid.scheme.ramp + table.radius + min(way, fastest + 0.5 * slope * span * span)


@jit
def is_steady(rigid, world, part):
    """Return whether friction does not tip a part that lies flat on level ground."""
    state = rigid.state
    factor = state.friction[world, part] * best_grip(state.patches[world])
    return factor < rigid.solids.unsteady[kind_in(rigid.bodies, world, part)]


@jit
def lies_level(rigid, world, part, periods):
    """Return whether a flat part stays flat for ``periods`` periods: it does not tip, and plates within reach move equally."""
    state, kind = rigid.state, kind_in(rigid.bodies, world, part)
    if not is_steady(rigid, world, part):
        return False
    reach = reach_of(rigid, world, part, periods)
    return is_level(rigid, world, kind, state.pose[world, part, 0], state.pose[world, part, 1], reach)


@jit
def enter_motion(rigid, world, part, kind):
    """Load a part's motion and attitude into the working arrays."""
    state, tilt, motion, frame, solids = rigid.state, rigid.tilt, rigid.work.motion, rigid.work.frame, rigid.solids
    motion[CX], motion[CY], motion[CZ] = (
        state.pose[world, part, 0],
        state.pose[world, part, 1],
        tilt.height[world, part],
    )
    motion[VX], motion[VY] = state.velocity[world, part, 0], state.velocity[world, part, 1]
    motion[VZ] = tilt.climb[world, part]
    enter_attitude(tilt.lean[world, part, 0], tilt.lean[world, part, 1], state.pose[world, part, 2], motion)
    write_frame(motion, frame)
    xx, yy, xy = solids.inertia[kind, 0], solids.inertia[kind, 1], solids.inertia[kind, 2]
    gyration = rigid.bodies.gyration[kind]
    spin_x, spin_y = tilt.rocking[world, part, 0], tilt.rocking[world, part, 1]
    enter_spin(motion, frame, xx, yy, xy, gyration, spin_x, spin_y, state.velocity[world, part, 2])
    write_inverse_inertia(motion, frame, xx, yy, xy, gyration)


@jit
def set_down(rigid, world, kind):
    """Place the part of the working arrays on the plates at the start of a period: its lowest point moves with the ground."""
    motion, corner, table = rigid.work.motion, rigid.work.corner, rigid.table
    motion[CZ] = rigid.solids.centre_height[kind]
    most, rate = -math.inf, 0.0
    wide = rigid.bodies.radius[kind] + rigid.scheme.ramp
    x, y = motion[CX] - table.radius, motion[CY]
    write_plates(rigid, world, x - wide, y - wide, x + wide, y + wide, 0, 0)
    for k in range(place_corners(rigid, kind)):
        height, speed, _, _ = ground(rigid, corner[k, 0] - table.radius, corner[k, 1])
        if height - corner[k, 2] > most:
            most, rate = height - corner[k, 2], speed
    size = table.element_size
    left = int(math.floor((motion[CX] - table.radius - rigid.bodies.radius[kind]) / size))
    right = int(math.floor((motion[CX] - table.radius + rigid.bodies.radius[kind]) / size))
    low = int(math.floor((motion[CY] - rigid.bodies.radius[kind]) / size))
    top = int(math.floor((motion[CY] + rigid.bodies.radius[kind]) / size))
    frame, h = rigid.work.frame, rigid.solids.centre_height[kind]
    for row in range(max(low, 0), min(top, table.rows - 1) + 1):
        for column in range(max(left, 0), min(right, table.columns - 1) + 1):
            # The point of this plate nearest to the centre of mass, if it is under the bottom.
            x = min(max(motion[CX] - table.radius, column * size), (column + 1) * size)
            y = min(max(motion[CY], row * size), (row + 1) * size)
            u, v = on_bottom(rigid, kind, x + table.radius, y)
            height, speed = plate(rigid, world, row, column, 0, 0)
            z = motion[CZ] - h * frame[8] + frame[6] * u + frame[7] * v
            if height - z > most and is_inside(rigid, kind, u, v):
                most, rate = height - z, speed
    motion[CZ] += most
    motion[VZ] = rate


@jit
def forget_contacts(rigid):
    """Delete the impulses stored for the next step."""
    rigid.work.kept[0] = 0


@jit
def drift(motion, span):
    """Move freely for ``span`` s."""
    motion[CX] += span * motion[VX]
    motion[CY] += span * motion[VY]
    motion[CZ] += span * motion[VZ]
    rotate(motion, span)


@jit
def take_step(rigid, world, kind, friction, level, turn):
    """Advance the part of the working arrays by a step."""
    table, scheme, motion, frame = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.frame
    step = table.period / scheme.steps
    node = 2 * turn + 1
    drift(motion, 0.5 * step)
    write_frame(motion, frame)
    solids = rigid.solids
    xx, yy, xy = solids.inertia[kind, 0], solids.inertia[kind, 1], solids.inertia[kind, 2]
    write_inverse_inertia(motion, frame, xx, yy, xy, rigid.bodies.gyration[kind])
    motion[VX] += step * rigid.state.incline[world, 0]
    motion[VY] += step * rigid.state.incline[world, 1]
    motion[VZ] -= step * table.gravity
    n = find_contacts(rigid, world, kind, level, node)
    if n > 0:
        table_x, table_y = -table.speed * scheme.sine[node], table.speed * scheme.cosine[node]
        resolve_contacts(rigid.work, n, friction, table_x, table_y)
    else:
        forget_contacts(rigid)
    drift(motion, 0.5 * step)


@jit
def is_calm(rigid, world, kind, node):
    """Return whether the part lies almost flat and at rest on level ground at the end of a step."""
    motion, table, frame = rigid.work.motion, rigid.table, rigid.work.frame
    if frame[8] < FLAT_COSINE:
        return False
    size = table.element_size
    column = min(max(int(motion[CX] / size), 0), table.columns - 1)
    row = min(max(int(motion[CY] / size), 0), table.rows - 1)
    _, rate = plate(rigid, world, row, column, node, node)
    edge = rigid.bodies.radius[kind] * math.sqrt(motion[WX] * motion[WX] + motion[WY] * motion[WY])
    slow = IMPACT / max(rigid.scheme.restitution, MIN_RESTITUTION)
    return edge < slow and abs(motion[VZ] - rate) < slow


@jit
def fate_of(rigid, kind):
    """Return whether the part's centre of mass has left the table, and whether it has tipped beyond its edge."""
    table, motion, frame = rigid.table, rigid.work.motion, rigid.work.frame
    x, y = motion[CX], motion[CY]
    off = not (x >= table.left and y >= table.bottom and x <= table.right and y <= table.top)
    if frame[8] < 0.05:
        return off, True
    u, v = on_bottom(rigid, kind, x, y)
    return off, not is_inside(rigid, kind, u, v)


@jit
def sound(motion):
    """Return whether all numbers are finite. A comparison, since isfinite does not survive reassociation."""
    total = abs(motion[CX]) + abs(motion[CY]) + abs(motion[CZ]) + abs(motion[VX]) + abs(motion[VY]) + abs(motion[VZ])
    total += abs(motion[LX]) + abs(motion[LY]) + abs(motion[LZ]) + abs(motion[WX]) + abs(motion[WY]) + abs(motion[WZ])
    return total + abs(motion[QW]) + abs(motion[QX]) + abs(motion[QY]) + abs(motion[QZ]) < math.inf


@jit
def rest(state, tilt, world, part):
    """Stop a part that has fallen or toppled."""
    for k in range(3):
        state.velocity[world, part, k] = 0.0
    state.fallen[world, part], state.sticking[world, part] = True, False
    tilt.climb[world, part] = tilt.rocking[world, part, 0] = tilt.rocking[world, part, 1] = 0.0


@jit
def leave_motion(rigid, world, part, flat, follows):
    """Store the working arrays in the state, at the end of a period.

    Args:
        flat: whether the part has landed on level ground.
        follows: whether the motion in the plane is stored as well; else contacts with other parts determine it.
    """
    state, tilt, motion = rigid.state, rigid.tilt, rigid.work.motion
    old = state.pose[world, part, 2]
    lean_x, lean_y, heading = leave_attitude(motion, old + rigid.table.period * state.velocity[world, part, 2])
    period = rigid.table.period
    if follows:
        x, y = state.pose[world, part, 0], state.pose[world, part, 1]
        state.mean_velocity[world, part, 0] = (motion[CX] - x) / period
        state.mean_velocity[world, part, 1] = (motion[CY] - y) / period
        state.mean_velocity[world, part, 2] = (heading - old) / period
        state.pose[world, part, 0], state.pose[world, part, 1] = motion[CX], motion[CY]
        state.pose[world, part, 2] = heading
        state.velocity[world, part, 0], state.velocity[world, part, 1] = motion[VX], motion[VY]
        state.velocity[world, part, 2] = motion[WZ]
        state.sticking[world, part] = False
    if flat:
        lie_flat(tilt, world, part)
        return
    tilt.mode[world, part] = TILTED
    tilt.lean[world, part, 0], tilt.lean[world, part, 1] = lean_x, lean_y
    tilt.height[world, part], tilt.climb[world, part] = motion[CZ], motion[VZ]
    tilt.rocking[world, part, 0], tilt.rocking[world, part, 1] = motion[WX], motion[WY]


@jit
def lie_flat(tilt, world, part):
    """Set a part to be advanced by the planar model."""
    tilt.mode[world, part], tilt.calm[world, part] = FLAT, 0
    tilt.lean[world, part, 0] = tilt.lean[world, part, 1] = 0.0
    tilt.rocking[world, part, 0] = tilt.rocking[world, part, 1] = 0.0
    tilt.height[world, part] = tilt.climb[world, part] = 0.0


@jit
def rock_period(rigid, world, part, follows, paths, base, nodes):
    """Advance a part by a period as a rigid body.

    Args:
        follows: see :func:`leave_motion`.
        paths: (all rows, nodes + 1, 3) overwritten with poses, see :func:`vibgym.physics.planar.friction.slide_rows`, or no
            rows.
        base: value of ``world * parts + part`` for the first row of ``paths``.
        nodes: number of poses to record within the period.
    """
    state, tilt, work = rigid.state, rigid.tilt, rigid.work
    kind = kind_in(rigid.bodies, world, part)
    x, y, heading = state.pose[world, part, 0], state.pose[world, part, 1], state.pose[world, part, 2]
    level = is_level(rigid, world, kind, x, y, reach_of(rigid, world, part, 1))
    begin_reading(rigid, kind)
    enter_motion(rigid, world, part, kind)
    if tilt.mode[world, part] == FLAT or tilt.mode[world, part] == TIPPED:
        set_down(rigid, world, kind)
    forget_contacts(rigid)
    friction = friction_in(rigid.bodies, state, world, part)
    row, written = world * state.pose.shape[1] + part - base, 0
    if paths.shape[0] > 0:
        paths[row, 0, 0], paths[row, 0, 1], paths[row, 0, 2] = x, y, heading
    steady = level and is_steady(rigid, world, part)
    gone, toppled, flat, now = False, False, False, heading
    for turn in range(rigid.scheme.steps):
        if steady and not flat and tilt.calm[world, part] >= CALM_STEPS:
            flat = True
            _, _, now = leave_attitude(work.motion, now)
            begin_flat(work.motion)
        if flat:
            now = slide_flat(rigid, world, kind, friction, now, turn)
            enter_attitude(0.0, 0.0, now, work.motion)
        elif not gone:
            take_step(rigid, world, kind, friction, level, turn)
            tilt.since[world, part] += 1
            if work.frame[8] < FLAT_COSINE:
                tilt.landing[world, part] = tilt.since[world, part]
            calm = steady and is_calm(rigid, world, kind, 2 * turn + 2)
            tilt.calm[world, part] = tilt.calm[world, part] + 1 if calm else 0
        if not gone:
            off, toppled = fate_of(rigid, kind)
            gone = off or (toppled and not flat)
        while paths.shape[0] > 0 and (written + 1) * rigid.scheme.steps <= (turn + 1) * nodes:
            written += 1
            _, _, now = leave_attitude(work.motion, now)
            paths[row, written, 0], paths[row, written, 1] = work.motion[CX], work.motion[CY]
            paths[row, written, 2] = now
    if not sound(work.motion):
        state.diverged[world] = True
        return
    leave_motion(rigid, world, part, flat, follows)
    if gone:
        tilt.mode[world, part], tilt.toppled[world, part] = TILTED, toppled
        rest(state, tilt, world, part)


@jit
def is_flat(rigid, world, part, periods):
    """Return whether the planar model advances a part for ``periods`` periods; True for fallen and diverged parts."""
    if rigid.state.fallen[world, part] or rigid.state.diverged[world]:
        return True
    return rigid.tilt.mode[world, part] == FLAT and lies_level(rigid, world, part, periods)


@jit
def rigid_at(fixed, drive, state, tilt):
    """Return the record of all data; ``drive`` is a reference, the others are addresses of pinned records."""
    fixed = fixed_tilting_at(fixed)
    return Rigid(
        fixed.table, fixed.bodies, fixed.solids, fixed.scheme, fixed.work, drive, state_at(state), tilt_at(tilt)
    )


@jit
def sort_rows(rows, flat, other, fixed, drive, state, tilt, periods):
    """Separate parts that lie flat on level ground for ``periods`` periods from others.

    Args:
        rows: (n,) parts, as ``world * parts + part``.
        flat, other: (at least n,) overwritten with the rows of flat parts and of others.
        fixed, drive, state, tilt: addresses of pinned records.

    Returns:
        The number of flat parts.
    """
    drive = reference(pinned_drive(drive))
    rigid = reference(rigid_at(fixed, drive, state, tilt))
    parts, n = rigid.state.pose.shape[1], 0
    for k in range(rows.shape[0]):
        if is_flat(rigid, rows[k] // parts, rows[k] % parts, periods):
            flat[n] = rows[k]
            n += 1
        else:
            other[k - n] = rows[k]
    return n


@jit
def rock_rows(rows, follows, fixed, drive, state, tilt, paths, base, nodes):
    """Advance parts by a period as rigid bodies.

    Args:
        rows: (n,) parts that do not lie flat, see :func:`sort_rows`.
        fixed, drive, state, tilt: addresses of pinned records.
        follows, paths, base, nodes: see :func:`rock_period`.
    """
    drive = reference(pinned_drive(drive))
    rigid = reference(rigid_at(fixed, drive, state, tilt))
    parts = rigid.state.pose.shape[1]
    for k in range(rows.shape[0]):
        rock_period(rigid, rows[k] // parts, rows[k] % parts, follows, paths, base, nodes)


@jit
def keep_toppled(start, stop, state, tilt):
    """Stop toppled parts of worlds ``start`` to ``stop``, also after contacts.

    Args:
        state, tilt: addresses of pinned records.
    """
    state, tilt = state_at(state), tilt_at(tilt)
    for world in range(start, stop):
        for part in range(state.pose.shape[1]):
            if tilt.toppled[world, part]:
                rest(state, tilt, world, part)
