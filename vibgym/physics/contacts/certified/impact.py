"""Impacts of two bodies with dry friction, and the sequence of impacts in a step.

During an impact the impulse grows, and velocities change linearly with it until a switch (Darboux and Keller): the slip ends
or the faces become parallel. In the compression phase the normal velocity falls to zero. In the restitution phase the normal
impulse returns a share ``e^2`` of the work of compression: Stronge's energetic coefficient of restitution (W. J. Stronge,
Impact Mechanics, 2000, ch. 3; J. B. Keller, J. Appl. Mech. 53, 1986). Friction opposes the slip at every instant, so slip may
end, stick or reverse. Every impact dissipates energy, for all shapes, whereas Newton's ratio of velocities can add energy if
slip reverses.

Two faces touch along a segment. The impulse acts at the end that closes fastest until both close equally fast, and then at the
point that keeps the faces parallel, if it is between the ends.

The impacts of a step are resolved one by one, the fastest first, until no pair that was hit approaches. They therefore
propagate through a row as in Newton's cradle, and none of them adds energy. After too many impacts, the contact solver brings
the parts to rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import jit
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.certified.approach import part_motion
from vibgym.physics.contacts.hulls import Span, hull_span, wall_span
from vibgym.physics.contacts.impulses import RESTING

MAX_PIECES = 24
"""Limit of linear pieces in an impact; switches are few."""

LOW, HIGH, FLAT = 0, 1, 2
"""End of the segment at which the impulse acts; ``FLAT``: between them."""

NOTHING, SLIP_ENDS, FACES_FLAT = 0, 1, 2
"""Switch that ends a linear piece; ``NOTHING``: the end of compression or restitution."""


class Mobility(NamedTuple):
    """Change of the relative velocity at a contact by a unit impulse; a symmetric matrix.

    Rows and columns: normal (n), tangential (t) and rotation (w). The tangent is the normal rotated by 90 degrees. An impulse
    ``p`` at the position ``s`` along the tangent is ``p`` at the origin and the moment ``-s p`` about it.
    """

    nn: float
    nt: float
    nw: float
    tt: float
    tw: float
    ww: float


class Impulse(NamedTuple):
    """Impulse of an impact at the contact's origin."""

    normal: float  # N s
    tangential: float  # N s
    turn: float  # N m s


@jit
def mobility_of(inverse_mass, inverse_inertia, rn, rt):
    """Return the mobility of one body.

    Args:
        inverse_mass: 1/kg.  inverse_inertia: 1/(kg m^2).
        rn, rt: m, from its centre to the contact's origin, along normal and tangent.
    """
    return Mobility(
        inverse_mass + rt * rt * inverse_inertia, -rn * rt * inverse_inertia, -rt * inverse_inertia,
        inverse_mass + rn * rn * inverse_inertia, rn * inverse_inertia, inverse_inertia,
    )  # fmt: skip


@jit
def sum_mobilities(one, other):
    """Return the mobility of a contact between two bodies."""
    return Mobility(
        one.nn + other.nn, one.nt + other.nt, one.nw + other.nw, one.tt + other.tt, one.tw + other.tw,
        one.ww + other.ww,
    )  # fmt: skip


@jit
def friction_ratio(slip, coefficient, coupling, resistance):
    """Return the ratio of tangential to normal impulse; without slip the one that maintains sticking, at most ``coefficient``.

    Args:
        coupling, resistance: change of slip by a unit normal and by a unit tangential impulse.
    """
    if slip > 0.0:
        return -coefficient
    if slip < 0.0:
        return coefficient
    return min(max(-coupling / resistance, -coefficient), coefficient)


