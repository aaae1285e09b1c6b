"""How fast a part may be so that it still stops in time: braking curves by the averaged friction, for ways and for turns.

Friction helps to brake, the more the faster a part is, and elements brake harder at speed: at 0.3 m/s a part on the prototype
can be slowed down by 4.4 m/s^2, near rest by 2.9. A law that counts on the latter all the way loses a twentieth of a second.

What turns a part depends on how it lies on the elements: less of their push goes into turning than of a push that moves it, and
by how much less changes with heading and place, for a block of 50 by 35 mm by 4 %. The mean over both is what can be counted on
over the tens of degrees in which a part stops.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.kernels.jit import borrowing
from vibgym.policies.task_info import TaskInfo

NODES = 512
"""Of a curve."""

PLACES, HEADINGS = 4, 24
"""Of a part on the elements, along each side of one and in a full turn, over which turning is averaged."""

FASTEST = 1e4
"""rad/s, more than any spin at which friction still lets a part gain speed."""

ROUNDS = 4
"""In which the speed at the end of a step is found, which the way left by then depends on."""

INSIDE = 0.7
"""Share of what a part may pass its target by at which it is to arrive before it, and within which it is to stay beyond."""


class StoppingCurve:
    """Speeds from which parts stop within a way under a steady braking push.

    Args:
        process: friction and elements.
        push: (parts,) that brakes, over full amplitude.
        top: (parts,) speed at which the curve ends, m/s or rad/s.
        turning: a curve for turns, rad and rad/s.

    Attributes:
        speed: (NODES, parts) from 0 to the top, evenly.
        way: (NODES, parts) m or rad in which a part stops from there.
    """

    def __init__(self, process: FrictionalInverse, push: np.ndarray, top: np.ndarray, turning: bool) -> None:
        parts, axis = len(top), 2 if turning else 0
        speed = np.linspace(0.0, 1.0, NODES)[:, None] * top
        velocity, pushes = np.zeros((NODES, parts, 3)), np.zeros((NODES, parts, 3))
        velocity[..., axis], pushes[..., axis] = speed, -push
        braking = -process.acceleration(velocity, pushes)[0][..., axis]
        step = np.diff(speed, axis=0)
        ways = 0.5 * (speed[1:] + speed[:-1]) * step / (0.5 * (braking[1:] + braking[:-1]))
        self.speed, self.way = speed, np.concatenate([np.zeros((1, parts)), np.cumsum(ways, axis=0)])

    def at(self, way: np.ndarray) -> np.ndarray:
        """Speeds (batch, parts) from which parts stop within ``way`` (batch, parts) >= 0; the top speed beyond the curve."""
        return np.stack([np.interp(way[:, p], self.way[:, p], self.speed[:, p]) for p in range(way.shape[1])], axis=-1)


@borrowing
def speed_at(ways, speeds, p, approach, way):
    """Speed of part ``p`` on its curve, but no more than ``approach`` times the way (>= 0)."""
    low, high = 0, ways.shape[0] - 1
    if way >= ways[high, p]:
        return min(speeds[high, p], approach * way)
    while high - low > 1:
        middle = (low + high) // 2
        if ways[middle, p] <= way:
            low = middle
        else:
            high = middle
    share = (way - ways[low, p]) / (ways[high, p] - ways[low, p])
    return min(speeds[low, p] + share * (speeds[high, p] - speeds[low, p]), approach * way)


@borrowing
def speed_along(ways, speeds, p, approach, step, left, now):
    """Speed at the end of the step that lies on the curve then: ``v' = curve(left - T (v + v') / 2)``."""
    speed = speed_at(ways, speeds, p, approach, max(left - step * now, 0.0))
    for _ in range(ROUNDS):
        ahead = max(left - 0.5 * step * (now + speed), 0.0)
        speed = 0.5 * (speed + speed_at(ways, speeds, p, approach, ahead))
    return speed


@borrowing
def land(ways, speeds, approach, step, over, left, now, result):
    """Speeds (batch, parts) for the end of the step, overwritten; see :class:`Landing`."""
    for w in range(left.shape[0]):
        for p in range(left.shape[1]):
            way, rate = left[w, p], now[w, p]
            # Of a part that has gone so far in the step, at an even rate: what it has at the end.
            arriving = 2.0 * (way - INSIDE * over) / step - rate
            back = 2.0 * (way + INSIDE * over) / step - rate
            latest = speed_along(ways, speeds, p, approach, step, way + over, rate)
            speed = min(max(speed_along(ways, speeds, p, approach, step, way, rate), arriving), latest)
            result[w, p] = min(speed, max(back, -2.0 * over / step))


class Landing:
    """Speeds for the ends of steps, with which parts get to their targets soon and stop there.

    A target is as good as reached within a tolerance on either side, and only the ends of steps count. So a part may come into
    the tolerance so fast that it passes its target, as long as it stops before it is out again. Until it can be in by the end
    of the step it therefore follows the curve to the far edge. Then it is as slow as lets it arrive, and from there on it goes
    for the target itself; one that would be beyond the far edge at the end of the step is turned back.

    Args:
        curve: of the braking that can be counted on.
        approach: 1/s, most speed over way left. Near a target curves are steeper than steps of finite length can follow: at
            ``2 / step`` a part is at rest one step later, if it can brake so hard.
        step: s.
        over: m or rad, by how much a part may pass its target; 0: not at all.
    """

    def __init__(self, curve: StoppingCurve, approach: float, step: float, over: float = 0.0) -> None:
        self.curve, self.approach, self.step, self.over = curve, approach, step, over

    def speed(self, left: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Speeds towards the target at the end of the step (batch, parts), m/s or rad/s; negative ones turn a part back.

        Args:
            left: (batch, parts) m or rad >= 0 to the target.
            now: (batch, parts) speed towards it at the start of the step.
        """
        result = np.empty(left.shape)
        left, now = np.ascontiguousarray(left), np.ascontiguousarray(now)
        land(self.curve.way, self.curve.speed, self.approach, self.step, self.over, left, now, result)
        return result


