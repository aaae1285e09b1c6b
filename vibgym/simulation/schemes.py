"""Time steps and tables of the models, from their settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.averaged.integrator import AveragedScheme
from vibgym.physics.core.records import Scheme
from vibgym.scene.hulls import WALLS
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import averages_tables

RUNGE_KUTTA_STEPS = 18
"""Default for the fewest Runge-Kutta steps in a period."""

FEWEST_STEPS = 4
"""Fewest cuts of the contact area in a period; with fewer, errors reach millimetres in a second."""

MOST_STEPS, MOST_SUBSTEPS = 10_000, 4096
"""Most cuts in a period and substeps in a step; more do not improve accuracy."""

CONTACT_OVERLAP = 5e-6
"""Default for the overlap of two parts by an impact, m."""

FRICTION_OVERLAP = 1.7e-4
"""m, largest ``mu g h^2``: overlap in a step ``h`` of two parts that friction drives together."""

CONTACT_STEPS = 10
"""Default for the fewest steps of the coupling between friction and contacts in a period."""


FAST_FRICTION_OVERLAP = 4e-4
"""``FRICTION_OVERLAP`` of fast contacts, m."""

FAST_CLOSING = 2.0
"""Largest closing speed of two parts that fast contacts resolve, over the table's largest speed: in a step they overlap by at
most half the narrowest width, beyond which the outlines would separate on the wrong side."""


class PlanarSchemes(NamedTuple):
    """Schemes of the planar model by kind of parts, and settings for contacts."""

    alone: tuple[Scheme, ...]  # by kind
    fewest: int  # steps of the coupling in a period
    bend: tuple[float, ...]  # m, largest ``mu g h^2`` in a step ``h``; infinite: no limit by friction
    overlap: tuple[float, ...]  # m, largest overlap of two parts by an impact
    walls: int  # set of walls, a bit each


def chosen(name: str, value: Any, most: int | None = None) -> int | None:
    """Return a count, or None for ``"auto"``."""
    if isinstance(value, str) and value == "auto":
        return None
    return checks.count(f"{name} (or 'auto')", value, most=most)


def varies(part: Part) -> bool:
    """Return whether a part's coefficient of friction depends on speed."""
    return part.friction_law is not None


def planar_scheme(
    surface: Surface,
    part: Part,
    *,
    steps: int | str = "auto",
    substeps: int | str = "auto",
    pieces: int | str = "auto",
    by_points: bool = False,
) -> Scheme:
    """Return the scheme with ``steps`` cuts of the contact area in a period, each with ``substeps`` of friction.

    ``by_points``: do not use the series, which requires a constant coefficient of friction.
    """
    travel = 2.0 * math.pi * surface.horizontal_amplitude
    cuts = chosen("steps", steps, most=MOST_STEPS) or (5 if part.gyration >= travel**2 else 9)
    if cuts < FEWEST_STEPS and surface.rows * surface.columns > 1 and surface.horizontal_amplitude > 0.0:
        raise checks.refuse("steps", cuts, f"a whole number >= {FEWEST_STEPS} on several elements")
    inner = chosen("substeps", substeps, most=MOST_SUBSTEPS) or math.ceil(RUNGE_KUTTA_STEPS / cuts)
    if cuts * inner < FEWEST_STEPS and surface.horizontal_amplitude > 0.0:
        least = math.ceil(FEWEST_STEPS / cuts)
        raise checks.refuse("substeps", inner, f"a whole number >= {least} with steps={cuts}")
    cells = chosen("pieces", pieces, most=64) or (-1 if by_points else 0)
    phase = np.arange(3 * cuts * inner + 1) * (2.0 * math.pi / (3 * cuts * inner))
    return Scheme(cuts, inner, cells, np.cos(phase), np.sin(phase))


