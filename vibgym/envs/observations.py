"""Observations: what a policy gets to see of a measurement, flat, by parts, as a goal dictionary or as a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.envs.base import Observation, RowObservation, Writer
from vibgym.envs.images import ImageObservation
from vibgym.envs.layout import Layout, RowLayout
from vibgym.envs.writing import pinned_scene, write_goals, write_mask, write_rows
from vibgym.kernels.reference import bound
from vibgym.registry import Registry
from vibgym.sensing import Measurement, Sensor
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import Episode, Relations


def written(task: Task, layout: Layout, measurement: Measurement, relations: Relations, episode: Episode) -> Writer:
    """What writes a layout of a task's parts into (worlds, slots, block) float32; zeros where no part is."""
    return bound(write_rows, pinned_scene(task, layout, relations, episode), *measurement)


class StateObservation(RowObservation):
    """One flat float32 box in [-1, 1]: a block of numbers for each slot, part p in slot p; see the layout."""

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        rows = np.empty((worlds, self.layout.slots, self.layout.block), dtype=np.float32)
        return [rows], rows.reshape(worlds, -1)

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        return [written(self.task, self.layout, measurement, relations, episode)]


class PartsObservation(RowObservation):
    """Dictionary of ``parts``, a row of numbers in [-1, 1] for each slot, and ``mask``, 1 where there is a part.

    Rows of parts that are not there, and of slots without a part, are all 0. Part p has row p, whose numbers the table in
    :mod:`vibgym.envs.features` explains.

    Attributes:
        row_layout: what the numbers of a row mean.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.row_layout = RowLayout.of(task)

    @property
    def space(self) -> spaces.Space:
        slots, size = self.task.slots, self.row_layout.block
        return spaces.Dict(
            {"parts": spaces.Box(-1.0, 1.0, (slots, size), np.float32), "mask": spaces.MultiBinary(slots)}
        )

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        rows = np.empty((worlds, self.task.slots, self.row_layout.block), dtype=np.float32)
        mask = np.empty((worlds, self.task.slots), dtype=np.int8)
        return [rows, mask], {"parts": rows, "mask": mask}

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        rows = written(self.task, self.row_layout, measurement, relations, episode)
        return [rows, bound(write_mask, episode.present)]


class PartsAndState(RowObservation):
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

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        (arrays, parts), (more, state) = self._parts.fresh(worlds), self._state.fresh(worlds)
        return [*arrays, *more], {**parts, "state": state}

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        return [each for of in (self._parts, self._state) for each in of.writers(measurement, relations, episode)]


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
        goals = np.empty((len(pose), len(self.low)), dtype=np.float32)
        write_goals(self.low, self.high, pose, np.arange(len(pose)), goals)
        return goals

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        arrays, state = super().fresh(worlds)
        achieved, desired = (np.empty((worlds, len(self.low)), dtype=np.float32) for _ in range(2))
        batch = {"observation": state, "achieved_goal": achieved, "desired_goal": desired}
        return [*arrays, achieved, desired], batch

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        goals = (bound(write_goals, self.low, self.high, pose) for pose in (measurement.pose, episode.goal))
        return [*super().writers(measurement, relations, episode), *goals]


def check_batch(name: str, space: spaces.Space, batch: Any, worlds: int) -> None:
    """Check shapes and types of a batch of observations.

    Args:
        name: of the observation, for errors.
        space: of one world.
        batch: array (worlds, ...), or a mapping of arrays for a ``Dict`` space.
        worlds: number of worlds.

    Raises:
        ValueError: a batch that does not fit.
    """
    if isinstance(space, spaces.Dict):
        if not isinstance(batch, Mapping) or set(batch) != set(space.spaces):
            got = sorted(map(str, batch)) if isinstance(batch, Mapping) else type(batch).__name__
            raise checks.refuse(name, got, f"a dictionary with the keys of its space: {', '.join(space.spaces)}")
        for key, each in space.spaces.items():
            check_batch(f"{name}, {key!r},", each, batch[key], worlds)
    elif space.shape is not None:
        shape = (worlds, *space.shape)
        if not isinstance(batch, np.ndarray) or batch.shape != shape or batch.dtype != space.dtype:
            got = type(batch).__name__
            if isinstance(batch, np.ndarray):
                got = f"an array of shape {batch.shape} and type {batch.dtype}"
            raise checks.refuse(name, got, f"an array of shape {shape} and type {space.dtype}: (worlds, *space.shape)")


OBSERVATIONS: Registry[type[Observation]] = Registry(
    "observation",
    {
        "state": StateObservation,
        "parts": PartsObservation,
        "parts_and_state": PartsAndState,
        "goal": GoalObservation,
        "image": ImageObservation,
    },
    "vibgym.observations",
)
"""Observations by name; ``OBSERVATIONS.register(name, cls)`` or an entry point in group ``vibgym.observations`` adds one."""
