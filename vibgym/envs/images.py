"""Image observation, drawn from the measurement."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym.envs.base import Observation
from vibgym.rendering.raster import Marks, rasterise
from vibgym.sensing import Measurement
from vibgym.tasks import Task
from vibgym.tasks.episode import Episode, Relations

PIXELS = 6  # along an element, in an image
KIND_VALUES = (255, 170, 85)
"""Brightness of the first, second and third kind in an image."""


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
            shown[:, ~self.task.asked] = 0  # of these there is nothing to show
        rasterise(
            pose, episode.present, episode.goal, shown, self.marks,
            surface.rows, surface.columns, surface.element_size, PIXELS, image,
        )  # fmt: skip
        return image
