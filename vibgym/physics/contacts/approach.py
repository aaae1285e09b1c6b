"""Conservative advancement: the longest step that parts may move independently, and the pairs that may touch in it.

The step ends before the earliest time of impact that bounds on velocity, friction and rotation allow (B. Mirtich,
Impulse-based Dynamic Simulation of Rigid Body Systems, PhD thesis, Berkeley, 1996, ch. 2; C. Ericson, Real-Time Collision
Detection, 2005, sec. 5.5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import borrowing
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.hulls import A_FACE, B_FACE, farthest, hull_contact, place_hulls, wall_direction
from vibgym.physics.core.records import friction_in, incline_size

FAST, SLOWLY = 0.02, 6.0
"""m/s; where parts come together more slowly, so many times the overlap of an impact is allowed."""

DEEP = 12.0
"""Times the overlap of an impact from which on slow parts and corners on circles get no more than it, either."""

RESTING = 0.01
"""m/s; parts that come together more slowly at the start of a step rest against one another, and do not rebound from what
friction's acceleration adds in it: they would chatter without end. A rebound of this speed is over after 10 um."""


class Approach(NamedTuple):
    """Result of conservative advancement for the pairs processed so far."""

    h: float  # s, its length
    touching: bool  # whether any pair may touch in it
    impact: bool  # whether such a pair comes together faster than ``RESTING``
    nearest: float  # m, gap of the pair at hand, or less, at the start of the step


@borrowing
def part_motion(workspace, slot):
    """x, y, and velocity x, y and spin of the part in a slot."""
    pose, velocity, lane = workspace.pose[slot // LANES], workspace.velocity[slot // LANES], slot % LANES
    return pose[lane], pose[LANES + lane], velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]


@borrowing
def friction_bound(encounter, slot):
    """Return an upper bound on the relative acceleration by friction of a part, m/s^2."""
    scene = encounter.scene
    friction = friction_in(scene.bodies, scene.state, encounter.world, scene.workspace.part[slot])
    return 2.0 * friction * scene.table.gravity


@borrowing
def arm_of(hulls, part):
    """Return the largest distance of a corner from the centre, m; zero for a disc."""
    return hulls.radius[part] - hulls.rounding[hulls.owner[part]]


@borrowing
def bound_motion(encounter, h):
    """Compute ``contacts.ahead``: bound (m) on the motion of any point of each part in a step of ``h`` s alone."""
    scene, contacts = encounter.scene, encounter.contacts
    incline = incline_size(scene.state, encounter.world)
    for slot in range(encounter.parts):
        part = scene.workspace.part[slot]
        _, _, vx, vy, spin = part_motion(scene.workspace, slot)
        radius, gyration = encounter.hulls.radius[part], scene.bodies.gyration[scene.bodies.kind[part]]
        pull = friction_bound(encounter, slot) * (1.0 + radius * radius / gyration) + incline
        contacts.ahead[slot] = (math.sqrt(vx * vx + vy * vy) + radius * abs(spin)) * h + 0.5 * pull * h * h


@borrowing
def stays_separated(contacts, pair, i, j):
    """Return whether the separation at the last exact test proves that a pair stays apart in this step."""
    used, ahead = contacts.gone[i], contacts.ahead[i]
    if j >= 0:
        used, ahead = used + contacts.gone[j], ahead + contacts.ahead[j]
    return contacts.clear[pair] - used > ahead


