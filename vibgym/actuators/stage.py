"""Actuator stage of a step: the interface between environments and actuators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vibgym.physics.core.drive import Drive
from vibgym.scene.surface import Surface
from vibgym.snapshots import Live


@dataclass(frozen=True)
class DataSheet:
    """Nominal properties of actuators, known beforehand and equal for all elements."""

    limit: float  # m, largest amplitude that they do
    dead_zone: float = 0.0  # m, amplitude below which they do little or nothing
    dead_zone_form: str = "hard"  # what becomes of smaller ones, see :data:`vibgym.physics.core.hardware.FORMS`
    latency: int = 0  # periods between a command and its effect
    resolution: float = 0.0  # m, of the amplitude; 0: continuous
    bandwidth: float | None = None  # Hz, of a lag of first order; None: they follow at once


class ActuatorStage(Live, ABC):
    """From a step's command to the drives that act; batched.

    Args:
        surface: the table.
        worlds: number of worlds.
        periods: oscillation periods of a step.

    Attributes:
        latency: periods between a command and its effect, as the data sheet has it.
        most_latency: largest that an episode may draw.
    """

    SNAPSHOT = "actuators"

    latency: int = 0
    most_latency: int = 0

    draws: int = 0
    """Uniform numbers that they need at the start of each episode, in :meth:`reset`."""

    VARIED: ClassVar[tuple[str, ...]] = ()
    """Settings that ``randomize=`` may give a range, see :meth:`vary`."""

    def __init__(self, surface: Surface, worlds: int, periods: int) -> None:
        self.surface, self.worlds, self.periods = surface, worlds, periods

    @property
    def data_sheet(self) -> DataSheet:
        """What policies may know of them beforehand."""
        assert self.surface.max_amplitude is not None
        return DataSheet(self.surface.max_amplitude, latency=self.latency)

    @property
    def most_amplitude(self) -> float:
        """m, largest amplitude of any element in any episode."""
        assert self.surface.max_amplitude is not None
        return self.surface.max_amplitude

    @property
    def least_latency(self) -> int:
        """Periods at the start of any episode in which all elements rest."""
        return self.latency

    def nominal(self) -> ActuatorStage | None:
        """Return actuators of the data sheet, without latency, for a model; None: ideal ones."""
        return None

    def prepare(self, command: Drive) -> None:
        """See what commands will look like, once, before the first of them."""

    def vary(self, ranges: Mapping[str, Any]) -> None:
        """Draw settings for each episode from ranges: name among :attr:`VARIED` -> (least, largest).

        Raises:
            ValueError: a bad range; no others than these names are asked for.
        """
        assert not ranges

    def drawn(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) of the values drawn for the episodes, by name."""
        return {}

    @abstractmethod
    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Start afresh in ``worlds`` (index array), all elements at rest.

        Args:
            uniform: (len(worlds), draws) in [0, 1).
        """

    @abstractmethod
    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        """Return the executed drives of the step that begins with this command, and the number of periods of each.

        They are good one after the other: one that has been handed out ends the one before.
        """


class IdealActuators(ActuatorStage):
    """Ideal actuators: commands are executed exactly and without delay, and read for the elements under a part only."""

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        pass

    def apply(self, command: Drive) -> Sequence[tuple[Drive, int]]:
        return ((command, self.periods),)
