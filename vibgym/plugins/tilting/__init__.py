"""Plug-in ``model="tilting"``: parts as rigid bodies above the plane, on plates of different heights."""

from __future__ import annotations

from vibgym.plugins.tilting.model import RAMP, RESTITUTION, STEPS, Tilting, scheme_of
from vibgym.scene.parts import kinds_of
from vibgym.simulation.model import Model, Setup
from vibgym.simulation.schemes import planar_scheme, planar_schemes


def tilting(
    setup: Setup, *, restitution: float = RESTITUTION, ramp_mm: float = 1e3 * RAMP, steps: int = STEPS
) -> Model:
    """Return the tilting model, for one part or for several; parts are convex.

    The planar model computes parts that lie flat on plates with equal motion, with the same bits. All others are rigid bodies;
    they cost 50 to 300 times as much.

    Args:
        setup: the scene.
        restitution: of a part's bottom on plates (Newton), 0 to 1.
        ramp_mm: mm on either side of a border between plates over which their heights are blended, up to half an element.
        steps: number of steps in a period.

    Raises:
        ValueError: an invalid setting, or a scene that the model does not cover.
    """
    scheme = scheme_of(setup.surface, restitution=restitution, ramp_mm=ramp_mm, steps=steps)
    if not setup.multibody:
        return Tilting(setup, planar_scheme(setup.surface, setup.parts[0]), scheme)
    from vibgym.plugins.tilting.multibody import TiltingMultibody

    return TiltingMultibody(setup, planar_schemes(setup.surface, kinds_of(setup.parts)[0], setup.walls), scheme)


__all__ = ["RAMP", "RESTITUTION", "STEPS", "Tilting", "tilting"]
