"""The ideal sensor: the truth, at once."""

from __future__ import annotations

from vibgym.physics.core.records import State
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Reading


class IdealSensor(Sensor):
    """Knows true poses and mean velocities, without delay unless it is asked for; nothing is copied unless somebody wants to.

    With effects its velocities are differences of what it reads, as those of :class:`vibgym.sensing.PoseSensor` are.
    """

    @property
    def exact(self) -> bool:
        return self.delay == 0 and self.every == 1 and not self._effects

    def measure(self, state: State, reading: Reading) -> None:
        for read, true in zip(reading, (state.pose, state.mean_velocity, state.fallen), strict=False):
            read[...] = true
