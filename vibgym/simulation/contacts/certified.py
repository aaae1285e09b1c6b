"""Certified contacts (``contacts="certified"``), see :mod:`vibgym.physics.contacts.certified.period`.

Contact steps and overlaps are smaller for parts that are not much larger than the overlaps, and in their contacts with others.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.certified.coupling import CONTACT_SCENE, ContactScene, Coupling, new_contacts
from vibgym.physics.contacts.certified.period import BROAD_PHASE, broad_phase, new_broad_phase, resolve
from vibgym.physics.contacts.certified.solver import new_solver
from vibgym.scene.outlines import narrowest_width
from vibgym.simulation.contacts.base import ContactModel, check_contact_steps, slop_of
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import CONTACT_STEPS, PlanarSettings

CONTACT_OVERLAP = 5e-6
"""Default for the overlap of two parts by an impact, m."""

FRICTION_OVERLAP = 1.7e-4
"""m, largest ``mu g h^2``: overlap in a step ``h`` of two parts that friction drives together."""


class CertifiedContacts(ContactModel):
    """Impacts one by one at their times, with bounded overlap.

    Attributes:
        scene: constants and working arrays for kernels.
    """

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup, settings)
        parts, hulls, coupling = len(setup.parts), self.hulls, self._coupling(settings)
        most = max(self.schemes, key=lambda scheme: scheme.substeps)
        scene = ContactScene(
            friction=self.new_friction(most, parts),
            hulls=hulls,
            solver=new_solver(parts, len(hulls.rounding)),
            properties=self.properties,
            contacts=new_contacts(parts, hulls),
            coupling=coupling,
            walls=self.walls,
        )
        self.scene, self.bend = Pinned(CONTACT_SCENE, scene), float(coupling.bend.min())

    def _coupling(self, settings: PlanarSettings) -> Coupling:
        """Return the resolution of the coupling between friction and contacts, by kind."""
        half_widths = np.array([0.5 * narrowest_width(kind.outline) for kind in self.kinds])
        overlap = np.minimum(CONTACT_OVERLAP, half_widths / 50.0)
        if settings.contact_overlap != "auto":
            overlap = np.full(len(self.kinds), settings.contact_overlap)
        fewest, bend = settings.contact_steps, np.full(len(self.kinds), math.inf)
        if fewest == "auto":
            fewest, bend = CONTACT_STEPS, np.minimum(FRICTION_OVERLAP, 0.25 * half_widths)
            friction = max(part.most_friction for part in self.kinds)
            check_contact_steps("parts", self.setup.surface, friction, 0.0, float(bend.min()))
        return Coupling(
            steps=np.array([scheme.steps for scheme in self.schemes]),
            substeps=np.array([scheme.substeps for scheme in self.schemes]),
            bend=bend,
            overlap=overlap,
            slop=np.array([slop_of(kind) for kind in self.kinds]),
            fewest=fewest,
        )

    def new_block(self, worlds: int) -> Pinned[Any]:
        return Pinned(BROAD_PHASE, new_broad_phase(worlds, len(self.setup.parts), self.scene.record.coupling.steps))

    def load(self, worlds: int) -> None:
        super().load(worlds)
        self.paths = self.block.record.paths

    def find(self, start: int, stop: int, state: int) -> bool:
        return broad_phase(start, stop, self.scene.address, state, self.block.address)

    def resolve(self, start: int, stop: int, drive: Any, state: Any, counts: np.ndarray, deepest: np.ndarray) -> None:
        scene, block = self.scene.address, self.block.address
        resolve(start, stop, scene, drive.address, state.address, block, counts, deepest)
