"""What the friction stepper works on: its working arrays, the scene with all that it looks at, and what a step is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym._numba.reference import Layout
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Bodies, Scheme, State, Table, body_of
from vibgym.physics.planar.cut import Cut, cells_across, finest_split, new_cut
from vibgym.physics.planar.phasors import Phasors, new_phasors
from vibgym.physics.planar.pressure_moments import LANES, MOMENT_ROWS, PIECE_FIELDS


class Step(NamedTuple):
    """A time in which friction alone moves the parts."""

    phase: float  # w t at its start
    span: float  # s
    h: float  # s, of a Runge-Kutta substep
    substeps: int
    cosine: np.ndarray  # cos wt at the stages, from ``node`` on
    sine: np.ndarray
    node: int
    stride: int  # nodes from one substep to the next


class Workspace(NamedTuple):
    """Parts that friction moves together: each has a slot, eight slots are a group, and a slot's place in it is its lane.

    Arrays of a group are flat, with the lane as their inner index: the compiler vectorises loops over lanes.
    """

    world: np.ndarray  # (slots,)
    part: np.ndarray  # (slots,) index in its world
    away: np.ndarray  # (slots,) bool: not on the table, or no part at all
    by_points: np.ndarray  # (slots,) bool: takes its steps by contact points
    stale: np.ndarray  # (slots,) bool: to be cut again
    most_square: np.ndarray  # (slots,) s^-2 m^2, see vibgym.physics.planar.series.limits
    slow_rate: np.ndarray  # (slots,) m/s^2
    pose: np.ndarray  # (groups, 3 x lane)
    velocity: np.ndarray  # (groups, 3 x lane)
    old_pose: np.ndarray  # of the step's start, to take it again
    old_velocity: np.ndarray
    begun_pose: np.ndarray  # of the period's start, for means and divergence
    begun_velocity: np.ndarray
    own: np.ndarray  # (groups, 6 x lane), see vibgym.physics.planar.series.kutta_lanes
    inverse_area: np.ndarray  # (groups, lane) one over the supported area, in cells
    held: np.ndarray  # (groups, lane) number of pieces
    pieces: np.ndarray  # (groups, piece x field x lane)
    moments: np.ndarray  # (groups, row x lane)
    spare: np.ndarray  # (row x lane)
    rows: np.ndarray  # (pieces,) elements under the part at hand
    columns: np.ndarray
    cosine: np.ndarray  # (4 x substeps) of a step whose times are in no table
    sine: np.ndarray
    cut: Cut
    phasors: Phasors


class FixedScene(NamedTuple):
    """What stays the same from call to call, pinned in memory (:mod:`vibgym._numba.reference`)."""

    table: Table
    bodies: Bodies
    scheme: Scheme
    workspace: Workspace


FIXED_SCENE: Layout[FixedScene] = Layout("FIXED_SCENE", __name__)
fixed_scene_at = FIXED_SCENE.at


class Scene(NamedTuple):
    """What friction moves, and how: references, that kernels hand on to one another."""

    table: Table
    bodies: Bodies
    scheme: Scheme
    drive: Drive
    state: State
    workspace: Workspace


def new_workspace(table: Table, bodies: Bodies, scheme: Scheme, slots: int) -> Workspace:
    """Working arrays for any ``slots`` parts of these kinds at a time."""
    groups = -(-slots // LANES)
    slots = groups * LANES
    body = getattr(body_of, "py_func", body_of)  # it is Python itself under NUMBA_DISABLE_JIT
    kinds = [body(bodies, kind) for kind in range(len(bodies.area))]
    across = max(cells_across(table, body, 1) for body in kinds)
    finest = max(cells_across(table, body, scheme.pieces or finest_split(table, body)) for body in kinds)
    corners = max(len(body.outline) for body in kinds)

    def lanes(rows: int) -> np.ndarray:
        return np.zeros((groups, rows * LANES))

    def flags() -> np.ndarray:
        return np.zeros(slots, np.bool_)

    return Workspace(
        world=np.zeros(slots, np.int64),
        part=np.zeros(slots, np.int64),
        away=flags(),
        by_points=flags(),
        stale=flags(),
        most_square=np.zeros(slots),
        slow_rate=np.zeros(slots),
        pose=lanes(3),
        velocity=lanes(3),
        old_pose=lanes(3),
        old_velocity=lanes(3),
        begun_pose=lanes(3),
        begun_velocity=lanes(3),
        own=lanes(6),
        inverse_area=lanes(1),
        held=np.zeros((groups, LANES), np.int64),
        pieces=lanes((across * across + 1) * PIECE_FIELDS),
        moments=lanes(MOMENT_ROWS),
        spare=np.zeros(MOMENT_ROWS * LANES),
        rows=np.zeros(across * across, np.int64),
        columns=np.zeros(across * across, np.int64),
        cosine=np.zeros(4 * scheme.substeps + 4),
        sine=np.zeros(4 * scheme.substeps + 4),
        cut=new_cut(corners, finest),
        phasors=new_phasors(slots, across),
    )
