"""Records of the tilting model's kernels: state of the parts, constants and working arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.reference import Layout
from vibgym.physics.core.drive import Drive, Phasors, new_phasors
from vibgym.physics.core.records import Bodies, State, Table

FLAT, TILTED, TIPPED = range(3)
"""Modes of a part: advanced by the planar model; a rigid body; just tipped by the user, to be placed on the plates when the
next period begins."""

MODES = ("flat", "tilted", "tipped")
"""Names of the modes."""


class Tilt(NamedTuple):
    """State in addition to :class:`vibgym.physics.core.records.State`, changed in place.

    Attitude and vertical motion of a flat part are zero. The attitude is a rotation by the heading about the vertical, then
    by the length of ``lean`` about a horizontal axis, so that poses of flat and tilted parts have the same definition.
    """

    mode: np.ndarray  # (worlds, parts) int64
    lean: np.ndarray  # (worlds, parts, 2) rad, rotation vector of the swing
    height: np.ndarray  # (worlds, parts) m, of the centre of mass above plates at mid-stroke
    climb: np.ndarray  # (worlds, parts) m/s, upward
    rocking: np.ndarray  # (worlds, parts, 2) rad/s, about the world's x and y
    calm: np.ndarray  # (worlds, parts) int64, consecutive steps in which it was almost flat and at rest
    since: np.ndarray  # (worlds, parts) int64, steps since it was last tipped
    landing: np.ndarray  # (worlds, parts) int64, steps from the last tip until its tilt was last significant
    toppled: np.ndarray  # (worlds, parts) bool: it has tipped beyond its edge, and counts as fallen


def new_tilt(worlds: int, parts: int) -> Tilt:
    """Return arrays for parts that lie flat."""
    return Tilt(
        mode=np.zeros((worlds, parts), np.int64),
        lean=np.zeros((worlds, parts, 2)),
        height=np.zeros((worlds, parts)),
        climb=np.zeros((worlds, parts)),
        rocking=np.zeros((worlds, parts, 2)),
        calm=np.zeros((worlds, parts), np.int64),
        since=np.zeros((worlds, parts), np.int64),
        landing=np.zeros((worlds, parts), np.int64),
        toppled=np.zeros((worlds, parts), np.bool_),
    )


class Solids(NamedTuple):
    """Vertical properties of the kinds of parts, in addition to :class:`vibgym.physics.core.records.Bodies`."""

    centre_height: np.ndarray  # (kinds,) m, of the centre of mass above the bottom
    inertia: np.ndarray  # (kinds, 3) m^2, xx, yy, xy about the centre of mass, over mass
    disc: np.ndarray  # (kinds,) m, radius of a disc, or 0
    cross: np.ndarray  # (kinds, 4, 2) m, points of equal load whose second moments are those of even pressure
    unsteady: np.ndarray  # (kinds,) largest factor on friction at which it stays flat on level ground


class TiltScheme(NamedTuple):
    """Constants of the model."""

    steps: int  # a period
    cosine: np.ndarray  # (2 * steps + 1) cos wt, from half step to half step
    sine: np.ndarray
    restitution: float
    ramp: float  # m, on either side of a border over which heights are blended
    fineness: float  # elements per m
    steepness: float  # of a ramp: decrease of an element's share per element length
    settling: float  # m/s, largest velocity at which penetration is corrected


MOTION = 24
"""Number of values of a rigid body in motion."""

CX, CY, CZ, QW, QX, QY, QZ, VX, VY, VZ, LX, LY, LZ, WX, WY, WZ, MXX, MYY, MZZ, MXY, MXZ, MYZ, REACH, LIFT = range(
    MOTION
)
"""Indices: centre of mass (m), attitude (quaternion), velocity (m/s), angular momentum over mass (m^2/s), angular velocity
(rad/s), inverse of the inertia over mass (m^-2), all in the world's axes; bound on the approach of any point to a plate in half
a step (m); speed of the fastest plate below (m/s)."""

FRAME = 9
"""Number of values of an attitude as a matrix, row by row."""

CONTACT = 23
"""Number of values of a contact."""

RX, RY, RZ, GOAL, RATE, GIVE, SLIDE, PN, PX, PY, BEFORE, SLIP_X, SLIP_Y, GRIP = range(14)
UP_X, UP_Y, UP_Z, EAST_X, EAST_Y, EAST_Z, NORTH_X, NORTH_Y, NORTH_Z = range(14, CONTACT)
"""Indices: arm from the centre of mass (m); target normal velocity, and that of the ground (m/s); effective masses of a normal
and a horizontal impulse; impulses over mass, normal, x and y (m/s); initial normal velocity against the ground, and slip (m/s);
the plate's factor on friction; angular velocity (rad/s) by a unit impulse over mass (m/s) upward, along x and along y."""


