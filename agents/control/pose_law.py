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
from agents.control.stopping import StoppingCurve, fastest_spin, turning_reach
from agents.task_info import TaskInfo
from vibgym.allocation.frictional import FrictionalInverse

BAND, TURN_BAND = 0.25e-3, math.radians(0.3)


class PoseLaw:
    def __init__(
        self,
        info: TaskInfo,
        *,
        braking: float = 0.9,
        turn_braking: float = 0.95,
        over: float = 0.5,
        inside: float = 0.7,
        approach: float = 28.0,
        turn_approach: float = 36.0,
        response: float = 1.0,
        band: float = BAND,
        turn_band: float = TURN_BAND,
        spread: float = 1.0,
        early: float = 0.06,
        soon: float = 0.15,
        gaining: float = 0.5,
    ) -> None:
        plant = plant_of(info)
        self.plant, self.step = plant, info.step_time
        process = FrictionalInverse(info.surface, info.parts, limit=info.hardware.limit)
        parts = len(info.parts)
        top = np.full(parts, 1.03 * plant.top_speed)
        self.curve = StoppingCurve(process, np.full(parts, braking), top, False)
        reach = turning_reach(info)
        turn_top = fastest_spin(process, reach)
        self.turn_curve = StoppingCurve(process, turn_braking * reach, turn_top, True)
        tol = info.heading_tolerance if info.has_goal and info.has_heading else 0.0
        self.over = over * tol if math.isfinite(tol) else 0.0
        self.inside, self.soon = inside, soon
        self.approach, self.turn_approach = approach, turn_approach
        self.lead = 1.0 / approach + info.step_time  # the speed asked for is that at the end of the step
        self.response = response * info.step_time
        self.spread, self.early, self.gain = spread, early, gaining * plant.push
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
        speed = self.along(self.curve, self.approach, distance, closing)
        velocity = speed[..., None] * toward
        left = np.abs(turn)
        rate = self.turning(left, measured.spin * np.sign(turn))
        # No faster than it has to: what turns a part does not move it.
        if self.spread:
            time = self.time_left(distance, closing) - self.early
            rate = np.where(time > self.soon, np.minimum(rate, self.spread * left / np.maximum(time, self.soon)), rate)
        change = np.concatenate(
            [velocity - measured.velocity, (np.sign(turn) * rate - measured.spin)[..., None]], axis=-1
        )
        return self.settle(measured, way, turn, change / self.response), memory

    def time_left(self, distance, closing):
        """s, about, until a part is there: speeding up at the mean rate to the top speed, at most, and braking."""
        gain, top = self.gain, self.curve.speed[-1]
        now = np.clip(closing, 0.0, top)
        brake = top**2 / (2.0 * self.curve.way[-1])
        peak = np.minimum(np.sqrt((2.0 * distance + now**2 / gain) / (1.0 / gain + 1.0 / brake)), top)
        cruise = distance - (peak**2 - now**2) / (2.0 * gain) - peak**2 / (2.0 * brake)
        return np.maximum((peak - now) / gain, 0.0) + peak / brake + np.maximum(cruise, 0.0) / top

    def turning(self, left, now):
        ordinary = self.along(self.turn_curve, self.turn_approach, left, now)
        latest = self.along(self.turn_curve, self.turn_approach, left + self.over, now)
        arriving = 2.0 * (left - self.inside * self.over) / self.step - now
        # Not beyond the far edge at the end of the step, if that takes turning back.
        last = 2.0 * (left + self.inside * self.over) / self.step - now if self.over else math.inf
        return np.minimum(np.minimum(latest, np.maximum(ordinary, arriving)), last)

    def along(self, curve, approach, left, now):
        """Speed at the end of the step that lies on the curve: ``v' = curve(left - T (v + v') / 2)``."""
        speed = np.minimum(curve.at(left), approach * left)
        for _ in range(4):
            ahead = np.maximum(left - 0.5 * self.step * (now + speed), 0.0)
            new = np.minimum(curve.at(ahead), approach * ahead)
            speed = 0.5 * (speed + new)
        return speed

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: Any) -> Any:
        return memory
