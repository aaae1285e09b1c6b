"""Planar contact, resolved in time: parts that touch nothing but the vibrating elements, sliding and sticking.

A period is divided into ``steps``. Each step cuts the outline once, at the pose predicted for its middle, and then takes
``substeps`` Runge-Kutta steps of the friction dynamics on these pieces (:mod:`vibgym.physics.friction.stepper`): fourth order
in time where no element edge is crossed, second order across edges. Cutting is what edges need and friction is what the fast
table needs, so each gets its own step. Trigonometry of the drive is tabulated at the stage times.
"""

from __future__ import annotations

import math

from vibgym.physics.contact_area.pressure_moments import LANES
from vibgym.physics.core.jit import borrowing
from vibgym.physics.friction.stepper import apply_friction, copy_lane, cut_stale, enter_part, finite_lane
from vibgym.physics.friction.workspace import Step


@borrowing
def begin_period(state, workspace):
    """Remember where the period began; returns whether any part can move."""
    pose, velocity = workspace.pose[0], workspace.velocity[0]
    for k in range(3 * LANES):
        workspace.begun_pose[0, k], workspace.begun_velocity[0, k] = pose[k], velocity[k]
    anything = False
    for lane in range(LANES):
        world = workspace.world[lane]
        workspace.away[lane] = (
            workspace.away[lane] or state.fallen[world, workspace.part[lane]] or state.diverged[world]
        )
        anything = anything or not workspace.away[lane]
    return anything


@borrowing
def end_period(state, workspace, lane):
    """After a period: a part whose numbers make no sense goes back to where it was, one that has fallen rests."""
    world, part = workspace.world[lane], workspace.part[lane]
    pose, velocity = workspace.pose[0], workspace.velocity[0]
    if state.diverged[world] or not (finite_lane(pose, lane) and finite_lane(velocity, lane)):
        # Keep the last state that made sense; nobody gets to see the other one.
        state.diverged[world], state.fallen[world, part] = True, False
        copy_lane(workspace.begun_pose[0], pose, lane)
        copy_lane(workspace.begun_velocity[0], velocity, lane)
    if state.fallen[world, part]:
        state.sticking[world, part] = False
        for k in range(lane, 3 * LANES, LANES):
            velocity[k] = 0.0


@borrowing
def write_paths(state, workspace, count, paths, base, node):
    """Write down where the first ``count`` lanes are, if paths are asked for."""
    if paths.shape[0] == 0:
        return
    parts = state.pose.shape[1]
    for lane in range(count):
        row = workspace.world[lane] * parts + workspace.part[lane] - base
        for k in range(3):
            paths[row, node, k] = workspace.pose[0, k * LANES + lane]


@borrowing
def slide_period(table, bodies, scheme, drive, state, workspace, count, paths, base):
    """Advance the first ``count`` lanes by a period; returns whether any part could move."""
    can_move = begin_period(state, workspace)
    write_paths(state, workspace, count, paths, base, 0)
    if not can_move:
        return False
    span = table.period / scheme.steps
    stages = 3 * scheme.substeps
    advance = 2.0 * math.pi / table.period * (span / stages)
    for turn in range(scheme.steps):
        for lane in range(LANES):
            workspace.stale[lane] = True
        cut_stale(table, bodies, scheme, drive, state, workspace, span, False)
        step = Step(
            advance * (stages * turn), span, table.period / (scheme.steps * scheme.substeps), scheme.substeps,
            scheme.cosine, scheme.sine, stages * turn, 3,
        )  # fmt: skip
        apply_friction(table, bodies, scheme, drive, state, workspace, step)
        write_paths(state, workspace, count, paths, base, turn + 1)
    for lane in range(count):
        end_period(state, workspace, lane)
    return True


@borrowing
def slide_rows(rows, drive, table, bodies, scheme, state, periods, paths, base, workspace):
    """Advance parts without contacts by whole periods under a held drive, changing ``state`` in place.

    Args:
        rows: (n,) the parts, as ``world * parts + part``.
        paths: (all rows, steps + 1, 3) overwritten with the poses of the last period at the ends of its steps, or no rows at
            all. The first is that of row ``base``.
        workspace: of one group of lanes.
    """
    parts = state.pose.shape[1]
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(LANES):
            row = rows[first + min(lane, count - 1)]
            enter_part(table, bodies, state, workspace, lane, row // parts, row % parts, lane >= count)
        for _ in range(periods):
            if not slide_period(table, bodies, scheme, drive, state, workspace, count, paths, base):
                break
        for lane in range(count):
            world, part = workspace.world[lane], workspace.part[lane]
            for k in range(3):
                at = k * LANES + lane
                pose = workspace.pose[0, at]
                state.pose[world, part, k], state.velocity[world, part, k] = pose, workspace.velocity[0, at]
                state.mean_velocity[world, part, k] = (pose - workspace.begun_pose[0, at]) / table.period
