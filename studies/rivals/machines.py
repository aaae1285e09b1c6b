"""Models of the other machines: mean pushes of all elements as a function of a few drive values.

A machine is an action (``action="plate"`` etc.) that converts its drive values to the motion of every element. Pushes are those
of :mod:`vibgym.allocation`, (rows, columns, 2), relative to the push of full amplitude at rest.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from vibgym import Part, Surface
from vibgym.envs import ACTIONS, Action
from vibgym.physics.core.drive import Drive, phasor_drive
from vibgym.sensing import Measurement

AXES = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
"""(2, 2, 2) axes of conveyor cells, alternately along and across the table."""

ONE_WAY = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, -1.0], [-1.0, 0.0]]])
"""(2, 2, 2) directions of one-way cells; every block of 2 x 2 cells has all four."""


class Machine(Action):
    """Base class: pushes of all elements from the drive values."""

    @abstractmethod
    def pushes(self, values: np.ndarray) -> np.ndarray:
        """Return the pushes (worlds, rows, columns, 2) of length up to 1 for a batch of actions (worlds, size)."""

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        """See :meth:`vibgym.envs.Action.command`."""
        push = self.pushes(np.clip(values, -1.0, 1.0).astype(np.float64))
        return phasor_drive(-push[..., ::-1].reshape(len(push), -1), self.surface.columns, self.full_scale)


class Plate(Machine):
    """(3,): stroke of one rigid plate, velocity x, y of the centre, and rotation; its length, up to 1, is the strength.

    A stroke rotates the plate about a centre at ``half * (-y, x) / rotation`` from the middle. By Coulomb's
    law friction pushes a part along the plate's velocity under it, independent of that speed. The push therefore has the same
    strength everywhere, except within :attr:`core` of the centre of rotation.

    Attributes:
        core: m, distance from the centre of rotation within which the push decreases linearly to zero.
        half: m, half the longer side of the table.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (3,)
        self.core = surface.element_size
        x, y = surface.element_centres()
        self.half = 0.5 * max(surface.width, surface.depth)
        self._from_middle = np.stack([x - 0.5 * surface.width, y - 0.5 * surface.depth], axis=-1)

    def velocity(self, stroke: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the plate's relative velocity (worlds, ..., 2) at positions ``place`` (..., 2), m from the middle."""
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
    """(3,): the plate with pushes proportional to its velocity, at most 1 at the fastest corner."""

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        reach = 0.5 * np.array([surface.width, surface.depth])
        self.corners = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) * reach

    def fastest(self, stroke: np.ndarray) -> np.ndarray:
        """Return the largest relative speed (worlds,) of the plate, which occurs at a corner."""
        return np.sqrt((self.velocity(stroke, self.corners) ** 2).sum(axis=-1)).max(axis=-1)

    def pushes(self, values: np.ndarray) -> np.ndarray:
        """See :meth:`Machine.pushes`; strokes whose fastest corner exceeds 1 are scaled down."""
        slowed = values / np.maximum(self.fastest(values), 1.0)[:, None]
        return self.velocity(slowed, self._from_middle)


class Cells(Machine):
    """Base class of conveyors: every cell pushes along its axis only.

    Attributes:
        axis: (rows, columns, 2) unit vectors.
        least: smallest push of a cell along its axis: -1 both ways, 0 one way.
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
    """(rows, columns): belts that run both ways, alternately along and across the table."""

    PATTERN, least = AXES, -1.0


class OneWay(Cells):
    """(rows, columns): cells that push in one fixed direction; values below 0 are rest."""

    PATTERN, least = ONE_WAY, 0.0


MACHINES: Mapping[str, type[Machine]] = {
    "plate": Plate,
    "plain-plate": PlainPlate,
    "conveyor": Conveyor,
    "one-way": OneWay,
}
"""Name of the environment's action -> machine."""


def register() -> None:
    """Register the machines as actions, once."""
    for name, machine in MACHINES.items():
        if name not in ACTIONS:
            ACTIONS.register(name, machine)
