"""Observations: what policies get of a measurement, flat, by parts, as a goal dictionary or as an image."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.envs.features import Layout, RowLayout
from vibgym.envs.writing import pinned_scene, write_goals, write_mask, write_rows
from vibgym.kernels.reference import bound
from vibgym.registry import Registry
from vibgym.rendering.raster import Marks, rasterise
from vibgym.sensing import Measurement, Sensor
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import Episode, Relations

PIXELS = 6  # per side of an element
KIND_VALUES = (255, 170, 85)
"""Brightness of the first, second and third kind in an image."""

Writer = Callable[[np.ndarray, np.ndarray], None]


class Observation(ABC):
    """Base class of observations: the space of one world, and a batch from a measurement.

    A custom observation is a subclass; ``vibgym.envs.OBSERVATIONS.register`` gives it a name.

    Args:
        task: with its surface and parts.

    Attributes:
        layout: of the state observation.

    Raises:
        ValueError: a task that does not support the observation.
    """

    goal_reward: bool = False
    """Whether the reward is that of a goal observation (GoalEnv)."""

    beside: bool = True
    """Whether it can be computed beside another observation; not if the sensor has to record data for it."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.layout = Layout(task.surface, task.parts, task.features, task.slots)

    def watch(self, sensor: Sensor) -> None:  # noqa: B027 - most need the measurement alone
        """Take the sensor into account; called once, before anything else.

        Raises:
            ValueError: a sensor that does not support the observation.
        """

    @property
    @abstractmethod
    def space(self) -> spaces.Space:
        """Space of one world."""

    @abstractmethod
    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        """Return a new batch of observations, arrays (worlds, ...).

        Args:
            measurement: of the parts.
            relations: errors and gaps by the measured poses.
            episode: goals, and which parts are present.
        """


class RowObservation(Observation):
    """Base class of observations that kernels write world by world, on the thread that has advanced them."""

    @abstractmethod
    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        """Return an uninitialised batch: the arrays that writers fill, and the batch made of them."""

    @abstractmethod
    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        """Return a function ``write(worlds, array)`` per array of a batch; ``worlds`` is an index array.

        Each call returns writers with scratch memory of their own, for use on several threads. The arguments are those of
        :meth:`observe`; their arrays are live.
        """

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        worlds = len(measurement.pose)
        arrays, batch = self.fresh(worlds)
        for write, array in zip(self.writers(measurement, relations, episode), arrays, strict=True):
            write(np.arange(worlds), array)
        return batch


def written(task: Task, layout: Layout, measurement: Measurement, relations: Relations, episode: Episode) -> Writer:
    """Return a function that writes a layout of a task's parts into (worlds, slots, block) float32."""
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
    """Dictionary of ``parts``, a row of numbers in [-1, 1] per slot, and ``mask``, 1 where a part is present.

    Part p has row p; rows of absent parts and empty slots are 0.

    Attributes:
        row_layout: features of a row.
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
    """The dictionary of ``"parts"`` with a further key ``state``, for residual policies on a classical controller."""

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
            raise checks.conflict(
                f"observation 'goal' requires a task with one part and a fixed goal pose; others: {have}"
            )
        n, surface = task.goal_size(), task.surface
        self.low = np.array([-0.1, -0.1, -self.TURN_LIMIT], dtype=np.float32)[:n]
        self.high = np.array([surface.width + 0.1, surface.depth + 0.1, self.TURN_LIMIT], dtype=np.float32)[:n]

    @property
    def space(self) -> spaces.Space:
        goals = (spaces.Box(self.low, self.high, dtype=np.float32) for _ in range(2))
        return spaces.Dict({"observation": super().space, "achieved_goal": next(goals), "desired_goal": next(goals)})

    def reached(self, pose: np.ndarray) -> np.ndarray:
        """Return goals (worlds, goal_size) of poses (worlds, parts, 3)."""
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


class ImageObservation(Observation):
    """uint8 image (rows x 6, columns x 6, 3), row 0 at the largest y.

    Channel 0: the parts, 255 for the first kind, 170 for the second and 85 for the third. Channel 1: the zones, with the
    values of their kinds, or the parts' outlines at their goal poses; their value is that of the kind, or for unwrapped
    headings 128 plus the heading error (128 levels to two full turns).
    Channel 2: checkerboard of the elements, and the parts' heading marks.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        values = np.array(KIND_VALUES, dtype=np.uint8)
        outlines = [np.array(part.outline) for part in task.parts]
        zones = np.zeros((0, 4)) if task.zones is None else task.zones
        self.marks = Marks(
            outline=np.concatenate(outlines),
            first=np.cumsum([0, *(len(outline) for outline in outlines)]),
            value=values[task.kind],
            zone=zones,
            zone_value=values[: len(zones)],
        )
        self._unwrapped = task.has_heading and all(task.heading_period(part) == 0.0 for part in task.parts)
        self.shape = (task.surface.rows * PIXELS, task.surface.columns * PIXELS, 3)

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(0, 255, self.shape, np.uint8)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        surface, pose = self.task.surface, measurement.pose
        image = np.empty((len(pose), *self.shape), dtype=np.uint8)
        shown = np.zeros(pose.shape[:2], dtype=np.uint8)
        if self.task.has_goal:
            shown[:] = self.marks.value
            if self._unwrapped:
                level = np.rint(128.0 + relations.error[..., 2] * (127.0 / (4.0 * math.pi)))
                shown[:] = np.clip(level, 1.0, 255.0)
            shown[:, ~self.task.asked] = 0
        rasterise(
            pose, episode.present, episode.goal, shown, self.marks,
            surface.rows, surface.columns, surface.element_size, PIXELS, image,
        )  # fmt: skip
        return image


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
