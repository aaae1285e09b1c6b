"""Local fields steered by the measured pose: a uniform field that carries the part, a tangential one that turns it.

Near rest a push of strength 1 accelerates a part by about ``mu g / 2`` and friction brakes it at the rate
``mu g / (2 a_h w)`` (first-order average, thesis eqs. 5.60 and 5.61). The law asks for the velocity from which the part can
still stop at the goal, ``sqrt(2 a d)`` far away and proportional to the distance near it, and pushes towards that velocity.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.control.seen import see
from agents.policy import Situation
from vibgym import checks
from vibgym.envs.actions import patch_size
from vibgym.fields import lead_angle
from vibgym.physics.core.drive import FIELD_STRENGTHS


class LocalFieldPolicy:
    """Uniform and tangential field around the part, as ``"field"`` actions.

    Args:
        situation: task, surface and part.
        response: s, time in which the velocity follows its set value.
        braking: share of the available acceleration that the stopping law counts on.
        approach: 1/s, rate at which the remaining error shrinks near the goal.
    """

    action, observation = "field", "state"

    def __init__(
        self, situation: Situation, response: float = 0.06, braking: float = 0.6, approach: float = 7.0
    ) -> None:
        situation.check_served("local_field", many=False)
        surface, part = situation.surface, situation.part
        self.surface, self.part = surface, part
        self.response = checks.number("response", response, above=0.0)
        self.braking = checks.number("braking", braking, above=0.0, most=1.0)
        self.approach = checks.number("approach", approach, above=0.0)
        self.push = 0.5 * part.friction * surface.full_scale  # m/s^2 of a push of strength 1
        self.drag = 0.5 * part.friction * surface.gravity / max(surface.table_speed, 1e-9)  # 1/s
        # A tangential field grows with the distance from the centre, so its torque over inertia is push / reach.
        self.turn_push = self.push / (0.5 * patch_size(surface, part) * surface.element_size)  # rad/s^2
        self.lead = lead_angle(surface, part.friction)

    def _strength(self, speed: np.ndarray, velocity: np.ndarray, push: float) -> np.ndarray:
        """Strength that takes the velocity to the set ``speed`` and makes up for friction's braking."""
        wanted = (speed - velocity) / self.response + self.drag * velocity
        return wanted / push

    def _rate(self, distance: np.ndarray, push: float) -> np.ndarray:
        """Set speed at a distance from the goal."""
        return np.minimum(np.sqrt(2.0 * self.braking * push * distance), self.approach * distance)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Field strengths from the measured pose and mean velocity; the policy has no memory."""
        seen = see(observation, self.surface, self.part)
        distance = np.hypot(*seen.error.T)[:, None]
        direction = seen.error / np.maximum(distance, 1e-12)
        speed = self._rate(distance, self.push) * direction
        push = self._strength(speed, seen.velocity, self.push)
        push /= np.maximum(np.hypot(*push.T)[:, None], 1.0)
        cosine, sine = np.cos(self.lead), np.sin(self.lead)
        rate = self._rate(np.abs(seen.turn), self.turn_push) * np.sign(seen.turn)
        action = np.zeros((len(distance), 1, FIELD_STRENGTHS), dtype=np.float32)
        action[:, 0, 0] = push[:, 0] * cosine + push[:, 1] * sine
        action[:, 0, 1] = push[:, 1] * cosine - push[:, 0] * sine
        action[:, 0, 5] = np.clip(self._strength(rate, seen.spin, self.turn_push), -1.0, 1.0)
        return (action[0] if seen.single else action), state
