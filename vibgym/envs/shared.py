"""What single and vector environments have in common besides the core: public knowledge of the scene, and the truth."""

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
from vibgym.envs.features import Numbers, RowLayout
from vibgym.envs.reset_options import StartOverride, parse_reset_options
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import Task


class Truth(NamedTuple):
    """The true state of all worlds, for those who judge and draw; policies do not get it. Copies."""

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
    """Properties of single and vector environments alike.

    Attributes:
        core: the batched core.
    """

    core: Core
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Specification by which Gymnasium made the environment; its keyword arguments are JSON values."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.kwargs = json_values(spec.kwargs)
        self._spec = spec

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
        """What is asked of the parts: tolerances, kinds, zones."""
        return self.core.task

    @property
    def data_sheet(self) -> DataSheet:
        """What is known of the actuators beforehand: nominal dead zone, limit, latency; nothing that an episode draws."""
        return self.core.actuators.data_sheet

    @property
    def measurement_lead(self) -> int:
        """Periods after the present of which measurements tell: the actuators' latency where an estimator predicts, else 0."""
        return self.core.sensing.lead

    @property
    def action_shape(self) -> tuple[int, ...]:
        """What the numbers of an action mean, such as (parts, k, k, 2); the space is flat, and ``step`` takes either."""
        return self.core.action.shape

    @property
    def periods_per_step(self) -> int:
        """Oscillation periods of a step."""
        return self.core.periods

    @property
    def step_time(self) -> float:
        """s that one step lasts in the world."""
        return self.core.surface.period * self.core.periods

    @property
    def observation_layout(self) -> tuple[Numbers, ...]:
        """What every number of the state observation means: name, width, unit, scale, range, part and place, in order."""
        return self.core.observation.layout.rows

    @property
    def parts_layout(self) -> tuple[Numbers, ...]:
        """What the numbers of a row of the observation by parts mean, in order; the same for every part.

        :class:`vibgym.envs.features.RowLayout` turns numbers back into quantities.
        """
        return RowLayout.of(self.core.task).rows

    def observed(self, kind: str) -> Any:
        """Another observation of the same instant, such as ``"state"`` beside ``observation="parts"``.

        So an expert that reads one observation can be asked while a learner acts by another.

        Args:
            kind: as for ``observation=``, but ``"camera"``, for which a camera has to keep pictures from the start.

        Returns:
            One observation, or a batch, as the environment's own observation is; of the episode that the last ``reset`` or
            ``step`` has shown.

        Raises:
            ValueError: there is no such observation, or the task has it not.
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        if not self.core.began:
            raise gym.error.ResetNeeded("observed(): call reset() before")
        return self._own(self.core.observed(kind))

    def _check_open(self, closed: bool) -> None:
        """Refuse a step of an environment that has been closed, or in which no episode has begun."""
        if closed:
            raise gym.error.ClosedEnvironmentError("step(): the environment is closed; reset() opens it again")
        if not self.core.began:
            raise gym.error.ResetNeeded("call reset() before step()")

    def _override(self, options: Any, more: tuple[str, ...] = ()) -> StartOverride | None:
        """What the options of a reset set of the start; ``more`` are known besides."""
        return parse_reset_options(options, self.core.task, self.core.worlds, self.core.longest, more)

    def _own(self, seen: Any) -> Any:
        """A batch of observations as this environment hands them out."""
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
        """(rows, columns, 2) what the elements of a world did last, as fractions of full scale; zeros before the first step."""
        return self.core.phasors(checks.count("world", world, least=0, most=self.core.worlds - 1))

    def paths(self, world: int = 0) -> list[np.ndarray]:
        """Lines (n, 2), m, along which the goals of a world's parts move, one for each part; none where goals stay."""
        return self.core.scoring.lines(checks.count("world", world, least=0, most=self.core.worlds - 1))

    def caption(self, world: int = 0) -> str:
        """One line on how the task stands in a world, for pictures."""
        world = checks.count("world", world, least=0, most=self.core.worlds - 1)
        return self.core.task.caption(self.core.relations, self.core.episode, world)


def frames_per_second(core: Core) -> int:
    """Steps a second in the world, at least 1: ``metadata["render_fps"]``."""
    return round(1.0 / (core.surface.period * core.periods)) or 1
