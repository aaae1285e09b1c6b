"""Ideal actuators: the elements do what they are told, at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym.actuators.base import Actuators
from vibgym.physics.core.drive import Drive
from vibgym.scene.surface import Surface


class IdealActuators(Actuators):
    """Elements that follow every command without delay; it is read for the elements under a part only."""

    latency = 0

    def __init__(self, surface: Surface, worlds: int, periods: int) -> None:
        self.surface, self.worlds, self.periods = surface, worlds, periods

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Nothing to do: they remember nothing."""

    def apply(self, command: Drive) -> Sequence[tuple[Drive, int]]:
        return ((command, self.periods),)

    def realise(self, phasors: np.ndarray) -> None:
        """As they are."""

    def live(self) -> dict[str, np.ndarray]:
        return {}