@borrowing
def place_slot(encounter, slot):
    """Place the hulls of the part in a slot unless they are up to date."""
    contacts = encounter.contacts
    if not contacts.fresh[slot]:
        contacts.fresh[slot] = True
        at, lane = encounter.scene.workspace.pose[slot // LANES], slot % LANES
        part = encounter.scene.workspace.part[slot]
        place_hulls(encounter.hulls, part, at[lane], at[LANES + lane], at[2 * LANES + lane], contacts.placed)


@borrowing
def invalidate_placement(encounter):
    """Mark all placed hulls as outdated, after parts have moved."""
    for slot in range(encounter.parts):
        encounter.contacts.fresh[slot] = False


@borrowing
def limit_to_impact(encounter, approach, gap, later, pull, curve, shortest, pair):
    """Shorten the step to the earliest possible time of impact of a pair whose gap is ``later`` at its end on straight lines.

    Args:
        gap, later: m, at the start and the end of the step of ``approach.h`` s.
        pull, curve: m/s^2, bounds on acceleration by friction and by rotation, which straight lines omit.
        shortest: s, lower limit of the step.
    """
    h, touching, impact, nearest = approach
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
    return Approach(h, touching, impact, min(nearest, gap))


@borrowing
def advance_to_wall(encounter, approach, shortest, pair, slot, wall):
    """Shorten the step by the time of impact of a part and a wall."""
    scene, hulls, placed = encounter.scene, encounter.hulls, encounter.contacts.placed
    part = scene.workspace.part[slot]
    x, y, vx, vy, spin = part_motion(scene.workspace, slot)
    nx, ny, border = wall_direction(scene.table, wall)
    pull = friction_bound(encounter, slot) + incline_size(scene.state, encounter.world)
    curve, h = spin * spin * arm_of(hulls, part), approach.h
    clear = border - (nx * x + ny * y) - hulls.radius[part]
    # Also what goes away from the wall may first turn a corner into it.
    if clear > max(nx * vx + ny * vy, 0.0) * h + 0.5 * pull * h * h:
        return Approach(h, approach.touching, approach.impact, clear)
    place_slot(encounter, slot)
    approach = Approach(h, approach.touching, approach.impact, math.inf)
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        h = approach.h
        gap = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, 0.0)
        later = border - farthest(hulls, placed, a, nx, ny, x, y, vx, vy, spin, h)
        approach = limit_to_impact(encounter, approach, gap, later, pull, curve, shortest, pair)
    return approach


@borrowing
def advance_to_part(encounter, approach, shortest, pair, i, j):
    """Shorten the step by the time of impact of the parts in two slots."""
    hulls, placed, part = encounter.hulls, encounter.contacts.placed, encounter.scene.workspace.part
    one, other = part[i], part[j]
    xi, yi, ui, wi, si = part_motion(encounter.scene.workspace, i)
    xj, yj, uj, wj, sj = part_motion(encounter.scene.workspace, j)
    h = approach.h
    pull = friction_bound(encounter, i) + friction_bound(encounter, j)  # an inclined table accelerates both alike
    dx, dy, du, dw = xj - xi, yj - yi, uj - ui, wj - wi
    speed, distance = math.sqrt(du * du + dw * dw), math.sqrt(dx * dx + dy * dy)
    clear = distance - hulls.radius[one] - hulls.radius[other]
    if clear > speed * h + 0.5 * pull * h * h:
        return Approach(h, approach.touching, approach.impact, clear)
    place_slot(encounter, i)
    place_slot(encounter, j)
    approach = Approach(h, approach.touching, approach.impact, math.inf)
    arm_i, arm_j, away = arm_of(hulls, one), arm_of(hulls, other), distance + speed * h
    relative = (sj - si) * (sj - si)
    for a in range(hulls.owner[one], hulls.owner[one + 1]):
        for b in range(hulls.owner[other], hulls.owner[other + 1]):
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
            approach = limit_to_impact(encounter, approach, gap, later, pull, curve, shortest, pair)
    return approach


@borrowing
def conservative_step(encounter, pairs, n, h, shortest):
    """Compute the longest step with friction alone, by conservative advancement over all pairs.

    Sets ``contacts.close`` for pairs that may touch in it, and ``contacts.impact`` where they approach faster than ``RESTING``.

    Velocities may add as much as ``encounter.overlap`` to the overlap of two parts; slow ones, and the circles on which
    corners go, ``SLOWLY`` times as much, at any instant of the step. What friction's acceleration adds, at most
    ``2 mu g h^2``, is for ``h`` to keep small.

    A pair is tested again only when motion or speed of its parts exceeds the separation of the last test.

    Args:
        pairs: of which ``n`` may come to touch.
        h, shortest: s, longest and shortest step.
    """
    away, contacts = encounter.scene.workspace.away, encounter.contacts
    approach = Approach(h, False, False, math.inf)
    bound_motion(encounter, h)
    for pair in range(n):
        contacts.close[pair] = contacts.impact[pair] = False
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]) or stays_separated(contacts, pair, i, j):
            continue
        used = contacts.gone[i]
        if j < 0:
            approach = advance_to_wall(encounter, approach, shortest, pair, i, -1 - j)
        else:
            approach = advance_to_part(encounter, approach, shortest, pair, i, j)
            used += contacts.gone[j]
        contacts.clear[pair] = approach.nearest + used
    return approach
