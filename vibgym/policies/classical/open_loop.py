"""Sensorless fields, as in chapter 4 of the thesis: planned from the first observation of an episode, never corrected.

A radial field brings the part to the goal from any place. To align it, a squeeze field towards a line through the goal, along
the wanted heading, follows. To turn it to an unwrapped heading, a tangential field acts for the time that the turn takes at its
steady rate: the spin builds up and decays with the same lag, so the two cancel.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from vibgym.envs.actions import ACTIONS
from vibgym.fields import radial, squeeze, tangential
from vibgym.policies.classical.measured import Measured, check_state, recall
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import BaseSettings, Unit


class ZeroPolicy:
    """Policy that keeps all elements at rest: parts slide in place."""

    class Settings(BaseSettings):
        """Settings of the policy: none."""

    action, observation = "field", "state"

    def __init__(self, info: TaskInfo, settings: Settings) -> None:
        self.layout, self.size = info.layout, ACTIONS[self.action](info.surface, info.parts).size

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return an action for every observation."""
        return self.draw((*check_state(observation, self.layout).shape[:-1], self.size)), state

    def draw(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return actions of this shape."""
        return np.zeros(shape, dtype=np.float32)


class RandomPolicy(ZeroPolicy):
    """Policy with uniformly random amplitudes and phases of all elements in every step."""

    class Settings(ZeroPolicy.Settings):
        """Settings of the policy."""

        seed: int = Field(default=0, ge=0)
        """Of the actions."""

    action = "element"

    def __init__(self, info: TaskInfo, settings: Settings) -> None:
        super().__init__(info, settings)
        self.generator = np.random.default_rng(settings.seed)

    def draw(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return actions of this shape."""
        return 2.0 * self.generator.random(shape, dtype=np.float32) - np.float32(1.0)


class OpenLoopPlan(NamedTuple):
    """Memory of :class:`OpenLoopPolicy`."""

    goal: np.ndarray  # (batch, 3) m, m, rad
    heading_error: np.ndarray  # (batch,) rad, from the heading at the start to the goal's
    time: np.ndarray  # (batch,) s, since the start


class OpenLoopPolicy:
    """Whole-surface fields around the goal, as ``"phasor"`` actions.

    Args:
        info: task, scene and step time.

    Raises:
        ValueError: a task for several parts or without goal pose.
    """

    class Settings(BaseSettings):
        """Settings of the fields."""

        turn_rate: Annotated[float, Unit("rad/s")] = Field(default=11.5, gt=0.0)
        """Steady angular velocity in the tangential field."""

        gather_time: float = Field(default=2.0, ge=0.0)
        """Duration of the radial field before the squeeze field, s."""

        centring: float = Field(default=0.2, ge=0.0, le=1.0)
        """Strength of the radial field added to the squeeze field."""

    action, observation = "phasor", "state"

    def __init__(self, info: TaskInfo, settings: Settings) -> None:
        if not info.has_goal or info.goal_moves or len(info.parts) != 1:
            raise info.unsupported("open_loop", "a task for one part with a fixed goal pose")
        self.info, self.settings = info, settings

    def initial(self, batch: int) -> OpenLoopPlan:
        """Return the memory before the first observation."""
        return OpenLoopPlan(np.zeros((batch, 3)), np.zeros(batch), np.zeros(batch))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return the field about the goal of the episode's first observation; the state is a :class:`OpenLoopPlan`."""
        info, measured = self.info, Measured.of(observation, self.info)
        plan, new = recall(state, episode_start, self.initial(len(measured.centre)), len(measured.centre))
        plan.goal[new, :2] = (measured.centre + measured.displacement)[new, 0]
        plan.goal[new, 2] = (measured.heading + measured.heading_error)[new, 0]
        plan.heading_error[new] = measured.heading_error[new, 0]
        phasors = self._phasors(plan).reshape(len(new), -1).astype(np.float32)
        return (phasors[0] if measured.single else phasors), plan._replace(time=plan.time + info.step_time)

    def _phasors(self, plan: OpenLoopPlan) -> np.ndarray:
        """Return the phasors (batch, rows, columns, 2) of this step: of a first field, then of a second one or none.

        The fields change at any instant of a step, which gets its share of both.
        """
        x, y, heading = (column[:, None, None] for column in plan.goal.T)
        first, second = radial(x, y), None
        until = np.full(len(plan.time), np.inf)
        if self.info.has_heading and self.info.wraps:
            second = radial(x, y, self.settings.centring) + squeeze(x, y, heading)
            until[:] = self.settings.gather_time
        elif self.info.has_heading:
            first = first + tangential(x, y, np.sign(plan.heading_error)[:, None, None])
            until = np.abs(plan.heading_error) / self.settings.turn_rate
        share = np.clip((until - plan.time) / self.info.step_time, 0.0, 1.0)[:, None, None, None]
        surface, friction = self.info.surface, self.info.parts[0].friction
        phasors = np.zeros((len(share), surface.rows, surface.columns, 2))
        for field, weight in ((first, share), (second, 1.0 - share)):
            if field is not None and weight.any():
                phasors += weight * field.phasors(surface, friction=friction)
        return phasors
