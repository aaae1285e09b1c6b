"""Interface that single and vector environments share: the scene, layouts of observations, and the true state."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from vibgym import checks
from vibgym.actuators import DataSheet
from vibgym.config import json_values
from vibgym.envs.core import Core
from vibgym.envs.features import LayoutEntry, RowLayout
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import Task


class Truth(NamedTuple):
    """The true state of all worlds, for evaluation and rendering; copies."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    velocity: np.ndarray  # (worlds, parts, 3) at this instant, m/s, m/s, rad/s
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period
    present: np.ndarray  # (worlds, parts) bool, parts of this episode
    fallen: np.ndarray  # (worlds, parts) bool
    done: np.ndarray  # (worlds, parts) bool
    goal: np.ndarray  # (worlds, parts, 3) goal poses; zeros for tasks without
    error: np.ndarray  # (worlds, parts, 3) goal, or nearest point of the zone, minus pose: m, m, rad
    gap: np.ndarray  # (worlds, parts) m, distance to the nearest other part


class SharedInterface:
    """Properties of single and vector environments.

    Attributes:
        core: the batched core.
    """

    core: Core

    max_episode_steps: int | None
    """Steps after which the environment truncates episodes; None: it does not."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification of the environment; its keyword arguments are JSON values."""
        self._set_time_limits()
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.kwargs = json_values(spec.kwargs)
            self._describe_limit(spec)
        self._spec = spec

    def _describe_limit(self, spec: EnvSpec) -> None:
        """Set ``max_episode_steps`` of a specification to that of the environment."""
        spec.max_episode_steps = self.max_episode_steps
        if "max_episode_steps" in spec.kwargs:
            spec.kwargs["max_episode_steps"] = -1 if self.max_episode_steps is None else self.max_episode_steps

    def _set_time_limits(self) -> None:
        """Set the limits of Gymnasium's wrappers around the environment; a batch has none."""

    @property
    def surface(self) -> Surface:
        """The table."""
        return self.core.surface

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of every world."""
        return self.core.parts

    @property
    def walls(self) -> tuple[str, ...]:
        """Borders with a wall."""
        return self.core.simulator.walls

    @property
    def task(self) -> Task:
        """The task: goals, tolerances, kinds, zones."""
        return self.core.task

    @property
    def data_sheet(self) -> DataSheet:
        """Nominal properties of the actuators: dead zone, limit, latency; not those drawn for an episode."""
        return self.core.actuators.data_sheet

    @property
    def measurement_lead(self) -> int:
        """Periods by which measurements are ahead: the actuators' latency if an estimator predicts, else 0."""
        return self.core.sensing.lead

    @property
    def action_shape(self) -> tuple[int, ...]:
        """Shape of an action, such as (parts, k, k, 2); the space is flat, and ``step`` takes arrays of either shape."""
        return self.core.action.shape

    @property
    def periods_per_step(self) -> int:
        """Oscillation periods of a step."""
        return self.core.periods

    @property
    def step_time(self) -> float:
        """Simulated time of a step, s."""
        return self.core.surface.period * self.core.periods

    @property
    def observation_layout(self) -> tuple[LayoutEntry, ...]:
        """Features of the state observation in order: name, part, start, width, unit, scale, range."""
        return self.core.observation.layout.rows

    @property
    def parts_layout(self) -> tuple[LayoutEntry, ...]:
        """Features of a row of the observation by parts in order, the same for every part.

        :class:`vibgym.envs.features.RowLayout` decodes them to quantities.
        """
        return RowLayout.of(self.core.task).rows

    def observed(self, kind: str) -> Any:
        """Return another observation of the same instant, for example for an expert with another observation than the learner.

        Args:
            kind: as for ``observation=``, except ``"camera"``.

        Returns:
            One observation, or a batch.

        Raises:
            ValueError: an unknown observation, or one that the task does not support.
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        if not self.core.began:
            raise gym.error.ResetNeeded("observed(): call reset() before")
        return self._own(self.core.observed(kind))

    @property
    def compute_reward(self) -> Any:
        """Compute the reward for achieved and desired goals, single or batched (GoalEnv).

        See :meth:`vibgym.tasks.PoseTask.compute_reward`. Requires ``observation="goal"``; learners detect a GoalEnv by it.
        Goals of observations are measured; the reward of a step is the same function of the true state.
        """
        if not self.core.observation.goal_reward:
            raise AttributeError("compute_reward: only with observation='goal'")
        return self._goal_reward

    def _goal_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        reward = self.core.task.compute_reward(achieved_goal, desired_goal, info)  # type: ignore[attr-defined]
        return float(reward) if reward.ndim == 0 else reward

    def _check_open(self, closed: bool) -> None:
        """Raise an error for a step of a closed environment, or before the first reset."""
        if closed:
            raise gym.error.ClosedEnvironmentError("step(): the environment is closed; reset() opens it again")
        if not self.core.began:
            raise gym.error.ResetNeeded("call reset() before step()")

    def _own(self, seen: Any) -> Any:
        """Return a batch of observations in the form of this environment."""
        return seen

    @property
    def truth(self) -> Truth:
        """The true state of all worlds; copies."""
        core, state = self.core, self.core.simulator.state
        return Truth(
            *(
                values.copy()
                for values in (
                    state.pose, state.velocity, state.mean_velocity, core.episode.present, state.fallen,
                    core.episode.done, core.episode.goal, core.relations.error, core.relations.gap,
                )
            )
        )  # fmt: skip

    def phasors(self, world: int = 0) -> np.ndarray:
        """Return phasors (rows, columns, 2) of a world's elements in the last step, as fractions of full scale."""
        return self.core.phasors(checks.count("world", world, least=0, most=self.core.worlds - 1))

    def paths(self, world: int = 0) -> list[np.ndarray]:
        """Return lines (n, 2), m, along which the goals of a world's parts move, one per part; none if goals are fixed."""
        return self.core.scoring.lines(checks.count("world", world, least=0, most=self.core.worlds - 1))

    def caption(self, world: int = 0) -> str:
        """Return a line on the progress of a world, for images."""
        world = checks.count("world", world, least=0, most=self.core.worlds - 1)
        return self.core.task.caption(self.core.relations, self.core.episode, world)


def frames_per_second(core: Core) -> int:
    """Return steps per simulated second, at least 1: ``metadata["render_fps"]``."""
    return round(1.0 / (core.surface.period * core.periods)) or 1
