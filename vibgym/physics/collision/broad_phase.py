"""Which parts can come to touch: pairs that are near before a period, and paths that have come near after it.

Before a period nothing is known but speeds: friction accelerates a part by at most ``2 mu g`` (and an inclined table by as much
as it is inclined), which bounds how far it gets.
Parts whose circumscribed circles stay apart under that bound are not near. After a period without contacts the paths are
known, and the outlines' distances along them say whether anything came to touch.
"""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.collision.hulls import BOTTOM, LEFT, RIGHT, part_gap, place_hulls, wall_gap
from vibgym.physics.core.records import friction_in, incline_size

IN_TOUCH = 2e-4
"""m; what begins a period nearer than this is taken to touch in it, and no path without contacts is tried."""

FREE, NEAR, CONTACT = 0, 1, 2
"""What a world's period is: nothing is near enough to touch; something is, and what was near stays apart; with contacts."""


@borrowing
def travel_bound(table, friction, incline, vx, vy):
    """Largest distance, m, that a part can cover in a period while nothing but the table (incline in m/s^2) moves it."""
    # Not less for parts at the table's speed: what spins on an uneven pressure may become faster than the table.
    pull = friction * table.gravity + 0.5 * incline
    return (math.sqrt(vx * vx + vy * vy) + pull * table.period) * table.period


@borrowing
def wall_distance(table, wall, x, y):
    """Distance of a point from the wall along a border, m."""
    if wall == LEFT:
        return x
    if wall == RIGHT:
        return table.columns * table.element_size - x
    if wall == BOTTOM:
        return y
    return table.rows * table.element_size - y


@borrowing
def near_pairs(table, bodies, hulls, walls, state, world, pose, velocity, away, slack, pairs, reach, order):
    """Pairs of parts, and of parts and walls, of one world that may touch within a period.

    Args:
        state, world: for the world's conditions.
        walls: set of walls, a bit each.
        pose, velocity: (parts, 3).
        away: (parts,) bool, parts that have fallen.
        slack: m that a part may go farther than friction takes it, since others push it.
        pairs: (:func:`pair_capacity`, 2) overwritten: part and part, or part and ``-1 - wall``.
        reach: (parts,) working array.
        order: (parts,) working array.

    Returns:
        Number of pairs.
    """
    parts, incline = pose.shape[0], incline_size(state, world)
    n, largest = 0, 0.0
    for i in range(parts):
        mu = friction_in(bodies, state, world, i)
        reach[i] = hulls.radius[i] + travel_bound(table, mu, incline, velocity[i, 0], velocity[i, 1]) + slack
        if not away[i]:
            largest = max(largest, reach[i])
    for i in range(parts):  # sorted along x, the longer side of most tables, by insertion: it is nearly sorted often
        k = i
        while k > 0 and pose[order[k - 1], 0] > pose[i, 0]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i
    for a in range(parts):
        i = order[a]
        if away[i]:
            continue
        for b in range(a + 1, parts):
            j = order[b]
            dx = pose[j, 0] - pose[i, 0]
            if not dx <= reach[i] + largest:
                break
            if away[j]:
                continue
            dy, sum_of_both = pose[j, 1] - pose[i, 1], reach[i] + reach[j]
            if dx * dx + dy * dy <= sum_of_both * sum_of_both:
                pairs[n, 0], pairs[n, 1] = min(i, j), max(i, j)
                n += 1
        if walls != 0:
            for wall in range(4):
                if (walls >> wall) & 1 and wall_distance(table, wall, pose[i, 0], pose[i, 1]) <= reach[i]:
                    pairs[n, 0], pairs[n, 1] = i, -1 - wall
                    n += 1
    return n


@borrowing
def pair_gap(table, hulls, placed, i, j):
    """Gap between two placed parts, or a part and a wall (``j = -1 - wall``), m."""
    if j >= 0:
        return part_gap(hulls, placed, i, j)
    return wall_gap(hulls, placed, i, -1 - j, table.columns * table.element_size, table.rows * table.element_size)


@borrowing
def proximity(table, hulls, pose, pairs, n, placed):
    """``CONTACT`` if one of the pairs is in touch at these poses, else ``NEAR``."""
    for k in range(n):
        for end in range(2):
            i = pairs[k, end]
            if i >= 0:
                place_hulls(hulls, i, pose[i, 0], pose[i, 1], pose[i, 2], placed)
        if pair_gap(table, hulls, placed, pairs[k, 0], pairs[k, 1]) < IN_TOUCH:
            return CONTACT
    return NEAR


@borrowing
def curvature_bound(table, bodies, hulls, state, world, part, step):
    """How far a point of a part can be from the straight line between two poses ``step`` s apart, m."""
    friction, radius = friction_in(bodies, state, world, part), hulls.radius[part]
    gyration, bend = bodies.gyration[bodies.kind[part]], incline_size(state, world) * step * step / 8.0
    return 2.0 * friction * table.gravity * (1.0 + radius * radius / gyration) * step * step / 8.0 + bend


@borrowing
def paths_cross(table, bodies, hulls, state, world, paths, steps, first, pairs, n, placed):
    """Whether one of the pairs may have touched on the way.

    Args:
        state, world: for the world's conditions.
        paths: (worlds * parts, most steps + 1, 3) poses at the ends of steps; the world's rows begin at ``first``.
        steps: (kinds,) steps per period of each kind.
    """
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        mine = steps[bodies.kind[i]]
        theirs = mine if j < 0 else steps[bodies.kind[j]]
        common = math.gcd(mine, theirs)
        slack = curvature_bound(table, bodies, hulls, state, world, i, table.period / common)
        if j >= 0:
            slack += curvature_bound(table, bodies, hulls, state, world, j, table.period / common)
        for k in range(common):
            p = paths[first + i]
            at, then = p[k * (mine // common)], p[(k + 1) * (mine // common)]
            place_hulls(hulls, i, at[0], at[1], at[2], placed)
            dx, dy = then[0] - at[0], then[1] - at[1]
            turned = hulls.radius[i] * abs(then[2] - at[2])
            if j >= 0:
                q = paths[first + j]
                at, then = q[k * (theirs // common)], q[(k + 1) * (theirs // common)]
                place_hulls(hulls, j, at[0], at[1], at[2], placed)
                dx, dy = dx - (then[0] - at[0]), dy - (then[1] - at[1])
                turned += hulls.radius[j] * abs(then[2] - at[2])
            if not pair_gap(table, hulls, placed, i, j) > math.sqrt(dx * dx + dy * dy) + turned + slack:
                return True
    return False


def pair_capacity(parts: int) -> int:
    """Pairs that a world of so many parts can have: every part with every other and with every wall."""
    return parts * (parts - 1) // 2 + 4 * parts
