"""Records of the friction stepper: working arrays, scene and step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.kernels.vector import LANES, WIDTH
from vibgym.physics.core.drive import Drive, Phasors, new_phasors
from vibgym.physics.core.records import Bodies, Body, Scheme, State, Table, body_of
from vibgym.physics.planar.contact_area import Cut, cells_across, finest_split, new_cut
from vibgym.physics.planar.group_cut import CELL, window
from vibgym.physics.planar.pressure_moments import MOMENT_ROWS, PIECE

SECTORS = 8
"""Number of sectors of headings. In each, outlines start at their lowest corner, so that edges of similar shapes in a group
have similar directions and cross the same elements."""


class TimeSpan(NamedTuple):
    """A time span in which friction alone moves the parts."""

    phase: float  # w t at its start
    span: float  # s
    h: float  # s, of a Runge-Kutta substep
    substeps: int
    cosine: np.ndarray  # cos wt at the stages, from ``node`` on
    sine: np.ndarray
    node: int
    stride: int  # nodes from one substep to the next


class Workspace(NamedTuple):
    """Parts that friction moves together. Each has a slot; ``LANES`` slots are a group; the index in the group is the lane.

    Arrays of a group are flat, with the lane as their inner index (:mod:`vibgym.kernels.vector`).
    """

    world: np.ndarray  # (slots,)
    part: np.ndarray  # (slots,) index in its world
    away: np.ndarray  # (slots,) bool: not on the table, or an unused slot
    by_points: np.ndarray  # (slots,) bool: takes its steps by contact points
    stale: np.ndarray  # (slots,) bool: must be cut again
    most_square: np.ndarray  # (slots,) s^-2 m^2, see vibgym.physics.planar.wrench.limits
    slow_rate: np.ndarray  # (slots,) m/s^2
    pose: np.ndarray  # (groups, 3 x lane)
    velocity: np.ndarray  # (groups, 3 x lane)
    old_pose: np.ndarray  # at the step's start, to repeat it
    old_velocity: np.ndarray
    start_pose: np.ndarray  # at the period's start, for means and divergence
    start_velocity: np.ndarray
    middle: np.ndarray  # (3 x lane) poses at which the current group is cut
    own: np.ndarray  # (groups, 6 x lane), see vibgym.physics.planar.wrench.slide_by_series
    kind: np.ndarray  # (slots,) kind of the stored outline and shape, -1: none
    outline: np.ndarray  # (groups, corner x 2 x lane) m
    shape: np.ndarray  # (groups, 4 x lane), see vibgym.physics.planar.stepper.load_shape
    corners: np.ndarray  # (slots,) number of corners of the stored outline, with repeated ones
    most: np.ndarray  # (groups,) largest number of corners of the group's outlines, -1: not known
    lowest: np.ndarray  # (kinds, SECTORS) lowest corner of an outline whose heading is in a sector
    sector: np.ndarray  # (groups, lane) sector of the loaded outline
    across: int  # elements along a side of the window that holds any part
    base: np.ndarray  # (groups, 2 x lane) column and row of the window's first element
    known: np.ndarray  # (groups, across x across) lanes whose phasors in the window are read, a bit each
    phasor_c: np.ndarray  # (groups, across x across x lane) m/s^2
    phasor_s: np.ndarray
    grip: np.ndarray  # (groups, across x across x lane) factor on friction
    cells: np.ndarray  # (across x across x field x register), see vibgym.physics.planar.group_cut.cut_outlines
    crossings: np.ndarray  # (across x register)
    pieces: np.ndarray  # (across x across x field x register), see vibgym.physics.planar.pressure_moments
    held: np.ndarray  # (slots,) bool: supported, so that ``moments`` is valid
    moments: np.ndarray  # (groups, row x lane)
    cosine: np.ndarray  # (4 x substeps) for steps between the table's times
    sine: np.ndarray
    cut: Cut
    phasors: Phasors


class FixedScene(NamedTuple):
    """Constant data of a scene, pinned in memory (:mod:`vibgym.kernels.reference`)."""

    table: Table
    bodies: Bodies
    scheme: Scheme
    workspace: Workspace


FIXED_SCENE: Layout[FixedScene] = Layout("FIXED_SCENE", __name__)
fixed_scene_at = FIXED_SCENE.at


class Scene(NamedTuple):
    """Parts and drive of the friction stepper; kernels pass it by reference."""

    table: Table
    bodies: Bodies
    scheme: Scheme
    drive: Drive
    state: State
    workspace: Workspace
    groups: int  # of slots that are in use, the first ones


@jit
def scene_of(fixed, drive, state, groups):
    """Return a fixed scene with references to drive and state; ``groups`` of its slots are in use."""
    return Scene(fixed.table, fixed.bodies, fixed.scheme, drive, state, fixed.workspace, groups)


def _aligned_zeros(*shape: int) -> np.ndarray:
    """Allocate zeros aligned to the processor's cache lines of 64 bytes, so that eight doubles are in one line."""
    size = math.prod(shape)
    room = np.zeros(size + 8)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + size].reshape(shape)


def lowest_corners(body: Body) -> list[int]:
    """Return the lowest corner of an outline for the middle of every sector of headings."""
    headings = (np.arange(SECTORS) + 0.5) * (2.0 * math.pi / SECTORS)
    if not body.turns:
        headings = np.zeros(SECTORS)
    height = np.outer(np.sin(headings), body.outline[:, 0]) + np.outer(np.cos(headings), body.outline[:, 1])
    return height.argmin(axis=1).tolist()


def new_workspace(table: Table, bodies: Bodies, scheme: Scheme, slots: int) -> Workspace:
    """Allocate working arrays for any ``slots`` parts of these kinds."""
    groups = -(-slots // LANES)
    slots = groups * LANES
    body = getattr(body_of, "py_func", body_of)  # a plain function under NUMBA_DISABLE_JIT
    kinds = [body(bodies, kind) for kind in range(len(bodies.area))]
    across = max(window(body.radius / table.element_size) for body in kinds)
    cells = across * across
    finest = max(
        cells_across(table, body, scheme.pieces if scheme.pieces > 0 else finest_split(table, body)) for body in kinds
    )
    corners = max(len(body.outline) for body in kinds)

    def lanes(rows: int) -> np.ndarray:
        return _aligned_zeros(groups, rows * LANES)

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
        start_pose=lanes(3),
        start_velocity=lanes(3),
        middle=_aligned_zeros(3 * LANES),
        own=lanes(6),
        kind=np.full(slots, -1),
        outline=lanes(2 * corners),
        shape=lanes(4),
        corners=np.zeros(slots, np.int64),
        most=np.full(groups, -1),
        lowest=np.array([lowest_corners(body) for body in kinds]),
        sector=lanes(1),
        across=across,
        base=lanes(2),
        known=np.zeros((groups, cells), np.int64),
        phasor_c=lanes(cells),
        phasor_s=lanes(cells),
        grip=lanes(cells),
        cells=_aligned_zeros(cells * CELL),
        crossings=_aligned_zeros(across * WIDTH),
        pieces=_aligned_zeros(cells * PIECE),
        held=flags(),
        moments=lanes(MOMENT_ROWS),
        cosine=np.zeros(4 * scheme.substeps + 4),
        sine=np.zeros(4 * scheme.substeps + 4),
        cut=new_cut(corners, finest),
        phasors=new_phasors(slots, max(cells_across(table, body, 1) for body in kinds)),
    )
