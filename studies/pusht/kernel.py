"""Kernel of PushT: a pusher with given motion and a T without inertia, in contact by the kernels of vibgym.

Contact points are those of :mod:`vibgym.physics.contacts.manifold`, impulses those of
:mod:`vibgym.physics.contacts.impulses`. Lengths are pixels: these kernels are homogeneous in the unit of length, and their
limits of convergence (1e-3 of a unit per second, 2e-5 of a unit) are below what matters here.

The T moves only while it is pushed, by ``M^-1 J^T p`` with impulses ``p >= 0`` that close no gap: ``M`` is its mass matrix,
which has the role of the limit surface of friction. Two laws of contact differ in when they apply it:

- ``PROJECTED``: the pusher moves on, at most ``STEP`` px at a time, and the T is moved until nothing overlaps;
- ``DELAYED``: as pymunk does it. The T moves by the velocity computed in the previous step, and overlaps decay by a share
  of 1 - 0.9^0.6 in a step (E. Catto, Iterative Dynamics with Temporal Coherence, GDC 2005, as in Chipmunk's ``cpArbiter.c``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import Hulls, place_hulls
from vibgym.physics.contacts.impulses import GAP, MOVED, STILL_SPEED, Points, add_manifold, iterate, move_apart
from vibgym.physics.contacts.manifold import hull_manifold

PROJECTED, DELAYED = 0, 1

T, PUSHER, WALLS = 0, 1, 2
"""Bodies of the contact points, and parts of the hulls."""

SUBSTEP, SUBSTEPS = 0.01, 10
"""Step of the simulation (s), and steps in a control period."""

STIFFNESS, DAMPING = 100.0, 20.0
"""Gains of the pusher's controller, 1/s^2 and 1/s."""

LOW, HIGH, THICKNESS = 5.0, 506.0, 2.0
"""Ends of the walls, which are segments with this radius, px."""

STEP = 2.0
"""Longest motion of the pusher before the T follows, px (``PROJECTED``)."""

SLOP, SLACK = 0.1, 0.01
"""Overlaps (px) that stay: in pymunk, and with ``PROJECTED``."""

CORRECTED = 1.0 - 0.9**0.6
"""Share of an overlap that pymunk removes in a step: ``1 - collision_bias^SUBSTEP``."""

ROUNDS = 30
"""Most iterations over the velocities."""


class Scene(NamedTuple):
    """Constants and working arrays."""

    hulls: Hulls  # of the T and the pusher, about their centres of mass, and of the walls
    points: Points
    placed: np.ndarray  # (corners, 4); those of the walls do not change


SCENE: Layout[Scene] = Layout("SCENE", __name__)
scene_at = SCENE.at


@jit
def find_points(scene, x, y, heading, px, py, margin):
    """Find the contact points of the T with pusher and walls; return their number.

    Args:
        x, y, heading: pose of the T's centre of mass, px, px, rad.
        px, py: centre of the pusher, px.
        margin: largest gap, px.
    """
    hulls, points, placed, n = scene.hulls, scene.points, scene.placed, 0
    reach, dx, dy = hulls.radius[T] + hulls.radius[PUSHER] + margin, px - x, py - y
    near = dx * dx + dy * dy < reach * reach
    low, high = LOW + THICKNESS + hulls.radius[T] + margin, HIGH - THICKNESS - hulls.radius[T] - margin
    walls = x < low or y < low or x > high or y > high
    if not (near or walls):
        return 0
    place_hulls(hulls, T, x, y, heading, placed)
    if near:
        place_hulls(hulls, PUSHER, px, py, 0.0, placed)
    for piece in range(hulls.owner[T], hulls.owner[T + 1]):
        if near:
            manifold = hull_manifold(hulls, placed, piece, hulls.owner[PUSHER], dx, dy, margin)
            n = add_manifold(points, n, T, PUSHER, x, y, px, py, manifold, 0.0, 0.0, SUBSTEP)
        if walls:
            for wall in range(hulls.owner[WALLS], hulls.owner[WALLS + 1]):
                face = hulls.first[wall]  # whose normal leads into the world
                manifold = hull_manifold(hulls, placed, piece, wall, -placed[face, 2], -placed[face, 3], margin)
                n = add_manifold(points, n, T, WALLS, x, y, x, y, manifold, 0.0, 0.0, SUBSTEP)
    return n


