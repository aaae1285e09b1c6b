"""Tipping of parts by friction: checks for models that keep parts flat, and the margin of a motion."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.kernels.vector import LANES
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.physics.planar.tipping import edge_fractions
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.scene.bodies import bodies_of
from vibgym.scene.outlines import convex_hull
from vibgym.scene.parts import Part
from vibgym.simulation.schemes import planar_scheme

if TYPE_CHECKING:
    from vibgym.simulation.model import Setup

SLENDER_DISC, SLENDER = 0.4, 1.0
"""Slenderness of discs and of others, above which a disturbed part wobbles for longer than a second, driven by the table."""


def warn_of_slender(kinds: Sequence[Part], model: str) -> None:
    """Warn about kinds of parts that wobble after a disturbance, which planar models do not cover."""
    for part in kinds:
        limit = SLENDER_DISC if part.symmetry == 0 else SLENDER
        if part.height_is_known and part.slenderness > limit:
            warnings.warn(
                f"parts: {part.name!r}: centre height over distance to the edge is {part.slenderness:.2g}; above "
                f"{limit:g} a disturbed part wobbles, which model={model!r} does not cover: try model='tilting'",
                UserWarning,
                stacklevel=4,
            )


def check_tipping(parts: Sequence[Part], factors: np.ndarray, where: str, model: str) -> None:
    """Check that friction alone does not tip parts, which planar models do not cover; parts of unknown height pass.

    Args:
        factors: (n, parts) on friction.
        where: name of the argument in errors.
    """
    ratio = factors * [part.tipping_ratio if part.height_is_known else 0.0 for part in parts]
    if ratio.size and ratio.max() > 1.0:
        part = parts[int(np.unravel_index(int(ratio.argmax()), ratio.shape)[1])]
        raise checks.conflict(
            f"{where}: friction alone tips {part.name!r} (friction times centre_height, {part.centre_height:g} m, is "
            f"{ratio.max():.3g} of the distance to its edge, at most 1 with model={model!r}): use model='tilting', or set "
            "its true height"
        )


class TippingMargin:
    """Function that computes :attr:`vibgym.Simulator.tipping_margin`."""

    def __init__(self, setup: Setup) -> None:
        kinds = setup.parts.every
        hulls = [convex_hull(kind.outline) for kind in kinds]
        self._height = np.array([kind.centre_height for kind in kinds])
        self._hull, self._first = np.concatenate(hulls), np.cumsum([0, *(len(hull) for hull in hulls)])
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        scheme = planar_scheme(setup.surface, kinds[0])
        self._scene = Pinned(
            FIXED_SCENE, FixedScene(table, bodies, scheme, new_workspace(table, bodies, scheme, LANES))
        )

    def __call__(self, drive: Pinned[Drive], state: Pinned[State]) -> np.ndarray:
        """Return (worlds, parts) one minus the worst share; minus infinity for parts that have fallen."""
        shares = np.empty(state.record.fallen.shape)
        scene, parts = self._scene.address, (self._height, self._hull, self._first)
        edge_fractions(scene, drive.address, state.address, *parts, shares)
        return 1.0 - shares
