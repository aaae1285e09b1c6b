"""Averaged model: one part per world in permanent sliding on the vibrating elements.

The state is that of the planar model, pose and velocity at an instant. Each call converts it to the slow variables, pose and
velocity without wobble (:mod:`vibgym.physics.averaged.averages`), advances these, and converts them back under the same drive.
The wobble depends on the drive, so without this conversion each change of the drive would cause an error of first order. With
a drive that changes every period, it also reduces the error of the first-order model by a factor of 2.6.

A step covers a fraction of a period, one or several. The outline is cut at both ends. Between them the acceleration minus
``-mu g / (2 a_h w) v``, the linear part of friction, is linear in time, and the rest is solved exactly (exponential
Runge-Kutta, second order), so that steps of several periods are stable and damping is exact.

If slip may have passed through zero within a period, ``state.doubtful`` is set: the wobble may then accelerate the part to the
speed of the table, which this model does not cover.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.averaged.averages import (
    Averages,
    Scratch,
    first_order,
    friction_rate,
    gather_moments,
    new_scratch,
    second_order,
    slip_margin,
    velocity_wobble,
    wobble,
)
from vibgym.physics.core.drive import Drive, Phasors, clear_phasors, new_phasors
from vibgym.physics.core.records import Body, Motion, State, Table, is_finite, under_conditions
from vibgym.physics.planar.contact_area import (
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

CLOSE = 1e-5
"""Tolerance of :func:`mean_velocity_of`, over the table's speed."""


class AveragedScheme(NamedTuple):
    """Order, step sizes and tables."""

    order: int  # 1 or 2
    stride: int  # periods in a span of steps
    steps: int  # in each span
    tables: Averages


class AveragedWorkspace(NamedTuple):
    """Working arrays for one part at a time."""

    cut: Cut
    phasors: Phasors
    moments: np.ndarray  # (6, 3) of the pressure at the last cut
    before: np.ndarray  # (6, 3) of the pressure at the cut before
    shift: np.ndarray  # (6) a wobble
    scratch: Scratch


def new_workspace(table: Table, body: Body) -> AveragedWorkspace:
    """Allocate working arrays for parts of one kind."""
    return AveragedWorkspace(
        cut=new_cut(len(body.outline), cells_across(table, body, finest_split(table, body))),
        phasors=new_phasors(1, cells_across(table, body, 1), body.coupling),
        moments=np.zeros((6, 3)),
        before=np.zeros((6, 3)),
        shift=np.zeros(6),
        scratch=new_scratch(),
    )


@jit
def cut_at(table, body, x, y, heading, spin, work):
    """Cut the outline at a pose into contact points; return their number, 0 without support."""
    split = spin_split(table, body, table.speed, spin)
    if place_part(table, body, split, x, y, heading, work.cut) != PLACED:
        return 0
    return cut_into_points(table, body, split, x, y, work.cut)


@jit
def sample_contact(table, body, drive, world, x, y, heading, spin, work):
    """Cut the outline at a pose, read phasors and compute their moments; return the number of points, 0 without support."""
    n = cut_at(table, body, x, y, heading, spin, work)
    if n > 0:
        read_points(table, body, drive, world, n, work.cut, work.phasors, 0)
        gather_moments(work.cut.points, work.cut.phasor_c, work.cut.phasor_s, n, work.moments)
    return n


@jit
def mean_acceleration(table, body, scheme, n, vx, vy, spin, work):
    """Return the mean acceleration (m/s^2, m/s^2, rad/s^2) by friction at a mean velocity, for the last cut."""
    mu = body.friction
    cut = work.cut
    ax, ay, aw = first_order(
        scheme.tables, cut.points, cut.phasor_c, cut.phasor_s, n, table.gravity, table.speed, body.radius, vx, vy, spin,
        work.scratch,
    )  # fmt: skip
    if scheme.order == 2:
        small = mu * table.period / (2.0 * math.pi)
        bx, by, bw = second_order(
            scheme.tables, work.moments, table.gravity, table.speed, body.gyration, vx, vy, work.scratch
        )
        ax, ay, aw = ax + small * bx, ay + small * by, aw + small * bw
    return mu * ax, mu * ay, mu / body.gyration * aw


@jit
def mean_velocity_of(table, body, scheme, vx, vy, work):
    """Return the mean velocity of an instantaneous one, by Broyden's method; write its wobble to ``work.shift``."""
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
    # The result differs from the instantaneous velocity by exactly a wobble.
    wobble(tables, moments, table.gravity, table.speed, body.gyration, ux, uy, result, scratch)
    return vx - size * result[0], vy - size * result[1]


class AveragedScene(NamedTuple):
    """Part, drive and scheme of the averaged model; kernels pass it by reference."""

    table: Table
    body: Body
    scheme: AveragedScheme
    drive: Drive
    state: State
    work: AveragedWorkspace


