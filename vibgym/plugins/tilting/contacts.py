"""Contacts of a part with the plates in a step: candidates, their impulses, and the impulses of a part that lies flat.

Candidates are the vertices of the pieces into which the borders of plates cut a part's bottom. The bottom is a convex plane
polygon, and the ground over one plate is level. The gap over a piece is therefore least at a vertex: a corner of the bottom, a
crossing of its edge with a line at which plates begin or end, or a crossing of these lines under the bottom. Over a ramp
between two plates the gap is least at the ends of the ramp, which are such lines. Candidates on the rim of a disc are its
lowest point and points evenly around.

Impulses of a tilted part follow from Gauss-Seidel sweeps over its contacts. A part that has landed on level ground lies flat
for the rest of the period, under even pressure as in the planar model. Contacts at the corners would decelerate its spin three
times as fast as even pressure. Four points of equal load with the second moments of the outline are accurate to second order in
the change of slip across the part.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.physics.core.records import body_of, grip_of
from vibgym.plugins.tilting.attitude import spin_up
from vibgym.plugins.tilting.ground import LEVEL, grip_at, ground, ground_on_line, plate, write_plates
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
    LIFT,
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
    REACH,
    RIM_POINTS,
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

NEAR = 5e-6
"""m, largest gap of a contact that does not close within half a step."""

AHEAD = 1e-3
"""m, bound on the sliding of any point in half a step."""

SAME, MIN_SAME = 4.0, 1e-5
"""Largest displacement of a contact in a step: in units of the table's displacement, and m."""

KEPT = 0.1
"""Share of the depth of a contact that is corrected in a step."""


ENOUGH = 3e-7
"""m/s, largest change in the last sweep."""

MAX_SWEEPS = 60

IMPACT = 0.01
"""m/s, approach velocity above which contacts rebound."""

NO_GAIN = 1e-7
"""J/kg, energy that counts as zero: a fall of ten nanometres."""

SOFTER = 4
"""Most reductions of rebounds that add energy: each halves them, the last one removes them."""

POINTS = 4
"""Contacts of a part that lies flat."""


@jit
def place_corners(rigid, kind):
    """Write the corners of the bottom into the working array; returns their number."""
    frame, motion, corner = rigid.work.frame, rigid.work.motion, rigid.work.corner
    h, radius = rigid.solids.centre_height[kind], rigid.solids.disc[kind]
    x, y, z = motion[CX] - h * frame[2], motion[CY] - h * frame[5], motion[CZ] - h * frame[8]
    if radius > 0.0:
        a, b = -frame[6], -frame[7]  # downhill on the bottom
        size = math.sqrt(a * a + b * b)
        a, b = (a / size, b / size) if size > 1e-12 else (1.0, 0.0)
        turn = math.sqrt(0.5)
        for k in range(RIM_POINTS):
            u, v = radius * a, radius * b
            corner[k, 0], corner[k, 1] = x + frame[0] * u + frame[1] * v, y + frame[3] * u + frame[4] * v
            corner[k, 2] = z + frame[6] * u + frame[7] * v
            a, b = turn * (a - b), turn * (a + b)
        return RIM_POINTS
    outline = body_of(rigid.bodies, kind).outline
    for k in range(outline.shape[0]):
        u, v = outline[k, 0], outline[k, 1]
        corner[k, 0], corner[k, 1] = x + frame[0] * u + frame[1] * v, y + frame[3] * u + frame[4] * v
        corner[k, 2] = z + frame[6] * u + frame[7] * v
    return outline.shape[0]


@jit
def begin_warm(work, contact, n, x, y, reach):
    """Warm-start a contact at (x, y) with the impulses of one within ``reach`` (m) in the last step, if any."""
    contact[n, PN] = contact[n, PX] = contact[n, PY] = 0.0
    warm = work.warm
    for k in range(work.kept[0]):
        if abs(warm[k, 0] - x) < reach and abs(warm[k, 1] - y) < reach and warm[k, 2] > 0.0:
            contact[n, PN], contact[n, PX], contact[n, PY] = warm[k, 2], warm[k, 3], warm[k, 4]
            warm[k, 2] = 0.0
            return


