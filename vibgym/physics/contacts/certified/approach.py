"""Conservative advancement: the longest step that parts may move independently, and the pairs that may touch in it.

The step ends before the earliest time of impact that bounds on velocity, friction and rotation allow (B. Mirtich,
Impulse-based Dynamic Simulation of Rigid Body Systems, PhD thesis, Berkeley, 1996, ch. 2; C. Ericson, Real-Time Collision
Detection, 2005, sec. 5.5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import jit
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.hulls import A_FACE, B_FACE, kept_contact, moved_support, place_hulls, wall_direction
from vibgym.physics.contacts.impulses import RESTING
from vibgym.physics.core.records import friction_in, incline_size, kind_in

FAST, SLOWLY = 0.02, 6.0
"""Closing speed (m/s) below which the allowed overlap is larger, and the factor."""

DEEP = 12.0
"""Overlap over that allowed for an impact, from which on slow parts and rotating corners may add no more than that."""


class Approach(NamedTuple):
    """Result of conservative advancement for the pairs processed so far."""

    h: float  # s, length of the step
    touching: bool  # a pair may touch in it
    impact: bool  # such a pair approaches faster than ``RESTING``
    nearest: float  # m, lower bound of the last pair's gap at the start of the step


@jit
def part_motion(workspace, slot):
    """Return x, y, velocity x, y and spin of the part in a slot."""
    pose, velocity, lane = workspace.pose[slot // LANES], workspace.velocity[slot // LANES], slot % LANES
    return pose[lane], pose[LANES + lane], velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]


@jit
def friction_bound(island, slot):
    """Return an upper bound on the acceleration of a part by friction, relative to the table's, and by contacts, m/s^2."""
    scene = island.scene
    part, push = scene.workspace.part[slot], island.solver.push[slot]
    friction = friction_in(scene.bodies, scene.state, island.world, part)
    contact = math.sqrt(push[0] * push[0] + push[1] * push[1]) + island.hulls.radius[part] * abs(push[2])
    return 2.0 * friction * scene.table.gravity + contact


@jit
def arm_of(hulls, part):
    """Return the largest distance of a corner from the centre, m; zero for a disc."""
    return hulls.radius[part] - hulls.rounding[hulls.owner[part]]


@jit
def bound_motion(island, h):
    """Compute ``contacts.ahead``: bound (m) on the motion of any point of each part in a step of ``h`` s alone."""
    scene, contacts = island.scene, island.contacts
    incline = incline_size(scene.state, island.world)
    for slot in range(island.parts):
        part = scene.workspace.part[slot]
        _, _, vx, vy, spin = part_motion(scene.workspace, slot)
        radius, kind = island.hulls.radius[part], kind_in(scene.bodies, island.world, part)
        pull = friction_bound(island, slot) * (1.0 + radius * radius / scene.bodies.gyration[kind]) + incline
        contacts.step_bound[slot] = (math.sqrt(vx * vx + vy * vy) + radius * abs(spin)) * h + 0.5 * pull * h * h


@jit
def stays_separated(contacts, pair, i, j):
    """Return whether the separation at the last exact test proves that a pair stays apart in this step."""
    used, step_bound = contacts.travelled[i], contacts.step_bound[i]
    if j >= 0:
        used, step_bound = used + contacts.travelled[j], step_bound + contacts.step_bound[j]
    return contacts.separation[pair] - used > step_bound


