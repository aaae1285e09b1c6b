"""From what is commanded to what the elements do: the door that all actuators go through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.actuators.data_sheet import DataSheet
from vibgym.physics.core.drive import Drive, all_phasors, cartesian_drive, limit_phasors
from vibgym.scene.surface import Surface
from vibgym.snapshots import copied, restored


class Actuators(ABC):
    """Base of all actuators: batched, with a latency in periods.

    Actuators of your own are a subclass with :meth:`realise`, and ``vibgym.actuators.ACTUATORS.register`` gives them a name.

    Args:
        surface: the table.
        worlds: number of worlds.
        periods: oscillation periods of a step.
        latency: periods between a command and its effect; until then the elements do what they were told before, and at the
            start of an episode they rest.

    Raises:
        ValueError: a bad setting.
    """

    draws: int = 0
    """Uniform numbers that they need at the start of each episode, in :meth:`begin`."""

    VARIED: ClassVar[tuple[str, ...]] = ()
    """Settings that ``randomize=`` may give a range, see :meth:`vary`."""

    def __init__(self, surface: Surface, worlds: int, periods: int, *, latency: int = 0) -> None:
        self.surface, self.worlds, self.periods = surface, worlds, periods
        self.latency = checks.count("actuators.latency", latency, least=0, most=10_000)
        shape = (self.latency // periods + 2, worlds, surface.rows, surface.columns, 2)
        self._realised = np.zeros(shape)  # C, S (m/s^2) of every element for the last steps, the oldest first

    @property
    def data_sheet(self) -> DataSheet:
        """What policies may know of them beforehand."""
        assert self.surface.max_amplitude is not None
        return DataSheet(self.surface.max_amplitude, latency=self.latency)

    def nominal(self) -> Actuators:
        """Actuators as the data sheet has them, without latency: what a model of the machine goes by.

        Actuators of your own are taken for ideal ones unless you say more here.
        """
        from vibgym.actuators.ideal import IdealActuators  # which is one of these

        return IdealActuators(self.surface, self.worlds, self.periods)

    def prepare(self, command: Drive) -> None:  # noqa: B027 - most need no such thing
        """See what commands will look like, once, before the first of them."""

    def vary(self, ranges: Mapping[str, Any]) -> None:
        """Draw settings for each episode from ranges: name among :attr:`VARIED` -> (least, largest).

        Raises:
            ValueError: a bad range; no others than these names are asked for.
        """
        assert not ranges

    def drawn(self) -> dict[str, np.ndarray]:
        """What has been drawn for the episodes, by name: live arrays (worlds, ...)."""
        return {}

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Start afresh in ``worlds`` (index array), all elements at rest.

        Args:
            uniform: (len(worlds), draws) in [0, 1).
        """
        self._realised[:, worlds] = 0.0
        self.begin(worlds, uniform)

    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        """What the elements do in the step that begins with this command: drives, and for how many periods each.

        They are good one after the other: one that has been handed out ends the one before.
        """
        self._realised[:-1] = self._realised[1:]
        all_phasors(command, self._realised[-1])
        self.realise(self._realised[-1])
        late = self.latency % self.periods  # of this step's periods still belong to the command before
        stretches = ((self._realised[0], late), (self._realised[1], self.periods - late))
        return [(self._drive(phasors), periods) for phasors, periods in stretches if periods > 0]

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:  # noqa: B027 - most have nothing to do
        """Set what holds for the whole episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def realise(self, phasors: np.ndarray) -> None:
        """Turn commanded phasors (worlds, rows, columns, 2), C and S in m/s^2, into those that the elements do, in place."""

    def own_state(self) -> dict[str, np.ndarray]:
        """Live arrays that belong to a snapshot, by name, besides what the base class keeps."""
        return {}

    def get_state(self) -> dict[str, Any]:
        """Everything needed to go on bit for bit."""
        return copied(self.live())

    def check_state(self, state: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """What :meth:`get_state` gave, checked; for :meth:`set_state`."""
        return restored("state['actuators']", self.live(), state)

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a checked state."""
        for name, values in self.live().items():
            values[...] = state[name]

    def live(self) -> dict[str, np.ndarray]:
        """All live arrays of a snapshot."""
        return {"realised": self._realised, **self.own_state()}

    def _drive(self, phasors: np.ndarray) -> Drive:
        c, s = np.empty(phasors.shape[:3]), np.empty(phasors.shape[:3])
        limit_phasors(phasors, self.surface.full_scale, c, s)
        return cartesian_drive(c, s)