@jit
def add_contact(rigid, n, x, y, z, height, rate, node):
    """Add a point of the bottom (m, world) to the ``n`` contacts if it touches the ground or may touch it within the step.

    Args:
        height, rate: of the ground below (m, m/s); the approach in half a step is bounded by ``REACH``.
        node: half steps since the period's start, for the position of the ground.

    Returns:
        The new number of contacts.
    """
    table, scheme, motion, contact = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.contact
    cosine, sine = scheme.cosine[node], scheme.sine[node]
    step, gap = table.period / scheme.steps, z - height
    rx, ry, rz = x - motion[CX], y - motion[CY], z - motion[CZ]
    u = motion[VZ] + motion[WX] * ry - motion[WY] * rx - rate
    ahead = gap + 0.5 * step * u
    if not ahead < (NEAR if u > -IMPACT else 0.0):
        return n
    goal = -2.0 * gap / step if gap > 0.0 else min(-KEPT * gap / step, scheme.settling)
    if u <= -IMPACT:  # not distributed over steps, in which friction would stop the slip early
        goal = max(goal, -scheme.restitution * u)
    slip_x = motion[VX] + motion[WY] * rz - motion[WZ] * ry + table.speed * sine
    slip_y = motion[VY] + motion[WZ] * rx - motion[WX] * rz - table.speed * cosine
    give = 1.0 + ry * ry * motion[MXX] - 2.0 * rx * ry * motion[MXY] + rx * rx * motion[MYY]
    slide_x = 1.0 + rz * rz * motion[MYY] - 2.0 * ry * rz * motion[MYZ] + ry * ry * motion[MZZ]
    slide_y = 1.0 + rz * rz * motion[MXX] - 2.0 * rx * rz * motion[MXZ] + rx * rx * motion[MZZ]
    contact[n, RX], contact[n, RY], contact[n, RZ] = rx, ry, rz
    contact[n, BEFORE] = u
    contact[n, GOAL], contact[n, RATE], contact[n, SLIP_X], contact[n, SLIP_Y] = goal, rate, slip_x, slip_y
    contact[n, GIVE], contact[n, SLIDE] = 1.0 / give, 1.0 / max(slide_x, slide_y)
    contact[n, GRIP] = grip_at(rigid, x - table.radius * cosine, y - table.radius * sine)
    begin_warm(rigid.work, contact, n, x, y, SAME * table.speed * step + MIN_SAME)
    return n + 1


@jit
def add_corner(rigid, n, k, level, climbing, node):
    """Add a corner of the bottom, see :func:`add_contact`.

    Args:
        level: whether the plates below have equal motion.
        climbing: m, largest rise in half a step by sliding up a ramp.
    """
    table, scheme, motion, corner = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.corner
    x, y, z = corner[k, 0], corner[k, 1], corner[k, 2]
    cosine, sine = scheme.cosine[node], scheme.sine[node]
    at_x, at_y = x - table.radius * cosine, y - table.radius * sine
    height, rate, slope_x, slope_y = ground(rigid, at_x, at_y)
    if z - height > motion[REACH] + climbing:
        return n
    if not level:  # sliding up a ramp lifts a corner
        rz = z - motion[CZ]
        slip_x = motion[VX] + motion[WY] * rz - motion[WZ] * (y - motion[CY]) + table.speed * sine
        slip_y = motion[VY] + motion[WZ] * (x - motion[CX]) - motion[WX] * rz - table.speed * cosine
        rate += min(max(slope_x * slip_x + slope_y * slip_y, -scheme.settling), scheme.settling)
    return add_contact(rigid, n, x, y, z, height, rate, node)


