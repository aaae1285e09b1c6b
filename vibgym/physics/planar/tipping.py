"""Tipping margin of a flat part: the required centre of pressure relative to the edge of the support.

Friction ``F`` acts at the bottom, ``h`` below the centre of mass. Elements of different heights require an angular
acceleration of a part that follows them. A rigid part that stays flat needs its pressure, with the sum ``N``, to be centred at

    r = (M_1 - h F) / N

where ``M_1`` is the first moment of uniform pressure ``(m / A)(g + z'')`` about the centre of the supported area. The part does
not tip while ``r`` is inside its support, the convex hull of the outline on the table.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.core.drive import clear_phasors, pinned_drive
from vibgym.physics.core.records import body_in, grip_of, kind_in, state_at
from vibgym.physics.planar.contact_area import POINTS_PER_PIECE, points_at
from vibgym.physics.planar.static import set_loads
from vibgym.physics.planar.workspace import fixed_scene_at
from vibgym.physics.planar.wrench import sliding_wrench, varying_wrench

PHASES = 24
"""Number of instants in a period that are tested."""


@jit
def edge_fraction(table, x, y, heading, hull, first, last, rx, ry):
    """Return the distance of a centre of pressure (rx, ry) (m, from the centre of mass) over that of the edge; 1: tipping.

    Args:
        x, y, heading: pose of the part.
        hull: (n, 2) m, convex hulls of the kinds; corners ``first`` to ``last`` are the part's.
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    px, py = cosine * rx + sine * ry, -sine * rx + cosine * ry
    most = 0.0
    ax, ay = hull[last - 1, 0], hull[last - 1, 1]
    for k in range(first, last):
        bx, by = hull[k, 0], hull[k, 1]
        nx, ny = by - ay, ax - bx
        room = max(ax * nx + ay * ny, 1e-300)
        most = max(most, (px * nx + py * ny) / room)
        ax, ay = bx, by
    width, depth = table.columns * table.element_size, table.rows * table.element_size
    most = max(most, max(rx / max(width - x, 1e-300), -rx / max(x, 1e-300)))
    return max(most, max(ry / max(depth - y, 1e-300), -ry / max(y, 1e-300)))


@jit
def grip_under(table, body, cut, point):
    """Return the factor on friction of the element under a contact point."""
    element = cut.under[point // POINTS_PER_PIECE]
    return grip_of(body.patches, element // table.columns, element % table.columns)


@jit
def largest_edge_fraction(scene, drive, state, world, part, centre_height, hull, first, last):
    """Return the largest edge fraction in a period, for a part at its current pose and velocity."""
    table, cut = scene.table, scene.workspace.cut
    body = body_in(scene.bodies, state, world, part)
    phasors = scene.workspace.phasors
    clear_phasors(phasors, 0)
    phasors.coupling[0] = body.coupling
    x, y, heading = state.pose[world, part, 0], state.pose[world, part, 1], state.pose[world, part, 2]
    n = points_at(table, body, 1, drive, world, x, y, heading, cut, phasors, 0)
    weight, px, py = cut.points[0], cut.points[1], cut.points[2]
    vx, vy, spin = state.velocity[world, part, 0], state.velocity[world, part, 1], state.velocity[world, part, 2]
    carried, ax, ay = 0.0, 0.0, 0.0
    for point in range(n):  # weights include the factors on friction
        share = weight[point] / grip_under(table, body, cut, point)
        carried += share
        ax += share * px[point]
        ay += share * py[point]
    ax, ay = ax / max(carried, 1e-300), ay / max(carried, 1e-300)
    most = 0.0
    for k in range(PHASES):
        c, s = math.cos(2.0 * math.pi * k / PHASES), math.sin(2.0 * math.pi * k / PHASES)
        set_loads(weight, cut.phasor_c, cut.phasor_s, n, table.gravity, c, s, 1.0, cut.load)
        total, mx, my = 0.0, 0.0, 0.0
        for point in range(n):
            load = cut.load[point] / grip_under(table, body, cut, point)
            total += load
            mx += load * (px[point] - ax)
            my += load * (py[point] - ay)
        if not total > 1e-9 * table.gravity:
            continue
        ux, uy = -table.speed * s - vx, table.speed * c - vy
        if body.law.shape[0] > 1:
            fx, fy, _ = varying_wrench(
                weight, px, py, cut.phasor_c, cut.phasor_s, n, table.gravity, c, s, ux, uy, spin, body.law
            )
        else:
            fx, fy, _ = sliding_wrench(weight, px, py, cut.phasor_c, cut.phasor_s, n, table.gravity, c, s, ux, uy, spin)
        down = body.friction * centre_height
        rx, ry = (mx - down * fx) / total, (my - down * fy) / total
        most = max(most, edge_fraction(table, x, y, heading, hull, first, last, rx, ry))
    return most


@jit
def edge_fractions(fixed, drive, state, centre_height, hull, first, shares):
    """Compute the largest edge fraction of every part, see :func:`edge_fraction`.

    Args:
        fixed, drive, state: addresses of pinned records.
        centre_height: (kinds,) m.  hull, first: of the kinds, (corners, 2) m and (kinds + 1,).
        shares: (worlds, parts), overwritten; infinite for parts that have fallen.
    """
    scene, drive, state = fixed_scene_at(fixed), reference(pinned_drive(drive)), state_at(state)
    for world in range(shares.shape[0]):
        for part in range(shares.shape[1]):
            kind = kind_in(scene.bodies, world, part)
            shares[world, part] = math.inf
            if not state.fallen[world, part]:
                shares[world, part] = largest_edge_fraction(
                    scene, drive, state, world, part, centre_height[kind], hull, first[kind], first[kind + 1]
                )
