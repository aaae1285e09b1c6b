"""The impact of two bodies: one impulse, integrated in closed pieces (Darboux and Keller).

While two bodies are in touch for an instant, the impulse between them grows and their velocities change with it, linearly as
long as nothing switches. First the normal velocity at the contact goes to zero (compression); then they are driven apart
(restitution) until the normal impulse has given back a share ``e^2`` of the work that compression took: Stronge's energetic
coefficient of restitution (W. J. Stronge, Impact Mechanics, 2000, ch. 3; J. B. Keller, J. Appl. Mech. 53, 1986). On the way
dry friction opposes the slip at every instant: slip may end, stick or reverse. So normal impulse and friction both take
energy in every impact, whatever the shapes, whereas Newton's ratio of velocities makes some where slip turns around.

Two faces meet along a segment. The impulse acts at the end that is pressed in fastest, until both are equally fast, and then
where it keeps the faces flat on one another, as long as that place lies between the ends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import borrowing

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
