"""Goals that move: where they will be when a command begins to act, and parts seen from there.

Observations tell a goal's velocity and its places up to four periods ahead. Between these its acceleration is taken for
constant in each period, so that from the first velocity on

    v_{k+1} = 2 (p_{k+1} - p_k) / T - v_k

and beyond them for that of the last period. A law sees parts in the frame of their goals, which does not turn: there a goal
stands still at the origin, velocities are differences, and what a law asks for is added to the goal's own acceleration. So all
laws follow paths, and none of them knows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.episode import PREVIEW


class Preview:
    """Shifts what is measured to the goals of the instant at which a step's command begins to act.

    Args:
        info: task, scene and step time.
    """

    def __init__(self, info: TaskInfo) -> None:
        self.period, self.lead, self.periods = info.surface.period, info.lead, info.periods_per_step
        turns = [info.has_heading and part.symmetry > 0 for part in info.parts]
        self._counts = np.array([[1.0, 1.0, float(each)] for each in turns])

    def __call__(self, measured: Measured) -> Measured:
        """With ``way`` and ``turn`` to these goals, their velocity, and their mean acceleration over the step."""
        period, ahead = self.period, measured.goal_ahead * self._counts[:, None]
        places = np.concatenate([np.zeros_like(ahead[..., :1, :]), ahead], axis=-2)
        velocity = np.empty_like(places)
        velocity[..., 0, :] = measured.goal_velocity * self._counts
        for k in range(PREVIEW):
            mean = (places[..., k + 1, :] - places[..., k, :]) / period
            velocity[..., k + 1, :] = 2.0 * mean - velocity[..., k, :]
        begin, speed = self._at(places, velocity, self.lead)
        end, _ = self._at(places, velocity, self.lead + self.periods)
        time = self.periods * period
        return replace(
            measured,
            way=measured.way + begin[..., :2],
            turn=measured.turn + begin[..., 2],
            goal_velocity=speed,
            goal_acceleration=2.0 * (end - begin - time * speed) / time**2,
        )

    def _at(self, places: np.ndarray, velocity: np.ndarray, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Places and velocities so many periods from now."""
        if periods <= PREVIEW:
            return places[..., periods, :], velocity[..., periods, :]
        last, beyond = velocity[..., PREVIEW, :], (periods - PREVIEW) * self.period
        rate = (last - velocity[..., PREVIEW - 1, :]) / self.period
        return places[..., PREVIEW, :] + beyond * last + 0.5 * beyond**2 * rate, last + beyond * rate


def from_goals(measured: Measured) -> Measured:
    """Parts in the frames of their goals, see the module."""
    velocity = measured.goal_velocity
    return replace(
        measured,
        centre=-measured.way,
        heading=-measured.turn,
        velocity=measured.velocity - velocity[..., :2],
        spin=measured.spin - velocity[..., 2],
    )


def as_they_stand(measured: Measured) -> Measured:
    """Where goals do not move, nothing changes."""
    return measured