@jit
def impulse_location(mobility, slip, end, low, high, coefficient):
    """Return the position at which the impulse acts (m, along the tangent), its friction ratio, and the end.

    Args:
        slip: m/s, tangential velocity of one body against the other.
        end: ``LOW``, ``HIGH``, or ``FLAT`` if both close equally fast.
        low, high: m, the contact's ends.
        coefficient: of friction.
    """
    if end == FLAT:
        # The impulse keeps the faces parallel if it can act between the ends.
        coupling = mobility.nt - mobility.tw * mobility.nw / mobility.ww
        resistance = mobility.tt - mobility.tw * mobility.tw / mobility.ww
        ratio = friction_ratio(slip, coefficient, coupling, resistance)
        place = (mobility.nw + ratio * mobility.tw) / mobility.ww
        if low <= place <= high:
            return place, ratio, FLAT
        end = LOW if place < low else HIGH
    place = low if end == LOW else high
    return place, friction_ratio(slip, coefficient, mobility.nt - place * mobility.tw, mobility.tt), end


@jit
def impact_impulse(mobility, approach, slip, turning, low, high, restitution, coefficient):
    """Compute the impulse of an impact.

    Args:
        mobility: of the contact.
        approach, slip, turning: velocity of the second body against the first at the contact's origin: along the normal, which
            points from the first to the second, along the tangent, m/s, and rotation, rad/s.
        low, high: m, ends of the contact along the tangent.
        restitution: energetic coefficient, 0 to 1.  coefficient: of dry friction.

    Returns:
        The impulse on the second body. To rounding, kinetic energy after the impact or any piece of it is not above that
        before.
    """
    normal, tangential, turn, taken, owed = 0.0, 0.0, 0.0, 0.0, 0.0
    compressed = False
    end = FLAT
    if low == high or turning < 0.0:
        end = LOW
    elif turning > 0.0:
        end = HIGH
    for _ in range(MAX_PIECES):
        place, ratio, end = impulse_location(mobility, slip, end, low, high, coefficient)
        by_normal = mobility.nn + ratio * mobility.nt - place * mobility.nw
        by_slip = mobility.nt + ratio * mobility.tt - place * mobility.tw
        by_turning = mobility.nw + ratio * mobility.tw - place * mobility.ww
        if slip == 0.0 and abs(ratio) < coefficient:
            by_slip = 0.0  # exactly
        if end == FLAT:
            by_turning = 0.0
        speed, gain = approach - place * turning, by_normal - place * by_turning
        # The piece ends where the normal velocity is zero, or the work has been returned, unless a switch occurs before.
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
            if root > 0.0:
                rate = speed + math.sqrt(root)
                length = 2.0 * owed / rate if rate > 0.0 else 0.0  # zero by rounding, where hardly any work is owed
            else:
                length = -speed / gain  # without gain the speed may reach zero first: the impact ends there
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
"""Overlap (m) from which on there is a contact, so that touching parts do not overlap by rounding."""

MAX_IMPACTS, IMPACTS_A_PAIR = 32, 8
"""Limit of impacts in a step: constant, plus this for each near pair."""


class RelativeMotion(NamedTuple):
    """Velocity of the second body relative to the first, in the middle of the contact segment."""

    approach: float  # m/s, along the normal
    slip: float  # m/s, along the tangent
    turning: float  # rad/s


@jit
def relative_motion(scene, i, j, span):
    """Return the relative motion of the part in slot ``i`` and that in ``j``, or a wall (``-1 - wall``), at a contact."""
    x, y, vx, vy, spin = part_motion(scene.workspace, i)
    ux, uy, turning = spin * (span.y - y) - vx, -spin * (span.x - x) - vy, -spin
    if j >= 0:
        x, y, vx, vy, spin = part_motion(scene.workspace, j)
        ux, uy, turning = ux + vx - spin * (span.y - y), uy + vy + spin * (span.x - x), turning + spin
    return RelativeMotion(span.nx * ux + span.ny * uy, span.nx * uy - span.ny * ux, turning)