def planar_schemes(
    surface: Surface,
    kinds: Sequence[Part],
    walls: Sequence[str],
    *,
    steps: int | str = "auto",
    substeps: int | str = "auto",
    pieces: int | str = "auto",
    contact_steps: int | str = "auto",
    contact_overlap: float | str = "auto",
) -> PlanarSchemes:
    """Return the schemes of the planar model with contacts: :func:`planar_scheme` for each kind, and settings for contacts.

    Settings are those of :class:`vibgym.Simulator`. Steps and overlaps are smaller for parts that are not much larger than the
    overlaps, and in their contacts with others.
    """
    half_widths = [0.5 * narrowest_width(kind.outline) for kind in kinds]
    overlaps = [min(CONTACT_OVERLAP, half_width / 50.0) for half_width in half_widths]
    if not (isinstance(contact_overlap, str) and contact_overlap == "auto"):
        overlaps = [checks.number("contact_overlap (or 'auto')", contact_overlap, least=2e-6, most=1e-4)] * len(kinds)
    settings = {"steps": steps, "substeps": substeps, "pieces": pieces, "by_points": any(map(varies, kinds))}
    alone = [planar_scheme(surface, part, **settings) for part in kinds]
    coupled, bends = chosen("contact_steps", contact_steps, most=MOST_STEPS), [math.inf] * len(kinds)
    if coupled is None:
        coupled, bends = CONTACT_STEPS, [min(FRICTION_OVERLAP, 0.25 * half_width) for half_width in half_widths]
        check_contact_steps("parts", surface, max(part.most_friction for part in kinds), 0.0, min(bends))
    return PlanarSchemes(
        alone=tuple(alone),
        fewest=coupled,
        bend=tuple(bends),
        overlap=tuple(overlaps),
        walls=sum(1 << WALLS.index(name) for name in walls),
    )


def fast_schemes(
    surface: Surface,
    kinds: Sequence[Part],
    walls: Sequence[str],
    *,
    steps: int | str = "auto",
    substeps: int | str = "auto",
    pieces: int | str = "auto",
    contact_steps: int | str = "auto",
    fewest: int = 1,
) -> PlanarSchemes:
    """Return the schemes of the planar model with equal contact steps; settings are those of :class:`vibgym.Simulator`.

    ``fewest``: contact steps in a period where ``"auto"`` requires no more.
    """
    settings = {"steps": steps, "substeps": substeps, "pieces": pieces, "by_points": any(map(varies, kinds))}
    alone = [planar_scheme(surface, part, **settings) for part in kinds]
    coupled, none = chosen("contact_steps", contact_steps, most=MOST_STEPS), (math.inf,) * len(kinds)
    if coupled is None:
        friction = max(part.most_friction for part in kinds)
        check_contact_steps("parts", surface, friction, 0.0, FAST_FRICTION_OVERLAP)
        half_width = 0.5 * min(narrowest_width(kind.outline) for kind in kinds)
        by_friction = surface.period * math.sqrt(friction * surface.gravity / FAST_FRICTION_OVERLAP)
        by_speed = FAST_CLOSING * surface.table_speed * surface.period / half_width
        coupled = max(math.ceil(max(by_friction, by_speed)), fewest)
    walled = sum(1 << WALLS.index(name) for name in walls)
    return PlanarSchemes(alone=tuple(alone), fewest=coupled, bend=none, overlap=none, walls=walled)


def check_contact_steps(argument: str, surface: Surface, friction: float, incline: float, bend: float) -> None:
    """Check that friction (and an incline, m/s^2) does not require too many contact steps in a period.

    Kernels compute the number of steps for each island (:func:`vibgym.physics.contacts.islands.run_island`); ``bend``: see
    :class:`PlanarSchemes`.
    """
    needed = surface.period * math.sqrt((friction * surface.gravity + 0.5 * incline) / bend)
    if not needed <= MOST_STEPS:
        raise checks.conflict(
            f"{argument}: contacts with a friction of {friction:g} require more than {MOST_STEPS} steps in a period of "
            f"{surface.period:g} s"
        )


def averaged_scheme(
    surface: Surface, part: Part, *, order: int = 2, stride: int = 1, steps: int | str = "auto"
) -> AveragedScheme:
    """Return the scheme of the averaged model: ``steps`` in each span of ``stride`` periods."""
    order = checks.count("order", order, most=2)
    stride = checks.count("stride", stride, most=checks.MOST_PERIODS)
    cuts = chosen("steps", steps, most=MOST_STEPS) or 1
    check_sliding(surface, part.static_friction)
    if varies(part):
        raise checks.conflict("model='averaged' requires a constant coefficient of friction: use model='planar'")
    return AveragedScheme(order, stride, cuts, averages_tables.averages())


def check_sliding(
    surface: Surface,
    static_friction: float,
    incline: float = 0.0,
    argument: str = "model",
    value: Any = "averaged",
    remedy: str = "use model='planar'",
) -> None:
    """Raise ValueError, naming the argument, for scenes that averages over a period do not cover.

    Args:
        incline: m/s^2.
        remedy: advice of the error.
    """
    needed = static_friction * (surface.gravity + surface.full_scale) + incline
    horizontal = surface.horizontal_amplitude * surface.angular_frequency**2
    if not horizontal > needed:
        raise checks.conflict(
            f"{argument}={value!r} requires a part that always slides, a_h w^2 > static_friction (g + a_v w^2) + incline; here "
            f"{horizontal:.4g} <= {needed:.4g} m/s^2: {remedy}, or lower max_amplitude"
        )
