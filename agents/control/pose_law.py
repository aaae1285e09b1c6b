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
from agents.control.stopping import StoppingCurve
from agents.task_info import TaskInfo
from vibgym.allocation.frictional import FrictionalInverse

BAND, TURN_BAND = 0.25e-3, math.radians(0.3)


class PoseLaw:
    def __init__(
        self,
        info: TaskInfo,
        *,
        braking: float = 0.9,
        turn_braking: float = 0.7,
        approach: float = 28.0,
        turn_approach: float = 22.0,
        response: float = 1.0,
        band: float = BAND,
        turn_band: float = TURN_BAND,
        spread: float = 1.0,
    ) -> None:
        plant = plant_of(info)
        self.plant, self.step = plant, info.step_time
        process = FrictionalInverse(info.surface, info.parts, limit=info.hardware.limit)
        parts = len(info.parts)
        top = np.full(parts, 1.03 * plant.top_speed)
        self.curve = StoppingCurve(process, np.full(parts, braking), top, False)
        turn_top = np.full(parts, 12.0)
        self.turn_curve = StoppingCurve(process, np.full(parts, turn_braking), turn_top, True)
        self.approach, self.turn_approach = approach, turn_approach
        self.lead = 1.0 / approach + info.step_time  # the speed asked for is that at the end of the step
        self.response = response * info.step_time
        self.spread = spread
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
        rate = self.along(self.turn_curve, self.turn_approach, left, measured.spin * np.sign(turn))
        # No faster than it has to: what turns a part does not move it.
        if self.spread:
            time = self.curve.time_for(distance) - 0.1
            rate = np.where(time > 0.15, np.minimum(rate, self.spread * left / np.maximum(time, 0.15)), rate)
        change = np.concatenate(
            [velocity - measured.velocity, (np.sign(turn) * rate - measured.spin)[..., None]], axis=-1
        )
        return self.settle(measured, way, turn, change / self.response), memory

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