@jit
def closing_speed(scene, i, j, span):
    """Return the normal velocity at the end that closes faster, m/s, negative: approaching; infinite without overlap."""
    if span.gap < -CONTACT_FROM:
        meeting = relative_motion(scene, i, j, span)
        return meeting.approach - span.high * abs(meeting.turning)
    return math.inf


@jit
def fastest_impact(island, pairs, n, hit):
    """Find the pair that closes fastest among those that met in this step or have a part that was hit.

    Returns:
        Index of the pair, -1 if there is none, and its contact segment.
    """
    scene, hulls, contacts = island.scene, island.hulls, island.contacts
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


@jit
def mobility_at(island, slot, span):
    """Return the mobility of the part in a slot at a contact."""
    x, y, _, _, _ = part_motion(island.scene.workspace, slot)
    rx, ry = span.x - x, span.y - y
    normal, tangent = span.nx * rx + span.ny * ry, span.nx * ry - span.ny * rx
    return mobility_of(island.solver.points.inverse[slot, 0], island.solver.points.inverse[slot, 1], normal, tangent)


@jit
def apply_impulse(island, slot, span, normal, tangential, turn):
    """Apply an impulse at a contact to a slot's part; return the largest change of velocity of any point, m/s."""
    workspace, inverse = island.scene.workspace, island.solver.points.inverse[slot]
    part = workspace.part[slot]
    x, y, _, _, _ = part_motion(workspace, slot)
    px, py = normal * span.nx - tangential * span.ny, normal * span.ny + tangential * span.nx
    moment = (span.x - x) * py - (span.y - y) * px + turn
    velocity, lane = workspace.velocity[slot // LANES], slot % LANES
    dx, dy, spin = inverse[0] * px, inverse[0] * py, inverse[1] * moment
    velocity[lane] += dx
    velocity[LANES + lane] += dy
    velocity[2 * LANES + lane] += spin
    island.scene.state.sticking[island.world, part] = False
    return max(abs(dx), abs(dy), island.hulls.radius[part] * abs(spin))


@jit
def clear_hits(island):
    """Mark all parts as not hit."""
    for slot in range(island.parts):
        island.contacts.hit[slot] = False


@jit
def resolve_impacts(island, pairs, n, hit_speed):
    """Resolve the impacts of parts with each other and with walls at the current poses, changing velocities.

    Marks the parts in impacts in ``contacts.hit``, which :func:`clear_hits` has cleared.

    Args:
        pairs: (pairs, 2), of which the first ``n`` may touch.
        hit_speed: m/s; parts whose velocity an impact changes by more are marked in ``workspace.stale``.

    Returns:
        Whether any part was marked.
    """
    scene, properties, hit = island.scene, island.properties, island.contacts.hit
    part = scene.workspace.part
    marked = False
    for _ in range(MAX_IMPACTS + IMPACTS_A_PAIR * n):
        pair, span = fastest_impact(island, pairs, n, hit)
        if pair < 0:
            break
        i, j = pairs[pair, 0], pairs[pair, 1]
        met = relative_motion(scene, i, j, span)
        mobility, other = mobility_at(island, i, span), Mobility(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        restitution, friction = properties.restitution[part[i]], properties.friction[part[i]]
        if j >= 0:
            other = mobility_at(island, j, span)
            restitution = (restitution * properties.restitution[part[j]]) ** 0.5
            friction = (friction * properties.friction[part[j]]) ** 0.5
        impulse = impact_impulse(
            sum_mobilities(mobility, other), met.approach, met.slip, met.turning, span.low, span.high, restitution, friction,
        )  # fmt: skip
        for end in range(2):
            slot, sign = (i, -1.0) if end == 0 else (j, 1.0)
            if slot >= 0:
                change = apply_impulse(
                    island, slot, span, sign * impulse.normal, sign * impulse.tangential, sign * impulse.turn
                )
                hit[slot] = True
                if change > hit_speed:
                    scene.workspace.stale[slot] = marked = True
    return marked
