"""Actuator stage of a step: base classes of actuators, and ideal actuators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vibgym.physics.core.drive import Drive
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings
from vibgym.snapshots import Live


@dataclass(frozen=True)
class DataSheet:
    """Nominal properties of actuators, equal for all elements and available to policies."""

    limit: float  # m, largest amplitude
    dead_zone: float = 0.0  # m, amplitude below which elements hardly move
    dead_zone_form: str = "hard"  # response to smaller amplitudes, see :data:`vibgym.physics.core.hardware.FORMS`
    latency: int = 0  # periods between a command and its effect
    resolution: float = 0.0  # m, of the amplitude; 0: continuous
    bandwidth: float | None = None  # Hz, of a first-order lag; None: no lag


class ActuatorStage(Live, ABC):
    """Base class of actuators: the drives executed for a command; batched.

    Args:
        surface: the table.
        worlds: number of worlds.
        periods: oscillation periods of a step.
        settings: None: the defaults.

    Attributes:
        latency: nominal periods between a command and its effect.
        most_latency: largest latency that an episode may draw.
    """

    SNAPSHOT = "actuators"

    class Settings(BaseSettings):
        """Settings of actuators."""

    settings: Settings

    latency: int = 0
    most_latency: int = 0

    draws: int = 0
    """Number of uniform random numbers for :meth:`reset` at the start of each episode."""

    VARIED: ClassVar[tuple[str, ...]] = ()
    """Settings with optional ranges in ``randomize=``, see :meth:`vary`."""

    def __init__(self, surface: Surface, worlds: int, periods: int, settings: Settings | None = None) -> None:
        self.surface, self.worlds, self.periods = surface, worlds, periods
        self.settings = type(self).Settings() if settings is None else settings

    @property
    def data_sheet(self) -> DataSheet:
        """Nominal properties, which policies may use."""
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

    def nominal(self) -> ActuatorStage:
        """Return actuators with the properties of the data sheet, without latency, for a model; by default ideal ones."""
        return IdealActuators(self.surface, self.worlds, self.periods)

    def compensated(self, command: Drive) -> Drive:
        """Return the command that elements get for this one; the same, unless their known response is compensated.

        The result is valid until the next call.
        """
        return command

    def prepare(self, command: Drive) -> None:
        """Allocate buffers for commands of this form, once, before the first of them."""

    def vary(self, ranges: Mapping[str, Any]) -> None:
        """Draw settings for each episode from ranges: name among :attr:`VARIED` -> (least, largest).

        Raises:
            ValueError: a bad range.
        """
        assert not ranges

    def drawn(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) of the values drawn for the episodes, by name."""
        return {}

    @abstractmethod
    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Restart in ``worlds`` (index array), all elements at rest.

        Args:
            uniform: (len(worlds), draws) in [0, 1).
        """

    @abstractmethod
    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        """Return the executed drives of the step that begins with this command, and the number of periods of each.

        A drive is valid until the next one is taken from the iterable.
        """


class IdealActuators(ActuatorStage):
    """Ideal actuators: commands are executed exactly and without delay; only elements under a part are read."""

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        pass

    def apply(self, command: Drive) -> Sequence[tuple[Drive, int]]:
        return ((command, self.periods),)
