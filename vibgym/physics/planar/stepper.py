"""Friction stepper: a step of parts on the vibrating elements, alone or between contacts.

A step cuts a part's contact area once, at the pose predicted for its middle. Friction then moves a group of eight parts
together, by a series in the moments of the pressure (:func:`vibgym.physics.planar.wrench.slide_by_series`). A part for which
the series is inaccurate, because slip varies strongly across it or nearly vanishes, or that sticks, repeats the step by
contact points (:mod:`vibgym.physics.planar.points`). Lanes are independent, so a part's result does not depend on the others
in its group.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import exact, jit
from vibgym.kernels.vector import (
    LANES,
    WIDTH,
    absolute,
    bits,
    floor,
    load,
    load_mask,
    load_register,
    logical_not,
    mask_of,
    mask_register,
    maximum,
    minimum,
    select,
    store,
    store_mask,
)
from vibgym.physics.core.drive import clear_phasors
from vibgym.physics.core.records import Motion, body_in, body_of, kind_in, under_conditions
from vibgym.physics.planar.contact_area import NEGLIGIBLE_PIECE, OFF, PLACED, place_part
from vibgym.physics.planar.group_cut import MARGIN, cut_outlines
from vibgym.physics.planar.points import MAX_TRAVEL, MAX_TURN, slide_by_points
from vibgym.physics.planar.pressure_moments import pressure_moments
from vibgym.physics.planar.workspace import SECTORS, TimeSpan
from vibgym.physics.planar.wrench import limits, slide_by_series

_PER_QUARTER = 2.0 / math.pi

# A quarter turn as a sum of three numbers, the first two of 33 bits: products with integers of up to 20 bits are exact.
_HIGH, _MIDDLE, _LOW = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21

_WIDEST = 0.8
"""Limit of the reduced angle; only angles larger than 1e15 rad, whose spacing exceeds an eighth of a turn, reach it."""


@exact(inline=True)
def sincos(angle):
    """Return ``(sin, cos)`` to 1e-16 for angles of up to 1e6 rad; for larger ones to the angle's last digit.

    Taylor series up to the 16th order within an eighth of a turn; the next terms are below 1e-16.
    """
    turns = floor(angle * _PER_QUARTER + 0.5)
    x = ((angle - turns * _HIGH) - turns * _MIDDLE) - turns * _LOW
    x = minimum(maximum(x, -_WIDEST), _WIDEST)
    quarter = turns - 4.0 * floor(0.25 * turns)
    square = x * x
    sine = -1.0 / 1307674368000.0
    sine = sine * square + 1.0 / 6227020800.0
    sine = sine * square - 1.0 / 39916800.0
    sine = sine * square + 1.0 / 362880.0
    sine = sine * square - 1.0 / 5040.0
    sine = sine * square + 1.0 / 120.0
    sine = sine * square - 1.0 / 6.0
    sine = x * square * sine + x
    cosine = 1.0 / 20922789888000.0
    cosine = cosine * square - 1.0 / 87178291200.0
    cosine = cosine * square + 1.0 / 479001600.0
    cosine = cosine * square - 1.0 / 3628800.0
    cosine = cosine * square + 1.0 / 40320.0
    cosine = cosine * square - 1.0 / 720.0
    cosine = cosine * square + 1.0 / 24.0
    cosine = cosine * square - 0.5
    cosine = cosine * square + 1.0
    odd = (quarter > 0.5) & (quarter < 1.5) | (quarter > 2.5)
    one, other = select(odd, cosine, sine), select(odd, sine, cosine)
    return select(quarter > 1.5, -one, one), select((quarter > 0.5) & (quarter < 2.5), -other, other)


UNPLACED = -1e300
"""First column of a window that is not placed yet."""


@jit
def copy_lane(source, target, lane):
    """Copy a lane's three values."""
    for k in range(lane, 3 * LANES, LANES):
        target[k] = source[k]


@jit
def finite_lane(values, lane):
    """Return whether a lane's three values are finite; by comparison, since isfinite(a + b) does not survive reassociation."""
    return abs(values[lane] + values[LANES + lane] + values[2 * LANES + lane]) < math.inf


