"""Where a planar model may be asked: how near parts are to tipping, warnings for slender ones, and refusals."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.kernels.vector import LANES
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.physics.planar.tipping import tipping_shares
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.scene.outlines import convex_hull
from vibgym.scene.parts import Part, bodies_of, kinds_of
from vibgym.simulation.protocol import Setup
from vibgym.simulation.schemes import planar_scheme

SLENDER_DISC, SLENDER = 0.4, 1.0
"""Height of the centre of mass over radius, and over half the width, above which a part that is knocked goes on wobbling, fed
by the drive, for longer than a second."""


def warn_of_slender(parts: Sequence[Part], model: str) -> None:
    """Warn of parts that a planar model holds only as long as nothing knocks them."""
    for part in kinds_of(parts, Part.same_as)[0]:
        limit = SLENDER_DISC if part.symmetry == 0 else SLENDER
        if part.height_is_known and part.slenderness > limit:
            warnings.warn(
                f"parts: {part.name!r} has its centre of mass {part.slenderness:.2g} times as high as its edge is far; above "
                f"{limit:g} a part that is knocked goes on wobbling, which model={model!r} does not see: try model='tilting'",
                UserWarning,
                stacklevel=3,
            )


def check_tipping(parts: Sequence[Part], factors: np.ndarray, where: str, model: str) -> None:
    """Refuse parts that friction alone tips, which no planar model can hold, as far as their heights are known.

    Args:
        factors: (n, parts) on friction.
        where: how errors name the argument.
    """
    ratio = factors * [part.tipping_ratio if part.height_is_known else 0.0 for part in parts]
    if ratio.size and ratio.max() > 1.0:
        part = parts[int(np.unravel_index(int(ratio.argmax()), ratio.shape)[1])]
        way = f"friction times centre_height ({part.centre_height:g} m) is {ratio.max():.3g} of the way to its edge"
        got = f"{part.name!r}, whose {way}"
        allowed = (
            f"at most 1 with model={model!r}, for friction alone tips it: use model='tilting', or give its true height"
        )
        raise checks.refuse(where, got, allowed)


class TippingMargin:
    """Computes :attr:`vibgym.Simulator.tipping_margin`."""

    def __init__(self, setup: Setup) -> None:
        kinds, self._kind = kinds_of(setup.parts, Part.same_as)
        hulls = [convex_hull(kind.outline) for kind in kinds]
        self._height = np.array([kind.centre_height for kind in kinds])
        self._hull, self._first = np.concatenate(hulls), np.cumsum([0, *(len(hull) for hull in hulls)])
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        scheme = planar_scheme(setup.surface, setup.parts[0])
        self._scene = Pinned(
            FIXED_SCENE, FixedScene(table, bodies, scheme, new_workspace(table, bodies, scheme, LANES))
        )

    def __call__(self, drive: Pinned[Drive], state: Pinned[State]) -> np.ndarray:
        """(worlds, parts) one minus the worst share; minus infinity for parts that have fallen."""
        shares = np.empty(state.record.fallen.shape)
        hull, first, kind = self._hull, self._first, self._kind
        tipping_shares(self._scene.address, drive.address, state.address, self._height, hull, first, kind, shares)
        return 1.0 - shares