@jit
def clear_motion(scene, vx, vy):
    """Set the velocity of the pusher, and those of the other bodies and all moves to zero."""
    points = scene.points
    for body in range(3):
        for k in range(3):
            points.velocity[body, k] = points.move[body, k] = 0.0
    points.velocity[PUSHER, 0], points.velocity[PUSHER, 1] = vx, vy


@jit
def project(scene, pose, px, py, vx, vy, h):
    """Move the pusher from (px, py) for ``h`` s and the T out of its way."""
    parts = max(int(math.ceil(math.sqrt(vx * vx + vy * vy) * h / STEP)), 1)
    for k in range(parts):
        share = h * (k + 1) / parts
        n = find_points(scene, pose[0], pose[1], pose[2], px + vx * share, py + vy * share, STEP)
        if n > 0:
            clear_motion(scene, 0.0, 0.0)
            for point in range(n):
                scene.points.value[point, MOVED] = 0.0
            move_apart(scene.points, n, SLACK)
            for axis in range(3):
                pose[axis] += scene.points.move[T, axis]


@jit
def push_delayed(scene, pose, drift, px, py, vx, vy, h):
    """Move the T by ``drift`` (its velocity) for ``h`` s and compute the next one, with the pusher at (px, py) by then."""
    for axis in range(3):
        pose[axis] += drift[axis] * h
        drift[axis] = 0.0
    n = find_points(scene, pose[0], pose[1], pose[2], px, py, 0.0)
    if n > 0:
        clear_motion(scene, vx, vy)
        iterate(scene.points, n, ROUNDS, STILL_SPEED)
        for k in range(n):
            value = scene.points.value[k]
            value[GAP], value[MOVED] = CORRECTED * min(value[GAP] + SLOP, 0.0), 0.0
        move_apart(scene.points, n, 0.0)
        for axis in range(3):
            drift[axis] = scene.points.velocity[T, axis] + scene.points.move[T, axis] / h


@jit
def advance(scene, law, controlled, pusher, block, drift, actions, trace):
    """Advance all worlds by control periods, or by one step with the pusher at rest.

    Args:
        scene: address of a pinned record.
        law: ``PROJECTED`` or ``DELAYED``.
        controlled: whether the pusher follows its controller.
        pusher: (worlds, 4) position px and velocity px/s, changed in place.
        block: (worlds, 3) pose of the T's centre of mass, px, px, rad, changed in place.
        drift: (worlds, 3) velocity of the T, px/s, px/s, rad/s, of law ``DELAYED``, changed in place.
        actions: (worlds, periods, 2) target positions of the pusher, px.
        trace: (worlds, periods, 5) overwritten: position of the pusher and ``block`` at the end of each period.
    """
    scene = scene_at(scene)
    for world in range(pusher.shape[0]):
        pose, mover = block[world], pusher[world]
        for period in range(actions.shape[1]):
            tx, ty = actions[world, period, 0], actions[world, period, 1]
            for _ in range(SUBSTEPS if controlled else 1):
                if controlled:
                    mover[2] += (STIFFNESS * (tx - mover[0]) - DAMPING * mover[2]) * SUBSTEP
                    mover[3] += (STIFFNESS * (ty - mover[1]) - DAMPING * mover[3]) * SUBSTEP
                x, y = mover[0], mover[1]
                mover[0] += mover[2] * SUBSTEP
                mover[1] += mover[3] * SUBSTEP
                if law == PROJECTED:
                    project(scene, pose, x, y, mover[2], mover[3], SUBSTEP)
                else:
                    push_delayed(scene, pose, drift[world], mover[0], mover[1], mover[2], mover[3], SUBSTEP)
            trace[world, period, 0], trace[world, period, 1] = mover[0], mover[1]
            for axis in range(3):
                trace[world, period, 2 + axis] = pose[axis]