@jit
def load_shape(scene, slot, kind):
    """Load ``workspace.shape`` of a kind: radius and smallest piece (elements), whether the outline rotates, and is convex."""
    workspace, bodies, pitch = scene.workspace, scene.bodies, scene.table.element_size
    g, lane = slot // LANES, slot % LANES
    shape = workspace.shape[g]
    shape[lane] = bodies.radius[kind] / pitch * (1.0 + MARGIN)
    shape[LANES + lane] = NEGLIGIBLE_PIECE * bodies.area[kind] / (pitch * pitch)
    shape[2 * LANES + lane] = 1.0 if bodies.turns[kind] else 0.0
    shape[3 * LANES + lane] = 1.0 if bodies.convex[kind] else 0.0
    workspace.kind[slot] = kind
    workspace.sector[g, lane], workspace.most[g] = -1.0, -1


@jit
def most_corners(scene, g):
    """Return the largest number of corners of a group's outlines; outlines with fewer stored ones are loaded again."""
    workspace = scene.workspace
    if workspace.most[g] < 0:
        for lane in range(LANES):
            kind = workspace.kind[g * LANES + lane]
            workspace.most[g] = max(workspace.most[g], scene.bodies.first[kind + 1] - scene.bodies.first[kind])
        for lane in range(LANES):
            if workspace.corners[g * LANES + lane] < workspace.most[g]:
                workspace.sector[g, lane] = -1.0
    return workspace.most[g]


@jit
def load_outlines(scene, g, lanes, count):
    """Load the outlines of the lanes whose bits are set, starting at the lowest corner.

    Args:
        count: number of corners; outlines with fewer end with the same one several times.
    """
    workspace, bodies = scene.workspace, scene.bodies
    outline, sector = workspace.outline[g], workspace.sector[g]
    for lane in range(LANES):
        if lanes >> lane & 1:
            kind = workspace.kind[g * LANES + lane]
            first, corners = bodies.first[kind], bodies.first[kind + 1] - bodies.first[kind]
            from_corner = workspace.lowest[kind, int(sector[lane])]
            workspace.corners[g * LANES + lane] = count
            for k in range(count):
                corner = from_corner + min(k, corners - 1)
                corner = first + (corner if corner < corners else corner - corners)
                outline[2 * k * LANES + lane] = bodies.outline[corner, 0]
                outline[(2 * k + 1) * LANES + lane] = bodies.outline[corner, 1]


@jit
def load_part(scene, slot, world, part, away):
    """Load a part into a slot; ``away``: it is not on the table, or the slot is unused and only copies that part."""
    state, workspace = scene.state, scene.workspace
    g, lane = slot // LANES, slot % LANES
    kind = kind_in(scene.bodies, world, part)
    body = under_conditions(body_of(scene.bodies, kind), state, world, part)
    workspace.world[slot], workspace.part[slot], workspace.away[slot] = world, part, away
    workspace.most_square[slot], workspace.slow_rate[slot] = limits(scene.table, body)
    own = workspace.own[g]
    own[2 * LANES + lane], own[3 * LANES + lane] = body.friction, body.friction / body.gyration
    own[4 * LANES + lane], own[5 * LANES + lane] = body.incline_x, body.incline_y
    for k in range(3):
        workspace.pose[g, k * LANES + lane] = state.pose[world, part, k]
        workspace.velocity[g, k * LANES + lane] = state.velocity[world, part, k]
    if workspace.kind[slot] != kind:
        load_shape(scene, slot, kind)
    workspace.base[g, lane] = UNPLACED
    workspace.phasors.coupling[slot] = body.coupling
    clear_phasors(workspace.phasors, slot)


@jit
def store_parts(scene, world, first, stop, pushed):
    """Store the state of a world's parts in slots ``first`` to ``stop`` after a period.

    With non-finite values the world has diverged and keeps its last state.

    Args:
        pushed: (slots, 2) m/s, change of velocity by contacts.
    """
    state, pose, velocity = scene.state, scene.workspace.pose, scene.workspace.velocity
    total = 0.0
    for slot in range(first, stop):
        g, lane = slot // LANES, slot % LANES
        for k in range(lane, 3 * LANES, LANES):
            total += abs(pose[g, k]) + abs(velocity[g, k])
    if state.diverged[world] or not total < math.inf:
        state.diverged[world] = True
        return
    for slot in range(first, stop):
        g, lane, part = slot // LANES, slot % LANES, scene.workspace.part[slot]
        fallen = state.fallen[world, part]
        for k in range(3):
            place = pose[g, k * LANES + lane]
            state.mean_velocity[world, part, k] = (place - state.pose[world, part, k]) / scene.table.period
            state.pose[world, part, k] = place
            state.velocity[world, part, k] = 0.0 if fallen else velocity[g, k * LANES + lane]
        for k in range(2):
            state.pushed[world, part, k] = pushed[slot, k]
        if fallen:
            state.sticking[world, part] = False


