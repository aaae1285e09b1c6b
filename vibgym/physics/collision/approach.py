"""How long parts may move as if they were alone before one runs into another, and which pairs may touch by then."""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym._numba.jit import borrowing
from vibgym.physics.collision.hulls import A_FACE, B_FACE, farthest, hull_contact, wall_direction
from vibgym.physics.core.records import friction_in, incline_size
from vibgym.physics.planar.pressure_moments import LANES

FAST, SLOWLY = 0.02, 6.0
"""m/s; where parts come together more slowly, so many times the overlap of an impact is allowed."""

DEEP = 12.0
"""Times the overlap of an impact from which on slow parts and corners on circles get no more than it, either."""

RESTING = 0.01
"""m/s; parts that come together more slowly at the start of a step rest against one another, and do not rebound from what
friction's acceleration adds in it: they would chatter without end. A rebound of this speed is over after 10 um."""


class Approach(NamedTuple):
    """What is known of a step so far."""

    h: float  # s, its length
    touching: bool  # whether any pair may touch in it
    impact: bool  # whether such a pair comes together faster than ``RESTING``


@borrowing
def part_motion(workspace, part):
    """x, y, and velocity x, y and spin of a part."""
    pose, velocity, lane = workspace.pose[part // LANES], workspace.velocity[part // LANES], part % LANES
    return pose[lane], pose[LANES + lane], velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]


@borrowing
def pull_on(encounter, part):
    """Friction's acceleration of a part, which straight lines leave out, m/s^2."""
    scene = encounter.scene
    return 2.0 * friction_in(scene.bodies, scene.state, scene.workspace.world[part], part) * scene.table.gravity


@borrowing
def arm_of(hulls, part):
    """Largest distance of a corner from the centre, m: none for a disc, which looks the same however it turns."""
    return hulls.radius[part] - hulls.rounding[hulls.owner[part]]


@borrowing
def meet(encounter, approach, gap, later, pull, curve, shortest, pair):
    """Take a gap into account that shrinks to ``later`` in the step where everything goes straight on.

    Args:
        pull, curve: m/s^2, what friction and the circles on which corners go may bend that.
    """
    h, touching, impact = approach
    if later < 0.5 * (pull + curve) * h * h:
        touching = encounter.contacts.close[pair] = True
        if gap - later > RESTING * h:
            impact = encounter.contacts.impact[pair] = True
    overlap, change, along = encounter.overlap, later - gap, h
    lowest = min(gap, 0.0) - (overlap if gap < -DEEP * overlap else SLOWLY * overlap)
    least = min(gap, 0.0) - overlap if -change > FAST * h else lowest
    if later < least:
        # The gap along a fixed direction is concave in time: its chord is met too early, never too late.
        h = max(along * (gap - least) / -change, shortest)
    if later - 0.5 * curve * along * along < lowest:
        # Where the chord less ``curve t^2 / 2`` is down to the lowest.
        slope = change / along
        h = max(min(h, (slope + math.sqrt(slope * slope + 2.0 * curve * (gap - lowest))) / curve), shortest)
    return Approach(h, touching, impact)


@borrowing
def meet_wall(encounter, approach, shortest, pair, part, wall):
    """Take a part and a wall into account."""
    table, hulls, placed = encounter.scene.table, encounter.hulls, encounter.contacts.placed
    x, y, vx, vy, spin = part_motion(encounter.scene.workspace, part)
    nx, ny, border = wall_direction(table, wall)
    scene = encounter.scene
    pull = pull_on(encounter, part) + incline_size(scene.state, scene.workspace.world[part])
    curve, h = spin * spin * arm_of(hulls, part), approach.h
    # Also what goes away from the wall may first turn a corner into it.
    if border - (nx * x + ny * y) > hulls.radius[part] + max(nx * vx + ny * vy, 0.0) * h + 0.5 * pull * h * h:
        return approach
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        h = approach.h
        gap = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, 0.0)
        later = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, h)
        approach = meet(encounter, approach, gap, later, pull, curve, shortest, pair)
    return approach


@borrowing
def meet_part(encounter, approach, shortest, pair, i, j):
    """Take two parts into account."""
    hulls, placed = encounter.hulls, encounter.contacts.placed
    xi, yi, ui, wi, si = part_motion(encounter.scene.workspace, i)
    xj, yj, uj, wj, sj = part_motion(encounter.scene.workspace, j)
    h = approach.h
    pull = pull_on(encounter, i) + pull_on(encounter, j)  # an inclined table accelerates both alike
    dx, dy, du, dw = xj - xi, yj - yi, uj - ui, wj - wi
    speed = math.sqrt(du * du + dw * dw)
    clear = hulls.radius[i] + hulls.radius[j] + speed * h + 0.5 * pull * h * h
    if dx * dx + dy * dy > clear * clear:
        return approach
    arm_i, arm_j, away = arm_of(hulls, i), arm_of(hulls, j), math.sqrt(dx * dx + dy * dy) + speed * h
    relative = (sj - si) * (sj - si)
    for a in range(hulls.owner[i], hulls.owner[i + 1]):
        for b in range(hulls.owner[j], hulls.owner[j + 1]):
            h = approach.h
            gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
            # An edge takes its normal along when its part turns: seen from there, only the other hull moves, and goes on a
            # curve by its own turning against the edge, and by centrifugal and Coriolis acceleration.
            if owner == A_FACE:
                vx, vy = du - sj * (yi - yj), dw + sj * (xi - xj)
                now = farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, 0.0)
                later = gap + now - farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, h)
                curve = relative * arm_j + abs(si) * (abs(si) * away + 2.0 * speed)
            elif owner == B_FACE:
                vx, vy = -du - si * (yj - yi), -dw + si * (xj - xi)
                now = farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, 0.0)
                later = gap + now - farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, h)
                curve = relative * arm_i + abs(sj) * (abs(sj) * away + 2.0 * speed)
            else:
                later = -farthest(hulls, placed, b, -nx, -ny, xj, yj, uj, wj, sj, h)
                later -= farthest(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, h)
                curve = si * si * arm_i + sj * sj * arm_j
            approach = meet(encounter, approach, gap, later, pull, curve, shortest, pair)
    return approach


@borrowing
def safe_step(encounter, pairs, n, h, shortest):
    """How long friction may go on alone, and what may touch by then: ``contacts.close``, and ``contacts.impact`` where it comes
    together faster than ``RESTING``.

    Velocities may add as much as ``encounter.overlap`` to the overlap of two parts; slow ones, and the circles on which
    corners go, ``SLOWLY`` times as much, at any instant of the step. What friction's acceleration adds, at most
    ``2 mu g h^2``, is for ``h`` to keep small.

    Args:
        pairs: of which ``n`` may come to touch.
        h, shortest: s, longest and shortest step.
    """
    away = encounter.scene.workspace.away
    approach = Approach(h, False, False)
    for pair in range(n):
        encounter.contacts.close[pair] = encounter.contacts.impact[pair] = False
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]):
            continue
        if j < 0:
            approach = meet_wall(encounter, approach, shortest, pair, i, -1 - j)
        else:
            approach = meet_part(encounter, approach, shortest, pair, i, j)
    return approach
