"""What a model computes with: its kernel and its scheme, made once from the model's knobs."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.averaged import integrator as averaged
from vibgym.physics.averaged.contact import AveragedScheme
from vibgym.physics.contact_area.pressure_moments import LANES
from vibgym.physics.friction import planar
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import averages_tables

RUNGE_KUTTA_STEPS = 18
"""Fewest of them in a period unless asked for otherwise."""


FEWEST_STEPS = 4
"""With fewer cuts a period, whatever moves under a part goes unseen: errors of millimetres in a second, and no sign of it."""


class Method(NamedTuple):
    """``advance(start, stop, drive, table, body, scheme, state, periods)`` and its scheme."""

    advance: Callable[..., None]
    scheme: Any


def chosen(name: str, value: Any, most: int | None = None) -> int | None:
    """A count, or None for ``"auto"``."""
    if isinstance(value, str) and value == "auto":
        return None
    return checks.count(f"{name} (or 'auto')", value, most=most)


def planar_method(
    surface: Surface, part: Part, *, steps: int | str = "auto", substeps: int | str = "auto", pieces: int | str = "auto"
) -> Method:
    """Resolved in time: the contact area is cut ``steps`` times a period, friction takes ``substeps`` in each."""
    travel = 2.0 * math.pi * surface.horizontal_amplitude
    cuts = chosen("steps", steps) or (5 if part.gyration >= travel**2 else 9)
    if cuts < FEWEST_STEPS and surface.rows * surface.columns > 1 and surface.horizontal_amplitude > 0.0:
        raise checks.refuse(
            "steps",
            cuts,
            f"a whole number >= {FEWEST_STEPS} on several elements: fewer cuts a period miss what lies beneath",
        )
    inner = chosen("substeps", substeps) or math.ceil(RUNGE_KUTTA_STEPS / cuts)
    if cuts * inner < FEWEST_STEPS and surface.horizontal_amplitude > 0.0:
        allowed = (
            f"a whole number >= {math.ceil(FEWEST_STEPS / cuts)} with steps={cuts}: the table turns too far in one step"
        )
        raise checks.refuse("substeps", inner, allowed)
    cells = chosen("pieces", pieces, most=64) or 0
    phase = np.arange(3 * cuts * inner + 1) * (2.0 * math.pi / (3 * cuts * inner))
    return Method(planar.advance_worlds, planar.Scheme(cuts, inner, cells, LANES, np.cos(phase), np.sin(phase)))


def averaged_method(
    surface: Surface, part: Part, *, order: int = 2, stride: int = 1, steps: int | str = "auto"
) -> Method:
    """Averaged over the period: ``steps`` in each span of ``stride`` periods."""
    order = checks.count("order", order, most=2)
    stride = checks.count("stride", stride)
    cuts = chosen("steps", steps) or 1
    check_sliding(surface, part)
    return Method(averaged.advance_worlds, AveragedScheme(order, stride, cuts, averages_tables.averages()))


def check_sliding(surface: Surface, part: Part) -> None:
    """Refuse scenes that the averaged model does not cover."""
    if not surface.slides_permanently(part.static_friction):
        needed = part.static_friction * (surface.gravity + surface.full_scale)
        horizontal = surface.horizontal_amplitude * surface.angular_frequency**2
        raise checks.refuse(
            "model",
            "averaged",
            f"scenes that always slide, a_h w^2 > static_friction (g + a_v w^2); here {horizontal:.4g} <= {needed:.4g} m/s^2:"
            " use model='planar', or lower max_amplitude",
        )


MODELS: Mapping[str, Callable[..., Method]] = {"planar": planar_method, "averaged": averaged_method}


def build(model: str, surface: Surface, part: Part, knobs: Mapping[str, Any]) -> Method:
    """Kernel and scheme of ``model``, for one part.

    Raises:
        ValueError: an unknown model, a knob that it does not have, a bad value, or a scene that it does not cover.
    """
    checks.choice("model", model, tuple(MODELS))
    check_knobs(model, MODELS[model], knobs)
    return MODELS[model](surface, part, **knobs)


def check_knobs(model: str, make: Callable[..., Any], knobs: Mapping[str, Any]) -> None:
    """Refuse knobs that are not keyword arguments of ``make``."""
    known = [name for name, each in inspect.signature(make).parameters.items() if each.kind is each.KEYWORD_ONLY]
    for name, value in knobs.items():
        if name not in known:
            raise checks.refuse(name, value, f"the knobs of model={model!r}: {', '.join(known)}")