def time_left(way: np.ndarray, now: np.ndarray, gain: np.ndarray, curve: StoppingCurve) -> np.ndarray:
    """About how long parts take to stop at a place ``way`` (batch, parts) ahead, s, as fast as they can.

    They gain speed at an even rate up to the top speed of the curve, at most, and lose it at its mean rate.

    Args:
        way: m.
        now: m/s towards it.
        gain: (parts,) m/s^2.
        curve: for ways.
    """
    top, full = curve.speed[-1], curve.way[-1]
    now = np.clip(now, 0.0, top)
    loss = top**2 / (2.0 * full)
    peak = np.minimum(np.sqrt((2.0 * way + now**2 / gain) / (1.0 / gain + 1.0 / loss)), top)
    cruise = way - (peak**2 - now**2) / (2.0 * gain) - peak**2 / (2.0 * loss)
    return np.maximum((peak - now) / gain, 0.0) + peak / loss + np.maximum(cruise, 0.0) / top


def turning_push(info: TaskInfo) -> np.ndarray:
    """Largest pushes that turn the parts (parts,) over full amplitude, in the mean over headings and places on an element."""
    surface, parts = info.surface, len(info.parts)
    side, heading = np.arange(PLACES) / PLACES, 2.0 * math.pi / HEADINGS * np.arange(HEADINGS)
    column, row, angle = (each.ravel() for each in np.meshgrid(side, side, heading))
    middle = surface.columns // 2, surface.rows // 2
    place = surface.element_size * np.column_stack([middle[0] + column, middle[1] + row])
    pose = np.repeat(np.column_stack([place, angle])[:, None], parts, axis=1)
    return Allocator(surface, info.parts, info.hardware).reach(pose).mean(axis=0)


def fastest_spin(process: FrictionalInverse, push: np.ndarray) -> np.ndarray:
    """Spins (parts,) rad/s at which friction takes all that pushes (parts,) give, by bisection."""
    pushes, velocity = np.zeros((1, len(push), 3)), np.zeros((1, len(push), 3))
    pushes[..., 2] = push
    slow, fast = np.zeros(len(push)), np.full(len(push), FASTEST)
    for _ in range(60):
        velocity[..., 2] = 0.5 * (slow + fast)
        gains = process.acceleration(velocity, pushes)[0][0, :, 2] > 0.0
        slow, fast = np.where(gains, velocity[0, :, 2], slow), np.where(gains, fast, velocity[0, :, 2])
    return slow
