"""Ideal actuators: elements execute commands exactly and without delay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym.actuators.stage import ActuatorStage
from vibgym.physics.core.drive import Drive


class IdealActuators(ActuatorStage):
    """Elements that follow every command without delay; it is read for the elements under a part only."""

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Nothing to do: they remember nothing."""

    def apply(self, command: Drive) -> Sequence[tuple[Drive, int]]:
        return ((command, self.periods),)
