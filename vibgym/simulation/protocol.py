"""What every model follows, and what it is made for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vibgym._numba.reference import Pinned
from vibgym.physics.collision.hulls import Hulls
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.conditions import Conditions

NO_PATHS = np.empty((0, 0, 3))
"""For kernels that write down paths only if they are asked to."""


@dataclass(frozen=True)
class Setup:
    """What a model is made for."""

    surface: Surface
    parts: tuple[Part, ...]
    walls: tuple[str, ...]
    hulls: Hulls  # of the parts
    worlds: int

    @property
    def multibody(self) -> bool:
        """Whether parts may touch one another, or walls."""
        return len(self.parts) > 1 or len(self.walls) > 0


class Model(Protocol):
    """Advances blocks of worlds, several at a time in threads; keeps nothing of them from one call to the next."""

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Raise ValueError for conditions that the model does not cover, see :func:`.conditions.conditions_of`."""

    def reset(self) -> None:
        """Begin counting anew."""

    def deepest_overlap(self) -> float:
        """See :attr:`vibgym.Simulator.deepest_overlap`."""
        ...

    def statistics(self, periods: int) -> dict[str, int]:
        """See :attr:`vibgym.Simulator.statistics`; ``periods``: of all worlds together since the reset."""
        ...
