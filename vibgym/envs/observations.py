"""Observations: what a policy gets to see of a measurement, flat, by parts, as a goal dictionary or an image."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym._numba.jit import borrowing
from vibgym._numba.reference import Layout, Pinned
from vibgym.envs import layout as table
from vibgym.envs.base import Observation
from vibgym.envs.row_observation import PartsObservation
from vibgym.registry import Registry
from vibgym.rendering.raster import Marks, rasterise
from vibgym.sensing import Measurement, Sensor
from vibgym.sensing.camera import CameraSensor
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import PREVIEW, Episode, Relations

PIXELS = 6  # along an element, in an image
KIND_VALUES = (255, 170, 85)
"""Brightness of the first, second and third kind in an image."""

# The rows of the table as the kernel's constants.
PRESENT, KIND, ELEMENT, HEADING, POSITION = table.PRESENT, table.KIND, table.ELEMENT, table.HEADING, table.POSITION
WAY, WAY_COARSE, WAY_FINE = table.WAY, table.WAY_COARSE, table.WAY_FINE
TURN, TURN_COARSE, TURN_FINE = table.TURN, table.TURN_COARSE, table.TURN_FINE
VELOCITY, SPIN, GAP, NEIGHBOUR = table.VELOCITY, table.SPIN_RATE, table.GAP, table.NEIGHBOUR
GOAL_VELOCITY, GOAL_SPIN, WAY_AHEAD, TURN_AHEAD = (
    table.GOAL_VELOCITY, table.GOAL_SPIN, table.WAY_AHEAD, table.TURN_AHEAD,
)  # fmt: skip
AGE, SIGMA = table.AGE, table.SIGMA


class Blocks(NamedTuple):
    """What the kernel needs besides the measurement, pinned in memory."""

    relations: Relations  # of the measured poses
    present: np.ndarray  # (worlds, parts) bool
    motion: np.ndarray  # (worlds, parts, ...) of the goals, see vibgym.tasks.episode.Episode
    traits: np.ndarray  # (parts, 2) int64, kind and symmetry
    column: np.ndarray  # of the layout: where each feature stands, -1: nowhere, ...
    scale: np.ndarray  # ... and in what unit


BLOCKS: Layout[Blocks] = Layout("BLOCKS", __name__)
blocks_at = BLOCKS.at


@borrowing
def _unit(value):
    return min(max(value, -1.0), 1.0)


@borrowing
def write_blocks(pose, mean_velocity, age, sigma, blocks, size, flat):
    """Write every world's state observation into ``flat`` (worlds, slots x size) float32.

    Args:
        pose, mean_velocity, age, sigma: measured.
        blocks: address of pinned :class:`Blocks`.
        size: numbers in a block.
    """
    seen = blocks_at(blocks)
    present, traits, column, scale = seen.present, seen.traits, seen.column, seen.scale
    error, gap, neighbour = seen.relations.error, seen.relations.gap, seen.relations.neighbour
    motion = seen.motion
    for w in range(pose.shape[0]):
        for k in range(flat.shape[1]):
            flat[w, k] = 0.0
        for p in range(pose.shape[1]):
            if not present[w, p]:
                continue
            block = flat[w, p * size : (p + 1) * size]
            if column[PRESENT] >= 0:
                block[column[PRESENT]] = 1.0
            if column[KIND] >= 0:
                block[column[KIND] + traits[p, 0]] = 1.0
            for axis in range(2):
                at = pose[w, p, axis]
                if column[ELEMENT] >= 0:
                    place = at / (2.0 * scale[ELEMENT, axis])
                    block[column[ELEMENT] + axis] = 2.0 * (place - math.floor(place)) - 1.0
                if column[POSITION] >= 0:
                    block[column[POSITION] + axis] = _unit(at / scale[POSITION, axis] - 1.0)
                if column[WAY] >= 0:
                    block[column[WAY] + axis] = _unit(error[w, p, axis] / scale[WAY, axis])
                if column[WAY_COARSE] >= 0:
                    block[column[WAY_COARSE] + axis] = math.tanh(error[w, p, axis] / scale[WAY_COARSE, axis])
                if column[WAY_FINE] >= 0:
                    block[column[WAY_FINE] + axis] = math.tanh(error[w, p, axis] / scale[WAY_FINE, axis])
                if column[VELOCITY] >= 0:
                    block[column[VELOCITY] + axis] = _unit(mean_velocity[w, p, axis] / scale[VELOCITY, axis])
            if column[HEADING] >= 0:
                block[column[HEADING]] = math.cos(traits[p, 1] * pose[w, p, 2])
                block[column[HEADING] + 1] = math.sin(traits[p, 1] * pose[w, p, 2])
            if column[TURN] >= 0:
                block[column[TURN]] = _unit(error[w, p, 2] / scale[TURN, 0])
            if column[TURN_COARSE] >= 0:
                block[column[TURN_COARSE]] = math.tanh(error[w, p, 2] / scale[TURN_COARSE, 0])
            if column[TURN_FINE] >= 0:
                block[column[TURN_FINE]] = math.tanh(error[w, p, 2] / scale[TURN_FINE, 0])
            if column[SPIN] >= 0:
                block[column[SPIN]] = _unit(mean_velocity[w, p, 2] / scale[SPIN, 0])
            if column[GAP] >= 0:
                block[column[GAP]] = math.tanh(gap[w, p] / scale[GAP, 0])
            if column[GOAL_VELOCITY] >= 0:
                for axis in range(2):
                    block[column[GOAL_VELOCITY] + axis] = _unit(motion[w, p, axis] / scale[GOAL_VELOCITY, axis])
            if column[GOAL_SPIN] >= 0:
                block[column[GOAL_SPIN]] = _unit(motion[w, p, 2] / scale[GOAL_SPIN, 0])
            for ahead in range(PREVIEW):
                if column[WAY_AHEAD] >= 0:
                    for axis in range(2):
                        way = error[w, p, axis] + motion[w, p, 3 + 3 * ahead + axis]
                        block[column[WAY_AHEAD] + 2 * ahead + axis] = _unit(way / scale[WAY_AHEAD, axis])
                if column[TURN_AHEAD] >= 0:
                    turn = error[w, p, 2] + motion[w, p, 5 + 3 * ahead]
                    block[column[TURN_AHEAD] + ahead] = _unit(turn / scale[TURN_AHEAD, 0])
            if column[AGE] >= 0:
                block[column[AGE]] = math.tanh(age[w, p] / scale[AGE, 0])
            if column[SIGMA] >= 0:
                unsure = math.sqrt(sigma[w, p, 0] * sigma[w, p, 0] + sigma[w, p, 1] * sigma[w, p, 1])
                block[column[SIGMA]] = math.tanh(unsure / scale[SIGMA, 0])
                block[column[SIGMA] + 1] = math.tanh(sigma[w, p, 2] / scale[SIGMA, 1])
            other = neighbour[w, p]
            if column[NEIGHBOUR] >= 0 and other >= 0:
                dx, dy = pose[w, other, 0] - pose[w, p, 0], pose[w, other, 1] - pose[w, p, 1]
                apart = math.sqrt(dx * dx + dy * dy)
                if apart > 0.0:
                    block[column[NEIGHBOUR]], block[column[NEIGHBOUR] + 1] = dx / apart, dy / apart


class StateObservation(Observation):
    """One flat float32 box in [-1, 1]: a block of numbers for each slot, part p in slot p; see the layout."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        traits = np.column_stack([task.kind, [part.symmetry for part in task.parts]])
        self._traits = np.ascontiguousarray(traits)
        self._relations: Relations | None = None
        self._blocks: Any = None

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        out = np.empty((len(measurement.pose), self.layout.size), dtype=np.float32)
        if relations is not self._relations:  # the same ones ever after
            layout = self.layout
            blocks = Blocks(relations, episode.present, episode.motion, self._traits, layout.column, layout.scale)
            self._relations, self._blocks = relations, Pinned(BLOCKS, blocks)
        pose, mean_velocity, _, age, sigma = measurement
        write_blocks(pose, mean_velocity, age, sigma, self._blocks.address, self.layout.block, out)
        return out


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
            raise checks.refuse("observation", "goal", "'state', 'image' (only tasks with a goal pose have 'goal')")
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


class ImageObservation(Observation):
    """uint8 image (rows x 6, columns x 6, 3), row 0 at the largest y.

    Channel 0: the parts, 255 for the first kind, 170 for the second and 85 for the third. Channel 1: the zones, with the
    values of their kinds, or the parts' outlines at their goal poses; their value is that of the kind, or for unwrapped
    headings 128 plus the remaining turn (128 levels to two full turns), which a picture of the goal pose alone could not show.
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
        rasterise(
            pose, episode.present, episode.goal, shown, self.marks,
            surface.rows, surface.columns, surface.element_size, PIXELS, image,
        )  # fmt: skip
        return image


class CameraObservation(Observation):
    """uint8 image (lines, columns): what the camera saw at the look that is due, with all its noise and distortion."""

    beside = False

    def watch(self, sensor: Sensor) -> None:
        if not isinstance(sensor, CameraSensor):
            raise checks.refuse(
                "observation", "camera", "'camera' only with sensor='camera', or a mapping of that kind"
            )
        self._camera = sensor
        sensor.keep_pictures()

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(0, 255, self._camera.setup.shape, np.uint8)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        return self._camera.image()


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
