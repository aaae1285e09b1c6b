"""Certified contacts (``contacts="certified"``), see :mod:`vibgym.physics.contacts.certified.period`.

Contact steps and overlaps are smaller for parts that are not much larger than the overlaps, and in their contacts with others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.certified.coupling import CONTACT_SCENE, ContactScene, Coupling, new_contacts
from vibgym.physics.contacts.certified.period import BROAD_PHASE, broad_phase, new_broad_phase, resolve
from vibgym.physics.contacts.certified.solver import new_solver
from vibgym.physics.core.records import Scheme
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.contacts.base import ContactModel, check_contact_steps, impact_properties_of, slop_of
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import CONTACT_STEPS, PlanarSettings

CONTACT_OVERLAP = 5e-6
"""Default for the overlap of two parts by an impact, m."""

FRICTION_OVERLAP = 1.7e-4
"""m, largest ``mu g h^2``: overlap in a step ``h`` of two parts that friction drives together."""


class CertifiedContacts(ContactModel):
    """Impacts one by one at their times, with bounded overlap."""

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup, settings)
        parts, hulls = len(setup.parts), setup.hulls
        most = max(self.schemes, key=lambda scheme: scheme.substeps)
        coupling = coupling_of(setup.surface, self.kinds, self.schemes, settings)
        scene = ContactScene(
            self.new_friction(most, parts), hulls, new_solver(parts, len(hulls.rounding)),
            impact_properties_of(setup.parts), new_contacts(parts, hulls), coupling, self.walls,
        )  # fmt: skip
        self._scene, self._steps, self.bend = Pinned(CONTACT_SCENE, scene), coupling.steps, float(coupling.bend.min())

    def new_block(self, worlds: int) -> Pinned[Any]:
        return Pinned(BROAD_PHASE, new_broad_phase(worlds, len(self.setup.parts), self._steps))

    def load(self, worlds: int) -> None:
        super().load(worlds)
        self.paths = self.block.record.paths

    def find(self, start: int, stop: int, state: int) -> bool:
        return broad_phase(start, stop, self._scene.address, state, self.block.address)

    def resolve(self, start: int, stop: int, drive: Any, state: Any, counts: np.ndarray, deepest: np.ndarray) -> None:
        scene, block = self._scene.address, self.block.address
        resolve(start, stop, scene, drive.address, state.address, block, counts, deepest)


def coupling_of(
    surface: Surface, kinds: Sequence[Part], schemes: Sequence[Scheme], settings: PlanarSettings
) -> Coupling:
    """Return the resolution of the coupling between friction and contacts, by kind."""
    half_widths = np.array([0.5 * narrowest_width(kind.outline) for kind in kinds])
    overlap = np.minimum(CONTACT_OVERLAP, half_widths / 50.0)
    if settings.contact_overlap != "auto":
        overlap = np.full(len(kinds), settings.contact_overlap)
    fewest, bend = settings.contact_steps, np.full(len(kinds), math.inf)
    if fewest == "auto":
        fewest, bend = CONTACT_STEPS, np.minimum(FRICTION_OVERLAP, 0.25 * half_widths)
        check_contact_steps("parts", surface, max(part.most_friction for part in kinds), 0.0, float(bend.min()))
    return Coupling(
        steps=np.array([scheme.steps for scheme in schemes]),
        substeps=np.array([scheme.substeps for scheme in schemes]),
        bend=bend,
        overlap=overlap,
        slop=np.array([slop_of(kind) for kind in kinds]),
        fewest=fewest,
    )