@jit
def write_lines(rigid, axis, low, high):
    """Write the lines across an axis on which plates begin and end, between ``low`` and ``high`` (m) in the table's frame.

    Returns:
        Number of lines.
    """
    table, ramp, lines, beside = rigid.table, rigid.scheme.ramp, rigid.work.lines, rigid.work.beside
    size, count = table.element_size, table.columns if axis == 0 else table.rows
    first, last = int(math.floor((low - ramp) / size)), int(math.floor((high + ramp) / size)) + 1
    n = 0
    for border in range(max(first, 0), min(last, count) + 1):
        for side in range(2):
            line = border * size
            if border > 0 and border < count:
                line += ramp if side == 1 else -ramp
            elif side == 1:
                continue
            if line > low and line < high:
                lines[axis, n] = line
                own = border - 1 + side
                other = 2 * border - 1 - own
                if own < 0 or own >= count:  # no plate beyond the table's border
                    own, other = other, -1
                beside[axis, n, 0], beside[axis, n, 1] = own, other
                n += 1
    return n


@jit
def is_step(rigid, axis, line, along):
    """Return whether the ground descends beyond a line, at a plate ``along`` the other axis.

    Other lines have no candidates: on level ground no piece ends, and over a rise the gap is least elsewhere.
    """
    heights, beside = rigid.work.height, rigid.work.beside
    mask = heights.shape[1] - 1
    own, other = beside[axis, line, 0], beside[axis, line, 1]
    if other < 0 or other >= (rigid.table.columns if axis == 0 else rigid.table.rows):
        return True  # border of the table
    if axis == 0:
        return heights[along & mask, own & mask] - heights[along & mask, other & mask] > LEVEL
    return heights[own & mask, along & mask] - heights[other & mask, along & mask] > LEVEL


@jit
def add_crossing(rigid, n, axis, line, x, y, z, node):
    """Add the crossing of an edge of the bottom with a line across an axis, see :func:`add_contact`."""
    table, scheme, work = rigid.table, rigid.scheme, rigid.work
    at = y - table.radius * scheme.sine[node] if axis == 0 else x - table.radius * scheme.cosine[node]
    own, along = work.beside[axis, line, 0], int(math.floor(at * scheme.fineness))
    if along < 0 or along >= (table.rows if axis == 0 else table.columns) or not is_step(rigid, axis, line, along):
        return n
    height, rate = ground_on_line(rigid, axis, own, along, at)
    if z - height > work.motion[REACH]:
        return n
    return add_contact(rigid, n, x, y, z, height, rate, node)


@jit
def add_edges(rigid, n, corners, crossed_x, crossed_y, node, high):
    """Add the crossings of the bottom's edges with lines; ``crossed_x``, ``crossed_y``: number of lines across each axis."""
    table, scheme, corner, lines = rigid.table, rigid.scheme, rigid.work.corner, rigid.work.lines
    beside, highest, reach = rigid.work.beside, rigid.work.highest, rigid.work.motion[REACH]
    mask = highest.shape[1] - 1
    other = corners - 1
    for one in range(corners):
        x, y, z = corner[other, 0], corner[other, 1], corner[other, 2]
        to_x, to_y, to_z = corner[one, 0] - x, corner[one, 1] - y, corner[one, 2] - z
        other = one
        if z >= high and z + to_z >= high:
            continue
        for axis in range(2):
            length = to_x if axis == 0 else to_y
            if length == 0.0:
                continue
            inverse = 1.0 / length
            begin = x - table.radius * scheme.cosine[node] if axis == 0 else y - table.radius * scheme.sine[node]
            low, top = min(begin, begin + length), max(begin, begin + length)
            k, last = 0, crossed_x if axis == 0 else crossed_y
            while k < last and lines[axis, k] <= low:  # they are in order
                k += 1
            while k < last and lines[axis, k] < top:
                t = (lines[axis, k] - begin) * inverse
                if z + t * to_z < highest[axis, beside[axis, k, 0] & mask] + reach:
                    n = add_crossing(rigid, n, axis, k, x + t * to_x, y + t * to_y, z + t * to_z, node)
                k += 1
    return n


