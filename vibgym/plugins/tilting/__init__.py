"""Plug-in ``model="tilting"``: parts as rigid bodies above the plane, on plates of different heights."""

from __future__ import annotations

from vibgym.plugins.tilting.model import Tilting, TiltingMultibody, TiltingSettings, scheme_of
from vibgym.simulation.model import Model, Setup
from vibgym.simulation.schemes import PlanarSettings, schemes_alone


def tilting(setup: Setup, settings: TiltingSettings | None = None) -> Model:
    """Return the tilting model, for one part or for several; parts are convex.

    The planar model computes parts that lie flat on plates with equal motion, with the same bits. All others are rigid bodies;
    they cost 50 to 300 times as much.

    Args:
        setup: the scene.
        settings: None: the defaults.

    Raises:
        ValueError: a ramp longer than half an element, or a scene that the model does not cover.
    """
    scheme = scheme_of(setup.surface, TiltingSettings() if settings is None else settings)
    if not setup.multibody:
        return Tilting(setup, schemes_alone(setup.surface, setup.parts.every, PlanarSettings()), scheme)
    return TiltingMultibody(setup, scheme)


tilting.Settings = TiltingSettings  # type: ignore[attr-defined]

__all__ = ["Tilting", "TiltingSettings", "tilting"]
