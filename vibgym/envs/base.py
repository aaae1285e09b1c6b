"""What an observation is: the space of one world, and a batch of it from what is measured."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym.envs.layout import Layout
from vibgym.sensing import Measurement, Sensor
from vibgym.tasks import Task
from vibgym.tasks.episode import Episode, Relations


class Observation(ABC):
    """Base: the space of one world and a fresh batch of observations.

    An observation of your own is a subclass; ``vibgym.envs.OBSERVATIONS.register`` gives it a name.

    Args:
        task: with its surface and parts.

    Attributes:
        layout: of the state observation, also where another one is handed out.

    Raises:
        ValueError: the task has no such observation.
    """

    goal_reward: bool = False
    """Whether the reward is that of a goal observation (GoalEnv)."""

    beside: bool = True
    """Whether it can also be had beside another one, from any step on; not if a sensor has to note something for it."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.layout = Layout(task.surface, task.parts, task.features, task.slots)

    def watch(self, sensor: Sensor) -> None:  # noqa: B027 - most get all that they need with every measurement
        """Get to know the sensor, once, before anything else is asked.

        Raises:
            ValueError: the sensor has not what this observation shows.
        """

    @property
    @abstractmethod
    def space(self) -> spaces.Space:
        """Space of one world."""

    @abstractmethod
    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        """A fresh batch of observations.

        Args:
            measurement: what is known of the parts.
            relations: how they stand to their goals and to one another, by the measured poses.
            episode: of which goals and present parts are known.
        """


Writer = Callable[[np.ndarray, np.ndarray], None]


class RowObservation(Observation):
    """Base of observations that kernels write world by world, so that a block of worlds is observed where it was advanced."""

    @abstractmethod
    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        """A batch with nothing in it yet: the arrays that are written, and what is handed out when they have been."""

    @abstractmethod
    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        """What writes the arrays of a batch, one for each of them, called with an index array of worlds and the array.

        They have working arrays of their own: those of several calls of this may be at work at the same time, on different
        worlds. The records are those of :meth:`observe`; their arrays are looked at whenever a writer is called.
        """

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        worlds = len(measurement.pose)
        arrays, batch = self.fresh(worlds)
        for write, array in zip(self.writers(measurement, relations, episode), arrays, strict=True):
            write(np.arange(worlds), array)
        return batch
