"""Sequential impulses: all contact points of a world at once, by projected Gauss-Seidel iteration.

Velocities: no point approaches, and friction at a point is at most ``mu`` times its normal impulse (J. J. Moreau, Unilateral
Contact and Dry Friction in Finite Freedom Dynamics, 1988; E. Catto, Iterative Dynamics with Temporal Coherence, GDC 2005). An
impact then returns the share ``e`` of its impulses (Poisson), or less where energy would be gained.

Positions: impulses move the parts for the time since they touched, and a second iteration over the linearised gaps removes the
overlap that is left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit

NX, NY, ARM_I, ARM_J, LEVER_I, LEVER_J, NORMAL_MASS, TANGENT_MASS = 0, 1, 2, 3, 4, 5, 6, 7
ALLOWED, FRICTION, GAP, NORMAL, TANGENTIAL, RESTITUTION, TIME, MOVED, SLID = 8, 9, 10, 11, 12, 13, 14, 15, 16
KICK, KICK_ALONG, CROSS, NORMAL_MOBILITY, TANGENT_MOBILITY = 17, 18, 19, 20, 21
FIELDS = 22
"""Columns of a point: normal; lever arms of both bodies for normal and tangential impulses (m); effective masses (kg); allowed
closing speed (m/s); coefficient of friction; gap (m); impulses (N s); restitution, 0 at points that rest; time for which the
impulses have moved the bodies (s); impulses times time (kg m); normal and tangential impulse that were applied at the step's
start (N s); changes of the velocities by unit impulses: of slip by a normal one, of normal velocity, of slip (1/kg)."""

STILL_SPEED, STILL_MOVE = 1e-3, 2e-5
"""Largest change (m/s; m) in an iteration at which it ends."""

RESTING = 0.01
"""Closing speed at the start of a step (m/s) below which parts rest against each other and do not rebound: the acceleration by
friction would cause endless chatter. A rebound at this speed is 10 um high."""

HIT_SPEED = 0.1
"""Change of velocity by contacts (m/s) above which a part was hit, not held: its contact area is cut again, and the next step
does not start from the impulses of that impact."""

FEWEST_ROUNDS, MAX_ROUNDS = 10, 1000
"""Limits of the iterations over all contacts in a step."""

UNLIMITED = 1e9
"""Closing speed that no parts reach, m/s."""

MOVES = 8
"""Most iterations over positions."""


class Points(NamedTuple):
    """Contact points of one world and the motion of its bodies; the last body is that of all walls."""

    value: np.ndarray  # (points, FIELDS)
    body: np.ndarray  # (points, 2) bodies
    velocity: np.ndarray  # (bodies, 3) m/s, m/s, rad/s
    before: np.ndarray  # (bodies, 3) at the step's start
    move: np.ndarray  # (bodies, 3) m, m, rad
    inverse: np.ndarray  # (bodies, 2) 1/kg, 1/(kg m^2); zero for walls


class ImpactProperties(NamedTuple):
    """Properties of parts for impacts."""

    every: np.ndarray  # (kinds, 4) mass, gyration, restitution and friction
    mass: np.ndarray  # (parts,) kg, of the current world, as all that follows; without the factor on mass
    gyration: np.ndarray  # (parts,) m^2, inertia over mass
    restitution: np.ndarray  # (parts,) energetic coefficient; a pair uses the geometric mean, a wall the part's
    friction: np.ndarray  # (parts,) likewise


@jit
def load_properties(properties, kind):
    """Load the properties of parts of these kinds (parts,)."""
    for part in range(kind.shape[0]):
        every = properties.every[kind[part]]
        properties.mass[part], properties.gyration[part] = every[0], every[1]
        properties.restitution[part], properties.friction[part] = every[2], every[3]


def point_capacity(hulls: int) -> int:
    """Return the largest number of contact points of ``hulls`` and the walls.

    Outlines that do not overlap touch at most three times as many others, since these pairs form a planar graph. There is
    room for twice as many points, since some are only near.
    """
    return 2 * 6 * (hulls + 4)


def new_points(bodies: int, capacity: int) -> Points:
    """Allocate working arrays."""
    return Points(
        value=np.zeros((capacity, FIELDS)),
        body=np.zeros((capacity, 2), np.int64),
        velocity=np.zeros((bodies, 3)),
        before=np.zeros((bodies, 3)),
        move=np.zeros((bodies, 3)),
        inverse=np.zeros((bodies, 2)),
    )


@jit
def normal_speed(value, motion, i, j):
    """Return the relative speed of two bodies along a point's normal, negative: approaching."""
    return (
        value[NX] * (motion[j, 0] - motion[i, 0]) + value[NY] * (motion[j, 1] - motion[i, 1])
        + value[ARM_J] * motion[j, 2] - value[ARM_I] * motion[i, 2]
    )  # fmt: skip


@jit
def slip_speed(value, motion, i, j):
    """Return the relative speed of two bodies along a point's tangent, the normal rotated by 90 degrees."""
    return (
        value[NX] * (motion[j, 1] - motion[i, 1]) - value[NY] * (motion[j, 0] - motion[i, 0])
        + value[LEVER_J] * motion[j, 2] - value[LEVER_I] * motion[i, 2]
    )  # fmt: skip


