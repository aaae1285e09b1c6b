"""The pose law: as fast as the elements let a part go, and to rest within a tenth of a millimetre.

Far from its target a part follows the curve from which it can just stop (:mod:`.stopping`): the acceleration
asked for is the one that puts it on the curve at the end of the step. It turns on the way, no faster than it has to. Near its
target, on elements with a hard dead zone, :mod:`vibgym.policies.classical.settling` fires single pulses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.settling import LOOSE_BAND, LOOSE_TURN, Settling, keep_on
from vibgym.policies.classical.stopping import Landing, StoppingCurve, fastest_spin, time_left, turning_push
from vibgym.policies.task_info import TaskInfo

OVER = 0.5
"""Share of the heading's tolerance by which a part may pass its goal when it arrives: in Rotate and Align that saves a step."""

GAIN = 0.5
"""Mean acceleration on the way to the top speed, over that near rest, which friction takes more and more of."""

SOON = 0.1
"""s before its arrival, about, from which on a part turns as fast as it can."""

BAND, TURN_BAND = 0.25e-3, math.radians(0.3)
"""m and rad, within which parts at rest are left as they are, where a task has goal poses."""

APPROACH, SPREAD_APPROACH, CROWD_APPROACH = 28.0, 21.0, 12.0
"""1/s, maximum speed over the remaining distance: for ideal elements, for elements that differ, and among other parts, where
slowing down early keeps parts at a distance for longer. With 28 on the prototype one part in twenty
overshoots by 1.1 to 1.6 % of its way, with 21 by about 0.5 %, and takes 0.02 s longer."""

BEYOND = 1.03
"""Speed that is asked for over the top speed, so that parts reach that."""


class PoseLaw(Law):
    """Ways and turns along the curves from which parts can just stop; see the module.

    Args:
        info: task, scene and step time.
        braking, turn_braking: share of the largest push that braking counts on.
        approach, turn_approach: 1/s, most speed over way and turn left; None: what suits task and hardware.
        band, turn_band: m and rad, within which parts at rest are left as they are, on elements with a hard dead zone.
        over: share of the heading's tolerance by which a part may pass its goal when it arrives.

    Raises:
        ValueError: a bad argument.
    """

    def __init__(
        self,
        info: TaskInfo,
        *,
        braking: float = 0.9,
        turn_braking: float = 0.95,
        approach: float | None = None,
        turn_approach: float = 36.0,
        band: float = BAND,
        turn_band: float = TURN_BAND,
        over: float = OVER,
    ) -> None:
        plant, step, sheet = info.plant, info.step_time, info.hardware
        braking = checks.number("braking", braking, above=0.0, most=1.0)
        turn_braking = checks.number("turn_braking", turn_braking, above=0.0, most=1.0)
        usual = APPROACH if sheet.dead_zone == 0.0 and sheet.latency == 0 else SPREAD_APPROACH
        usual = usual if info.has_goal else CROWD_APPROACH
        approach = checks.number("approach", usual if approach is None else approach, above=0.0)
        turn_approach = checks.number("turn_approach", turn_approach, above=0.0)
        over = checks.number("over", over, least=0.0, most=1.0)
        process = FrictionalInverse(info.surface, info.parts, limit=sheet.limit)
        parts = len(info.parts)
        top = np.full(parts, BEYOND * plant.top_speed)
        self.curve = StoppingCurve(process, np.full(parts, braking * plant.strength), top, False)
        self.landing = Landing(self.curve, approach, step)
        turning = turning_push(info)
        turn_curve = StoppingCurve(process, turn_braking * turning, fastest_spin(process, turning), True)
        self.turn_landing = Landing(turn_curve, turn_approach, step, over * allowed_turn(info))
        self.gain, self.step = GAIN * plant.push, step
        self.lead = 1.0 / approach + step  # the speed asked for is that at the end of the step
        self.settle = keep_on
        if info.hard_dead_zone:
            band = checks.number("band", band, above=0.0) if info.has_goal else LOOSE_BAND
            turn_band = checks.number("turn_band", turn_band, above=0.0) if info.has_goal else LOOSE_TURN
            self.settle = Settling(info, plant.drag, band, turn_band)
            self.slack = self.settle.slack

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        distance = np.sqrt((way**2).sum(axis=-1))
        toward = way / np.maximum(distance, 1e-12)[..., None]
        closing = (measured.velocity * toward).sum(axis=-1)
        velocity = self.landing.speed(distance, closing)[..., None] * toward
        left = np.abs(turn)
        rate = self.turn_landing.speed(left, measured.spin * np.sign(turn))
        # No faster than it has to: what turns a part does not move it.
        time = time_left(distance, closing, self.gain, self.curve)
        rate = np.where(time > SOON, np.minimum(rate, left / np.maximum(time, SOON)), rate)
        spin = (np.sign(turn) * rate)[..., None]
        change = np.concatenate([velocity, spin], axis=-1) - measured.rate
        return self.settle(measured, way, turn, change / self.step), memory


def allowed_turn(info: TaskInfo) -> float:
    """By how much (rad) headings may be off; 0 where nothing says it, and where goals move on."""
    counts = info.has_goal and info.has_heading and "way_ahead" not in info.layout
    return info.heading_tolerance if counts and math.isfinite(info.heading_tolerance) else 0.0
