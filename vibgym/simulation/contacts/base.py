"""Interface of contact models, and the parts that they cover."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.broad_phase import ROWS, new_rows
from vibgym.physics.contacts.impulses import ImpactProperties
from vibgym.physics.core.records import Scheme
from vibgym.physics.planar.workspace import FixedScene, new_workspace
from vibgym.scene.bodies import bodies_of
from vibgym.scene.hulls import WALLS, hulls_of
from vibgym.scene.kinds import Kinds
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.overlaps import IN_MOTION
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.alone import Alone
from vibgym.simulation.model import NO_PATHS, Setup
from vibgym.simulation.schemes import MAX_STEPS, PlanarSettings, schemes_alone

SLOP = 4e-6
"""m, overlap that the solver does not correct, so that contacts last from step to step."""

MIN_WIDTH = 1e-4
"""m, least width of a part that may touch others: overlaps must be small against it."""

MAX_MASS_RATIO = 2000.0
"""Largest ratio of masses of parts that may touch, up to which the solver's iterations converge."""


class ContactModel(ABC):
    """Base class of contact models: advances the parts of worlds that may touch. An object serves one thread at a time.

    :class:`vibgym.simulation.multibody.Multibody` calls for a block of worlds :meth:`load`, and in each period

    1. :meth:`find`, which lists the parts that touch nothing. These advance by friction alone.
    2. :meth:`resolve`, which advances all others and writes the state.

    :class:`vibgym.simulation.contacts.stepped.SteppedContacts` does this for models that correct the motion after each of
    several equal steps.

    Attributes:
        setup: the scene.
        kinds: different parts in it.
        schemes: steps of friction, by kind.
        walls: set of walls, a bit each.
        properties: of the parts of a world, for impacts.
        hulls: likewise, for contacts.
        alone: constants for parts that touch nothing.
        block: working arrays of the current block of worlds, which begin with those of
            :class:`vibgym.physics.contacts.broad_phase.Rows`.
        paths: (worlds * parts, steps + 1, 3) to be overwritten with the poses of parts that touch nothing, or empty.
        bend: m, largest ``mu g h^2`` in a contact step ``h``, which limits friction; infinite: no limit.
    """

    most_overlap: ClassVar[float] = IN_MOTION
    """m, largest overlap of parts in a state of a simulation; infinite: no limit."""

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        check_parts(setup.parts)
        self.setup, self.kinds = setup, setup.parts.every
        self.schemes = schemes_alone(setup.surface, self.kinds, settings)
        self.walls = sum(1 << WALLS.index(name) for name in setup.walls)
        self.properties = ImpactProperties(
            every=np.array(
                [[kind.mass, kind.gyration, kind.restitution, kind.contact_friction] for kind in self.kinds]
            ),
            mass=np.array([part.mass for part in setup.parts]),
            gyration=np.array([part.gyration for part in setup.parts]),
            restitution=np.array([part.restitution for part in setup.parts]),
            friction=np.array([part.contact_friction for part in setup.parts]),
        )
        self.hulls, self.alone = hulls_of(setup.parts), Alone(setup, self.schemes)
        self.block: Pinned[Any]
        self.paths, self.bend = NO_PATHS, math.inf
        self._blocks: dict[int, Pinned[Any]] = {}

    def new_friction(self, scheme: Scheme, slots: int) -> FixedScene:
        """Return constants, and working arrays for friction on up to ``slots`` parts of all kinds."""
        surface = self.setup.surface
        table, bodies = surface.table(self.setup.walls), bodies_of(self.setup.parts, surface.element_size)
        most = max(self.schemes, key=lambda scheme: scheme.substeps)  # for the size of the working arrays
        return FixedScene(table, bodies, scheme, new_workspace(table, bodies, most, slots))

    def new_block(self, worlds: int) -> Pinned[Any]:
        """Return working arrays for a block of ``worlds``."""
        return Pinned(ROWS, new_rows(worlds, len(self.setup.parts), len(self.kinds)))

    def load(self, worlds: int) -> None:
        """Set :attr:`block` for a block of ``worlds``."""
        if worlds not in self._blocks:
            self._blocks[worlds] = self.new_block(worlds)
        self.block = self._blocks[worlds]

    @abstractmethod
    def find(self, start: int, stop: int, state: int) -> bool:
        """Find the parts of worlds ``start`` to ``stop`` that may touch others, and list the rest in :attr:`block`.

        Args:
            state: address of the pinned state; ``pushed`` must be set to zero.

        Returns:
            Whether any parts may touch.
        """

    @abstractmethod
    def resolve(self, start: int, stop: int, drive: Any, state: Any, counts: np.ndarray, deepest: np.ndarray) -> None:
        """Advance the parts of worlds ``start`` to ``stop`` that may touch by a period, after the others.

        Args:
            drive, state: pinned records.
            counts: (worlds, COUNTS) int64, added to: periods of each kind, and steps with contacts, see
                :mod:`vibgym.physics.contacts.broad_phase`.
            deepest: (worlds,) m, smallest gap at the end of a contact step so far; negative: overlap.
        """


def check_parts(parts: Kinds) -> None:
    """Raise ValueError for parts that are too thin, or much heavier than another, for reliable contacts."""
    for number, part in enumerate(parts.largest(lambda part: -narrowest_width(part.outline))):
        width = narrowest_width(part.outline)
        if width < MIN_WIDTH:
            allowed = f"at least {1e3 * MIN_WIDTH:g} mm wide where parts may touch one another or walls"
            raise checks.refuse("parts", f"part {number} ({part.name!r}), {1e3 * width:.3g} mm wide", allowed)
    check_masses("parts", parts, np.ones((1, len(parts))))


def slop_of(part: Part) -> float:
    """Return the overlap of a part that the solver does not correct, m."""
    return min(SLOP, 0.05 * narrowest_width(part.outline))


def check_masses(argument: str, parts: Kinds, factors: np.ndarray) -> None:
    """Check that the ratio of masses under ``factors`` (n, parts) is within the range of the solver."""
    heaviest, lightest = parts.largest(lambda part: part.mass), parts.largest(lambda part: -part.mass)
    most, least = (factors * [part.mass for part in some] for some in (heaviest, lightest))
    row = int(np.argmax(most.max(axis=1) / least.min(axis=1)))
    heavy, light = int(np.argmax(most[row])), int(np.argmin(least[row]))
    ratio = most[row, heavy] / least[row, light]
    if ratio > MAX_MASS_RATIO:
        names = heaviest[heavy].name, lightest[light].name
        got = f"part {heavy} ({names[0]!r}), {ratio:.3g} times as heavy as part {light} ({names[1]!r})"
        allowed = f"masses with a ratio of at most {MAX_MASS_RATIO:g} where parts may touch one another"
        raise checks.refuse(argument, got, allowed)


def check_contact_steps(argument: str, surface: Surface, friction: float, incline: float, bend: float) -> None:
    """Check that friction (and an incline, m/s^2) does not require too many contact steps in a period.

    ``bend``: see :class:`ContactModel`.
    """
    needed = surface.period * math.sqrt((friction * surface.gravity + 0.5 * incline) / bend)
    if not needed <= MAX_STEPS:
        raise checks.conflict(
            f"{argument}: contacts with a friction of {friction:g} require more than {MAX_STEPS} steps in a period of "
            f"{surface.period:g} s"
        )
