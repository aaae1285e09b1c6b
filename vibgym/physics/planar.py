"""Planar contact, resolved in time: one part per world in sliding contact with the vibrating elements.

A period is divided into ``steps``. Each step cuts the outline once, at the pose predicted for its middle, and then takes
``substeps`` classical Runge-Kutta steps of the friction dynamics on these pieces: fourth order in time where no element
edge is crossed, second order across edges. Cutting is what edges need and friction is what the fast table needs, so each
gets its own step. Trigonometry of the drive is tabulated at the stage times.

Sticking is outside this model. Where it would start (the relative velocity can be brought to zero within a substep, and
static friction can then carry the table's acceleration, thesis eq. 3.2) the part is put on the table's velocity for that
substep and the world is marked: the mark says that from there on the result is not certified.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics._jit import jit
from vibgym.physics.contact_area import (
    MOMENTS,
    NEGLIGIBLE_PIECE,
    POINTS_PER_PIECE,
    contact_points,
    cut_outline,
    support_holds,
)
from vibgym.physics.drive import element_phasor
from vibgym.physics.friction import sliding_wrench


class Table(NamedTuple):
    """The surface as the kernel needs it."""

    rows: int
    columns: int
    element_size: float  # m
    gravity: float  # m/s^2
    period: float  # s
    radius: float  # m, of the horizontal motion
    speed: float  # m/s, of the horizontal motion


class Body(NamedTuple):
    """The part as the kernel needs it; the motion does not depend on mass."""

    outline: np.ndarray  # (n, 2) m, about the centre of mass, counter-clockwise
    area: float  # m^2
    radius: float  # m, of the circle about the centre of mass that holds the outline
    gyration: float  # m^2, planar inertia over mass
    friction: float
    static_friction: float
    convex: bool
    turns: bool  # False for a disc, whose contact area does not depend on heading


class Scheme(NamedTuple):
    """Step sizes and their tables."""

    steps: int
    substeps: int
    pieces: int  # cells per element and direction; 0 chooses by spin
    cosine: np.ndarray  # (2 * steps * substeps + 1) cos wt at the stage times
    sine: np.ndarray


class State(NamedTuple):
    """State of all worlds, changed in place."""

    pose: np.ndarray  # (worlds, 1, 3) m, m, rad
    velocity: np.ndarray  # (worlds, 1, 3) m/s, m/s, rad/s
    mean_velocity: np.ndarray  # (worlds, 1, 3) over the last period
    fallen: np.ndarray  # (worlds, 1) bool
    sticking: np.ndarray  # (worlds, 1) bool
    diverged: np.ndarray  # (worlds,) bool


FINEST_PIECES = 8
"""Most cells across an element (or across a smaller part) that the spin rule asks for."""


@jit
def most_split(table, body, scheme):
    """Largest number of cells per element and direction that a call can use."""
    if scheme.pieces > 0:
        return scheme.pieces
    size = min(table.element_size, 2.0 * body.radius)
    return int(math.ceil(FINEST_PIECES * table.element_size / size))


@jit
def spin_split(table, body, speed, spin):
    """Cells per element that the spin asks for: none extra until ``omega x size`` reaches the slip speed.

    Four points carry a piece's second moments exactly; what they miss grows with the change of slip across the piece.
    """
    size = min(table.element_size, 2.0 * body.radius)
    across = abs(spin) * size
    if across < speed:
        return 1
    pieces = min(1.0 + across / max(speed, 1e-9 * across + 1e-300), float(FINEST_PIECES))
    return int(math.ceil(math.floor(pieces) * table.element_size / size))


@jit
def place_outline(body, x, y, heading, scale, outline_x, outline_y):
    """Outline in the world frame, in units of ``1 / scale``."""
    cosine, sine = 1.0, 0.0
    if body.turns:
        cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(body.outline.shape[0]):
        bx, by = body.outline[k, 0], body.outline[k, 1]
        outline_x[k] = (x + cosine * bx - sine * by) * scale
        outline_y[k] = (y + sine * bx + cosine * by) * scale


@jit
def would_stick(table, body, h, points, phasor_c, phasor_s, n, cosine, sine, slip_x, slip_y, spin):
    """Whether sticking starts within a substep of length ``h``: slip and spin can be stopped, and then be held.

    Holding is judged by the force alone, which is necessary; where pressure differs under the part the torque may let it
    go earlier, so the mark comes rather too often than too late.
    """
    mean_c, mean_s, arm = 0.0, 0.0, 0.0
    for k in range(n):
        mean_c += points[0, k] * phasor_c[k]
        mean_s += points[0, k] * phasor_s[k]
        arm += points[0, k] * math.sqrt(points[1, k] ** 2 + points[2, k] ** 2)
    normal = table.gravity - mean_c * cosine + mean_s * sine
    needed = table.radius * (2.0 * math.pi / table.period) ** 2
    if needed > body.static_friction * normal:
        return False
    brake = body.friction * normal * h
    if abs(spin) * body.gyration > brake * arm:
        return False
    slip = math.sqrt(slip_x * slip_x + slip_y * slip_y)
    if slip == 0.0:
        return True
    helped = cosine * slip_x + sine * slip_y  # positive where the table's own acceleration takes slip away
    if needed <= body.friction * normal:
        # Friction stops slip in any direction, but the last of it turns faster than a substep can follow.
        helped = max(helped, 0.0)
    return slip - h * needed * helped / slip <= brake


@jit
def advance_worlds(start, stop, drive, table, body, scheme, state, periods):
    """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""
    table_acceleration = table.radius * (2.0 * math.pi / table.period) ** 2
    width, height = table.columns * table.element_size, table.rows * table.element_size
    step = table.period / scheme.steps
    h = step / scheme.substeps
    mu = body.friction
    mu_spin = mu / body.gyration
    nearly_still = (table_acceleration + 2.0 * mu * table.gravity) * h  # slip speed below which sticking is looked at

    n = body.outline.shape[0]
    outline_x, outline_y = np.empty(n), np.empty(n)
    across = int(2.0 * body.radius / table.element_size * most_split(table, body, scheme)) + 3
    cells = np.empty((across * across, MOMENTS))
    box = np.empty(4, np.int64)
    capacity = across * across * POINTS_PER_PIECE + 8
    points = np.empty((3, capacity))
    under = np.empty(capacity, np.int64)
    weight, rx, ry = points[0], points[1], points[2]
    phasor_c, phasor_s = np.empty(capacity), np.empty(capacity)
    element_c = np.empty(table.rows * table.columns)
    element_s = np.empty(table.rows * table.columns)
    read_for = np.full(table.rows * table.columns, -1)  # world whose phasor is in element_c, element_s

    for world in range(start, stop):
        x, y, heading = state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2]
        vx, vy, spin = state.velocity[world, 0, 0], state.velocity[world, 0, 1], state.velocity[world, 0, 2]
        x0, y0, heading0 = x, y, heading
        for _ in range(periods):
            if state.fallen[world, 0] or state.diverged[world]:
                x0, y0, heading0 = x, y, heading
                break
            x0, y0, heading0 = x, y, heading
            vx0, vy0, spin0 = vx, vy, spin
            node = 0
            for _ in range(scheme.steps):
                # Where the part will be in the middle of the step decides on what it rests.
                x_mid, y_mid, heading_mid = x + 0.5 * step * vx, y + 0.5 * step * vy, heading + 0.5 * step * spin
                if not abs(x_mid + y_mid + heading_mid) < math.inf:  # no outline can be placed there
                    heading = math.nan
                    break
                if not (x_mid >= 0.0 and y_mid >= 0.0 and x_mid <= width and y_mid <= height):
                    state.fallen[world, 0] = True
                    break
                slip_x, slip_y = -table.speed * scheme.sine[node] - vx, table.speed * scheme.cosine[node] - vy
                split = scheme.pieces
                if split == 0:
                    split = spin_split(table, body, math.sqrt(slip_x * slip_x + slip_y * slip_y), spin)
                pitch = table.element_size / split
                place_outline(body, x_mid, y_mid, heading_mid, 1.0 / pitch, outline_x, outline_y)
                if not body.convex and not support_holds(
                    outline_x, outline_y, width / pitch, height / pitch, x_mid / pitch, y_mid / pitch
                ):
                    state.fallen[world, 0] = True
                    break
                cut_outline(outline_x, outline_y, cells, box)
                smallest = NEGLIGIBLE_PIECE * body.area / (pitch * pitch)
                m = contact_points(
                    cells, box, table.rows, table.columns, split, pitch, x_mid, y_mid, smallest, points, under
                )
                if m == 0:
                    state.fallen[world, 0] = True
                    break
                for piece in range(m // POINTS_PER_PIECE):
                    element = under[piece]
                    if read_for[element] != world:
                        read_for[element] = world
                        element_c[element], element_s[element] = element_phasor(
                            drive, world, element // table.columns, element % table.columns
                        )
                    for k in range(POINTS_PER_PIECE * piece, POINTS_PER_PIECE * piece + POINTS_PER_PIECE):
                        phasor_c[k], phasor_s[k] = element_c[element], element_s[element]

                for _ in range(scheme.substeps):
                    c0, s0 = scheme.cosine[node], scheme.sine[node]
                    c1, s1 = scheme.cosine[node + 1], scheme.sine[node + 1]
                    c2, s2 = scheme.cosine[node + 2], scheme.sine[node + 2]
                    node += 2
                    slip_x, slip_y = -table.speed * s0 - vx, table.speed * c0 - vy
                    if slip_x * slip_x + slip_y * slip_y <= nearly_still * nearly_still and would_stick(
                        table, body, h, points, phasor_c, phasor_s, m, c0, s0, slip_x, slip_y, spin
                    ):
                        state.sticking[world, 0] = True
                        x += table.radius * (c2 - c0)
                        y += table.radius * (s2 - s0)
                        vx, vy, spin = -table.speed * s2, table.speed * c2, 0.0
                        continue
                    ax, ay, aw = sliding_wrench(
                        weight, rx, ry, phasor_c, phasor_s, m, table.gravity, c0, s0, slip_x, slip_y, spin
                    )
                    ax, ay, aw = mu * ax, mu * ay, mu_spin * aw
                    bx, by, bw = sliding_wrench(
                        weight, rx, ry, phasor_c, phasor_s, m, table.gravity, c1, s1,
                        -table.speed * s1 - (vx + 0.5 * h * ax),
                        table.speed * c1 - (vy + 0.5 * h * ay),
                        spin + 0.5 * h * aw,
                    )  # fmt: skip
                    bx, by, bw = mu * bx, mu * by, mu_spin * bw
                    cx, cy, cw = sliding_wrench(
                        weight, rx, ry, phasor_c, phasor_s, m, table.gravity, c1, s1,
                        -table.speed * s1 - (vx + 0.5 * h * bx),
                        table.speed * c1 - (vy + 0.5 * h * by),
                        spin + 0.5 * h * bw,
                    )  # fmt: skip
                    cx, cy, cw = mu * cx, mu * cy, mu_spin * cw
                    dx, dy, dw = sliding_wrench(
                        weight, rx, ry, phasor_c, phasor_s, m, table.gravity, c2, s2,
                        -table.speed * s2 - (vx + h * cx),
                        table.speed * c2 - (vy + h * cy),
                        spin + h * cw,
                    )  # fmt: skip
                    dx, dy, dw = mu * dx, mu * dy, mu_spin * dw
                    x += h * (vx + h / 6.0 * (ax + bx + cx))
                    y += h * (vy + h / 6.0 * (ay + by + cy))
                    heading += h * (spin + h / 6.0 * (aw + bw + cw))
                    vx += h / 6.0 * (ax + 2.0 * (bx + cx) + dx)
                    vy += h / 6.0 * (ay + 2.0 * (by + cy) + dy)
                    spin += h / 6.0 * (aw + 2.0 * (bw + cw) + dw)

            # A comparison, since isfinite(a + b) does not survive reassociation (see _jit).
            if not abs(x + y + heading + vx + vy + spin) < math.inf:
                # Keep the last state that made sense; nobody gets to see the other one.
                state.diverged[world], state.fallen[world, 0] = True, False
                x, y, heading, vx, vy, spin = x0, y0, heading0, vx0, vy0, spin0
            if state.fallen[world, 0]:
                vx, vy, spin = 0.0, 0.0, 0.0

        state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2] = x, y, heading
        state.velocity[world, 0, 0], state.velocity[world, 0, 1], state.velocity[world, 0, 2] = vx, vy, spin
        state.mean_velocity[world, 0, 0] = (x - x0) / table.period
        state.mean_velocity[world, 0, 1] = (y - y0) / table.period
        state.mean_velocity[world, 0, 2] = (heading - heading0) / table.period
