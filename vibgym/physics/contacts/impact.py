"""The impact of two bodies: one impulse, integrated in closed pieces (Darboux and Keller).

While two bodies are in touch for an instant, the impulse between them grows and their velocities change with it, linearly as
long as nothing switches. First the normal velocity at the contact goes to zero (compression); then they are driven apart
(restitution) until the normal impulse has given back a share ``e^2`` of the work that compression took: Stronge's energetic
coefficient of restitution (W. J. Stronge, Impact Mechanics, 2000, ch. 3; J. B. Keller, J. Appl. Mech. 53, 1986). On the way
dry friction opposes the slip at every instant: slip may end, stick or reverse. So normal impulse and friction both
dissipate energy in every impact, for all shapes, whereas Newton's ratio of velocities can add energy where slip reverses.

Two faces meet along a segment. The impulse acts at the end that is pressed in fastest, until both are equally fast, and then
where it keeps the faces flat on one another, as long as that place lies between the ends.

The impacts of a step: one after the other, the fastest first, until nothing that was hit comes together any more.

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
from vibgym.physics.contacts.hulls import Span, hull_span, wall_span

MOST_PIECES = 24
"""Switches are few: slip ends or turns once, faces come to lie flat or tip over."""


LOW, HIGH, FLAT = 0, 1, 2
"""At which end of the contact the bodies press against one another; ``FLAT``: somewhere between."""

NOTHING, SLIP_ENDS, FACES_FLAT = 0, 1, 2
"""What ends a piece of an impact besides compression and restitution."""


class Mobility(NamedTuple):
    """Change of the relative velocity at a contact by a unit impulse; a symmetric matrix.

    Rows and columns: normal (n), tangential (t) and rotation (w). The tangent is the normal turned by 90 degrees; an impulse
    ``p`` at the place ``s`` along the tangent is ``p`` at the origin and ``-s p`` about it.
    """

    nn: float
    nt: float
    nw: float
    tt: float
    tw: float
    ww: float


class Impulse(NamedTuple):
    """What an impact hands over at the contact's origin."""

    normal: float  # N s
    tangential: float  # N s
    turn: float  # N m s


@borrowing
def mobility_of(inverse_mass, inverse_inertia, rn, rt):
    """The mobility of one body.

    Args:
        inverse_mass: 1/kg.  inverse_inertia: 1/(kg m^2).
        rn, rt: m, from its centre to the contact's origin, along normal and tangent.
    """
    return Mobility(
        inverse_mass + rt * rt * inverse_inertia, -rn * rt * inverse_inertia, -rt * inverse_inertia,
        inverse_mass + rn * rn * inverse_inertia, rn * inverse_inertia, inverse_inertia,
    )  # fmt: skip


@borrowing
def both(one, other):
    """The mobility of a contact between two bodies."""
    return Mobility(
        one.nn + other.nn, one.nt + other.nt, one.nw + other.nw, one.tt + other.tt, one.tw + other.tw,
        one.ww + other.ww,
    )  # fmt: skip


@borrowing
def friction_ratio(slip, coefficient, coupling, resistance):
    """Tangential over normal impulse while the slip is what it is.

    Where nothing slips, as much as holds it, at most ``coefficient``.

    Args:
        coupling, resistance: change of slip by a unit normal and by a unit tangential impulse.
    """
    if slip > 0.0:
        return -coefficient
    if slip < 0.0:
        return coefficient
    return min(max(-coupling / resistance, -coefficient), coefficient)


@borrowing
def acting(mobility, slip, end, low, high, coefficient):
    """Where the impulse acts now: its place along the contact, the ratio of its friction, and at which end that is.

    Args:
        slip: m/s, tangential velocity of one body against the other.
        end: ``LOW``, ``HIGH``, or ``FLAT`` where both go in as fast.
        low, high: m, the contact's ends.
        coefficient: of friction.
    """
    if end == FLAT:
        # As if a torque kept the faces parallel: it is there as long as its force lies between the ends.
        coupling = mobility.nt - mobility.tw * mobility.nw / mobility.ww
        resistance = mobility.tt - mobility.tw * mobility.tw / mobility.ww
        ratio = friction_ratio(slip, coefficient, coupling, resistance)
        place = (mobility.nw + ratio * mobility.tw) / mobility.ww
        if low <= place <= high:
            return place, ratio, FLAT
        end = LOW if place < low else HIGH
    place = low if end == LOW else high
    return place, friction_ratio(slip, coefficient, mobility.nt - place * mobility.tw, mobility.tt), end


@borrowing
def impact_impulse(mobility, approach, slip, turning, low, high, restitution, coefficient):
    """The impulse of an impact.

    Args:
        mobility: of the contact.
        approach, slip, turning: velocity of the second body against the first at the contact's origin: along the normal, which
            points from the first to the second, along the tangent, m/s, and rotation, rad/s.
        low, high: m, places along the tangent between which the bodies touch.
        restitution: energetic coefficient, 0 to 1.  coefficient: of dry friction.

    Returns:
        The impulse on the second body. No part of it ever adds energy: to rounding, the kinetic energy after the impact, or
        after any part of it, is not above that before.
    """
    normal, tangential, turn, taken, owed = 0.0, 0.0, 0.0, 0.0, 0.0
    compressed = False
    end = FLAT
    if low == high or turning < 0.0:
        end = LOW
    elif turning > 0.0:
        end = HIGH
    for _ in range(MOST_PIECES):
        place, ratio, end = acting(mobility, slip, end, low, high, coefficient)
        by_normal = mobility.nn + ratio * mobility.nt - place * mobility.nw
        by_slip = mobility.nt + ratio * mobility.tt - place * mobility.tw
        by_turning = mobility.nw + ratio * mobility.tw - place * mobility.ww
        if slip == 0.0 and abs(ratio) < coefficient:
            by_slip = 0.0  # not only to rounding
        if end == FLAT:
            by_turning = 0.0
        speed, gain = approach - place * turning, by_normal - place * by_turning
        # The piece ends where the normal velocity is zero, or the work is done, unless something switches before.
        length, switch = math.inf, NOTHING
        if not compressed:
            if speed >= 0.0:
                length = 0.0
            elif gain > 0.0:
                length = -speed / gain
            until_flat = -turning / by_turning if turning * by_turning < 0.0 and low < high else math.inf
            if until_flat < length:
                length, switch = until_flat, FACES_FLAT
        else:
            root = speed * speed + 2.0 * gain * owed
            # Without gain the speed may not last: then it all ends where it is zero.
            length = 2.0 * owed / (speed + math.sqrt(root)) if root > 0.0 else -speed / gain
        if slip * by_slip < 0.0 and -slip / by_slip < length:
            length, switch = -slip / by_slip, SLIP_ENDS
        if not length < math.inf:
            break
        work = (speed + 0.5 * gain * length) * length
        normal += length
        tangential += ratio * length
        turn -= place * length
        approach += by_normal * length
        slip = 0.0 if switch == SLIP_ENDS else slip + by_slip * length
        turning = 0.0 if switch == FACES_FLAT else turning + by_turning * length
        if switch == FACES_FLAT:
            end = FLAT
        if compressed:
            owed -= work
        else:
            taken -= work
        if switch == NOTHING:
            if compressed:
                break
            compressed, owed = True, restitution * restitution * taken
        if compressed and not owed > 0.0:
            break
    return Impulse(normal, tangential, turn)


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
