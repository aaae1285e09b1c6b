"""Base class of models, and their arguments: :class:`Setup` and :class:`Conditions`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.scene.kinds import Kinds
from vibgym.scene.outlines import rotation
from vibgym.scene.overlaps import IN_MOTION
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings
from vibgym.simulation.threads import USUAL_COST
from vibgym.simulation.tipping import check_tipping, warn_of_slender

if TYPE_CHECKING:
    from vibgym.simulation.choice import Choice

NO_PATHS = np.empty((0, 0, 3))
"""Passed to kernels that record paths only on request."""

MIN_FACTOR, MAX_FACTOR = 0.01, 100.0
"""Range of the factors on friction and on mass."""


@dataclass(frozen=True)
class Setup:
    """Scene of a model.

    Attributes:
        surface: the table.
        parts: of the worlds.
        walls: names of the borders with a wall.
        worlds: number of worlds.
        model: name by which the model was selected; for error messages.
    """

    surface: Surface
    parts: Kinds
    walls: tuple[str, ...]
    worlds: int
    model: str = "planar"

    @property
    def multibody(self) -> bool:
        """Whether parts may touch one another, or walls."""
        return len(self.parts) > 1 or len(self.walls) > 0


class Conditions(NamedTuple):
    """Conditions of n worlds: factors on friction and mass, and the table's incline."""

    friction: np.ndarray  # (n, parts) factor on both coefficients of friction between part and table
    mass: np.ndarray  # (n, parts) factor on mass and inertia
    incline: np.ndarray  # (n, 2) m/s^2, constant acceleration of everything on the table
    patches: np.ndarray  # (n, rows, columns) factor of every element on friction, or (n, 1, 1): of all elements

    @property
    def strongest(self) -> np.ndarray:
        """(n, parts) largest factor on friction of a part on any element."""
        return self.friction * self.patches.max(axis=(1, 2), initial=0.0)[:, None]

    @property
    def stronger(self) -> str:
        """Name of the larger of the two factors on friction, for errors about too much friction."""
        larger = self.patches.max(initial=0.0) > self.friction.max(initial=0.0)
        return "patches" if larger else "friction"

    @property
    def slope(self) -> np.ndarray:
        """(n,) m/s^2, magnitude of the incline."""
        return np.hypot(self.incline[:, 0], self.incline[:, 1])


