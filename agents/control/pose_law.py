"""The pose law: as fast as the elements let a part go, and to rest within a tenth of a millimetre.

Far from its target a part follows the curve from which it can just stop (:mod:`agents.control.stopping`): the acceleration
asked for is the one that puts it on the curve at the end of the step. It turns on the way, no faster than it has to. Near its
target, on elements with a hard dead zone, :mod:`agents.control.settling` fires single pulses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agents.control.measured import Measured
from agents.control.plant import plant_of
from agents.control.settling import LOOSE_BAND, LOOSE_TURN, Settling, keep_on
from agents.control.stopping import Landing, StoppingCurve, fastest_spin, time_left, turning_push
from agents.task_info import TaskInfo
from vibgym.allocation.frictional import FrictionalInverse

OVER = 0.5
"""Share of the heading's tolerance by which a part may pass its goal when it arrives: in Rotate and Align that saves a step."""

GAIN = 0.5
"""Mean acceleration on the way to the top speed, over that near rest, which friction takes more and more of."""

SOON = 0.1
"""s before its arrival, about, from which on a part turns as fast as it can."""

BAND, TURN_BAND = 0.25e-3, math.radians(0.3)


class PoseLaw:
    def __init__(
        self,
        info: TaskInfo,
        *,
        braking: float = 0.9,
        turn_braking: float = 0.95,
        approach: float = 28.0,
        turn_approach: float = 36.0,
        response: float = 1.0,
        band: float = BAND,
        turn_band: float = TURN_BAND,
        over: float = OVER,
    ) -> None:
        plant = plant_of(info)
        self.plant, self.step = plant, info.step_time
        process = FrictionalInverse(info.surface, info.parts, limit=info.hardware.limit)
        parts = len(info.parts)
        top = np.full(parts, 1.03 * plant.top_speed)
        self.curve = StoppingCurve(process, np.full(parts, braking * plant.strength), top, False)
        self.landing = Landing(self.curve, approach, info.step_time)
        turning = turning_push(info)
        turn_curve = StoppingCurve(process, turn_braking * turning, fastest_spin(process, turning), True)
        self.turn_landing = Landing(turn_curve, turn_approach, info.step_time, over * allowed_turn(info))
        self.gain = GAIN * plant.push
        self.lead = 1.0 / approach + info.step_time  # the speed asked for is that at the end of the step
        self.response = response * info.step_time
        self.settle, self.slack = keep_on, 0.0
        if info.hardware.dead_zone > 0.0 and info.hardware.dead_zone_form == "hard":
            band, turn_band = (band, turn_band) if info.has_goal else (LOOSE_BAND, LOOSE_TURN)
            settling = Settling(info, plant.drag, band, turn_band)
            self.settle, self.slack = settling, settling.slack

    def initial(self, batch: int) -> tuple[()]:
        return ()

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        distance = np.sqrt((way**2).sum(axis=-1))
        toward = way / np.maximum(distance, 1e-12)[..., None]
        closing = (measured.velocity * toward).sum(axis=-1)
        velocity = self.landing.speed(distance, closing)[..., None] * toward
        left = np.abs(turn)
        rate = self.turn_landing.speed(left, measured.spin * np.sign(turn))
        # No faster than it has to: what turns a part does not move it.
        time = time_left(distance, closing, self.gain, self.curve)
        rate = np.where(time > SOON, np.minimum(rate, left / np.maximum(time, SOON)), rate)
        change = np.concatenate(
            [velocity - measured.velocity, (np.sign(turn) * rate - measured.spin)[..., None]], axis=-1
        )
        return self.settle(measured, way, turn, change / self.response), memory

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: Any) -> Any:
        return memory


def allowed_turn(info: TaskInfo) -> float:
    """By how much (rad) headings may be off; 0 where nothing says it, and where goals move on."""
    counts = info.has_goal and info.has_heading and "way_ahead" not in info.layout
    return info.heading_tolerance if counts and math.isfinite(info.heading_tolerance) else 0.0
