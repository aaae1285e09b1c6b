"""The law of local fields: a set velocity from which the part can still stop, and the acceleration that follows it.

Near rest a push of strength 1 accelerates a part by about ``mu a_v w^2 / 2`` and friction brakes it at the rate
``mu g / (2 a_h w)`` (first-order average, thesis eqs. 5.60 and 5.61). The law asks for the velocity from which the part can
still stop at its target, ``sqrt(2 a d)`` far away and proportional to the distance near it. Headings are controlled in the same
way. On elements with a hard dead zone, :mod:`vibgym.policies.classical.settling` takes over near the target.

The numbers are tuned for one period a step. A longer step holds its push for longer, so the velocity follows its set value no
faster than in one step, in ``(1 - exp(-drag T)) / drag``; and the law approaches more slowly by the added time, so that
parts do not overshoot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.settling import LEAST_DRAG, Settling, bands, keep_on
from vibgym.policies.task_info import TaskInfo

APPROACH, CROWD_APPROACH = 9.0, 7.0
"""1/s, near goal poses, and near places among others, passed at a distance for longer by parts that slow down early."""


SLOWER = 2.5
"""Times the time that longer steps add, by which the approach takes longer; tuned with four periods a step."""


class LocalLaw(Law):
    """Velocities along square roots of the distance; see the module.

    Args:
        info: task, scene and step time.
        response: s, time in which the velocity follows its set value; longer where steps are.
        braking: share of the available acceleration that the stopping law counts on.
        approach: 1/s, rate at which the remaining error shrinks near the target; less where steps are long. None: what suits
            the task.

    Raises:
        ValueError: a bad argument.
    """

    def __init__(
        self, info: TaskInfo, *, response: float = 0.04, braking: float = 0.5, approach: float | None = None
    ) -> None:
        self.plant = plant = info.plant
        self.braking = checks.number("braking", braking, above=0.0, most=1.0)
        ahead = 0.5 * (info.step_time - info.surface.period)
        usual = APPROACH if info.has_goal else CROWD_APPROACH
        self.approach = checks.number("approach", usual if approach is None else approach, above=0.0)
        self.approach /= 1.0 + SLOWER * self.approach * ahead
        self.lead = 1.0 / self.approach
        held = -np.expm1(-plant.drag * info.step_time) / np.maximum(plant.drag, LEAST_DRAG)  # s, see above
        self.response = np.maximum(checks.number("response", response, above=0.0), held)
        self.settle = keep_on
        if info.hard_dead_zone:
            self.settle = Settling(info, plant.drag, *bands(info))
            self.slack = self.settle.slack

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        distance = np.sqrt((way**2).sum(axis=-1))
        speed = np.minimum(self.stopping_rate(distance, self.plant.push), self.plant.top_speed)
        velocity = (speed / np.maximum(distance, 1e-12))[..., None] * way
        rate = np.sign(turn) * self.stopping_rate(np.abs(turn), self.plant.turn_push)
        change = np.concatenate([velocity - measured.velocity, (rate - measured.spin)[..., None]], axis=-1)
        return self.settle(measured, way, turn, change / self.response[:, None]), memory

    def stopping_rate(self, distance: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Set speed (..., parts) at a distance, from which a part that can be slowed down by ``push`` still stops."""
        return np.minimum(np.sqrt(2.0 * self.braking * push * distance), self.approach * distance)