@jit
def remove_part(scene, slot, fate):
    """Mark a part as away that has fallen or whose pose is not finite."""
    state, workspace = scene.state, scene.workspace
    world = workspace.world[slot]
    workspace.away[slot] = True
    state.fallen[world, workspace.part[slot]] = fate == OFF
    state.diverged[world] = state.diverged[world] or fate != OFF


@jit
def find_support(scene, slot, pushed):
    """Return whether a part is on the table at the pose of the cut, or, if others may push it, at its current pose.

    The current pose then replaces that of the cut. A part that is not on the table is removed.
    """
    table, workspace = scene.table, scene.workspace
    lane, pose, middle = slot % LANES, workspace.pose[slot // LANES], workspace.middle
    body = body_of(scene.bodies, workspace.kind[slot])
    x, y = middle[lane], middle[LANES + lane]
    fate = place_part(table, body, 1, x, y, middle[2 * LANES + lane], workspace.cut)
    on_elements = 0.0 <= x <= table.columns * table.element_size and 0.0 <= y <= table.rows * table.element_size
    if pushed and (fate == OFF or not on_elements):
        copy_lane(pose, middle, lane)
        fate = place_part(table, body, 1, pose[lane], pose[LANES + lane], pose[2 * LANES + lane], workspace.cut)
    if fate != PLACED:
        remove_part(scene, slot, fate)
    return fate == PLACED


@jit
def sticking_lanes(scene, first):
    """Return which parts in a group's slots from ``first`` on stick, a bit each."""
    state, workspace, stuck = scene.state, scene.workspace, 0
    for lane in range(LANES):
        if state.sticking[workspace.world[first + lane], workspace.part[first + lane]]:
            stuck |= 1 << lane
    return stuck


@exact
def choose_method(scene, g, active, left, pushed):
    """Predict the poses of a group's parts after half of ``left`` s, and choose the method of the active lanes' next steps.

    Returns:
        Mask of the lanes that use the series.
    """
    table, workspace, first = scene.table, scene.workspace, g * LANES
    pose, velocity, middle, shape = workspace.pose[g], workspace.velocity[g], workspace.middle, workspace.shape[g]
    half, pitch = 0.5 * left, table.element_size
    vx, vy, spin = load(velocity, 0), load(velocity, LANES), load(velocity, 2 * LANES)
    # The pose in the middle of the step determines the elements under the part.
    x, y = load(pose, 0) + half * vx, load(pose, LANES) + half * vy
    heading = load(pose, 2 * LANES) + half * spin
    store(middle, 0, x)
    store(middle, LANES, y)
    store(middle, 2 * LANES, heading)
    width, depth = table.columns * pitch, table.rows * pitch
    clear = select(
        load(shape, 3 * LANES) > 0.0, 0.0, load(shape, 0) * pitch
    )  # distance from the border at which it cannot fall
    safe = (
        (x >= clear) & (y >= clear) & (x <= width - clear) & (y <= depth - clear) & (absolute(heading) < math.inf)
        & (x >= table.left) & (y >= table.bottom) & (x <= table.right) & (y <= table.top)
    )  # fmt: skip
    placed = bits(active)
    doubtful = placed & ~bits(safe)
    for lane in range(LANES):
        if doubtful >> lane & 1 and not find_support(scene, first + lane, pushed):
            placed &= ~(1 << lane)
    stuck = 0 if pushed else sticking_lanes(scene, first)
    far = MAX_TRAVEL * pitch
    by_points = (absolute(spin) * left > MAX_TURN) | (left * left * (vx * vx + vy * vy) > far * far) | mask_of(stuck)
    if scene.scheme.pieces != 0:
        by_points = active
    on_table = mask_of(placed)
    old = load_mask(workspace.by_points, first) & logical_not(active)
    store_mask(workspace.by_points, first, old | (by_points & on_table))
    return on_table & logical_not(by_points)


@exact
def place_in_window(scene, g, first, cutting, count):
    """Place the windows of the lanes from ``first`` on that are cut; ``count``: largest number of corners of the group.

    Returns:
        Centres of mass in the windows (elements), and the headings' cosine and sine over the size of an element (m^-1); zero in
        lanes that are not cut.
    """
    workspace, scale = scene.workspace, 1.0 / scene.table.element_size
    middle, shape, base, known = workspace.middle, workspace.shape[g], workspace.base[g], workspace.known[g]
    reach = load_register(shape, first)
    old_x, old_y = load_register(base, first), load_register(base, LANES + first)
    x, y = load_register(middle, first) * scale, load_register(middle, LANES + first) * scale
    base_x, base_y = select(cutting, floor(x - reach), old_x), select(cutting, floor(y - reach), old_y)
    moved = bits((base_x > old_x) | (base_x < old_x) | (base_y > old_y) | (base_y < old_y))
    if moved != 0:
        store(base, first, base_x)
        store(base, LANES + first, base_y)
        for cell in range(known.shape[0]):
            known[cell] &= ~(moved << first)
    heading = load_register(middle, 2 * LANES + first) * load_register(shape, 2 * LANES + first)
    turns = heading * (SECTORS / (2.0 * math.pi))
    sector = floor(turns - SECTORS * floor(turns / SECTORS))
    sector, old = select(cutting, minimum(sector, SECTORS - 1.0), 0.0), load_register(workspace.sector[g], first)
    other = bits(cutting & ((sector > old) | (sector < old)))
    if other != 0:
        store(workspace.sector[g], first, select(cutting, sector, old))
        load_outlines(scene, g, other << first, count)
    sine, cosine = sincos(heading)
    return (
        select(cutting, x - base_x, 0.0), select(cutting, y - base_y, 0.0),
        select(cutting, cosine * scale, 0.0), select(cutting, sine * scale, 0.0),
    )  # fmt: skip


@exact
def cut_lanes(scene, g, first, cutting):
    """Cut the parts in the lanes from ``first`` on whose bits are set, and update their moments; return the supported ones."""
    workspace, mask, count = scene.workspace, mask_register(cutting), most_corners(scene, g)
    x, y, cosine, sine = place_in_window(scene, g, first, mask, count)
    box = cut_outlines(
        workspace.outline[g], first, count, x, y, cosine, sine, mask, workspace.across, workspace.cells,
        workspace.crossings,
    )  # fmt: skip
    smallest = load_register(workspace.shape[g], LANES + first)
    return bits(mask & pressure_moments(scene, g, first, x, y, smallest, box, mask))


@exact
def cut_group(scene, g, left, pushed):
    """Cut a group's stale parts at their poses after half of ``left`` s.

    Args:
        pushed: whether others may push the parts. They may then be stopped before they fall, and no longer stick.
    """
    workspace, slot = scene.workspace, g * LANES
    stale = load_mask(workspace.stale, slot)
    if bits(stale) == 0:
        return
    store_mask(workspace.stale, slot, logical_not(stale) & stale)
    active = stale & logical_not(load_mask(workspace.away, slot))
    held = bits(load_mask(workspace.held, slot) & logical_not(stale))
    if bits(active) != 0:
        cutting = bits(choose_method(scene, g, active, left, pushed))
        supported = 0
        for first in range(0, LANES, WIDTH):
            these = cutting >> first & ((1 << WIDTH) - 1)
            if these != 0:
                supported |= cut_lanes(scene, g, first, these) << first
        held |= supported
        for lane in range(LANES):
            if (cutting & ~supported) >> lane & 1:
                remove_part(scene, slot + lane, OFF)
    store_mask(workspace.held, slot, mask_of(held))


@jit
def cut_stale(scene, left, pushed):
    """Cut all stale parts and update their moments, see :func:`cut_group`."""
    for g in range(scene.groups):
        cut_group(scene, g, left, pushed)


@jit
def step_by_points(scene, step, slot):
    """Take a step of one part by contact points."""
    state, workspace = scene.state, scene.workspace
    g, lane = slot // LANES, slot % LANES
    world, part = workspace.world[slot], workspace.part[slot]
    pose, velocity = workspace.pose[g], workspace.velocity[g]
    motion, stuck, supported = slide_by_points(
        scene.table, body_in(scene.bodies, state, world, part), scene.scheme.pieces, scene.drive, world, step,
        workspace.cut, workspace.phasors, slot,
        Motion(
            pose[lane], pose[LANES + lane], pose[2 * LANES + lane],
            velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane],
        ),
        state.sticking[world, part],
    )  # fmt: skip
    pose[lane], pose[LANES + lane], pose[2 * LANES + lane] = motion.x, motion.y, motion.heading
    velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane] = motion.vx, motion.vy, motion.spin
    state.sticking[world, part] = stuck
    if not supported:
        workspace.away[slot] = True
        state.fallen[world, part] = True


