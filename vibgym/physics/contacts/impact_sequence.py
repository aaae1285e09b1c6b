"""The impacts of a step: one after the other, the fastest first, until nothing that was hit comes together any more.

What an impact sets in motion may hit the next part. Taken one by one (:mod:`vibgym.physics.contacts.impact`), impacts run
through a row as they do through Newton's cradle, and none of them can add energy. What is left when parts bounce between
others too often to follow is for the solver, which brings it to rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.approach import RESTING, part_motion
from vibgym.physics.contacts.impact import Mobility, both, impact_impulse, mobility_of
from vibgym.physics.contacts.span import Span, hull_span, wall_span

CONTACT_FROM = 2e-6
"""m of overlap from which there is a contact; the solver's shapes are so much smaller together."""

MOST_IMPACTS, IMPACTS_A_PAIR = 32, 8
"""Most of them in a step, and for each pair that may touch."""


class ImpactProperties(NamedTuple):
    """What an impact depends on besides shapes."""

    mass: np.ndarray  # (parts,) kg, of the parts as they were made
    gyration: np.ndarray  # (parts,) m^2, inertia over mass
    inverse_mass: np.ndarray  # (parts,) 1/kg, in the world at hand
    inverse_inertia: np.ndarray  # (parts,) 1/(kg m^2), likewise
    restitution: np.ndarray  # (parts,) energetic coefficient; a pair has the geometric mean, a wall what the part has
    friction: np.ndarray  # (parts,) likewise


class RelativeMotion(NamedTuple):
    """Velocity of the second of two bodies relative to the first, in the middle of the span where they touch."""

    approach: float  # m/s, along the normal
    slip: float  # m/s, along the tangent
    turning: float  # rad/s


@borrowing
def weigh_parts(encounter):
    """Set what the parts weigh, by the factors on their masses."""
    properties, factor = encounter.properties, encounter.scene.state.mass[encounter.world]
    for slot in range(encounter.parts):
        p = encounter.scene.workspace.part[slot]
        mass = factor[p] * properties.mass[p]
        properties.inverse_mass[p] = 1.0 / mass
        properties.inverse_inertia[p] = 1.0 / (mass * properties.gyration[p])


@borrowing
def relative_motion(scene, i, j, span):
    """The relative motion of two bodies at a contact: the part in slot ``i``, and that in ``j``, or a wall, ``-1 - wall``."""
    x, y, vx, vy, spin = part_motion(scene.workspace, i)
    ux, uy, turning = spin * (span.y - y) - vx, -spin * (span.x - x) - vy, -spin
    if j >= 0:
        x, y, vx, vy, spin = part_motion(scene.workspace, j)
        ux, uy, turning = ux + vx - spin * (span.y - y), uy + vy + spin * (span.x - x), turning + spin
    return RelativeMotion(span.nx * ux + span.ny * uy, span.nx * uy - span.ny * ux, turning)


@borrowing
def closing_speed(scene, i, j, span):
    """Relative velocity along the normal, m/s, at the end of a contact that goes in faster; negative: together. Infinite where
    nothing touches."""
    if span.gap < -CONTACT_FROM:
        meeting = relative_motion(scene, i, j, span)
        return meeting.approach - span.high * abs(meeting.turning)
    return math.inf


@borrowing
def fastest_impact(encounter, pairs, n, hit):
    """Which two bodies come together fastest, and where: of the pairs that met in this step or of which one was hit.

    Returns:
        Number of the pair, -1 if there is none, and the span of its contact.
    """
    scene, hulls, contacts = encounter.scene, encounter.hulls, encounter.contacts
    part = scene.workspace.part
    chosen, where, fastest = -1, Span(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0), -RESTING
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        if not contacts.close[pair] or not (contacts.impact[pair] or hit[i] or (j >= 0 and hit[j])):
            continue
        others = 1 if j < 0 else hulls.owner[part[j] + 1] - hulls.owner[part[j]]
        for a in range(hulls.owner[part[i]], hulls.owner[part[i] + 1]):
            for b in range(others):
                if j < 0:
                    span = wall_span(scene.table, hulls, contacts.placed, a, -1 - j)
                else:
                    span = hull_span(hulls, contacts.placed, a, hulls.owner[part[j]] + b)
                speed = closing_speed(scene, i, j, span)
                if speed < fastest:
                    chosen, where, fastest = pair, span, speed
    return chosen, where


@borrowing
def mobility_at(encounter, slot, span):
    """Mobility of the part in a slot at a contact."""
    x, y, _, _, _ = part_motion(encounter.scene.workspace, slot)
    rx, ry = span.x - x, span.y - y
    properties, part = encounter.properties, encounter.scene.workspace.part[slot]
    normal, tangent = span.nx * rx + span.ny * ry, span.nx * ry - span.ny * rx
    return mobility_of(properties.inverse_mass[part], properties.inverse_inertia[part], normal, tangent)


@borrowing
def apply_impulse(encounter, slot, span, normal, tangential, turn):
    """Change the velocity of a slot's part by an impulse at a contact; returns the largest change of a point's, m/s."""
    workspace, properties = encounter.scene.workspace, encounter.properties
    part = workspace.part[slot]
    x, y, _, _, _ = part_motion(workspace, slot)
    px, py = normal * span.nx - tangential * span.ny, normal * span.ny + tangential * span.nx
    moment = (span.x - x) * py - (span.y - y) * px + turn
    velocity, lane = workspace.velocity[slot // LANES], slot % LANES
    dx, dy = properties.inverse_mass[part] * px, properties.inverse_mass[part] * py
    spin = properties.inverse_inertia[part] * moment
    velocity[lane] += dx
    velocity[LANES + lane] += dy
    velocity[2 * LANES + lane] += spin
    encounter.scene.state.sticking[encounter.world, part] = False
    return max(abs(dx), abs(dy), encounter.hulls.radius[part] * abs(spin))


@borrowing
def resolve_impacts(encounter, pairs, n, jolt):
    """Change the velocities of parts that hit one another, or a wall, at the poses where they are placed.

    Args:
        pairs: of which ``n`` may touch.
        jolt: m/s; parts whose velocity an impact changes by more are marked as stale.

    Returns:
        Whether there was any impact, and whether any part was marked.
    """
    scene, properties, hit = encounter.scene, encounter.properties, encounter.contacts.hit
    part = scene.workspace.part
    for slot in range(encounter.parts):
        hit[slot] = False
    any_impact, marked = False, False
    for _ in range(MOST_IMPACTS + IMPACTS_A_PAIR * n):
        pair, span = fastest_impact(encounter, pairs, n, hit)
        if pair < 0:
            break
        i, j = pairs[pair, 0], pairs[pair, 1]
        met = relative_motion(scene, i, j, span)
        mobility, other = mobility_at(encounter, i, span), Mobility(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        restitution, friction = properties.restitution[part[i]], properties.friction[part[i]]
        if j >= 0:
            other = mobility_at(encounter, j, span)
            restitution = (restitution * properties.restitution[part[j]]) ** 0.5
            friction = (friction * properties.friction[part[j]]) ** 0.5
        impulse = impact_impulse(
            both(mobility, other), met.approach, met.slip, met.turning, span.low, span.high, restitution, friction
        )
        any_impact = True
        for end in range(2):
            slot, sign = (i, -1.0) if end == 0 else (j, 1.0)
            if slot >= 0:
                change = apply_impulse(
                    encounter, slot, span, sign * impulse.normal, sign * impulse.tangential, sign * impulse.turn
                )
                hit[slot] = True
                if change > jolt:
                    scene.workspace.stale[slot] = marked = True
    return any_impact, marked
