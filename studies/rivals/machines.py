"""The rivals' hardware: mean pushes of all elements as a function of a few numbers.

A rival is a smaller set of commands for the same surface. Its action (``action="plate"`` and so on) maps the numbers of its
drives to the motion of every element. Pushes are those of :mod:`vibgym.allocation`, (rows, columns, 2), over the push of full
amplitude at rest.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from vibgym import Part, Surface
from vibgym.allocation.allocator import turn_round
from vibgym.envs import ACTIONS, Action
from vibgym.physics.core.drive import Drive, phasor_drive
from vibgym.sensing import Measurement

AXES = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
"""Of conveyor cells, (2, 2, 2): along the table and across it by turns, so that each has neighbours of the other kind."""

ONE_WAY = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, -1.0], [-1.0, 0.0]]])
"""Directions of cells that push one way, (2, 2, 2): every two by two cells have all four."""


class Machine(Action):
    """Base of the rivals: pushes of all elements from the numbers of the drives."""

    @abstractmethod
    def pushes(self, values: np.ndarray) -> np.ndarray:
        """Return the pushes (worlds, rows, columns, 2) of length up to 1 for a batch of actions (worlds, size)."""

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        """See :meth:`vibgym.envs.Action.command`."""
        push = self.pushes(np.clip(values, -1.0, 1.0).astype(np.float64))
        phasors = np.empty((len(push), push[0].size), dtype=np.float32)
        turn_round(np.ascontiguousarray(push).reshape(-1), phasors.reshape(-1))
        return phasor_drive(phasors, self.surface.columns, self.full_scale)


class Plate(Machine):
    """(3,): a stroke of one rigid plate, velocity x and y of the table's centre and turn; its length, up to 1, is the strength.

    A stroke goes about some centre of rotation, ``half a length of the table * (-y, x) / turn`` away from the middle. By
    Coulomb's law friction pushes a part along the plate's velocity under it, however fast that is: the push has the same
    strength everywhere, but for :attr:`core` about the centre of rotation, where the plate hardly moves.

    Attributes:
        core: m, distance from the centre of rotation below which the push falls to zero.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (3,)
        self.core = surface.element_size
        x, y = surface.element_centres()
        self.half = 0.5 * max(surface.width, surface.depth)
        self._from_middle = np.stack([x - 0.5 * surface.width, y - 0.5 * surface.depth], axis=-1)

    def velocity(self, stroke: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the plate's velocity (worlds, ..., 2) at places (..., 2) m from the middle, over that of the stroke."""
        lead = (len(stroke), *(1,) * (place.ndim - 1))
        x, y, turn = (stroke[:, k].reshape(lead) for k in range(3))
        turn = turn / self.half
        return np.stack([x - turn * place[..., 1], y + turn * place[..., 0]], axis=-1)

    def pushes(self, values: np.ndarray) -> np.ndarray:
        """See :meth:`Machine.pushes`."""
        speed = self.velocity(values, self._from_middle)
        length = np.sqrt((speed**2).sum(axis=-1, keepdims=True))
        slow = np.abs(values[:, 2])[:, None, None, None] * self.core / self.half
        strength = np.minimum(np.sqrt((values**2).sum(axis=-1)), 1.0)[:, None, None, None]
        return strength * speed / np.maximum(np.maximum(length, slow), 1e-12)


class PlainPlate(Plate):
    """(3,): the same plate if pushes grew with its velocity: a stroke pushes as a rigid body moves, 1 where that is fastest."""

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        reach = 0.5 * np.array([surface.width, surface.depth])
        self.corners = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) * reach

    def fastest(self, stroke: np.ndarray) -> np.ndarray:
        """Return the largest speed (worlds,) of the plate, which is at one of its corners."""
        return np.sqrt((self.velocity(stroke, self.corners) ** 2).sum(axis=-1)).max(axis=-1)

    def pushes(self, values: np.ndarray) -> np.ndarray:
        """See :meth:`Machine.pushes`; strokes whose fastest corner is faster than 1 are slowed down."""
        slowed = values / np.maximum(self.fastest(values), 1.0)[:, None]
        return self.velocity(slowed, self._from_middle)


class Cells(Machine):
    """Base of conveyors: every cell pushes along its own axis only.

    Attributes:
        axis: (rows, columns, 2) unit vectors.
        least: of what a cell can do along its axis: -1 both ways, 0 one way.
    """

    PATTERN: np.ndarray
    least: float

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns)
        tiles = (-(-surface.rows // 2), -(-surface.columns // 2), 1)
        self.axis = np.tile(self.PATTERN, tiles)[: surface.rows, : surface.columns]

    def pushes(self, values: np.ndarray) -> np.ndarray:
        """See :meth:`Machine.pushes`."""
        return np.maximum(values, self.least).reshape(-1, *self.shape, 1) * self.axis


class Conveyor(Cells):
    """(rows, columns): belts that run both ways, along the table and across it by turns."""

    PATTERN, least = AXES, -1.0


class OneWay(Cells):
    """(rows, columns): cells that push one way, each its own; values below 0 are rest."""

    PATTERN, least = ONE_WAY, 0.0


MACHINES: Mapping[str, type[Machine]] = {
    "plate": Plate,
    "plain-plate": PlainPlate,
    "conveyor": Conveyor,
    "one-way": OneWay,
}
"""By the environment's ``action=``."""


def register() -> None:
    """Register the rivals' actions, once."""
    for name, machine in MACHINES.items():
        if name not in ACTIONS:
            ACTIONS.register(name, machine)
