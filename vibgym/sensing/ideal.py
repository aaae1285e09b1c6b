"""The ideal sensor: the truth, at once."""

from __future__ import annotations

from collections.abc import Sequence

from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Reading


class IdealSensor(Sensor):
    """Knows true poses and mean velocities without delay; nothing is copied unless an estimator wants to know it."""

    exact = True

    def __init__(self, surface: Surface, parts: Sequence[Part], worlds: int, periods: int) -> None:
        super().__init__(surface, parts, worlds, periods)

    def measure(self, state: State, reading: Reading) -> None:
        for read, true in zip(reading, (state.pose, state.mean_velocity, state.fallen), strict=False):
            read[...] = true