@jit
def in_world(scene, world):
    """Return the scene with the part's conditions in a world."""
    body = under_conditions(scene.body, scene.state, world, 0)
    return AveragedScene(scene.table, body, scene.scheme, scene.drive, scene.state, scene.work)


@jit
def exponential(z):
    """Return the functions phi_1, phi_2, phi_3 of exponential integrators at -z: 1, 1/2 and 1/6 at z = 0."""
    if z < 0.5:
        third = 1.0
        for k in range(15, 3, -1):
            third = 1.0 - z * third * (1.0 / k)
        third *= 1.0 / 6.0
        second = 0.5 - z * third
        return 1.0 - z * second, second, third
    first = (1.0 - math.exp(-z)) / z
    second = (1.0 - first) / z
    return first, second, (0.5 - second) / z


class Span(NamedTuple):
    """A span of one or several periods in equal steps."""

    h: float  # s, of a step
    rate: float  # 1/s, of the linear part of friction
    phi1: float  # see exponential
    phi2: float
    phi3: float
    last: int  # step in which the last period of a call starts, -1: none
    part: float  # fraction of that step


@jit
def span_of(scene, length, is_last, vx, vy):
    """Return the span of the next ``length`` periods."""
    table, steps = scene.table, scene.scheme.steps
    h = length * table.period / steps
    # For a part faster than the table, friction depends less on its speed.
    damping = friction_rate(scene.body.friction, table.gravity, table.speed)
    rate = damping * min(1.0, table.speed * table.speed / max(vx * vx + vy * vy, 1e-300))
    phi1, phi2, phi3 = exponential(rate * h)
    last, part = -1, 0.0
    if is_last:
        last = (length - 1) * steps // length
        part = ((length - 1) * steps - last * length) / length
    return Span(h, rate, phi1, phi2, phi3, last, part)


@jit
def sample_at(scene, world, motion):
    """Sample the contact at a part's pose, see :func:`sample_contact`."""
    return sample_contact(
        scene.table, scene.body, scene.drive, world, motion.x, motion.y, motion.heading, motion.spin, scene.work
    )


@jit
def acceleration_of(scene, n, motion):
    """Return the mean acceleration for the last cut, by friction and incline; the incline causes no wobble."""
    body = scene.body
    ax, ay, aw = mean_acceleration(scene.table, body, scene.scheme, n, motion.vx, motion.vy, motion.spin, scene.work)
    return ax + body.incline_x, ay + body.incline_y, aw


@jit
def margin_of(scene, motion):
    """Return :func:`vibgym.physics.averaged.averages.slip_margin` at a motion."""
    table, frequency = scene.table, 2.0 * math.pi / scene.table.period
    return slip_margin(
        scene.work.moments, table.gravity, table.speed, scene.body.friction, frequency, motion.vx, motion.vy
    )


@jit
def wobble_sizes(scene):
    """Return the factors of the wobble of velocity (s) and position (s^2)."""
    size = scene.body.friction * scene.table.period / (2.0 * math.pi)
    return size, size * scene.table.period / (2.0 * math.pi)


@jit
def find_wobble(scene, moments, vx, vy):
    """Write the wobble at a mean velocity to ``work.shift``."""
    table, work = scene.table, scene.work
    wobble(
        scene.scheme.tables, moments, table.gravity, table.speed, scene.body.gyration, vx, vy, work.shift, work.scratch
    )


@jit
def mean_motion(scene, motion):
    """Convert instantaneous to slow variables."""
    shift = scene.work.shift
    size, reach = wobble_sizes(scene)
    vx, vy = mean_velocity_of(scene.table, scene.body, scene.scheme, motion.vx, motion.vy, scene.work)
    return Motion(
        motion.x - reach * shift[3], motion.y - reach * shift[4], motion.heading - reach * shift[5],
        vx, vy, motion.spin - size * shift[2],
    )  # fmt: skip


@jit
def instantaneous_motion(scene, motion):
    """Convert slow to instantaneous variables."""
    shift = scene.work.shift
    size, reach = wobble_sizes(scene)
    find_wobble(scene, scene.work.moments, motion.vx, motion.vy)
    return Motion(
        motion.x + reach * shift[3], motion.y + reach * shift[4], motion.heading + reach * shift[5],
        motion.vx + size * shift[0], motion.vy + size * shift[1], motion.spin + size * shift[2],
    )  # fmt: skip


@jit
def predict(span, motion, ax, ay, aw):
    """Return the motion after a step in which only the linear part of friction changes."""
    h, phi1, phi2 = span.h, span.phi1, span.phi2
    return Motion(
        motion.x + h * (motion.vx + h * phi2 * ax),
        motion.y + h * (motion.vy + h * phi2 * ay),
        motion.heading + h * (motion.spin + h * phi2 * aw),
        motion.vx + h * phi1 * ax,
        motion.vy + h * phi1 * ay,
        motion.spin + h * phi1 * aw,
    )


