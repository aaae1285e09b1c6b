"""The friction stepper: a step of parts on the vibrating elements, alone or between contacts with others.

A part's contact area is cut once for a step, at the pose predicted for its middle. Then friction moves a group of eight parts
together, as a series in the moments of the pressure (:mod:`vibgym.physics.planar.series`). A part where that series is not
good enough, because slip varies too much across it or nearly vanishes, or that sticks, takes the step again on its own, by
contact points (:mod:`vibgym.physics.planar.points`). No lane ever looks at another, so a part's numbers do not depend on
its company.
"""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing
from vibgym.physics.core.records import Motion, body_in, body_of
from vibgym.physics.planar.cut import OFF, PLACED, place_part
from vibgym.physics.planar.outline import NEGLIGIBLE_PIECE, cut_outline
from vibgym.physics.planar.phasors import forget_phasors
from vibgym.physics.planar.points import cuts_needed, slide_by_points
from vibgym.physics.planar.pressure_moments import (
    LANES,
    clear_pieces,
    collect_pieces,
    pressure_moments,
    read_phasors,
)
from vibgym.physics.planar.series import limits, slide_by_series


@borrowing
def copy_lane(source, target, lane):
    """Copy the lane's three numbers."""
    for k in range(lane, 3 * LANES, LANES):
        target[k] = source[k]


@borrowing
def finite_lane(values, lane):
    """Whether the lane's three numbers are finite. A comparison, since isfinite(a + b) does not survive reassociation."""
    return abs(values[lane] + values[LANES + lane] + values[2 * LANES + lane]) < math.inf


@borrowing
def enter_part(scene, slot, world, part, away):
    """Put a part into a slot; ``away``: it is not on the table, or the slot stays empty and only copies that part."""
    state, workspace = scene.state, scene.workspace
    g, lane = slot // LANES, slot % LANES
    body = body_in(scene.bodies, state, world, part)
    workspace.world[slot], workspace.part[slot], workspace.away[slot] = world, part, away
    workspace.most_square[slot], workspace.slow_rate[slot] = limits(scene.table, body)
    own = workspace.own[g]
    own[2 * LANES + lane], own[3 * LANES + lane] = body.friction, 1.0 / body.gyration
    own[4 * LANES + lane], own[5 * LANES + lane] = body.incline_x, body.incline_y
    for k in range(3):
        workspace.pose[g, k * LANES + lane] = state.pose[world, part, k]
        workspace.velocity[g, k * LANES + lane] = state.velocity[world, part, k]
    forget_phasors(workspace.phasors, slot)


@borrowing
def cut_part(scene, slot, left, pushed):
    """Cut what will lie under a slot's part after half of ``left`` s; how it takes its next steps depends on it.

    Args:
        pushed: whether others may push the part. Then it may be stopped before it falls, and may stick no longer.
    """
    table, state, workspace = scene.table, scene.state, scene.workspace
    g, lane = slot // LANES, slot % LANES
    world, part = workspace.world[slot], workspace.part[slot]
    body = body_of(scene.bodies, scene.bodies.kind[part])
    pose, velocity, cut = workspace.pose[g], workspace.velocity[g], workspace.cut
    vx, vy, spin = velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]
    # Where the part will be in the middle of the step decides on what it rests.
    x, y = pose[lane] + 0.5 * left * vx, pose[LANES + lane] + 0.5 * left * vy
    heading = pose[2 * LANES + lane] + 0.5 * left * spin
    fate = place_part(table, body, 1, x, y, heading, cut)
    on_elements = 0.0 <= x <= table.columns * table.element_size and 0.0 <= y <= table.rows * table.element_size
    if pushed and (fate == OFF or not on_elements):
        x, y, heading = pose[lane], pose[LANES + lane], pose[2 * LANES + lane]
        fate = place_part(table, body, 1, x, y, heading, cut)
    by_points, held, inverse_area = False, 0, 0.0
    if fate == PLACED:
        by_points = scene.scheme.pieces > 0 or cuts_needed(table, left, vx, vy, spin) > 1
        by_points = by_points or (state.sticking[world, part] and not pushed)
        if not by_points:
            pieces, rows, columns = workspace.pieces[g], workspace.rows, workspace.columns
            corners = body.outline.shape[0]
            smallest = NEGLIGIBLE_PIECE * body.area / (table.element_size * table.element_size)
            cut_outline(cut.outline_x[:corners], cut.outline_y[:corners], cut.cells, cut.box)
            held, area = collect_pieces(cut.cells, cut.box, table, x, y, smallest, pieces, rows, columns, lane)
            read_phasors(scene.drive, world, rows, columns, held, workspace.phasors, slot, pieces, lane)
            if held > 0:
                inverse_area = 1.0 / area
            else:
                fate = OFF
    workspace.by_points[slot] = by_points
    workspace.held[g, lane], workspace.inverse_area[g, lane] = held, inverse_area
    if fate != PLACED:
        workspace.away[slot] = True
        state.fallen[world, part] = fate == OFF
        state.diverged[world] = state.diverged[world] or fate != OFF