@jit
def add_rim(rigid, n, kind, crossed_x, crossed_y, node):
    """Add the crossings of a disc's edge with lines, see :func:`add_edges`."""
    table, scheme, motion, frame = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.frame
    lines, h, radius = rigid.work.lines, rigid.solids.centre_height[kind], rigid.solids.disc[kind]
    beside, highest, reach = rigid.work.beside, rigid.work.highest, motion[REACH]
    mask = highest.shape[1] - 1
    x, y, z = motion[CX] - h * frame[2], motion[CY] - h * frame[5], motion[CZ] - h * frame[8]
    for axis in range(2):
        shift = table.radius * (scheme.cosine[node] if axis == 0 else scheme.sine[node])
        middle = (x if axis == 0 else y) - shift
        p, q = radius * frame[3 * axis], radius * frame[3 * axis + 1]
        square = p * p + q * q
        for k in range(crossed_x if axis == 0 else crossed_y):
            d = lines[axis, k] - middle
            root = math.sqrt(max(square - d * d, 0.0))
            for sign in range(2):
                far = root if sign == 0 else -root
                u, v = radius * (p * d - q * far) / square, radius * (q * d + p * far) / square
                height = z + frame[6] * u + frame[7] * v
                if d * d < square and height < highest[axis, beside[axis, k, 0] & mask] + reach:
                    at_x, at_y = x + frame[0] * u + frame[1] * v, y + frame[3] * u + frame[4] * v
                    n = add_crossing(rigid, n, axis, k, at_x, at_y, height, node)
    return n


@jit
def on_bottom(rigid, kind, x, y):
    """Return the point on the plane of the bottom (m, in the part's axes) below or above a point of the world."""
    frame, motion, h = rigid.work.frame, rigid.work.motion, rigid.solids.centre_height[kind]
    dx, dy = x - motion[CX] + h * frame[2], y - motion[CY] + h * frame[5]
    determinant = frame[0] * frame[4] - frame[1] * frame[3]
    return (frame[4] * dx - frame[1] * dy) / determinant, (frame[0] * dy - frame[3] * dx) / determinant


@jit
def is_inside(rigid, kind, u, v):
    """Return whether a point of the bottom's plane (m, in the part's axes) is inside the bottom."""
    radius = rigid.solids.disc[kind]
    if radius > 0.0:
        return u * u + v * v <= radius * radius
    outline = body_of(rigid.bodies, kind).outline
    n = outline.shape[0]
    for k in range(n):
        ax, ay = outline[k, 0], outline[k, 1]
        following = k + 1 if k + 1 < n else 0
        bx, by = outline[following, 0], outline[following, 1]
        if (bx - ax) * (v - ay) - (by - ay) * (u - ax) < 0.0:
            return False
    return True


@jit
def add_nodes(rigid, n, kind, crossed_x, crossed_y, low_y, high_y, node):
    """Add the crossings of lines under the bottom, which is between ``low_y`` and ``high_y`` (m) in the table's frame."""
    table, scheme, motion, frame = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.frame
    lines, h = rigid.work.lines, rigid.solids.centre_height[kind]
    heights, rates, reach = rigid.work.height, rigid.work.rate, motion[REACH]
    mask = heights.shape[1] - 1
    shift_x, shift_y = table.radius * scheme.cosine[node], table.radius * scheme.sine[node]
    down_x, down_y = -frame[2] / frame[8], -frame[5] / frame[8]  # slope of the bottom
    for i in range(crossed_x):
        x, column = lines[0, i] + shift_x, rigid.work.beside[0, i, 0]
        dx = x - motion[CX] + h * frame[2]
        base = motion[CZ] - h * frame[8] + down_x * dx
        away = max(abs(low_y + shift_y - motion[CY] + h * frame[5]), abs(high_y + shift_y - motion[CY] + h * frame[5]))
        if base - abs(down_y) * away - rigid.work.highest[0, column & mask] > reach:
            continue  # the whole line is too high
        for j in range(crossed_y):
            y = lines[1, j] + shift_y
            dy = y - motion[CY] + h * frame[5]
            z, row = base + down_y * dy, rigid.work.beside[1, j, 0]
            height = heights[row & mask, column & mask]  # crossings are outside of ramps
            if z - height > reach:
                continue
            if is_step(rigid, 0, i, row) and is_step(rigid, 1, j, column):
                u, v = on_bottom(rigid, kind, x, y)
                if is_inside(rigid, kind, u, v):
                    n = add_contact(rigid, n, x, y, z, height, rates[row & mask, column & mask], node)
    return n