@jit
def pose_within(scene, span, motion, ax, ay, aw, bx, by, bw):
    """Return the instantaneous pose at ``span.part`` of a step; moments of its ends: ``work.before``, ``work.moments``."""
    before, moments, shift, part = scene.work.before, scene.work.moments, scene.work.shift, span.part
    t = part * span.h
    psi1, psi2, psi3 = exponential(span.rate * t)
    for i in range(6):
        for j in range(3):
            before[i, j] += part * (moments[i, j] - before[i, j])
    vx, vy = motion.vx, motion.vy
    find_wobble(scene, before, vx + t * (psi1 * ax + part * psi2 * bx), vy + t * (psi1 * ay + part * psi2 * by))
    _, reach = wobble_sizes(scene)
    return (
        motion.x + t * (vx + t * (psi2 * ax + part * psi3 * bx)) + reach * shift[3],
        motion.y + t * (vy + t * (psi2 * ay + part * psi3 * by)) + reach * shift[4],
        motion.heading + t * (motion.spin + t * (psi2 * aw + part * psi3 * bw)) + reach * shift[5],
    )


@jit
def advance_world(scene, world, motion, periods):
    """Advance one world by whole periods.

    Returns:
        Motion at the end, pose one period before, smallest margin of slip, number of points (0: the part falls), and whether
        all values are finite.
    """
    scheme, work = scene.scheme, scene.work
    pose = motion.x, motion.y, motion.heading
    margin, n, sound = math.inf, 0, is_finite(motion)
    ax, ay, aw = 0.0, 0.0, 0.0
    if sound:
        clear_phasors(work.phasors, 0)
        n = sample_at(scene, world, motion)
    if n > 0:
        motion = mean_motion(scene, motion)
        margin = margin_of(scene, motion)
        ax, ay, aw = acceleration_of(scene, n, motion)
    spans = (periods + scheme.stride - 1) // scheme.stride
    for k in range(spans):
        if n == 0 or not sound:
            break
        length = min(scheme.stride, periods - k * scheme.stride)
        span = span_of(scene, length, k == spans - 1 and periods > 1, motion.vx, motion.vy)
        for step in range(scheme.steps):
            ahead = predict(span, motion, ax, ay, aw)
            sound = is_finite(ahead)
            if not sound:
                break
            for i in range(6):
                for j in range(3):
                    work.before[i, j] = work.moments[i, j]
            n = sample_at(scene, world, ahead)
            if n == 0:
                break
            cx, cy, cw = acceleration_of(scene, n, ahead)
            # change of the acceleration without the linear part of friction
            bx = cx - ax + span.rate * (ahead.vx - motion.vx)
            by = cy - ay + span.rate * (ahead.vy - motion.vy)
            bw = cw - aw + span.rate * (ahead.spin - motion.spin)
            if step == span.last:
                pose = pose_within(scene, span, motion, ax, ay, aw, bx, by, bw)
            third, second = span.h * span.h * span.phi3, span.h * span.phi2
            motion = Motion(
                ahead.x + third * bx, ahead.y + third * by, ahead.heading + third * bw,
                ahead.vx + second * bx, ahead.vy + second * by, ahead.spin + second * bw,
            )  # fmt: skip
            # Acceleration at the corrected velocity, for the next step; its linear part suffices for second order.
            damped = span.rate * second
            ax, ay, aw = cx - damped * bx, cy - damped * by, cw - damped * bw
            margin = min(margin, margin_of(scene, motion))
    if sound and n > 0:
        motion = instantaneous_motion(scene, motion)
        sound = is_finite(motion)
    return motion, pose, margin, n, sound


@jit
def advance_worlds(start, stop, scene, periods):
    """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing the state in place."""
    scene = reference(scene)
    state, period = scene.state, scene.table.period
    for world in range(start, stop):
        for k in range(3):
            state.mean_velocity[world, 0, k] = 0.0
        if state.fallen[world, 0] or state.diverged[world]:
            continue
        motion = Motion(
            state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2],
            state.velocity[world, 0, 0], state.velocity[world, 0, 1], state.velocity[world, 0, 2],
        )  # fmt: skip
        motion, pose, margin, n, sound = advance_world(in_world(scene, world), world, motion, periods)
        if margin < 0.0:
            state.doubtful[world, 0] = True
        if not sound:  # keep the last finite state and discard the diverged one
            state.diverged[world] = True
            continue
        state.pose[world, 0, 0], state.pose[world, 0, 1], state.pose[world, 0, 2] = motion.x, motion.y, motion.heading
        if n == 0:
            state.fallen[world, 0] = True
            for k in range(3):
                state.velocity[world, 0, k] = 0.0
            continue
        state.velocity[world, 0, 0], state.velocity[world, 0, 1] = motion.vx, motion.vy
        state.velocity[world, 0, 2] = motion.spin
        for k in range(3):
            state.mean_velocity[world, 0, k] = (state.pose[world, 0, k] - pose[k]) / period
