"""The pose law: motion along the curve from which a part can just stop, to 0.1 mm from its target.

Far from its target a part follows its stopping curve (:class:`StoppingCurve`): the wanted acceleration is the one that puts it
on the curve at the end of the step. It turns on the way, no faster than necessary. Near its target, on elements with a hard
dead zone, it gets single pulses (:class:`.law.Settling`).

Friction helps to brake, the more the faster a part is, and elements brake harder at speed: at 0.3 m/s a part on the prototype
can be slowed down by 4.4 m/s^2, near rest by 2.9. A law that assumes the latter all the way loses a twentieth of a second.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.kernels.jit import jit
from vibgym.policies.classical.law import Law, Settling
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import Angle, Length

GAIN = 0.5  # mean acceleration up to the top speed over that near rest; friction takes a growing share of it
SOON = 0.1  # s before its arrival, about, from which on a part turns as fast as it can
BEYOND = 1.03  # set speed over the top speed, so that parts reach the top speed

# 1/s, maximum speed over the distance: for ideal elements, for elements that differ, and among other parts, where slowing down
# early keeps parts at a distance for longer. With 28 on the prototype one part in twenty overshoots by 1.1 to 1.6 % of its
# displacement, with 21 by about 0.5 %, and takes 0.02 s longer.
APPROACH, SPREAD_APPROACH, CROWD_APPROACH = 28.0, 21.0, 12.0
TURN_APPROACH = 36.0
# The same, of positions and headings, for one part that tilts: strong pushes make rigid parts rock, which takes further pushes.
TILT_APPROACH = 12.0


class PoseLaw(Law):
    """Positions and headings along stopping curves; see the module."""

    class Settings(Law.Settings):
        """Settings of the pose law."""

        braking: float = Field(default=0.9, gt=0.0, le=1.0)
        """Share of the largest push used for braking."""

        turn_braking: float = Field(default=0.95, gt=0.0, le=1.0)
        """The same when a part turns."""

        approach: float | None = Field(default=None, gt=0.0)
        """Maximum speed over the error, 1/s. None: 28; 21 with a dead zone or latency; 12 without goals, or for one part that
        tilts."""

        turn_approach: float | None = Field(default=None, gt=0.0)
        """Maximum spin over the heading error, 1/s. None: 36; 12 for one part that tilts."""

        band: Length = Field(default=0.25e-3, gt=0.0)
        """Error at rest that is not corrected, in tasks with goals on elements with a hard dead zone."""

        turn_band: Angle = Field(default=math.radians(0.3), gt=0.0)
        """The same of the heading."""

        over: float = Field(default=0.5, ge=0.0, le=1.0)
        """Share of the heading tolerance by which a part may overshoot when it arrives; saves a step in Rotate and Align."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        plant, step, sheet, own = info.plant, info.step_time, info.hardware, self.settings
        parts = len(info.parts)
        usual = APPROACH if sheet.dead_zone == 0.0 and sheet.latency == 0 else SPREAD_APPROACH
        usual = usual if info.has_goal else CROWD_APPROACH
        usual, usual_turn = (usual, TURN_APPROACH) if info.flat or parts > 1 else (TILT_APPROACH, TILT_APPROACH)
        process = FrictionalInverse(info.surface, info.parts, limit=sheet.limit)
        turning = turning_push(info)
        top = np.full(parts, BEYOND * plant.top_speed)
        self.curve = StoppingCurve(process, np.full(parts, own.braking * plant.strength), top, False)
        self.turn_curve = StoppingCurve(process, own.turn_braking * turning, fastest_spin(process, turning), True)
        self.approach = usual if own.approach is None else own.approach
        self.turn_approach = usual_turn if own.turn_approach is None else own.turn_approach
        self.over = own.over * allowed_turn(info)
        self.gain, self.step = GAIN * plant.push, step
        self.lead = 1.0 / self.approach + step  # the set speed is that at the end of the step
        self.settling = None
        if info.hard_dead_zone:
            self.settling = Settling(info, own.band, own.turn_band)
            self.slack = self.settling.slack

    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, Any]:
        """See :meth:`.law.Law.wanted`."""
        distance = np.sqrt((displacement**2).sum(axis=-1))
        toward = displacement / np.maximum(distance, 1e-12)[..., None]
        closing = (measured.velocity * toward).sum(axis=-1)
        velocity = landing_speed(self.curve, self.approach, self.step, 0.0, distance, closing)[..., None] * toward
        left, spin = np.abs(heading_error), measured.spin * np.sign(heading_error)
        rate = landing_speed(self.turn_curve, self.turn_approach, self.step, self.over, left, spin)
        # No faster than necessary: pushes that turn a part do not move it.
        time = time_left(distance, closing, self.gain, self.curve)
        rate = np.where(time > SOON, np.minimum(rate, left / np.maximum(time, SOON)), rate)
        rates = np.concatenate([velocity, (np.sign(heading_error) * rate)[..., None]], axis=-1)
        wanted = (rates - measured.rate) / self.step
        return wanted if self.settling is None else self.settling(measured, displacement, heading_error, wanted), memory


