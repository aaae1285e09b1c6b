"""Base class of custom actuators."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.physics.core.drive import Drive, all_phasors, cartesian_drive, limit_phasors
from vibgym.scene.surface import Surface


class Actuators(ActuatorStage):
    """Base class of custom actuators: batched, with a latency in periods; every step reads all elements.

    Custom actuators are a subclass with :meth:`realise`, registered by ``vibgym.actuators.ACTUATORS.register``.

    Raises:
        ValueError: a latency whose commands do not fit into memory.
    """

    class Settings(ActuatorStage.Settings):
        """Settings of all custom actuators."""

        latency: int = Field(default=0, ge=0, le=10_000)
        """Periods between a command and its effect. Until then the elements follow the previous command; they rest at the start
        of an episode."""

    settings: Settings

    def __init__(self, surface: Surface, worlds: int, periods: int, settings: Settings | None = None) -> None:
        super().__init__(surface, worlds, periods, settings)
        step = 16 * worlds * surface.rows * surface.columns  # bytes
        self.latency = checks.fitting("actuators.latency", self.settings.latency, step / periods)
        self.most_latency = self.latency
        shape = (self.latency // periods + 2, worlds, surface.rows, surface.columns, 2)
        self._realised = np.zeros(shape)  # C, S (m/s^2) of every element for the last steps, the oldest first

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        self._realised[:, worlds] = 0.0
        self.begin(worlds, uniform)

    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        self._realised[:-1] = self._realised[1:]
        all_phasors(command, self._realised[-1])
        self.realise(self._realised[-1])
        late = self.latency % self.periods  # periods of this step that belong to the previous command
        stretches = ((self._realised[0], late), (self._realised[1], self.periods - late))
        return [(self._drive(phasors), periods) for phasors, periods in stretches if periods > 0]

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw what is constant during the episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def realise(self, phasors: np.ndarray) -> None:
        """Transform commanded phasors (worlds, rows, columns, 2), C and S in m/s^2, into executed ones, in place."""

    def custom_state(self) -> dict[str, np.ndarray]:
        """Return further live arrays of a snapshot, by name."""
        return {}

    def live(self) -> dict[str, np.ndarray]:
        return {"realised": self._realised, **self.custom_state()}

    def _drive(self, phasors: np.ndarray) -> Drive:
        c, s = np.empty(phasors.shape[:3]), np.empty(phasors.shape[:3])
        limit_phasors(phasors, self.surface.full_scale, c, s)
        return cartesian_drive(c, s)
