"""Observations: what a policy gets to see of a measurement, flat, by parts, as a goal dictionary or as a picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym._numba.reference import Pinned
from vibgym.envs.base import Observation
from vibgym.envs.images import CameraObservation, ImageObservation
from vibgym.envs.layout import Layout, RowLayout
from vibgym.envs.writing import Scene, pinned_scene, write_rows
from vibgym.registry import Registry
from vibgym.sensing import Measurement, Sensor
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import Episode, Relations


class Written:
    """Writes a layout of a task's parts."""

    def __init__(self, task: Task, layout: Layout) -> None:
        self.task, self.layout = task, layout
        self._relations: Relations | None = None
        self._scene: Pinned[Scene] | None = None

    def rows(self, measurement: Measurement, relations: Relations, episode: Episode) -> np.ndarray:
        """A fresh batch (worlds, slots, block) float32; zeros where no part is."""
        if self._scene is None or relations is not self._relations:  # the same ones ever after
            self._relations, self._scene = relations, pinned_scene(self.task, self.layout, relations, episode)
        pose, mean_velocity, gone, age, sigma = measurement
        out = np.zeros((len(pose), self.layout.slots, self.layout.block), dtype=np.float32)
        write_rows(pose, mean_velocity, gone, age, sigma, self._scene.address, out)
        return out


class StateObservation(Observation):
    """One flat float32 box in [-1, 1]: a block of numbers for each slot, part p in slot p; see the layout."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._written = Written(task, self.layout)

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        return self._written.rows(measurement, relations, episode).reshape(-1, self.layout.size)


class PartsObservation(Observation):
    """Dictionary of ``parts``, a row of numbers in [-1, 1] for each slot, and ``mask``, 1 where there is a part.

    Rows of parts that are not there, and of slots without a part, are all 0. Part p has row p, whose numbers the table in
    :mod:`vibgym.envs.features` explains.

    Attributes:
        row_layout: what the numbers of a row mean.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.row_layout = RowLayout.of(task)
        self._written = Written(task, self.row_layout)

    @property
    def space(self) -> spaces.Space:
        slots, size = self.task.slots, self.row_layout.block
        return spaces.Dict(
            {"parts": spaces.Box(-1.0, 1.0, (slots, size), np.float32), "mask": spaces.MultiBinary(slots)}
        )

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        rows = self._written.rows(measurement, relations, episode)
        mask = episode.present.astype(np.int8)
        if rows.shape[1] > mask.shape[1]:  # slots without a part
            mask = np.pad(mask, ((0, 0), (0, rows.shape[1] - mask.shape[1])))
        return {"parts": rows, "mask": mask}


class PartsAndState(Observation):
    """The dictionary of ``"parts"``, and the flat ``state`` besides: for a policy of two that read one each."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._parts, self._state = PartsObservation(task), StateObservation(task)

    def watch(self, sensor: Sensor) -> None:
        self._parts.watch(sensor)
        self._state.watch(sensor)

    @property
    def space(self) -> spaces.Space:
        return spaces.Dict({**self._parts.space.spaces, "state": self._state.space})  # type: ignore[attr-defined]

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        state = self._state.observe(measurement, relations, episode)
        return {**self._parts.observe(measurement, relations, episode), "state": state}


class GoalObservation(StateObservation):
    """GoalEnv dictionary: ``observation`` (the flat state), ``achieved_goal`` and ``desired_goal`` in m and rad."""

    goal_reward = True
    TURN_LIMIT = 8.0 * math.pi

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        if not isinstance(task, PoseTask):
            have = ", ".join(repr(name) for name, each in OBSERVATIONS.items() if each.beside and not each.goal_reward)
            why = "'goal' is for a PoseTask: one part, and a goal pose that stays"
            raise checks.refuse("observation", "goal", f"{have} ({why})")
        n, surface = task.goal_size(), task.surface
        self.low = np.array([-0.1, -0.1, -self.TURN_LIMIT], dtype=np.float32)[:n]
        self.high = np.array([surface.width + 0.1, surface.depth + 0.1, self.TURN_LIMIT], dtype=np.float32)[:n]

    @property
    def space(self) -> spaces.Space:
        goals = (spaces.Box(self.low, self.high, dtype=np.float32) for _ in range(2))
        return spaces.Dict({"observation": super().space, "achieved_goal": next(goals), "desired_goal": next(goals)})

    def reached(self, pose: np.ndarray) -> np.ndarray:
        """Poses (worlds, parts, 3) as goals (worlds, goal_size)."""
        return np.clip(pose[:, 0, : len(self.low)].astype(np.float32), self.low, self.high)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        return {
            "observation": super().observe(measurement, relations, episode),
            "achieved_goal": self.reached(measurement.pose),
            "desired_goal": self.reached(episode.goal),
        }


OBSERVATIONS: Registry[type[Observation]] = Registry(
    "observation",
    {
        "state": StateObservation,
        "parts": PartsObservation,
        "parts_and_state": PartsAndState,
        "goal": GoalObservation,
        "image": ImageObservation,
        "camera": CameraObservation,
    },
)
"""Observations by name; ``OBSERVATIONS.register(name, cls)`` adds one of your own."""