def allowed_turn(info: TaskInfo) -> float:
    """Return the heading tolerance (rad); 0 where headings do not count, and where goals move."""
    counts = info.has_goal and info.has_heading and "way_ahead" not in info.layout
    return info.heading_tolerance if counts and math.isfinite(info.heading_tolerance) else 0.0


NODES = 512  # of a stopping curve


class StoppingCurve:
    """Speeds from which parts stop within a distance under a constant braking push and friction.

    Args:
        process: friction and elements.
        push: (parts,) braking push over full amplitude.
        top: (parts,) speed at which the curve ends, m/s or rad/s.
        turning: whether the curve is for headings, in rad and rad/s.

    Attributes:
        speed: (NODES, parts) from 0 to the top, evenly spaced.
        displacement: (NODES, parts) m or rad, stopping distance from that speed.
    """

    def __init__(self, process: FrictionalInverse, push: np.ndarray, top: np.ndarray, turning: bool) -> None:
        parts, axis = len(top), 2 if turning else 0
        speed = np.linspace(0.0, 1.0, NODES)[:, None] * top
        velocity, pushes = np.zeros((NODES, parts, 3)), np.zeros((NODES, parts, 3))
        velocity[..., axis], pushes[..., axis] = speed, -push
        braking = -process.acceleration(velocity, pushes)[0][..., axis]
        step = np.diff(speed, axis=0)
        displacements = 0.5 * (speed[1:] + speed[:-1]) * step / (0.5 * (braking[1:] + braking[:-1]))
        self.speed, self.displacement = speed, np.concatenate([np.zeros((1, parts)), np.cumsum(displacements, axis=0)])


ROUNDS = 4  # iterations for the speed at the end of the step, on which the distance left by then depends
INSIDE = 0.7  # share of the allowed overshoot within which a part has to arrive, and to stay afterwards


@jit
def speed_at(displacements, speeds, p, approach, displacement):
    """Return the speed of part ``p`` on its curve at a distance of its goal, at most ``approach`` times that."""
    low, high = 0, displacements.shape[0] - 1
    if displacement >= displacements[high, p]:
        return min(speeds[high, p], approach * displacement)
    while high - low > 1:
        middle = (low + high) // 2
        if displacements[middle, p] <= displacement:
            low = middle
        else:
            high = middle
    share = (displacement - displacements[low, p]) / (displacements[high, p] - displacements[low, p])
    return min(speeds[low, p] + share * (speeds[high, p] - speeds[low, p]), approach * displacement)


@jit
def speed_along(displacements, speeds, p, approach, step, left, now):
    """Return the speed at the end of the step that is on the curve then: ``v' = curve(left - T (v + v') / 2)``."""
    speed = speed_at(displacements, speeds, p, approach, max(left - step * now, 0.0))
    for _ in range(ROUNDS):
        ahead = max(left - 0.5 * step * (now + speed), 0.0)
        speed = 0.5 * (speed + speed_at(displacements, speeds, p, approach, ahead))
    return speed


@jit
def land(displacements, speeds, approach, step, over, left, now, result):
    """Compute speeds (batch, parts) for the end of the step into ``result``; see :func:`landing_speed`."""
    for w in range(left.shape[0]):
        for p in range(left.shape[1]):
            displacement, rate = left[w, p], now[w, p]
            # Speeds at the end of the step of parts that cover these distances in it with constant acceleration.
            arriving = 2.0 * (displacement - INSIDE * over) / step - rate
            back = 2.0 * (displacement + INSIDE * over) / step - rate
            latest = speed_along(displacements, speeds, p, approach, step, displacement + over, rate)
            speed = min(
                max(speed_along(displacements, speeds, p, approach, step, displacement, rate), arriving), latest
            )
            result[w, p] = min(speed, max(back, -2.0 * over / step))


