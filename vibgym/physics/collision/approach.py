"""How long parts may move as if they were alone before one runs into another, and which pairs may touch by then."""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.physics.collision.hulls import A_FACE, B_FACE, BOTTOM, LEFT, RIGHT, farthest, hull_contact
from vibgym.physics.contact_area.pressure_moments import LANES
from vibgym.physics.core.jit import borrowing

FAST, SLOWLY = 0.02, 10.0
"""m/s; where parts come together more slowly, so many times the overlap of an impact is allowed."""

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
def pull_on(encounter, part, spin):
    """What straight lines leave out, m/s^2: friction's acceleration, and the circles on which points of a spinning part go."""
    bodies, gravity = encounter.scene.bodies, encounter.scene.table.gravity
    return 2.0 * bodies.friction[bodies.kind[part]] * gravity + spin * spin * encounter.hulls.radius[part]


@borrowing
def meet(encounter, approach, gap, later, bow, shortest, pair):
    """Take a gap into account that shrinks to ``later`` in the step, and may be smaller by ``bow`` (m)."""
    h, touching, impact = approach
    if later < bow:
        touching = encounter.contacts.close[pair] = True
        impact = impact or gap - later > RESTING * h
    overlap = encounter.overlap
    least = min(gap, 0.0) - (overlap if gap - later > FAST * h else SLOWLY * overlap)
    if later < least:
        # The gap along a fixed direction is concave in time: its chord is met too early, never too late.
        h = max(h * (gap - least) / (gap - later), shortest)
    return Approach(h, touching, impact)


@borrowing
def meet_wall(encounter, approach, shortest, pair, part, wall):
    """Take a part and a wall into account."""
    table, hulls, placed = encounter.scene.table, encounter.hulls, encounter.contacts.placed
    x, y, vx, vy, spin = part_motion(encounter.scene.workspace, part)
    nx, ny, border = 0.0, 0.0, 0.0
    if wall == LEFT:
        nx = -1.0
    elif wall == RIGHT:
        nx, border = 1.0, table.columns * table.element_size
    elif wall == BOTTOM:
        ny = -1.0
    else:
        ny, border = 1.0, table.rows * table.element_size
    pull = pull_on(encounter, part, spin)
    h = approach.h
    if border - (nx * x + ny * y) > hulls.radius[part] + (nx * vx + ny * vy) * h + 0.5 * pull * h * h:
        return approach
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        h = approach.h
        gap = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, 0.0)
        later = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, h)
        approach = meet(encounter, approach, gap, later, 0.5 * pull * h * h, shortest, pair)
    return approach


@borrowing
def meet_part(encounter, approach, shortest, pair, i, j):
    """Take two parts into account."""
    hulls, placed = encounter.hulls, encounter.contacts.placed
    xi, yi, ui, wi, si = part_motion(encounter.scene.workspace, i)
    xj, yj, uj, wj, sj = part_motion(encounter.scene.workspace, j)
    h = approach.h
    bow = 0.5 * (pull_on(encounter, i, si) + pull_on(encounter, j, sj)) * h * h
    dx, dy, du, dw = xj - xi, yj - yi, uj - ui, wj - wi
    clear = hulls.radius[i] + hulls.radius[j] + math.sqrt(du * du + dw * dw) * h + bow
    if dx * dx + dy * dy > clear * clear:
        return approach
    for a in range(hulls.owner[i], hulls.owner[i + 1]):
        for b in range(hulls.owner[j], hulls.owner[j + 1]):
            h = approach.h
            gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
            # An edge takes its normal along when its part turns: seen from there, only the other hull moves.
            if owner == A_FACE:
                vx, vy = du - sj * (yi - yj), dw + sj * (xi - xj)
                now = farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, 0.0)
                later = gap + now - farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, h)
            elif owner == B_FACE:
                vx, vy = -du - si * (yj - yi), -dw + si * (xj - xi)
                now = farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, 0.0)
                later = gap + now - farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, h)
            else:
                later = -farthest(hulls, placed, b, -nx, -ny, xj, yj, uj, wj, sj, h)
                later -= farthest(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, h)
            approach = meet(encounter, approach, gap, later, bow, shortest, pair)
    return approach


@borrowing
def safe_step(encounter, pairs, n, h, shortest):
    """How long friction may go on alone, and whether anything may touch by then: ``contacts.close``.

    Velocities may add as much as ``encounter.overlap`` to the overlap of two parts. What friction's acceleration adds in a
    step, at most ``2 mu g h^2``, is for ``h`` to keep small.

    Args:
        pairs: of which ``n`` may come to touch.
        h, shortest: s, longest and shortest step.
    """
    away = encounter.scene.workspace.away
    approach = Approach(h, False, False)
    for pair in range(n):
        encounter.contacts.close[pair] = False
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]):
            continue
        if j < 0:
            approach = meet_wall(encounter, approach, shortest, pair, i, -1 - j)
        else:
            approach = meet_part(encounter, approach, shortest, pair, i, j)
    return approach
