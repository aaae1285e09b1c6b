"""Observations: what a policy gets to see of a measurement, flat, by parts, as a goal dictionary or as a picture."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym._numba.reference import Pinned
from vibgym.envs.base import Observation, RowObservation
from vibgym.envs.images import CameraObservation, ImageObservation
from vibgym.envs.layout import Layout, RowLayout
from vibgym.envs.writing import Scene, pinned_scene, write_goals, write_mask, write_rows
from vibgym.registry import Registry
from vibgym.sensing import Measurement, Sensor
from vibgym.simulation.threads import Pool
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import Episode, Relations


class Written:
    """Writes a layout of a task's parts."""

    def __init__(self, task: Task, layout: Layout) -> None:
        self.task, self.layout = task, layout
        self._relations: Relations | None = None
        self._scenes: Pool[Pinned[Scene]] | None = None

    def fresh(self, worlds: int) -> np.ndarray:
        """(worlds, slots, block) float32, with nothing in it yet."""
        return np.empty((worlds, self.layout.slots, self.layout.block), dtype=np.float32)

    def write(
        self, worlds: np.ndarray, out: np.ndarray, measurement: Measurement, relations: Relations, episode: Episode
    ) -> None:
        """Write the blocks or rows of ``worlds`` (index array) into ``out``; zeros where no part is."""
        if self._scenes is None or relations is not self._relations:  # the same ones ever after
            self._relations = relations
            self._scenes = Pool(partial(pinned_scene, self.task, self.layout, relations, episode))
        scenes = self._scenes
        scene = scenes.take()
        write_rows(worlds, *measurement, scene.address, out)
        scenes.give(scene)


class StateObservation(RowObservation):
    """One flat float32 box in [-1, 1]: a block of numbers for each slot, part p in slot p; see the layout."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._written = Written(task, self.layout)

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def fresh(self, worlds: int) -> Any:
        return np.empty((worlds, self.layout.size), dtype=np.float32)

    def write(
        self, worlds: np.ndarray, out: Any, measurement: Measurement, relations: Relations, episode: Episode
    ) -> None:
        rows = out.reshape(-1, self.layout.slots, self.layout.block)
        self._written.write(worlds, rows, measurement, relations, episode)


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
        self._written = Written(task, self.row_layout)

    @property
    def space(self) -> spaces.Space:
        slots, size = self.task.slots, self.row_layout.block
        return spaces.Dict(
            {"parts": spaces.Box(-1.0, 1.0, (slots, size), np.float32), "mask": spaces.MultiBinary(slots)}
        )

    def fresh(self, worlds: int) -> Any:
        return {"parts": self._written.fresh(worlds), "mask": np.empty((worlds, self.task.slots), dtype=np.int8)}

    def write(
        self, worlds: np.ndarray, out: Any, measurement: Measurement, relations: Relations, episode: Episode
    ) -> None:
        self._written.write(worlds, out["parts"], measurement, relations, episode)
        write_mask(worlds, episode.present, out["mask"])


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

    def fresh(self, worlds: int) -> Any:
        return {**self._parts.fresh(worlds), "state": self._state.fresh(worlds)}

    def write(
        self, worlds: np.ndarray, out: Any, measurement: Measurement, relations: Relations, episode: Episode
    ) -> None:
        self._parts.write(worlds, out, measurement, relations, episode)
        self._state.write(worlds, out["state"], measurement, relations, episode)


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
        write_goals(np.arange(len(pose)), pose, self.low, self.high, goals)
        return goals

    def fresh(self, worlds: int) -> Any:
        goals = (np.empty((worlds, len(self.low)), dtype=np.float32) for _ in range(2))
        return {"observation": super().fresh(worlds), "achieved_goal": next(goals), "desired_goal": next(goals)}

    def write(
        self, worlds: np.ndarray, out: Any, measurement: Measurement, relations: Relations, episode: Episode
    ) -> None:
        super().write(worlds, out["observation"], measurement, relations, episode)
        write_goals(worlds, measurement.pose, self.low, self.high, out["achieved_goal"])
        write_goals(worlds, episode.goal, self.low, self.high, out["desired_goal"])


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
