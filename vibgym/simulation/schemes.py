"""Time steps and tables of the models, from their settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from pydantic import Field

from vibgym import checks
from vibgym.physics.averaged.integrator import AveragedScheme
from vibgym.physics.core.records import Scheme
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings, Length
from vibgym.simulation import averages_tables

RUNGE_KUTTA_STEPS = 18
"""Default for the fewest Runge-Kutta steps in a period."""

FEWEST_STEPS = 4
"""Fewest cuts of the contact area in a period; with fewer, errors reach millimetres in a second."""

MAX_STEPS, MAX_SUBSTEPS = 10_000, 4096
"""Most cuts in a period and substeps in a step; more do not improve accuracy."""

CONTACT_STEPS = 10
"""Default for the fewest steps of the coupling between friction and contacts in a period."""

Auto = Literal["auto"]


class PlanarSettings(BaseSettings):
    """Settings of the planar model: flat contact with static and sliding friction, resolved in time."""

    steps: Auto | Annotated[int, Ge(1), Le(MAX_STEPS)] = "auto"
    """Times per period that the contact area is cut by the element grid; second order. ``"auto"``: 5, or 9 for parts whose
    radius of gyration is below ``2 pi a_h``, the displacement of the table in a period."""

    substeps: Auto | Annotated[int, Ge(1), Le(MAX_SUBSTEPS)] = "auto"
    """Runge-Kutta steps of the friction dynamics in each step; fourth order. ``"auto"``: at least 18 in a period, which
    resolve the table's motion to 0.1 % at full speed."""

    pieces: Auto | Annotated[int, Ge(1), Le(64)] = "auto"
    """Cells per element and direction into which the contact area is cut. ``"auto"``: friction as a series over the whole
    contact area where slip varies little under the part, elsewhere as many cells as the spin requires."""

    contacts: str = "certified"
    """With several parts or walls. ``"certified"``: impacts one by one at their times, overlaps below 0.3 mm. ``"pymunk"``: by
    pymunk's solver, an independent check; parts may overlap by the closing speed times a step. ``"fast"``, for training: a few
    steps per period, impacts at the same time; parts may overlap by more within a step (:mod:`vibgym.simulation.contacts`)."""

    contact_steps: Auto | Annotated[int, Ge(1), Le(MAX_STEPS)] = "auto"
    """With several parts or walls, fewest alternating steps of friction and contacts in a period; ``"auto"``: 10, or as many
    as keep what friction adds to an overlap small (long periods, narrow parts). Steps are shorter where parts come together
    or spin fast. With other contacts all steps are equal, and ``"auto"`` is 10 (pymunk) or 5 (fast), or as many as friction
    and narrow parts require."""

    contact_overlap: Auto | Annotated[Length, Ge(2e-6), Le(1e-4)] = "auto"
    """With certified contacts, overlap of two parts before contacts act; ``"auto"``: 5e-6 m, or a fiftieth of half the
    narrowest part."""


class AveragedSettings(BaseSettings):
    """Settings of the averaged model (one part and no walls): the planar model averaged over the period, for parts that always
    slide; faster where drives are held for several periods, and less exact."""

    order: int = Field(default=2, ge=1, le=2)
    """Order in ``mu g / (a_h w^2)``."""

    stride: int = Field(default=1, ge=1, le=checks.MAX_PERIODS)
    """Periods that one span of steps covers; the last span of a call may be shorter."""

    steps: Auto | Annotated[int, Ge(1), Le(MAX_STEPS)] = "auto"
    """Steps in each span; the contact area is cut once in each and once a call; second order. ``"auto"``: 1."""


def varies(part: Part) -> bool:
    """Return whether a part's coefficient of friction depends on speed."""
    return part.friction_law is not None


def planar_scheme(
    surface: Surface,
    part: Part,
    settings: PlanarSettings | None = None,
    *,
    by_points: bool = False,
) -> Scheme:
    """Return the scheme with ``steps`` cuts of the contact area in a period, each with ``substeps`` of friction.

    ``by_points``: do not use the series, which requires a constant coefficient of friction.
    """
    settings = PlanarSettings() if settings is None else settings
    travel = 2.0 * math.pi * surface.horizontal_amplitude
    cuts = _chosen(settings.steps) or (5 if part.gyration >= travel**2 else 9)
    if cuts < FEWEST_STEPS and surface.rows * surface.columns > 1 and surface.horizontal_amplitude > 0.0:
        raise checks.refuse("steps", cuts, f"a whole number >= {FEWEST_STEPS} on several elements")
    inner = _chosen(settings.substeps) or math.ceil(RUNGE_KUTTA_STEPS / cuts)
    if cuts * inner < FEWEST_STEPS and surface.horizontal_amplitude > 0.0:
        least = math.ceil(FEWEST_STEPS / cuts)
        raise checks.refuse("substeps", inner, f"a whole number >= {least} with steps={cuts}")
    cells = _chosen(settings.pieces) or (-1 if by_points else 0)
    phase = np.arange(3 * cuts * inner + 1) * (2.0 * math.pi / (3 * cuts * inner))
    return Scheme(cuts, inner, cells, np.cos(phase), np.sin(phase))


def schemes_alone(surface: Surface, kinds: Sequence[Part], settings: PlanarSettings) -> list[Scheme]:
    """Return :func:`planar_scheme` for each kind, by points if the friction of any depends on speed."""
    by_points = any(map(varies, kinds))
    return [planar_scheme(surface, part, settings, by_points=by_points) for part in kinds]


def _chosen(value: int | str) -> int | None:
    """Return a count, or None for ``"auto"``."""
    return value if isinstance(value, int) else None


def averaged_scheme(surface: Surface, part: Part, settings: AveragedSettings) -> AveragedScheme:
    """Return the scheme of the averaged model: ``steps`` in each span of ``stride`` periods."""
    check_sliding(surface, part.static_friction)
    if varies(part):
        raise checks.conflict("model='averaged' requires a constant coefficient of friction: use model='planar'")
    cuts = _chosen(settings.steps) or 1
    return AveragedScheme(settings.order, settings.stride, cuts, averages_tables.averages())


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