@exact
def series_held(workspace, g, h):
    """Return the mask of lanes for which the series was accurate during a step with substeps of ``h`` s."""
    first, own = g * LANES, workspace.own[g]
    slow = load(workspace.slow_rate, first) * h
    pose, velocity = workspace.pose[g], workspace.velocity[g]
    place = load(pose, 0) + load(pose, LANES) + load(pose, 2 * LANES)
    motion = load(velocity, 0) + load(velocity, LANES) + load(velocity, 2 * LANES)
    return (
        (load(own, 0) <= load(workspace.most_square, first)) & (load(own, LANES) >= slow * slow)
        & (absolute(place + motion) < math.inf)
    )  # fmt: skip


@exact
def slide_group(scene, g, step):
    """Move a group's parts by the series for a step; return the bits of the lanes that must take it by points, unmoved."""
    workspace, first = scene.workspace, g * LANES
    pose, velocity = workspace.pose[g], workspace.velocity[g]
    here = logical_not(load_mask(workspace.away, first))
    by_series = here & logical_not(load_mask(workspace.by_points, first) | mask_of(sticking_lanes(scene, first)))
    sliding = bits(by_series & load_mask(workspace.held, first))
    if sliding == 0:
        by_series = logical_not(here) & here
    else:
        old_pose, old_velocity = workspace.old_pose[g], workspace.old_velocity[g]
        for k in range(0, 3 * LANES, LANES):
            store(old_pose, k, load(pose, k))
            store(old_velocity, k, load(velocity, k))
        for lane in range(0, LANES, WIDTH):
            if sliding >> lane & ((1 << WIDTH) - 1) != 0:
                moments, own = workspace.moments[g, lane:], workspace.own[g, lane:]
                slide_by_series(scene.table, step, moments, pose[lane:], velocity[lane:], own)
        by_series = by_series & series_held(workspace, g, step.h)
        if bits(logical_not(by_series)) != 0:
            for k in range(0, 3 * LANES, LANES):
                store(pose, k, select(by_series, load(pose, k), load(old_pose, k)))
                store(velocity, k, select(by_series, load(velocity, k), load(old_velocity, k)))
    return bits(here & logical_not(by_series))


@jit
def apply_friction(scene, step):
    """Move all parts by friction alone for a step."""
    for g in range(scene.groups):
        again = slide_group(scene, g, step)
        lane = 0
        while again >> lane != 0:
            if again >> lane & 1:
                step_by_points(scene, step, g * LANES + lane)
            lane += 1


@jit
def friction_step(scene, phase, span):
    """Return a step of ``span`` s from ``phase = w t`` on, in the scheme's Runge-Kutta steps or shorter ones."""
    table, scheme, cosine, sine = scene.table, scene.scheme, scene.workspace.cosine, scene.workspace.sine
    substeps = int(math.ceil(span * scheme.steps * scheme.substeps / table.period - 1e-9))
    h = span / substeps
    third = 2.0 * math.pi / table.period * h / 3.0
    c, s, turn, rise = math.cos(phase), math.sin(phase), math.cos(third), math.sin(third)
    for node in range(3 * substeps + 1):  # substeps share nodes
        cosine[node], sine[node] = c, s
        c, s = c * turn - s * rise, s * turn + c * rise
    return TimeSpan(phase, span, h, substeps, cosine, sine, 0, 3)