class Work(NamedTuple):
    """Working arrays of one thread."""

    motion: np.ndarray  # (MOTION,)
    frame: np.ndarray  # (FRAME,)
    corner: np.ndarray  # (corners, 3) m, of the bottom, in the world
    contact: np.ndarray  # (capacity, CONTACT)
    warm: np.ndarray  # (capacity, 5) m, m, m/s, positions of the last step's contacts, and their impulses over mass
    kept: np.ndarray  # (1,) number of these
    lines: np.ndarray  # (2, lines) m, across x and y, on which plates begin or end, in the table's frame
    beside: np.ndarray  # (2, lines, 2) plates along the axis on either side of each line
    phasors: Phasors
    height: np.ndarray  # (size, size) m, of the plates below, by row and column modulo size, which is a power of two
    rate: np.ndarray  # (size, size) m/s, likewise
    grip: np.ndarray  # (size, size) factor on friction, likewise
    highest: np.ndarray  # (2, size) m, highest plate below the part in each column and in each row


RIM_POINTS = 8
"""Points on the rim of a disc: the lowest, and others evenly around."""


class FixedTilting(NamedTuple):
    """Constants and working arrays of a thread."""

    table: Table
    bodies: Bodies
    solids: Solids
    scheme: TiltScheme
    work: Work


FIXED_TILTING: Layout[FixedTilting] = Layout("FIXED_TILTING", __name__)
fixed_tilting_at = FIXED_TILTING.at
TILT: Layout[Tilt] = Layout("TILT", __name__)
tilt_at = TILT.at


class Rigid(NamedTuple):
    """References to all data of a kernel."""

    table: Table
    bodies: Bodies
    solids: Solids
    scheme: TiltScheme
    work: Work
    drive: Drive
    state: State
    tilt: Tilt


def new_work(table: Table, bodies: Bodies) -> Work:
    """Return working arrays for any part of these kinds."""
    corners = max(int(np.diff(bodies.first).max()), RIM_POINTS)
    across = (
        int(2.0 * float(bodies.radius.max()) / table.element_size) + 3
    )  # borders under a part along an axis, with room
    lines = 2 * across  # each crosses a convex outline twice
    phasors = new_phasors(1, across + 2)
    return Work(
        motion=np.zeros(MOTION),
        frame=np.zeros(FRAME),
        corner=np.zeros((corners, 3)),
        contact=np.zeros((corners + 4 * lines + lines * lines, CONTACT)),
        warm=np.zeros((corners + 4 * lines + lines * lines, 5)),
        kept=np.zeros(1, np.int64),
        lines=np.zeros((2, lines)),
        beside=np.zeros((2, lines, 2), np.int64),
        phasors=phasors,
        height=np.zeros(phasors.c.shape[1:]),
        rate=np.zeros(phasors.c.shape[1:]),
        grip=np.ones(phasors.c.shape[1:]),
        highest=np.zeros((2, phasors.c.shape[1])),
    )
