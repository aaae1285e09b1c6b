"""The ideal sensor: the truth, at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym.physics.core.records import State
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Measurement, Sensor


class IdealSensor(Sensor):
    """Knows true poses and mean velocities without delay: its measurement is the live true state, and nothing is copied."""

    exact = True

    def __init__(self, surface: Surface, worlds: int, parts: int, periods: int) -> None:
        super().__init__(surface, worlds, parts, periods)
        self._truth: Measurement | None = None

    @property
    def measurement(self) -> Measurement:
        """The true state."""
        assert self._truth is not None  # an episode has begun
        return self._truth

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        self._truth = Measurement(state.pose, state.mean_velocity, state.fallen)

    def look(self, state: State) -> None:
        """Nothing to do: the state is live."""

    def measure(self, state: State, measurement: Measurement) -> None:
        for seen, true in zip(measurement, (state.pose, state.mean_velocity, state.fallen), strict=True):
            seen[...] = true

    def _state(self) -> dict[str, Any]:
        return {}