@jit
def place_slot(island, slot):
    """Place the hulls of the part in a slot unless they are up to date."""
    contacts = island.contacts
    if not contacts.fresh[slot]:
        contacts.fresh[slot] = True
        at, lane = island.scene.workspace.pose[slot // LANES], slot % LANES
        part = island.scene.workspace.part[slot]
        place_hulls(island.hulls, part, at[lane], at[LANES + lane], at[2 * LANES + lane], contacts.placed)


@jit
def invalidate_placement(island):
    """Mark all placed hulls as outdated, after parts have moved."""
    for slot in range(island.parts):
        island.contacts.fresh[slot] = False


@jit
def limit_to_impact(island, approach, gap, later, pull, curve, shortest, pair):
    """Shorten the step to the earliest possible time of impact of a pair.

    Args:
        gap, later: m, at the start and the end of the step of ``approach.h`` s, for motion on straight lines.
        pull, curve: m/s^2, bounds on acceleration by friction and by rotation, which straight lines omit.
        shortest: s, lower limit of the step.
    """
    h, touching, impact, nearest = approach
    if later < 0.5 * (pull + curve) * h * h:
        touching = island.contacts.close[pair] = True
        if gap - later > RESTING * h:
            impact = island.contacts.impact[pair] = True
    overlap, change, along = island.overlap, later - gap, h
    lowest = min(gap, 0.0) - (overlap if gap < -DEEP * overlap else SLOWLY * overlap)
    least = min(gap, 0.0) - overlap if -change > FAST * h else lowest
    if later < least:
        # The gap along a fixed direction is concave in time, so its chord gives too early a time, never too late.
        h = max(along * (gap - least) / -change, shortest)
    if later - 0.5 * curve * along * along < lowest:
        # Time at which the chord less ``curve t^2 / 2`` reaches the lowest gap allowed.
        slope = change / along
        h = max(min(h, (slope + math.sqrt(slope * slope + 2.0 * curve * (gap - lowest))) / curve), shortest)
    return Approach(h, touching, impact, min(nearest, gap))


@jit
def advance_to_wall(island, approach, shortest, pair, slot, wall):
    """Shorten the step by the time of impact of a part and a wall."""
    scene, hulls, placed = island.scene, island.hulls, island.contacts.placed
    part = scene.workspace.part[slot]
    x, y, vx, vy, spin = part_motion(scene.workspace, slot)
    nx, ny, border = wall_direction(scene.table, wall)
    pull = friction_bound(island, slot) + incline_size(scene.state, island.world)
    curve, h = spin * spin * arm_of(hulls, part), approach.h
    separation = border - (nx * x + ny * y) - hulls.radius[part]
    # A part that moves away from the wall may still turn a corner into it.
    if separation > max(nx * vx + ny * vy, 0.0) * h + 0.5 * pull * h * h:
        return Approach(h, approach.touching, approach.impact, separation)
    place_slot(island, slot)
    approach = Approach(h, approach.touching, approach.impact, math.inf)
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        h = approach.h
        gap = border - moved_support(hulls, placed, a, nx, ny, x, y, vx, vy, spin, 0.0)
        later = border - moved_support(hulls, placed, a, nx, ny, x, y, vx, vy, spin, h)
        approach = limit_to_impact(island, approach, gap, later, pull, curve, shortest, pair)
    return approach


@jit
def advance_to_part(island, approach, shortest, pair, i, j):
    """Shorten the step by the time of impact of the parts in two slots."""
    hulls, placed, part = island.hulls, island.contacts.placed, island.scene.workspace.part
    one, other = part[i], part[j]
    xi, yi, ui, wi, si = part_motion(island.scene.workspace, i)
    xj, yj, uj, wj, sj = part_motion(island.scene.workspace, j)
    h = approach.h
    pull = friction_bound(island, i) + friction_bound(island, j)  # an incline accelerates both equally
    dx, dy, du, dw = xj - xi, yj - yi, uj - ui, wj - wi
    speed, distance = math.sqrt(du * du + dw * dw), math.sqrt(dx * dx + dy * dy)
    separation = distance - hulls.radius[one] - hulls.radius[other]
    if separation > speed * h + 0.5 * pull * h * h:
        return Approach(h, approach.touching, approach.impact, separation)
    place_slot(island, i)
    place_slot(island, j)
    approach = Approach(h, approach.touching, approach.impact, math.inf)
    arm_i, arm_j, away = arm_of(hulls, one), arm_of(hulls, other), distance + speed * h
    relative, contacts, combination = (sj - si) * (sj - si), island.contacts, 0
    for a in range(hulls.owner[one], hulls.owner[one + 1]):
        for b in range(hulls.owner[other], hulls.owner[other + 1]):
            h = approach.h
            feature = contacts.feature[contacts.first_feature[pair] + combination]
            gap, nx, ny, owner = kept_contact(hulls, placed, a, b, feature)
            combination += 1
            # The normal of an edge rotates with its part. In the part's frame only the other hull moves, on a curve: by its
            # rotation relative to the edge, and by centrifugal and Coriolis acceleration.
            if owner == A_FACE:
                vx, vy = du - sj * (yi - yj), dw + sj * (xi - xj)
                now = moved_support(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, 0.0)
                later = gap + now - moved_support(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, h)
                curve = relative * arm_j + abs(si) * (abs(si) * away + 2.0 * speed)
            elif owner == B_FACE:
                vx, vy = -du - si * (yj - yi), -dw + si * (xj - xi)
                now = moved_support(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, 0.0)
                later = gap + now - moved_support(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, h)
                curve = relative * arm_i + abs(sj) * (abs(sj) * away + 2.0 * speed)
            else:
                later = -moved_support(hulls, placed, b, -nx, -ny, xj, yj, uj, wj, sj, h)
                later -= moved_support(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, h)
                curve = si * si * arm_i + sj * sj * arm_j
            approach = limit_to_impact(island, approach, gap, later, pull, curve, shortest, pair)
    return approach


@jit
def conservative_step(island, pairs, n, h, shortest):
    """Compute the longest step with friction alone, by conservative advancement over all pairs.

    Sets ``contacts.close`` for pairs that may touch in it, and ``contacts.impact`` where they approach faster than ``RESTING``.

    At any instant of the step, velocities add at most ``island.overlap`` to the overlap of two parts; slow ones and rotation
    ``SLOWLY`` times as much. Acceleration by friction adds at most ``2 mu g h^2``, which the caller limits by ``h``.

    A pair is tested again only when motion or speed of its parts exceeds the separation of the last test.

    Args:
        pairs: (pairs, 2), of which the first ``n`` are near.
        h, shortest: s, longest and shortest step.
    """
    away, contacts = island.scene.workspace.away, island.contacts
    approach = Approach(h, False, False, math.inf)
    bound_motion(island, h)
    for pair in range(n):
        contacts.close[pair] = contacts.impact[pair] = False
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]) or stays_separated(contacts, pair, i, j):
            continue
        used = contacts.travelled[i]
        if j < 0:
            approach = advance_to_wall(island, approach, shortest, pair, i, -1 - j)
        else:
            approach = advance_to_part(island, approach, shortest, pair, i, j)
            used += contacts.travelled[j]
        contacts.separation[pair] = approach.nearest + used
    return approach
