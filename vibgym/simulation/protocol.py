"""What every model follows, and what it is made for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.hulls import Hulls
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


class InPlane:
    """What models have in common whose parts lie flat, whatever happens."""

    def live(self) -> dict[str, np.ndarray]:
        """Nothing: the state says it all."""
        return {}

    def check_live(self, values: Mapping[str, np.ndarray]) -> None:
        """There are none."""

    def begin(self, worlds: Any) -> None:
        """There is nothing to forget."""


class NoContacts:
    """What models have in common whose parts touch nothing."""

    def reset(self) -> None:
        """Begin counting anew."""

    def deepest_overlap(self) -> float:
        """There is none."""
        return 0.0

    def statistics(self, periods: int) -> dict[str, int]:
        """All periods are free."""
        return {"free": periods, "near": 0, "contact": 0, "contact_steps": 0}


class Model(Protocol):
    """Advances blocks of worlds, several at a time in threads; all that it keeps of them from one call to the next is live."""

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""

    def live(self) -> dict[str, np.ndarray]:
        """Arrays (worlds, ...) of what a snapshot has to hold besides the state, by name."""
        ...

    def check_live(self, values: Mapping[str, np.ndarray]) -> None:
        """Raise ValueError for such arrays, finite and of the right shapes, that cannot be."""

    def begin(self, worlds: Any) -> None:
        """Forget what is live of the given worlds (index or mask, also of parts): their parts have been put down afresh."""

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