@jit
def apply(value, inverse, motion, i, j, normal, tangential):
    """Change the motion of both bodies by an impulse on the second."""
    px, py = normal * value[NX] - tangential * value[NY], normal * value[NY] + tangential * value[NX]
    motion[i, 0] -= inverse[i, 0] * px
    motion[i, 1] -= inverse[i, 0] * py
    motion[i, 2] -= inverse[i, 1] * (normal * value[ARM_I] + tangential * value[LEVER_I])
    motion[j, 0] += inverse[j, 0] * px
    motion[j, 1] += inverse[j, 0] * py
    motion[j, 2] += inverse[j, 1] * (normal * value[ARM_J] + tangential * value[LEVER_J])


@jit
def add_point(points, n, i, j, nx, ny, at_i, at_j, gap, friction, restitution, h):
    """Add a contact point; return the new number of points.

    Args:
        n: number of points.
        at_i, at_j: (x, y) m, from the centre of each body to the point.
        gap: m; negative: overlap.
        h: s, length of the step, at whose end the point is.
    """
    if n >= points.body.shape[0]:
        return n
    value, inverse = points.value[n], points.inverse
    points.body[n, 0], points.body[n, 1] = i, j
    value[NX], value[NY], value[GAP], value[FRICTION] = nx, ny, gap, friction
    value[ARM_I], value[ARM_J] = at_i[0] * ny - at_i[1] * nx, at_j[0] * ny - at_j[1] * nx
    value[LEVER_I], value[LEVER_J] = at_i[0] * nx + at_i[1] * ny, at_j[0] * nx + at_j[1] * ny
    mass = inverse[i, 0] + inverse[j, 0]
    arm, lever = inverse[i, 1] * value[ARM_I], inverse[j, 1] * value[ARM_J]
    value[NORMAL_MOBILITY] = mass + arm * value[ARM_I] + lever * value[ARM_J]
    value[CROSS] = arm * value[LEVER_I] + lever * value[LEVER_J]
    value[TANGENT_MOBILITY] = (
        mass + inverse[i, 1] * value[LEVER_I] * value[LEVER_I] + inverse[j, 1] * value[LEVER_J] * value[LEVER_J]
    )
    value[NORMAL_MASS], value[TANGENT_MASS] = 1.0 / value[NORMAL_MOBILITY], 1.0 / value[TANGENT_MOBILITY]
    value[NORMAL] = value[TANGENTIAL] = value[KICK] = value[KICK_ALONG] = 0.0
    closing = -normal_speed(value, points.velocity, i, j)
    # Friction accelerates parts that rest against each other in every step: only those that approached at its start rebound.
    impact = normal_speed(value, points.before, i, j) < -RESTING and closing > 0.0
    value[RESTITUTION], value[ALLOWED], value[TIME] = 0.0, 0.0, 0.5 * h
    if gap > 0.0:
        # Others may push it into contact. Those that approach meet in the next step, and rebound only then.
        value[ALLOWED], value[TIME] = UNLIMITED if impact else gap / h, 0.0
    elif impact:
        value[RESTITUTION], value[TIME] = restitution, min(-gap / closing, h)
    return n + 1


@jit
def add_manifold(points, n, i, j, x, y, u, w, manifold, friction, restitution, h):
    """Add the points of a manifold; return the new number of points.

    Args:
        x, y, u, w: m, centres of bodies ``i`` and ``j``.
    """
    if manifold.count > 0:
        px, py = manifold.x, manifold.y
        n = add_point(
            points, n, i, j, manifold.nx, manifold.ny, (px - x, py - y), (px - u, py - w), manifold.gap, friction,
            restitution, h,
        )  # fmt: skip
    if manifold.count > 1:
        px, py = manifold.other_x, manifold.other_y
        n = add_point(
            points, n, i, j, manifold.nx, manifold.ny, (px - x, py - y), (px - u, py - w), manifold.other_gap, friction,
            restitution, h,
        )  # fmt: skip
    return n


@jit
def rounds_needed(parts, ratio):
    """Return the largest number of iterations: impulses must propagate through a heap, and from heavy to light parts.

    A light part between a heavy one and a wall transmits a share ``light / heavy`` of the impulse in each iteration.

    Args:
        parts: number of parts.
        ratio: largest mass over smallest.
    """
    return int(min(FEWEST_ROUNDS + np.rint(2.0 * math.sqrt(parts) + ratio), float(MAX_ROUNDS)))


