"""The ideal sensor, and the pose sensor with white noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vibgym.physics.core.records import State
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Reading

POSITION_NOISE, HEADING_NOISE = 1e-4, math.radians(0.2)


class IdealSensor(Sensor):
    """Sensor of true poses and mean velocities, by default without delay; arrays are not copied unless needed.

    With effects, velocities are differences of readings, as for :class:`vibgym.sensing.PoseSensor`.
    """

    @property
    def exact(self) -> bool:
        return self.delay == 0 and self.every == 1 and not self._effects

    def measure(self, state: State, reading: Reading) -> None:
        for read, true in zip(reading, (state.pose, state.mean_velocity, state.fallen), strict=False):
            read[...] = true


class PoseSensor(IdealSensor):
    """Sensor of every part's pose with noise; velocities are differences of successive poses.

    The ideal sensor with a permanent effect.
    """

    class Settings(IdealSensor.Settings):
        """Settings of the pose sensor: those of every sensor, with noise by default."""

        effects: Mapping[str, Any] = {"noise": (POSITION_NOISE, HEADING_NOISE)}

    settings: Settings