@borrowing
def cut_stale(scene, left, pushed):
    """Cut what lies under every stale part, see :func:`cut_part`, and bring the moments of its group up to date."""
    workspace = scene.workspace
    for g in range(workspace.pose.shape[0]):
        cut, most = False, 0
        for lane in range(LANES):
            slot = g * LANES + lane
            if workspace.stale[slot]:
                workspace.stale[slot] = False
                if workspace.away[slot]:
                    workspace.held[g, lane], workspace.inverse_area[g, lane] = 0, 0.0
                else:
                    cut_part(scene, slot, left, pushed)
                cut = True
            most = max(most, workspace.held[g, lane])
        if cut and most > 0:
            most += most % 2  # pieces are taken in twos
            pieces = workspace.pieces[g]
            for lane in range(LANES):
                clear_pieces(pieces, lane, workspace.held[g, lane], most)
            pressure_moments(
                pieces, most, scene.table.element_size, workspace.inverse_area[g], workspace.moments[g], workspace.spare,
                scene.scheme.lanes,
            )  # fmt: skip


@borrowing
def take_by_points(scene, step, slot):
    """Take the step for one part, by contact points."""
    state, workspace = scene.state, scene.workspace
    g, lane = slot // LANES, slot % LANES
    world, part = workspace.world[slot], workspace.part[slot]
    pose, velocity = workspace.pose[g], workspace.velocity[g]
    motion, stuck, supported = slide_by_points(
        scene.table, body_in(scene.bodies, state, world, part), scene.scheme.pieces, scene.drive, world, step,
        workspace.cut, workspace.phasors, slot,
        Motion(
            pose[lane], pose[LANES + lane], pose[2 * LANES + lane],
            velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane],
        ),
        state.sticking[world, part],
    )  # fmt: skip
    pose[lane], pose[LANES + lane], pose[2 * LANES + lane] = motion.x, motion.y, motion.heading
    velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane] = motion.vx, motion.vy, motion.spin
    state.sticking[world, part] = stuck
    if not supported:
        workspace.away[slot] = True
        state.fallen[world, part] = True


@borrowing
def series_held(workspace, g, lane, h):
    """Whether the series was good enough for a lane all along a step with substeps of ``h`` s."""
    slot, own = g * LANES + lane, workspace.own[g]
    slow = workspace.slow_rate[slot] * h
    return (
        own[lane] <= workspace.most_square[slot]
        and own[LANES + lane] >= slow * slow
        and finite_lane(workspace.pose[g], lane)
        and finite_lane(workspace.velocity[g], lane)
    )


@borrowing
def apply_friction(scene, step):
    """Let friction alone move all parts for a step."""
    state, workspace = scene.state, scene.workspace
    for g in range(workspace.pose.shape[0]):
        pose, velocity = workspace.pose[g], workspace.velocity[g]
        old_pose, old_velocity = workspace.old_pose[g], workspace.old_velocity[g]
        series = False
        for lane in range(LANES):
            series = series or workspace.held[g, lane] > 0
        if series:
            for k in range(3 * LANES):
                old_pose[k], old_velocity[k] = pose[k], velocity[k]
            slide_by_series(
                scene.table, step, workspace.moments[g], pose, velocity, workspace.own[g], scene.scheme.lanes
            )
        for lane in range(LANES):
            slot = g * LANES + lane
            away = workspace.away[slot]
            again = not away and (
                workspace.by_points[slot] or state.sticking[workspace.world[slot], workspace.part[slot]]
                or not series_held(workspace, g, lane, step.h)
            )  # fmt: skip
            if series and (away or again):
                copy_lane(old_pose, pose, lane)
                copy_lane(old_velocity, velocity, lane)
            if again:
                take_by_points(scene, step, slot)