@jit
def iterate(points, n, rounds, still):
    """Iterate over the velocities of all points until they change by less than ``still`` m/s, at most ``rounds`` times.

    The sums of the impulses and of those at the step's start press and are within the cone of friction.
    """
    velocity, inverse = points.velocity, points.inverse
    for _ in range(rounds):
        most = 0.0
        for k in range(n):
            value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
            speed, slip = normal_speed(value, velocity, i, j), slip_speed(value, velocity, i, j)
            old, earlier, kick, kick_along = value[NORMAL], value[TANGENTIAL], value[KICK], value[KICK_ALONG]
            new = max(old - (speed + value[ALLOWED]) * value[NORMAL_MASS], -kick)
            if new == -kick and old == new and earlier == -kick_along:
                continue
            normal = new - old  # which also changes the slip
            limit = value[FRICTION] * (new + kick)
            later = earlier - (slip + normal * value[CROSS]) * value[TANGENT_MASS]
            later = min(max(later, -limit - kick_along), limit - kick_along)
            tangential = later - earlier
            value[NORMAL], value[TANGENTIAL] = new, later
            apply(value, inverse, velocity, i, j, normal, tangential)
            most = max(most, abs(normal) * value[NORMAL_MOBILITY], abs(tangential) * value[TANGENT_MOBILITY])
        if most < still:
            break


@jit
def energy(points, bodies):
    """Return the kinetic energy of the first ``bodies``, J."""
    velocity, inverse, total = points.velocity, points.inverse, 0.0
    for k in range(bodies):
        total += (velocity[k, 0] * velocity[k, 0] + velocity[k, 1] * velocity[k, 1]) / inverse[k, 0]
        total += velocity[k, 2] * velocity[k, 2] / inverse[k, 1]
    return 0.5 * total


@jit
def return_share(points, n, factor):
    """Apply ``factor`` times the share ``e`` of the impulses of impacts."""
    for k in range(n):
        value, share = points.value[k], factor * points.value[k, RESTITUTION]
        normal, tangential = share * value[NORMAL], share * value[TANGENTIAL]
        apply(value, points.inverse, points.velocity, points.body[k, 0], points.body[k, 1], normal, tangential)


@jit
def rebound(points, n, bodies, before):
    """Return the share ``e`` of the impulses of impacts, or less of it if energy would exceed that ``before``, J.

    Energy is quadratic in the share. It may exceed the one before if the iteration has not converged, and if impacts of
    different restitution meet.
    """
    velocity, work = points.velocity, 0.0
    for k in range(n):
        value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
        along, across = normal_speed(value, velocity, i, j), slip_speed(value, velocity, i, j)
        work += value[RESTITUTION] * (value[NORMAL] * along + value[TANGENTIAL] * across)
    after = energy(points, bodies)
    return_share(points, n, 1.0)
    gained = energy(points, bodies) - after
    lost = max(before - after, 0.0)
    if gained > lost:
        square = gained - work
        root = math.sqrt(work * work + 4.0 * square * lost)
        factor = min(2.0 * lost / (work + root), 1.0) if work + root > 0.0 else 0.0
        return_share(points, n, factor - 1.0)
        for k in range(n):
            points.value[k, RESTITUTION] *= factor


@jit
def move_parts(points, n):
    """Move the bodies by the impulses, for the time since the points touched."""
    for k in range(n):
        value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
        value[MOVED], value[SLID] = value[TIME] * value[MOVED], value[TIME] * value[SLID]
        apply(value, points.inverse, points.move, i, j, value[MOVED], value[SLID])


@jit
def move_apart(points, n, slop):
    """Move the bodies apart until the points' overlap is ``slop`` m, so that contacts persist; return the smallest gap, m."""
    move, inverse, smallest = points.move, points.inverse, 0.0
    for _ in range(MOVES):
        most, smallest = 0.0, 0.0
        for k in range(n):
            value, i, j = points.value[k], points.body[k, 0], points.body[k, 1]
            gap = value[GAP] + normal_speed(value, move, i, j)
            smallest = min(smallest, gap)
            wanted = -value[RESTITUTION] * value[GAP] - slop  # after an impact the bodies have rebounded
            new = max(value[MOVED] + (wanted - gap) * value[NORMAL_MASS], 0.0)
            if new != value[MOVED]:
                apply(value, inverse, move, i, j, new - value[MOVED], 0.0)
                most = max(most, abs(new - value[MOVED]) / value[NORMAL_MASS])
                value[MOVED] = new
        if most < STILL_MOVE:
            break
    return smallest


@jit
def solve_points(points, n, bodies, rounds, slop):
    """Compute ``points.velocity`` after the impulses of ``n`` points, and ``points.move``; return the smallest gap then, m.

    Args:
        bodies: number of bodies that can move.
        rounds: most iterations over velocities.
        slop: see :func:`move_apart`.
    """
    impact = False
    for k in range(n):
        impact = impact or points.value[k, RESTITUTION] > 0.0
    before = energy(points, bodies) if impact else 0.0
    iterate(points, n, rounds, STILL_SPEED)
    if impact:
        rebound(points, n, bodies, before)
    for k in range(n):
        value = points.value[k]
        share = 1.0 + value[RESTITUTION]
        value[MOVED], value[SLID] = share * value[NORMAL], share * value[TANGENTIAL]
        value[NORMAL] = value[TANGENTIAL] = 0.0
    if impact:  # parts that rebound may approach others
        iterate(points, n, rounds, STILL_SPEED)
        for k in range(n):
            value = points.value[k]
            value[MOVED], value[SLID] = value[MOVED] + value[NORMAL], value[SLID] + value[TANGENTIAL]
    move_parts(points, n)
    return move_apart(points, n, slop)
