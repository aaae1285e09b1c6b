"""Properties of parts that may touch one another or walls, and the limits of the contact solver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.impact import ImpactProperties
from vibgym.scene.kinds import Kinds
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.parts import Part

SLOP = 3e-5
"""m, overlap that the solver does not correct, so that contacts persist and it can warm-start."""

LEAST_WIDTH = 1e-4
"""m, least width of a part that may touch others: overlaps must be small against it."""

MOST_MASS_RATIO = 2000.0
"""Largest ratio of masses of parts that may touch, up to which the solver's iterations converge."""


def check_parts(parts: Kinds) -> None:
    """Raise ValueError for parts that are too thin, or much heavier than another, for reliable contacts."""
    for number, part in enumerate(parts.largest(lambda part: -narrowest_width(part.outline))):
        width = narrowest_width(part.outline)
        if width < LEAST_WIDTH:
            allowed = f"at least {1e3 * LEAST_WIDTH:g} mm wide where parts may touch one another or walls"
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
    if ratio > MOST_MASS_RATIO:
        names = heaviest[heavy].name, lightest[light].name
        got = f"part {heavy} ({names[0]!r}), {ratio:.3g} times as heavy as part {light} ({names[1]!r})"
        allowed = f"masses with a ratio of at most {MOST_MASS_RATIO:g} where parts may touch one another"
        raise checks.refuse(argument, got, allowed)


def impact_properties_of(parts: Sequence[Part]) -> ImpactProperties:
    """Return the properties of the parts of a world that determine impacts, those of the first one."""
    n, every = len(parts), Kinds.of(parts).every
    return ImpactProperties(
        every=np.array([[kind.mass, kind.gyration, kind.restitution, kind.contact_friction] for kind in every]),
        mass=np.array([part.mass for part in parts]),
        gyration=np.array([part.gyration for part in parts]),
        inverse_mass=np.zeros(n),  # written for each world
        inverse_inertia=np.zeros(n),
        restitution=np.array([part.restitution for part in parts]),
        friction=np.array([part.contact_friction for part in parts]),
    )
