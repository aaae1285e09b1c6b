"""Observations: what a policy gets to see, as a flat state, a goal dictionary or an image."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym.physics.core.jit import jit
from vibgym.rendering.raster import rasterise
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.pose import PoseTask, Score

STATE_SIZE = 18
COARSE, FINE = 0.050, 0.005  # m, scales of the position error
COARSE_TURN, FINE_TURN = 0.5, 0.05  # rad, scales of the heading error
SPIN_SCALE = 10.0  # rad/s
LEAST_SPEED = 1e-3  # m/s, taken for the table's where that is slower
PIXELS = 6  # along an element, in an image


@jit
def _unit(value):
    return min(max(value, -1.0), 1.0)


@jit
def state_observation(pose, mean_velocity, error, size, symmetry, speed, element_size, out):
    """Write the flat state of every world into ``out`` (worlds, STATE_SIZE) float32."""
    longer = max(size[0], size[1])
    for w in range(pose.shape[0]):
        for axis in range(2):
            at = pose[w, 0, axis] / element_size
            out[w, axis] = 2.0 * (at - math.floor(at)) - 1.0
            out[w, 4 + axis] = _unit(2.0 * pose[w, 0, axis] / size[axis] - 1.0)
            out[w, 6 + axis] = _unit(error[w, axis] / longer)
            out[w, 8 + axis] = math.tanh(error[w, axis] / COARSE)
            out[w, 10 + axis] = math.tanh(error[w, axis] / FINE)
            out[w, 15 + axis] = _unit(mean_velocity[w, 0, axis] / speed)
        out[w, 2] = math.cos(symmetry * pose[w, 0, 2])
        out[w, 3] = math.sin(symmetry * pose[w, 0, 2])
        out[w, 12] = _unit(error[w, 2] / (2.0 * math.pi))
        out[w, 13] = math.tanh(error[w, 2] / COARSE_TURN)
        out[w, 14] = math.tanh(error[w, 2] / FINE_TURN)
        out[w, 17] = _unit(mean_velocity[w, 0, 2] / SPIN_SCALE)


class StateObservation:
    """One flat float32 box of 18 numbers in [-1, 1] (table in :class:`vibgym.envs.VibgymEnv`)."""

    def __init__(self, surface: Surface, part: Part, task: PoseTask) -> None:
        self.surface, self.part = surface, part
        self.size = np.array([surface.width, surface.height])
        self.speed = max(surface.table_speed, LEAST_SPEED)

    @property
    def space(self) -> spaces.Space:
        """Space of one world."""
        return spaces.Box(-1.0, 1.0, (STATE_SIZE,), np.float32)

    def observe(self, pose: np.ndarray, mean_velocity: np.ndarray, goal: np.ndarray, score: Score) -> Any:
        """A fresh batch of observations."""
        out = np.empty((len(pose), STATE_SIZE), dtype=np.float32)
        state_observation(
            pose,
            mean_velocity,
            score.error,
            self.size,
            self.part.symmetry,
            self.speed,
            self.surface.element_size,
            out,
        )
        return out


class GoalObservation(StateObservation):
    """GoalEnv dictionary: ``observation`` (the flat state), ``achieved_goal`` and ``desired_goal`` in m and rad."""

    TURN_LIMIT = 8.0 * math.pi

    def __init__(self, surface: Surface, part: Part, task: PoseTask) -> None:
        super().__init__(surface, part, task)
        n = task.goal_size()
        self.low = np.array([-0.1, -0.1, -self.TURN_LIMIT], dtype=np.float32)[:n]
        self.high = np.array([surface.width + 0.1, surface.height + 0.1, self.TURN_LIMIT], dtype=np.float32)[:n]

    @property
    def space(self) -> spaces.Space:
        goal = spaces.Box(self.low, self.high, dtype=np.float32)
        return spaces.Dict(
            {
                "observation": super().space,
                "achieved_goal": goal,
                "desired_goal": spaces.Box(self.low, self.high, dtype=np.float32),
            }
        )

    def observe(self, pose: np.ndarray, mean_velocity: np.ndarray, goal: np.ndarray, score: Score) -> Any:
        n = len(self.low)
        return {
            "observation": super().observe(pose, mean_velocity, goal, score),
            "achieved_goal": np.clip(pose[:, 0, :n].astype(np.float32), self.low, self.high),
            "desired_goal": np.clip(goal[:, :n].astype(np.float32), self.low, self.high),
        }


class ImageObservation:
    """uint8 image (rows x 6, columns x 6, 3), row 0 at the largest y.

    Channel 0: the part. Channel 1: the part's outline at the goal pose; its value is 255, or for unwrapped headings
    128 plus the remaining turn (128 levels to two full turns), which a picture of the goal pose alone could not show.
    Channel 2: checkerboard of the elements, and the part's heading mark.
    """

    def __init__(self, surface: Surface, part: Part, task: PoseTask) -> None:
        self.surface = surface
        self.outline = np.array(part.outline)
        self.unwrapped = task.has_heading and task.rules.heading_period == 0.0
        self.shape = (surface.rows * PIXELS, surface.columns * PIXELS, 3)

    @property
    def space(self) -> spaces.Space:
        """Space of one world."""
        return spaces.Box(0, 255, self.shape, np.uint8)

    def observe(self, pose: np.ndarray, mean_velocity: np.ndarray, goal: np.ndarray, score: Score) -> Any:
        """A fresh batch of observations."""
        image = np.empty((len(pose), *self.shape), dtype=np.uint8)
        value = np.full(len(pose), 255, dtype=np.uint8)
        if self.unwrapped:
            level = np.rint(128.0 + score.error[:, 2] * (127.0 / (4.0 * math.pi)))
            value = np.clip(level, 1.0, 255.0).astype(np.uint8)
        rasterise(
            np.ascontiguousarray(pose[:, 0]),
            self.outline,
            goal,
            value,
            self.surface.rows,
            self.surface.columns,
            self.surface.element_size,
            PIXELS,
            image,
        )
        return image


OBSERVATIONS: dict[str, Any] = {"state": StateObservation, "goal": GoalObservation, "image": ImageObservation}