@jit
def find_contacts(rigid, world, kind, level, node):
    """Write all points at which the part touches the ground or may touch it within the step; returns their number.

    Args:
        level: whether the plates below have equal motion, so that only corners can touch.
        node: half steps since the period's start.
    """
    table, scheme, motion, corner = rigid.table, rigid.scheme, rigid.work.motion, rigid.work.corner
    corners, n = place_corners(rigid, kind), 0
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for k in range(corners):
        low_x, high_x = min(low_x, corner[k, 0]), max(high_x, corner[k, 0])
        low_y, high_y = min(low_y, corner[k, 1]), max(high_y, corner[k, 1])
    radius = rigid.solids.disc[kind]
    if radius > 0.0:  # a disc extends beyond its corners
        x, y = 0.5 * (corner[0, 0] + corner[4, 0]), 0.5 * (corner[0, 1] + corner[4, 1])
        low_x, high_x, low_y, high_y = x - radius, x + radius, y - radius, y + radius
    dx, dy = table.radius * scheme.cosine[node], table.radius * scheme.sine[node]
    low_x, high_x, low_y, high_y = low_x - dx, high_x - dx, low_y - dy, high_y - dy
    wide = scheme.ramp + AHEAD
    high = write_plates(rigid, world, low_x - wide, low_y - wide, high_x + wide, high_y + wide, node, node + 1)
    # Points higher above a plate than they can descend in half a step cannot touch it.
    rocking = math.sqrt(motion[WX] * motion[WX] + motion[WY] * motion[WY])
    coming = abs(motion[VZ]) + rocking * (rigid.bodies.radius[kind] + rigid.solids.centre_height[kind]) + motion[LIFT]
    motion[REACH] = NEAR + 0.5 * table.period / scheme.steps * coming
    climbing = 0.5 * table.period / scheme.steps * scheme.settling  # largest rise of a corner that slides up a ramp
    high += motion[REACH]
    for k in range(corners):
        if corner[k, 2] < high + climbing:
            n = add_corner(rigid, n, k, level, climbing, node)
    if level:
        return n
    crossed_x, crossed_y = write_lines(rigid, 0, low_x, high_x), write_lines(rigid, 1, low_y, high_y)
    if radius > 0.0:
        n = add_rim(rigid, n, kind, crossed_x, crossed_y, node)
    else:
        n = add_edges(rigid, n, corners, crossed_x, crossed_y, node, high)
    return add_nodes(rigid, n, kind, crossed_x, crossed_y, low_y, high_y, node)


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
    """Iterate over ``n`` contacts to convergence, at most ``MAX_SWEEPS`` times: normal impulse, then friction of each.

    Velocity and angular velocity change, angular momentum does not.
    """
    vx, vy, vz, wx, wy, wz = motion[VX], motion[VY], motion[VZ], motion[WX], motion[WY], motion[WZ]
    most, sweeps = math.inf, 0
    while sweeps < MAX_SWEEPS and most > ENOUGH:
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
    while sweeps < MAX_SWEEPS and most > ENOUGH:
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
