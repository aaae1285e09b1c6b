"""Schemes of the planar model for several parts: each kind's own without contacts, and the steps of the coupling with them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.collision.multibody import CrowdScheme
from vibgym.physics.friction import planar
from vibgym.scene.hulls import WALLS
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.schemes import check_knobs, chosen, planar_method

CONTACT_OVERLAP = 5e-6
"""m that a blow may make two parts overlap unless asked for otherwise."""

CONTACT_STEPS = 10
"""Fewest steps of the coupling between friction and contacts in a period unless asked for otherwise."""


class CrowdMethod(NamedTuple):
    """Schemes for several parts: each kind's own without contacts, and what goes for all with them."""

    alone: tuple[planar.Scheme, ...]  # one a kind
    crowd: CrowdScheme


def crowd_method(
    surface: Surface,
    kinds: Sequence[Part],
    walls: Sequence[str],
    *,
    steps: int | str = "auto",
    substeps: int | str = "auto",
    pieces: int | str = "auto",
    contact_steps: int | str = "auto",
    contact_overlap: float | str = "auto",
) -> CrowdMethod:
    """The planar model for several parts: each kind by itself as :func:`planar_method` says, and steps for contacts.

    ``contact_steps``: fewest steps of the coupling in a period with contacts. ``contact_overlap``: m, how far parts may run
    into one another before the solver sees the blow; steps are cut short for it.
    """
    overlap = CONTACT_OVERLAP
    if not (isinstance(contact_overlap, str) and contact_overlap == "auto"):
        overlap = checks.number("contact_overlap (or 'auto')", contact_overlap, least=2e-6, most=1e-4)
    alone = [planar_method(surface, part, steps=steps, substeps=substeps, pieces=pieces).scheme for part in kinds]
    finest = max(alone, key=lambda scheme: scheme.steps)
    coupled = chosen("contact_steps", contact_steps) or CONTACT_STEPS
    return CrowdMethod(
        alone=tuple(alone),
        crowd=CrowdScheme(
            steps=np.array([scheme.steps for scheme in alone]),
            with_contacts=finest,
            couplings=math.ceil(coupled / finest.steps),
            overlap=overlap,
            walls=sum(1 << WALLS.index(name) for name in walls),
        ),
    )


def build_crowd(
    model: str, surface: Surface, kinds: Sequence[Part], walls: Sequence[str], knobs: Mapping[str, Any]
) -> CrowdMethod:
    """Schemes of ``model`` for several parts or walls.

    Raises:
        ValueError: as for :func:`vibgym.simulation.schemes.build`.
    """
    if model != "planar":
        raise checks.refuse("model", model, "'planar' with several parts or walls: contacts are resolved in time")
    check_knobs(model, crowd_method, knobs)
    return crowd_method(surface, kinds, walls, **knobs)
