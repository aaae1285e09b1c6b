"""Fast contacts (``contacts="fast"``), for training, see :mod:`vibgym.physics.contacts.fast`."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.fast import FAST_SCENE, FastScene, drive_together, find_rows, new_fast_contacts
from vibgym.scene.outlines import narrowest_width
from vibgym.simulation.contacts.base import ContactModel, check_contact_steps, slop_of
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import PlanarSettings

FRICTION_OVERLAP = 4e-4
"""m, largest ``mu g h^2``: overlap in a step ``h`` of two parts that friction drives together."""

CLOSING = 2.0
"""Largest closing speed of two parts that fast contacts resolve, over the table's largest speed: in a step they overlap by at
most half the narrowest width, beyond which the outlines would separate on the wrong side."""

SLOTS = 32
"""Parts of several worlds that friction moves together; more do not fit into the nearest cache."""


class FastContacts(ContactModel):
    """Equal contact steps, in which all impacts are simultaneous.

    Attributes:
        scene: constants and working arrays for kernels.
        steps: contact steps in a period.
    """

    FEWEST: ClassVar[int] = 1
    """Contact steps in a period where friction and narrow parts require no more."""

    WHOLE: ClassVar[bool] = False
    """Whether all parts of a world advance with contacts where any of them are near, or those parts alone."""

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup, settings)
        if settings.contact_overlap != "auto":
            raise checks.conflict("contact_overlap requires contacts='certified'")
        finest = max(self.schemes, key=lambda scheme: scheme.steps)
        friction = self.new_friction(finest, max(len(setup.parts), SLOTS))
        couplings = -(-self._fewest_steps(settings) // finest.steps)
        self.steps = finest.steps * couplings
        scene = FastScene(
            friction=friction,
            hulls=self.hulls,
            properties=self.properties,
            contacts=new_fast_contacts(len(setup.parts), len(friction.workspace.away), self.hulls),
            couplings=couplings,
            slop=min(map(slop_of, self.kinds)),
            walls=self.walls,
        )
        self.scene = Pinned(FAST_SCENE, scene)

    def _fewest_steps(self, settings: PlanarSettings) -> int:
        """Return the fewest contact steps in a period."""
        if settings.contact_steps != "auto":
            return settings.contact_steps
        surface, friction = self.setup.surface, max(part.most_friction for part in self.kinds)
        check_contact_steps("parts", surface, friction, 0.0, FRICTION_OVERLAP)
        half_width = 0.5 * min(narrowest_width(kind.outline) for kind in self.kinds)
        by_friction = surface.period * math.sqrt(friction * surface.gravity / FRICTION_OVERLAP)
        by_speed = CLOSING * surface.table_speed * surface.period / half_width
        return max(math.ceil(max(by_friction, by_speed)), self.FEWEST)

    def find(self, start: int, stop: int, state: int) -> bool:
        return find_rows(start, stop, self.scene.address, state, self.block.address, self.WHOLE)

    def resolve(self, start: int, stop: int, drive: Any, state: Any, counts: np.ndarray, deepest: np.ndarray) -> None:
        scene, block = self.scene.address, self.block.address
        drive_together(start, stop, scene, drive.address, state.address, block, counts, deepest)