class Model(ABC):
    """Base class of models: advances blocks of worlds, several at a time in threads.

    A model is registered by name: ``vibgym.simulation.MODELS.register(name, cls)``, or an entry point in group
    ``vibgym.models``. It is called with a :class:`Setup` and its ``Settings``. Only ``advance`` is required:

    - ``check_parts``, ``check_conditions``: scenes that the model does not cover.
    - ``live``, ``check_live``, ``begin``: state between calls of :meth:`advance`, in addition to ``state``.
    - ``reset``, ``statistics``, ``deepest_overlap``: statistics of contacts.
    - ``part_info``, ``quantities``, ``ADDS``: further results, attributes and methods.
    - ``flat``, ``tilted``, ``bottoms``, ``disturb``: models in which parts can tilt.

    Attributes:
        setup: the scene.
        choice: set by models that select another one, such as ``"auto"``; None: the model was named.
        cost: us, rough time of a world and period; several threads are used where this saves time.
    """

    flat: ClassVar[bool] = True
    """Whether parts always lie flat. If so, parts that friction alone tips are refused, and no side view is drawn."""

    ADDS: ClassVar[tuple[str, ...]] = ()
    """Names of attributes and methods that simulators of this model have in addition to those of
    :class:`vibgym.Simulator`; methods take the simulator as their first argument."""

    most_overlap: float = IN_MOTION
    """m, largest overlap of parts in a state of a simulation; infinite: no limit."""

    class Settings(BaseSettings):
        """Settings of a model."""

    settings: Settings

    def __init__(self, setup: Setup, settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings
        self.setup = setup
        self.choice: Choice | None = None
        self.cost = USUAL_COST

    @abstractmethod
    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        """Advance worlds ``start`` to ``stop`` by whole periods under a held drive.

        Several threads call this at the same time, for different worlds.

        Args:
            drive: ``drive.record``: motion of the elements, see :func:`vibgym.physics.core.drive.all_phasors`;
                ``drive.address``: the same for kernels.
            state: ``state.record``: arrays (worlds, ...), changed in place; ``state.address`` likewise.
        """

    def check_parts(self) -> None:
        """Raise ValueError for parts that the model does not cover; the default refuses parts that friction alone tips."""
        every = self.setup.parts.every
        check_tipping(every, np.ones((1, len(every))), "parts", self.setup.model)
        warn_of_slender(every, self.setup.model)

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Raise ValueError for conditions that the model does not cover, see :func:`conditions_of`."""
        parts = self.setup.parts.largest(lambda part: part.tipping_ratio if part.height_is_known else 0.0)
        check_tipping(parts, conditions.strongest, where.format(conditions.stronger), self.setup.model)

    def live(self) -> dict[str, np.ndarray]:
        """Return the live arrays (worlds, ...) that a snapshot holds in addition to the state, by name."""
        return {}

    def check_live(self, values: Mapping[str, np.ndarray]) -> None:  # noqa: B027 - optional
        """Raise ValueError for invalid values of :meth:`live`, which are finite and have the right shapes."""

    def begin(self, worlds: Any) -> None:  # noqa: B027 - optional
        """Reset :meth:`live` for worlds (index or mask, also of single parts) whose parts have been placed."""

    def reset(self) -> None:  # noqa: B027 - optional
        """Reset the statistics."""

    def statistics(self, periods: int) -> dict[str, int]:
        """See :attr:`vibgym.Simulator.statistics`; ``periods``: of all worlds together since the reset."""
        return {"free": periods, "near": 0, "contact": 0, "contact_steps": 0}

    def deepest_overlap(self) -> float:
        """See :attr:`vibgym.Simulator.deepest_overlap`."""
        return 0.0

    def part_info(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, parts) that environments report in ``info["parts"]``, by name."""
        return {}

    def quantities(self) -> dict[str, np.ndarray]:
        """Return arrays (worlds, ...) that :attr:`vibgym.Simulator.quantities` reports, by name."""
        return {}

    def tilted(self) -> np.ndarray:
        """Return (worlds, parts) whether a part does not lie flat; bool, or broadcastable."""
        return np.zeros((1, 1), dtype=bool)

    def bottoms(self, pose: np.ndarray, world: int) -> list[np.ndarray]:
        """Return the corners of the bottom of each part of a world at poses (parts, 3), each (n, 3) m; flat parts: z = 0."""
        flat = (
            part.outline @ rotation(0.0, 0.0, at[2])[:2, :2].T + at[:2]
            for part, at in zip(self.setup.parts.parts(world), pose)
        )
        return [np.column_stack([corners, np.zeros(len(corners))]) for corners in flat]

    def disturb(self, state: State, lean: np.ndarray, impulse: np.ndarray) -> None:
        """Apply impulse disturbances, see :meth:`vibgym.Simulator.disturb`; the default adds ``impulse`` to the velocity."""
        state.velocity[...] += impulse


def conditions_of(
    now: Conditions, wanted: Mapping[str, Any], elements: tuple[int, int], gravity: float, where: str
) -> Conditions:
    """Return checked conditions; those that are None keep their values in ``now``.

    Args:
        elements: rows and columns of the surface.
        gravity: m/s^2, which an incline cannot exceed.
        where: name of an argument in errors, with ``{}`` for the condition's name.

    Raises:
        ValueError: a number that is not finite or out of its range, or a shape that does not fit.
    """

    def factor(name: str, shape: tuple[int, ...]) -> np.ndarray:
        if wanted[name] is None:
            return getattr(now, name)
        return checks.array(where.format(name), wanted[name], shape, least=MIN_FACTOR, most=MAX_FACTOR)

    incline = (
        now.incline
        if wanted["incline"] is None
        else checks.array(where.format("incline"), wanted["incline"], now.incline.shape)
    )
    patches = factor("patches", (len(now.friction), *elements))
    conditions = Conditions(factor("friction", now.friction.shape), factor("mass", now.mass.shape), incline, patches)
    steep = ~(conditions.slope <= gravity * (1.0 + 1e-12))
    if steep.any():
        allowed = f"an acceleration (x, y) of at most {gravity:g} m/s^2, the table's gravity"
        raise checks.refuse(where.format("incline"), conditions.incline[steep][0].tolist(), allowed)
    return conditions


def worlds_from(worlds: Any, count: int) -> np.ndarray:
    """Return indices of worlds from a mask, a slice, or one or several indices.

    Raises:
        ValueError: another type, or an index out of range.
    """
    if isinstance(worlds, slice):
        return np.arange(count)[worlds]
    allowed = f"a mask of shape ({count},), or indices from 0 to {count - 1}"
    try:
        indices = np.asarray(worlds)
    except (TypeError, ValueError, RecursionError):  # rows of different lengths
        raise checks.refuse("worlds", worlds, allowed) from None
    if indices.dtype == bool and indices.shape == (count,):
        return np.flatnonzero(indices)
    if indices.size == 0 and indices.ndim == 1:
        return np.zeros(0, dtype=np.int64)
    if indices.dtype.kind not in "iu" or indices.ndim > 1 or indices.min() < 0 or indices.max() >= count:
        raise checks.refuse("worlds", worlds, allowed)
    return np.atleast_1d(indices)
