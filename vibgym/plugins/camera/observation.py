"""Observation ``"camera"``: the latest delayed image."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.envs import Observation
from vibgym.plugins.camera.sensor import CameraSensor
from vibgym.sensing import Measurement, Sensor
from vibgym.tasks.episode import Episode, Relations


class CameraObservation(Observation):
    """uint8 image (lines, columns): the latest delayed camera image, with noise and distortion."""

    extra = False

    def watch(self, sensor: Sensor) -> None:
        if not isinstance(sensor, CameraSensor):
            raise checks.conflict("observation='camera' requires sensor='camera', or a mapping of that kind")
        self._camera = sensor
        sensor.keep_pictures()

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(0, 255, self._camera.setup.shape, np.uint8)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        return self._camera.image()
