"""Planar contact, averaged over the period: one part per world in permanent sliding on the vibrating elements.

The state is that of the planar model, pose and velocity at one instant. Every call goes over to the slow variables, pose
and velocity without their wobble (:mod:`vibgym.physics.averaged.averages`), advances those, and goes back under the same
drive: the wobble depends on the drive, so that without this a drive that changes would cost an error of first order each
time. Both orders do so and differ in the mean acceleration alone: with a drive that changes every period it takes 2.6 times
the error off first order, too.

A step spans one or several periods or a part of one. Both its ends cut the outline; between them the acceleration less
``-mu g / (2 a_h w) v``, the linear part of friction, is taken as linear in time and the rest is solved exactly (exponential
Runge-Kutta, second order). So steps of several periods stay sound: what friction damps within them is no error.

Where slip may have passed through zero within a period the world is marked in ``state.doubtful``, and the result is not
certified from there on: the wobble may then carry the part to the speed of the table.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import reference
from vibgym.physics.averaged.averages import friction_rate, slip_margin, wobble
from vibgym.physics.averaged.contact import (
    AveragedScheme,
    AveragedWorkspace,
    look_under,
    mean_acceleration,
    steady_part,
)
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Body, Motion, State, Table, is_finite, under_conditions
from vibgym.physics.planar.phasors import forget_phasors


class AveragedScene(NamedTuple):
    """What the averaged model moves, and how; kernels hand it on by reference."""

    table: Table
    body: Body
    scheme: AveragedScheme
    drive: Drive
    state: State
    work: AveragedWorkspace


@borrowing
def in_world(scene, world):
    """The scene with the part as it is in a world."""
    body = under_conditions(scene.body, scene.state, world, 0)
    return AveragedScene(scene.table, body, scene.scheme, scene.drive, scene.state, scene.work)


@borrowing
def exponential(z):
    """(1 - exp(-z)) / z and the next two of its kind, each the integral of the one before: 1, 1/2 and 1/6 at z = 0."""
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
    """A span of one or several periods, in equal steps."""

    h: float  # s, of a step
    rate: float  # 1/s, of the linear part of friction
    phi1: float  # see exponential
    phi2: float
    phi3: float
    last: int  # the step in which the last period of a call begins, -1: in none
    part: float  # and at which part of it


@borrowing
def span_of(scene, length, is_last, vx, vy):
    """The span that covers the next ``length`` periods."""
    table, steps = scene.table, scene.scheme.steps
    h = length * table.period / steps
    # The faster a part is than the table, the less its friction depends on its speed.
    damping = friction_rate(scene.body.friction, table.gravity, table.speed)
    rate = damping * min(1.0, table.speed * table.speed / max(vx * vx + vy * vy, 1e-300))
    phi1, phi2, phi3 = exponential(rate * h)
    last, part = -1, 0.0
    if is_last:
        last = (length - 1) * steps // length
        part = ((length - 1) * steps - last * length) / length
    return Span(h, rate, phi1, phi2, phi3, last, part)


@borrowing
def look_ahead(scene, world, motion):
    """Cut the outline where the part is and look under it; returns the number of points."""
    return look_under(
        scene.table, scene.body, scene.drive, world, motion.x, motion.y, motion.heading, motion.spin, scene.work
    )


@borrowing
def acceleration_of(scene, n, motion):
    """Mean acceleration for the cut at hand, by friction and by the table's incline, a constant that does not wobble."""
    body = scene.body
    ax, ay, aw = mean_acceleration(scene.table, body, scene.scheme, n, motion.vx, motion.vy, motion.spin, scene.work)
    return ax + body.incline_x, ay + body.incline_y, aw


@borrowing
def margin_of(scene, motion):
    """How far slip stays from zero, see :func:`vibgym.physics.averaged.averages.slip_margin`."""
    table, frequency = scene.table, 2.0 * math.pi / scene.table.period
    return slip_margin(
        scene.work.moments, table.gravity, table.speed, scene.body.friction, frequency, motion.vx, motion.vy
    )


@borrowing
def wobble_sizes(scene):
    """Of velocity (s) and position (s^2), by which the wobble's numbers are multiplied."""
    size = scene.body.friction * scene.table.period / (2.0 * math.pi)
    return size, size * scene.table.period / (2.0 * math.pi)


@borrowing
def find_wobble(scene, moments, vx, vy):
    """Leave the wobble at a mean velocity in ``work.shift``."""
    table, work = scene.table, scene.work
    wobble(
        scene.scheme.tables, moments, table.gravity, table.speed, scene.body.gyration, vx, vy, work.shift, work.scratch
    )


@borrowing
def without_wobble(scene, motion):
    """Slow variables that belong to those of one instant."""
    shift = scene.work.shift
    size, reach = wobble_sizes(scene)
    vx, vy = steady_part(scene.table, scene.body, scene.scheme, motion.vx, motion.vy, scene.work)
    return Motion(
        motion.x - reach * shift[3], motion.y - reach * shift[4], motion.heading - reach * shift[5],
        vx, vy, motion.spin - size * shift[2],
    )  # fmt: skip


@borrowing
def with_wobble(scene, motion):
    """Variables of one instant that belong to the slow ones."""
    shift = scene.work.shift
    size, reach = wobble_sizes(scene)
    find_wobble(scene, scene.work.moments, motion.vx, motion.vy)
    return Motion(
        motion.x + reach * shift[3], motion.y + reach * shift[4], motion.heading + reach * shift[5],
        motion.vx + size * shift[0], motion.vy + size * shift[1], motion.spin + size * shift[2],
    )  # fmt: skip


@borrowing
def predict(span, motion, ax, ay, aw):
    """Motion after a step in which the acceleration changes by its linear part alone."""
    h, phi1, phi2 = span.h, span.phi1, span.phi2
    return Motion(
        motion.x + h * (motion.vx + h * phi2 * ax),
        motion.y + h * (motion.vy + h * phi2 * ay),
        motion.heading + h * (motion.spin + h * phi2 * aw),
        motion.vx + h * phi1 * ax,
        motion.vy + h * phi1 * ay,
        motion.spin + h * phi1 * aw,
    )


@borrowing
def pose_within(scene, span, motion, ax, ay, aw, bx, by, bw):
    """Pose at one instant, at ``span.part`` of a step whose ends' moments are in ``work.before`` and ``work.moments``."""
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


@borrowing
def advance_world(scene, world, motion, periods):
    """Advance one world by whole periods.

    Returns:
        Motion at the end, pose one period before it, smallest margin of slip, number of points (0: the part falls), and whether
        all numbers make sense.
    """
    scheme, work = scene.scheme, scene.work
    pose = motion.x, motion.y, motion.heading
    margin, n, sound = math.inf, 0, is_finite(motion)
    ax, ay, aw = 0.0, 0.0, 0.0
    if sound:
        forget_phasors(work.phasors, 0)
        n = look_ahead(scene, world, motion)
    if n > 0:
        motion = without_wobble(scene, motion)
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
            n = look_ahead(scene, world, ahead)
            if n == 0:
                break
            cx, cy, cw = acceleration_of(scene, n, ahead)
            # by how much the acceleration without the linear part of friction has changed
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
            # The next step's acceleration, at the corrected velocity: the linear part is enough for second order.
            damped = span.rate * second
            ax, ay, aw = cx - damped * bx, cy - damped * by, cw - damped * bw
            margin = min(margin, margin_of(scene, motion))
    if sound and n > 0:
        motion = with_wobble(scene, motion)
        sound = is_finite(motion)
    return motion, pose, margin, n, sound


@borrowing
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
