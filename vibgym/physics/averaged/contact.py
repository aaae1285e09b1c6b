"""What the averaged model computes at one pose: contact points and phasors under a part, mean acceleration, wobble."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.physics.averaged.averages import (
    Averages,
    Scratch,
    first_order,
    gather_moments,
    new_scratch,
    second_order,
    velocity_wobble,
    wobble,
)
from vibgym.physics.core.records import Body, Table
from vibgym.physics.planar.cut import (
    PLACED,
    Cut,
    cells_across,
    cut_into_points,
    finest_split,
    new_cut,
    place_part,
    read_points,
    spin_split,
)
from vibgym.physics.planar.phasors import Phasors, new_phasors

CLOSE = 1e-5
"""Error allowed in the wobble that is taken off at the start, over the table's speed."""


class AveragedScheme(NamedTuple):
    """Order, step sizes and tables."""

    order: int  # 1 or 2
    stride: int  # periods that one span of steps covers
    steps: int  # in each span
    tables: Averages


class AveragedWorkspace(NamedTuple):
    """Working arrays for one part at a time."""

    cut: Cut
    phasors: Phasors
    moments: np.ndarray  # (6, 3) of the pressure at hand
    before: np.ndarray  # (6, 3) of the step before
    shift: np.ndarray  # (6) a wobble
    scratch: Scratch


def new_workspace(table: Table, body: Body) -> AveragedWorkspace:
    """Working arrays for parts like ``body``."""
    return AveragedWorkspace(
        cut=new_cut(len(body.outline), cells_across(table, body, finest_split(table, body))),
        phasors=new_phasors(1, cells_across(table, body, 1), body.coupling),
        moments=np.zeros((6, 3)),
        before=np.zeros((6, 3)),
        shift=np.zeros(6),
        scratch=new_scratch(),
    )


@borrowing
def cut_at(table, body, x, y, heading, spin, work):
    """Cut the outline at a pose into contact points; returns their number, 0 without support."""
    # One cell per element, and more where spin changes the slip strongly across a piece.
    split = spin_split(table, body, table.speed, spin)
    if place_part(table, body, split, x, y, heading, work.cut) != PLACED:
        return 0
    return cut_into_points(table, body, split, x, y, work.cut)


@borrowing
def look_under(table, body, drive, world, x, y, heading, spin, work):
    """Cut the outline at a pose, read the phasors under it and gather their moments; returns the number of points."""
    n = cut_at(table, body, x, y, heading, spin, work)
    if n > 0:
        read_points(table, body, drive, world, n, work.cut, work.phasors, 0)
        gather_moments(work.cut.points, work.cut.phasor_c, work.cut.phasor_s, n, work.moments)
    return n


@borrowing
def mean_acceleration(table, body, scheme, n, vx, vy, spin, work):
    """Mean acceleration (m/s^2, m/s^2, rad/s^2) at a mean velocity, at the cut at hand."""
    mu = body.friction
    ax, ay, aw = first_order(
        scheme.tables,
        work.cut.points,
        work.cut.phasor_c,
        work.cut.phasor_s,
        n,
        table.gravity,
        table.speed,
        body.radius,
        vx,
        vy,
        spin,
        work.scratch,
    )
    if scheme.order == 2:
        small = mu * table.period / (2.0 * math.pi)
        bx, by, bw = second_order(
            scheme.tables, work.moments, table.gravity, table.speed, body.gyration, vx, vy, work.scratch
        )
        ax, ay, aw = ax + small * bx, ay + small * by, aw + small * bw
    return mu * ax, mu * ay, mu / body.gyration * aw


@borrowing
def steady_part(table, body, scheme, vx, vy, work):
    """Mean velocity that belongs to an instantaneous one, by Broyden's method; leaves its wobble in ``work.shift``."""
    size = body.friction * table.period / (2.0 * math.pi)
    tables, scratch, moments, result = scheme.tables, work.scratch, work.moments, work.shift
    ux, uy = vx, vy
    rx, ry = velocity_wobble(tables, moments, table.gravity, table.speed, ux, uy, scratch)
    rx, ry = size * rx, size * ry
    hxx, hxy, hyx, hyy = 1.0, 0.0, 0.0, 1.0
    for _ in range(12):
        if abs(rx) + abs(ry) < CLOSE * table.speed:
            break
        sx, sy = -(hxx * rx + hxy * ry), -(hyx * rx + hyy * ry)
        ux, uy = ux + sx, uy + sy
        qx, qy = velocity_wobble(tables, moments, table.gravity, table.speed, ux, uy, scratch)
        qx, qy = ux + size * qx - vx, uy + size * qy - vy
        dx, dy = qx - rx, qy - ry
        rx, ry = qx, qy
        px, py = hxx * dx + hxy * dy, hyx * dx + hyy * dy
        lx, ly = sx * hxx + sy * hyx, sx * hxy + sy * hyy
        scale = sx * px + sy * py
        if abs(scale) > 1e-12 * (sx * sx + sy * sy):
            ex, ey = (sx - px) / scale, (sy - py) / scale
            hxx, hxy, hyx, hyy = hxx + ex * lx, hxy + ex * ly, hyx + ey * lx, hyy + ey * ly
    # Never farther from the instantaneous velocity than a wobble can be.
    wobble(tables, moments, table.gravity, table.speed, body.gyration, ux, uy, result, scratch)
    return vx - size * result[0], vy - size * result[1]
