"""The last millimetres on elements that cannot do little: pulses towards the place where a part comes to rest, then nothing.

Friction brakes a part at the rate c = mu g / (2 a_h w) for any element motion, so one at p with velocity v comes to rest at
p + v / c, and an acceleration a held for the time T shifts that place by a T / c. The same holds for headings. Near its target
a part therefore gets the one pulse that shifts its place of rest there, and then its elements are off until the place of rest
is off by more than a band. Held on all the time, elements would have to work against each other to do little, and their spread
would keep the part in motion.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

NEAR, NEAR_TURN = 0.003, math.radians(5.0)
"""m and rad, of the place of rest from the target: below both a part gets pulses."""

REACH, REACH_TURN = 0.015, math.radians(10.0)
"""m and rad, of the part from its target, likewise: friction grows with speed, the place of rest is known well for slow parts,
and those that are still fast get there sooner if they are pushed and braked."""

BAND = 0.25
"""Share of the tolerances within which places of rest are left as they are."""

LOOSE_BAND, LOOSE_TURN = 0.001, math.radians(2.5)
"""m and rad, the same where a task asks for no pose, but for zones or distances."""

LEAST_DRAG = 1e-9
"""1/s, taken for the drag of parts without friction."""

DOUBT = 1.5
"""Standard deviations of the place of rest by which bands are wider."""


def bands(info: TaskInfo) -> tuple[float, float]:
    """Bands (m, rad) that do for a task."""
    if not info.has_goal:
        return LOOSE_BAND, LOOSE_TURN
    return BAND * info.position_tolerance, BAND * info.heading_tolerance


class Settling:
    """Replaces what the law wants of parts near their targets.

    Args:
        info: task and step time.
        drag: (parts,) 1/s, c above.
        band, turn_band: m and rad, within which places of rest are left as they are.

    Attributes:
        slack: m, by how much corners of parts at rest may be off.
    """

    def __init__(self, info: TaskInfo, drag: np.ndarray, band: float, turn_band: float) -> None:
        self.drag, self.step, self.period = drag, info.step_time, info.surface.period
        ahead = 0.5 * (info.step_time - info.surface.period)
        self.coast = 1.0 / np.maximum(drag, LEAST_DRAG) - ahead  # s
        self.band, self.turn_band = band, turn_band
        self.slack = self.band + self.turn_band * max(part.radius for part in info.parts)
        self.near, self.near_turn = max(NEAR, 2.0 * self.band), max(NEAR_TURN, 2.0 * self.turn_band)

    def __call__(self, measured: Measured, way: np.ndarray, turn: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Wanted accelerations (batch, parts, 3), see :meth:`vibgym.policies.classical.law.Law.wanted`.

        Args:
            way: (batch, parts, 2) m that are left.
            turn: (batch, parts) rad that are left.
            wanted: (batch, parts, 3) by the law for parts on their way.
        """
        velocity = measured.rate
        off = np.concatenate([way, turn[..., None]], axis=-1) - self.coast[:, None] * velocity
        distance, skew = np.sqrt((off[..., :2] ** 2).sum(axis=-1)), np.abs(off[..., 2])
        # A part whose goal moves has nowhere to come to rest.
        near = ~(measured.goal_velocity.any(axis=-1) | measured.goal_acceleration.any(axis=-1))
        near = near & ((way**2).sum(axis=-1) < REACH**2) & (np.abs(turn) < REACH_TURN)
        near &= (distance < self.near) & (skew < self.near_turn)
        # Of late pulses: who does not wait for what they have done fires at errors of the estimate.
        doubt = measured.doubt
        wider = DOUBT * np.sqrt((doubt[..., :2] ** 2).sum(axis=-1))
        rests = near & (distance < self.band + wider) & (skew < self.turn_band + DOUBT * doubt[..., 2])
        # The push drag * off / step, less what friction takes on average.
        pulse = self.drag[:, None] * (off / self.step - velocity) / (1.0 + 0.5 * self.drag[:, None] * self.period)
        return np.where(rests[..., None], np.nan, np.where(near[..., None], pulse, wanted))


def keep_on(measured: Measured, way: np.ndarray, turn: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the law's acceleration unchanged, for elements without a hard dead zone."""
    return wanted
