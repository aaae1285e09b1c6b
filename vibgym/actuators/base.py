"""Base class of actuators that transform each element's phasor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

import numpy as np

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.physics.core.drive import Drive, all_phasors, cartesian_drive, limit_phasors
from vibgym.scene.surface import Surface


class Actuators(ActuatorStage):
    """Base of actuators of your own: batched, with a latency in periods; all elements are looked at in every step.

    Such actuators are a subclass with :meth:`realise`, and ``vibgym.actuators.ACTUATORS.register`` gives them a name.

    Args:
        surface: the table.
        worlds: number of worlds.
        periods: oscillation periods of a step.
        latency: periods between a command and its effect; until then the elements follow the previous command, and at the
            start of an episode they rest.

    Raises:
        ValueError: a bad setting.
    """

    def __init__(self, surface: Surface, worlds: int, periods: int, *, latency: int = 0) -> None:
        super().__init__(surface, worlds, periods)
        latency = checks.count("actuators.latency", latency, least=0, most=10_000)
        step = 16 * worlds * surface.rows * surface.columns  # bytes
        self.latency = self.most_latency = checks.fitting("actuators.latency", latency, step / periods)
        shape = (self.latency // periods + 2, worlds, surface.rows, surface.columns, 2)
        self._realised = np.zeros(shape)  # C, S (m/s^2) of every element for the last steps, the oldest first

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        self._realised[:, worlds] = 0.0
        self.begin(worlds, uniform)

    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        self._realised[:-1] = self._realised[1:]
        all_phasors(command, self._realised[-1])
        self.realise(self._realised[-1])
        late = self.latency % self.periods  # of this step's periods still belong to the command before
        stretches = ((self._realised[0], late), (self._realised[1], self.periods - late))
        return [(self._drive(phasors), periods) for phasors, periods in stretches if periods > 0]

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Set what holds for the whole episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def realise(self, phasors: np.ndarray) -> None:
        """Transform commanded phasors (worlds, rows, columns, 2), C and S in m/s^2, into executed ones, in place."""

    def own_state(self) -> dict[str, np.ndarray]:
        """Return further live arrays of a snapshot, by name."""
        return {}

    def live(self) -> dict[str, np.ndarray]:
        return {"realised": self._realised, **self.own_state()}

    def _drive(self, phasors: np.ndarray) -> Drive:
        c, s = np.empty(phasors.shape[:3]), np.empty(phasors.shape[:3])
        limit_phasors(phasors, self.surface.full_scale, c, s)
        return cartesian_drive(c, s)