def landing_speed(
    curve: StoppingCurve, approach: float, step: float, over: float, left: np.ndarray, now: np.ndarray
) -> np.ndarray:
    """Compute set speeds for the end of a step, with which parts reach their targets soon and stop there.

    A target counts as reached within a tolerance on either side, and only the ends of steps count. So a part may arrive so fast
    that it overshoots, if it stops before it leaves the tolerance. Until it can arrive by the end of the step it follows the
    curve to the far edge of the tolerance. Then it is slow enough to arrive, and from there on it goes to the target itself;
    one that would be beyond the far edge at the end of the step turns back.

    Args:
        curve: stopping curve.
        approach: 1/s, maximum speed over distance. Near a target curves are steeper than steps of finite length can follow:
            at ``2 / step`` a part is at rest one step later, if it can brake so hard.
        step: s.
        over: m or rad, allowed overshoot.
        left: (batch, parts) m or rad >= 0, distance to the target.
        now: (batch, parts) speed towards it at the start of the step.

    Returns:
        (batch, parts) speeds towards the target, m/s or rad/s; negative: away from it.
    """
    result = np.empty(left.shape)
    land(
        curve.displacement,
        curve.speed,
        approach,
        step,
        over,
        np.ascontiguousarray(left),
        np.ascontiguousarray(now),
        result,
    )
    return result


def time_left(displacement: np.ndarray, now: np.ndarray, gain: np.ndarray, curve: StoppingCurve) -> np.ndarray:
    """Estimate the time (batch, parts), s, in which parts can stop at a place ``displacement`` ahead.

    They accelerate constantly, at most to the top speed of the curve, and brake at its mean rate.

    Args:
        displacement: (batch, parts) m.
        now: (batch, parts) m/s towards the place.
        gain: (parts,) m/s^2.
        curve: for positions.
    """
    top, full = curve.speed[-1], curve.displacement[-1]
    now = np.clip(now, 0.0, top)
    loss = top**2 / (2.0 * full)
    peak = np.minimum(np.sqrt((2.0 * displacement + now**2 / gain) / (1.0 / gain + 1.0 / loss)), top)
    cruise = displacement - (peak**2 - now**2) / (2.0 * gain) - peak**2 / (2.0 * loss)
    return np.maximum((peak - now) / gain, 0.0) + peak / loss + np.maximum(cruise, 0.0) / top


PLACES, HEADINGS = 4, 24  # poses over which the turning push is averaged: along each side of an element, in a full turn
FASTEST = 1e4  # rad/s, above any spin at which a part can still be accelerated against friction


def turning_push(info: TaskInfo) -> np.ndarray:
    """Return the largest pushes (parts,) that turn the parts, over full amplitude: means over headings and places.

    They depend on how a part lies on the elements, by 4 % for a block of 50 by 35 mm, and a part stops within tens of degrees.
    """
    surface, parts = info.surface, len(info.parts)
    side, heading = np.arange(PLACES) / PLACES, 2.0 * math.pi / HEADINGS * np.arange(HEADINGS)
    column, row, angle = (grid.ravel() for grid in np.meshgrid(side, side, heading))
    middle = surface.columns // 2, surface.rows // 2
    place = surface.element_size * np.column_stack([middle[0] + column, middle[1] + row])
    pose = np.repeat(np.column_stack([place, angle])[:, None], parts, axis=1)
    return Allocator(surface, info.parts, info.hardware).reach(pose).mean(axis=0)


def fastest_spin(process: FrictionalInverse, push: np.ndarray) -> np.ndarray:
    """Return the spins (parts,), rad/s, at which friction balances turning pushes (parts,), by bisection."""
    pushes, velocity = np.zeros((1, len(push), 3)), np.zeros((1, len(push), 3))
    pushes[..., 2] = push
    slow, fast = np.zeros(len(push)), np.full(len(push), FASTEST)
    for _ in range(60):
        velocity[..., 2] = 0.5 * (slow + fast)
        gains = process.acceleration(velocity, pushes)[0][0, :, 2] > 0.0
        slow, fast = np.where(gains, velocity[0, :, 2], slow), np.where(gains, fast, velocity[0, :, 2])
    return slow
