"""Planar model without contacts, resolved in time: parts that slide and stick on the vibrating elements.

A period has ``steps``. Each step cuts the outline once, at the pose predicted for its middle, and takes ``substeps``
Runge-Kutta steps of the friction dynamics on these pieces (:mod:`vibgym.physics.planar.stepper`). The result is fourth order
in time where no element edge is crossed, second order across edges. Trigonometry of the drive is tabulated at the stage times.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import state_at
from vibgym.physics.planar.stepper import apply_friction, copy_lane, cut_stale, finite_lane, load_part
from vibgym.physics.planar.workspace import TimeSpan, fixed_scene_at, scene_of


@jit
def begin_period(scene):
    """Store the state at the period's start; return whether any part can move."""
    state, workspace = scene.state, scene.workspace
    pose, velocity = workspace.pose[0], workspace.velocity[0]
    for k in range(3 * LANES):
        workspace.start_pose[0, k], workspace.start_velocity[0, k] = pose[k], velocity[k]
    anything = False
    for lane in range(LANES):
        world = workspace.world[lane]
        workspace.away[lane] = (
            workspace.away[lane] or state.fallen[world, workspace.part[lane]] or state.diverged[world]
        )
        anything = anything or not workspace.away[lane]
    return anything


@jit
def end_period(scene, lane):
    """End a period: restore the last pose and velocity of a part with non-finite values, and stop a fallen part."""
    state, workspace = scene.state, scene.workspace
    world, part = workspace.world[lane], workspace.part[lane]
    pose, velocity = workspace.pose[0], workspace.velocity[0]
    if state.diverged[world] or not (finite_lane(pose, lane) and finite_lane(velocity, lane)):
        # Restore the last finite state and discard the diverged one.
        state.diverged[world], state.fallen[world, part] = True, False
        copy_lane(workspace.start_pose[0], pose, lane)
        copy_lane(workspace.start_velocity[0], velocity, lane)
    if state.fallen[world, part]:
        state.sticking[world, part] = False
        for k in range(lane, 3 * LANES, LANES):
            velocity[k] = 0.0


@jit
def record_paths(scene, count, paths, base, node):
    """Record the poses of the first ``count`` lanes at a node of the paths, if there are paths."""
    if paths.shape[0] == 0:
        return
    workspace, parts = scene.workspace, scene.state.pose.shape[1]
    for lane in range(count):
        row = workspace.world[lane] * parts + workspace.part[lane] - base
        for k in range(3):
            paths[row, node, k] = workspace.pose[0, k * LANES + lane]


@jit
def slide_period(scene, count, paths, base):
    """Advance the first ``count`` lanes by a period; return whether any part could move."""
    can_move = begin_period(scene)
    record_paths(scene, count, paths, base, np.int64(0))
    if not can_move:
        return False
    table, scheme, workspace = scene.table, scene.scheme, scene.workspace
    span = table.period / scheme.steps
    stages = 3 * scheme.substeps
    advance = 2.0 * math.pi / table.period * (span / stages)
    for turn in range(scheme.steps):
        for lane in range(LANES):
            workspace.stale[lane] = True
        cut_stale(scene, span, False)
        step = TimeSpan(
            advance * (stages * turn), span, table.period / (scheme.steps * scheme.substeps), scheme.substeps,
            scheme.cosine, scheme.sine, stages * turn, 3,
        )  # fmt: skip
        apply_friction(scene, reference(step))
        record_paths(scene, count, paths, base, turn + 1)
    for lane in range(count):
        end_period(scene, lane)
    return True


@jit
def slide_rows(rows, fixed, drive, state, periods, paths, base):
    """Advance parts without contacts by whole periods under a held drive, changing the state in place.

    Args:
        rows: (n,) the parts, as ``world * parts + part``.
        fixed, drive, state: addresses of pinned records, with a workspace for one group of lanes.
        periods: number of periods.
        paths: (all rows, steps + 1, 3) overwritten with the poses of the last period at the ends of its steps, or empty.
        base: row of ``paths[0]``.
    """
    scene = reference(scene_of(fixed_scene_at(fixed), reference(pinned_drive(drive)), state_at(state), 1))
    state, workspace = scene.state, scene.workspace
    parts = state.pose.shape[1]
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(LANES):
            row = rows[first + min(lane, count - 1)]
            load_part(scene, lane, row // parts, row % parts, lane >= count)
        for _ in range(periods):
            if not slide_period(scene, count, paths, base):
                break
        for lane in range(count):
            world, part = workspace.world[lane], workspace.part[lane]
            for k in range(3):
                at = k * LANES + lane
                pose = workspace.pose[0, at]
                state.pose[world, part, k], state.velocity[world, part, k] = pose, workspace.velocity[0, at]
                state.mean_velocity[world, part, k] = (pose - workspace.start_pose[0, at]) / scene.table.period
