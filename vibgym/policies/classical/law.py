"""Control laws: from positions and targets of parts to wanted mean accelerations.

    observation -> measured -> targets -> law -> wanted accelerations -> inverse of the frictional process, within the limits
    of the elements -> pushes -> allocation -> phasors of the elements

A law controls parts as free bodies, the reduced plant of the thesis (figs. 5.14 to 5.18). :mod:`.steering` compensates friction
and allocates pushes to elements, in the same way for all laws. Where goals move, a law gets positions relative to the goals,
and the goals' acceleration is added to its output (:func:`.measured.from_goals`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import POLICIES, TaskInfo
from vibgym.registry import Registry
from vibgym.settings import BaseSettings

LONGEST_LEAD = 10.0  # s, upper limit of the search of :func:`lead_of`


class Law(ABC):
    """A control law, batched, for one part or several.

    A law without memory defines :meth:`wanted` only. Its settings are the fields of its nested ``Settings``.

    Args:
        info: task, scene and step time.
        settings: of the law; None: the defaults.

    Attributes:
        lead: s, a target ``lead * v`` ahead of a part makes it move at the velocity ``v``. Planners, which set velocities, use
            it. None: :func:`lead_of` computes it.
        slack: m, largest position error of corners of parts that have arrived.
    """

    class Settings(BaseSettings):
        """Settings of a law without any."""

    lead: float | None = None
    slack: float = 0.0
    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings

    def initial(self, batch: int) -> Any:
        """Return the memory at the start of an episode: a NamedTuple of arrays (batch, ...), or ``()``."""
        return ()

    @abstractmethod
    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, Any]:
        """Return wanted mean accelerations (batch, parts, 3), m/s^2 and rad/s^2, and the new memory.

        NaN rows: the elements under these parts rest.

        Args:
            measured: parts at the instant when this step's command begins to act.
            displacement: (batch, parts, 2) m, displacement to the target.
            heading_error: (batch, parts) rad, heading error.
            memory: of :meth:`initial`, or what the last call returned.
        """

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: Any) -> Any:
        """Return the memory, given the accelerations (batch, parts, 3) that the elements can give the parts.

        Like wanted accelerations they are relative to the goals' own where goals move.
        """
        return memory


def laws() -> Registry[type[Law]]:
    """Return the control laws among :data:`vibgym.policies.POLICIES`, by name."""
    return Registry(
        "law", {name: item for name, item in POLICIES.items() if isinstance(item, type) and issubclass(item, Law)}
    )


def lead_of(law: Law, info: TaskInfo, speed: float) -> float:
    """Return the ``lead`` of a law, s; if it is None, compute it by bisection of :meth:`Law.wanted` at ``speed`` (m/s).

    Raises:
        ValueError: ``lead`` is None, and at no distance the law neither drives nor brakes parts of this speed.
    """
    if law.lead is not None:
        return law.lead
    still, alone = np.zeros((1, len(info.parts), 2)), np.zeros((1, len(info.parts)))
    along = still + [1.0, 0.0]
    seen = Measured(
        present=alone == 0.0, centre=still, heading=alone, displacement=still, heading_error=alone,
        velocity=speed * along, spin=alone,
        gap=alone + np.inf, single=False,
    )  # fmt: skip

    def wanted(lead: float) -> np.ndarray:
        return law.wanted(seen, lead * speed * along, alone, law.initial(1))[0][..., 0]

    near, far = 0.0, LONGEST_LEAD
    if not ((wanted(near) < 0.0).all() and (wanted(far) > 0.0).all()):
        name = type(law).__name__
        allowed = f"s, a number: from {name}.wanted() of parts at {speed:.3g} m/s it cannot be determined"
        raise checks.refuse(f"{name}.lead", law.lead, allowed)
    for _ in range(40):
        middle = 0.5 * (near + far)
        near, far = (near, middle) if (wanted(middle) > 0.0).all() else (middle, far)
    return far


# m and rad, errors of the place of rest, and of the pose, below which a part gets single pulses. Friction grows with speed, so
# the place of rest is known for slow parts only, and fast parts arrive sooner if they are pushed and braked.
NEAR, NEAR_TURN = 0.003, math.radians(5.0)
REACH, REACH_TURN = 0.015, math.radians(10.0)

BAND = 0.25  # share of the tolerances within which places of rest are not corrected
LOOSE_BAND, LOOSE_TURN = 0.001, math.radians(2.5)  # m and rad, in tasks with zones or distances instead of goals
MIN_DRAG = 1e-9  # 1/s, used for parts without friction
DOUBT = 1.5  # standard deviations of the place of rest by which bands are widened


class Settling:
    """Single pulses near the target, for elements with a hard dead zone.

    Friction brakes a part at the rate c = mu g / (2 a_h w) for any element motion, so a part at p with velocity v comes to rest
    at p + v / c, and an acceleration a held for the time T shifts that place by a T / c. The same holds for headings. Near its
    target a part gets the one pulse that shifts its place of rest there. Then its elements are off until the place of rest is
    outside a band: moving all the time, elements would work against each other, and their spread would keep the part in motion.

    Args:
        info: task and step time.
        band, turn_band: m and rad, within which places of rest are not corrected, in tasks with goals.

    Attributes:
        slack: m, largest position error of corners of parts at rest.
    """

    def __init__(self, info: TaskInfo, band: float, turn_band: float) -> None:
        self.drag, self.step, self.period = info.plant.drag, info.step_time, info.surface.period  # c above, 1/s
        ahead = 0.5 * (info.step_time - info.surface.period)
        self.coast = 1.0 / np.maximum(self.drag, MIN_DRAG) - ahead  # s
        self.band, self.turn_band = (band, turn_band) if info.has_goal else (LOOSE_BAND, LOOSE_TURN)
        self.slack = self.band + self.turn_band * max(part.radius for part in info.parts)
        self.near, self.near_turn = max(NEAR, 2.0 * self.band), max(NEAR_TURN, 2.0 * self.turn_band)

    def __call__(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, wanted: np.ndarray
    ) -> np.ndarray:
        """Return wanted accelerations (batch, parts, 3), see :meth:`Law.wanted`.

        Args:
            displacement: (batch, parts, 2) m, displacement to the target.
            heading_error: (batch, parts) rad, heading error.
            wanted: (batch, parts, 3) of the law, for parts that are not near their targets.
        """
        velocity = measured.rate
        off = np.concatenate([displacement, heading_error[..., None]], axis=-1) - self.coast[:, None] * velocity
        distance, skew = np.sqrt((off[..., :2] ** 2).sum(axis=-1)), np.abs(off[..., 2])
        # Parts whose goals move do not come to rest.
        near = ~(measured.goal_velocity.any(axis=-1) | measured.goal_acceleration.any(axis=-1))
        near = near & ((displacement**2).sum(axis=-1) < REACH**2) & (np.abs(heading_error) < REACH_TURN)
        near &= (distance < self.near) & (skew < self.near_turn)
        # The effect of recent pulses is uncertain: without this, pulses would correct errors of the estimate.
        doubt = measured.doubt
        wider = DOUBT * np.sqrt((doubt[..., :2] ** 2).sum(axis=-1))
        rests = near & (distance < self.band + wider) & (skew < self.turn_band + DOUBT * doubt[..., 2])
        # The push drag * off / step, minus the mean effect of friction.
        pulse = self.drag[:, None] * (off / self.step - velocity) / (1.0 + 0.5 * self.drag[:, None] * self.period)
        return np.where(rests[..., None], np.nan, np.where(near[..., None], pulse, wanted))


# 1/s, with goal poses, and without, where parts that slow down early keep their distance from others for longer.
APPROACH, CROWD_APPROACH = 9.0, 7.0
# Time by which longer steps make the approach longer, over the added time; tuned with four periods per step.
SLOWER = 2.5


class LocalLaw(Law):
    """Set velocity from which the part can still stop, and the acceleration that follows it.

    Near rest a push of strength 1 accelerates a part by about ``mu a_v w^2 / 2``, and friction brakes it at the rate
    ``mu g / (2 a_h w)`` (first-order averages, thesis eqs. 5.60 and 5.61). The set velocity is ``sqrt(2 a d)`` at the distance
    ``d`` and proportional to ``d`` near the target; headings likewise. Defaults are tuned for one period per step. A longer
    step holds its push for longer, so the velocity follows its set value no faster than ``(1 - exp(-drag T)) / drag``, and the
    approach is slower by the added time, so that parts do not overshoot.
    """

    class Settings(Law.Settings):
        """Settings of the local law."""

        response: float = Field(default=0.04, gt=0.0)
        """Time in which the velocity follows its set value, s; longer with long steps."""

        braking: float = Field(default=0.5, gt=0.0, le=1.0)
        """Share of the available acceleration used for stopping."""

        approach: float | None = Field(default=None, gt=0.0)
        """Rate at which the error shrinks near the target, 1/s; less with long steps. None: 9 with goals, else 7."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        self.plant = plant = info.plant
        self.braking = self.settings.braking
        ahead = 0.5 * (info.step_time - info.surface.period)
        usual = APPROACH if info.has_goal else CROWD_APPROACH
        self.approach = usual if self.settings.approach is None else self.settings.approach
        self.approach /= 1.0 + SLOWER * self.approach * ahead
        self.lead = 1.0 / self.approach
        held = -np.expm1(-plant.drag * info.step_time) / np.maximum(plant.drag, MIN_DRAG)  # s, see above
        self.response = np.maximum(self.settings.response, held)
        self.settling = None
        if info.hard_dead_zone:
            self.settling = Settling(info, BAND * info.position_tolerance, BAND * info.heading_tolerance)
            self.slack = self.settling.slack

    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, Any]:
        """See :meth:`Law.wanted`."""
        distance = np.sqrt((displacement**2).sum(axis=-1))
        speed = np.minimum(self.stopping_rate(distance, self.plant.push), self.plant.top_speed)
        velocity = (speed / np.maximum(distance, 1e-12))[..., None] * displacement
        rate = np.sign(heading_error) * self.stopping_rate(np.abs(heading_error), self.plant.turn_push)
        change = np.concatenate([velocity - measured.velocity, (rate - measured.spin)[..., None]], axis=-1)
        wanted = change / self.response[:, None]
        return wanted if self.settling is None else self.settling(measured, displacement, heading_error, wanted), memory

    def stopping_rate(self, distance: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Return the speed (..., parts) from which a part stops within ``distance`` if ``push`` brakes it."""
        return np.minimum(np.sqrt(2.0 * self.braking * push * distance), self.approach * distance)
