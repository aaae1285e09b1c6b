"""Which element does what when every part wants its own: phasors of all elements from the pushes that all parts want.

Near rest a part's acceleration is the mean of the pushes of the elements under it, weighted by the area that rests on each, and
its angular acceleration follows from their moments (first-order average, thesis eqs. 5.60 and 5.61). An element under one part
serves it alone; parts that share elements are served together, so that each gets what it wants from all its elements.

Below a smallest amplitude d an element does little or nothing. Where it does less than it is told, but something, it is told
more. Where it does nothing, elements rest or move with an amplitude of at least d, some against others, found by
:mod:`vibgym.allocation.projections`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vibgym.actuators import DataSheet
from vibgym.allocation.cut import new_pieces, outlines_of
from vibgym.allocation.projections import SPREAD, Limits, new_work, serve, start_table
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

MARGIN = 0.1
"""Share of a hard dead zone by which elements stay clear of it: no two are alike."""

INVERSES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {"soft": np.sqrt, "cubic": np.cbrt}
"""What to command, over d, for an amplitude below d: dead zones that make ``a^2 / d`` or ``a^3 / d^2`` of an amplitude a."""


def strongest(surface: Surface, sheet: DataSheet) -> float:
    """Largest amplitude of the elements over the surface's."""
    assert surface.max_amplitude is not None
    return min(sheet.limit / surface.max_amplitude, 1.0) if surface.max_amplitude > 0.0 else 1.0


class Allocator:
    """Turns pushes that parts want into phasors of the elements under them, within what these can do.

    A push is a mean acceleration as a fraction of what full amplitude gives at rest.

    Args:
        surface, parts: the scene.
        sheet: what is known of the elements: largest amplitude, dead zone, resolution.

    Attributes:
        most: largest amplitude, over the surface's.
        least: smallest one of elements that move, likewise.
        gyration: (parts,) radii, m.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], sheet: DataSheet) -> None:
        self.surface, self.parts = surface, tuple(parts)
        self.outlines = outlines_of(surface, self.parts)
        self.gyration = self.outlines.gyration
        largest = surface.max_amplitude
        assert largest is not None
        self.most, self.least, self._made_up = strongest(surface, sheet), 0.0, None
        if sheet.dead_zone > 0.0 and sheet.dead_zone_form == "hard":
            # Commands are rounded to the resolution before the dead zone takes what is small.
            least = ((1.0 + MARGIN) * sheet.dead_zone + 0.5 * sheet.resolution) / largest
            self.least = min(least, self.most)
        elif sheet.dead_zone > 0.0:
            self._made_up = sheet.dead_zone / largest, INVERSES[sheet.dead_zone_form]
        room = len(new_pieces(surface, self.parts).part)
        self._limits = Limits(self.least, self.most, start_table(room, 2.0 * self.least))
        self._usual = np.tile([[1.0], [SPREAD]], surface.rows * surface.columns)[:, None]

    def pushes(
        self,
        pose: np.ndarray,
        present: np.ndarray,
        wanted: np.ndarray,
        gain: np.ndarray | None = None,
        spread: np.ndarray | None = None,
    ) -> np.ndarray:
        """Pushes (worlds, rows, columns, 2) of the elements that do what the parts want as nearly as they can.

        Each is zero or of a length between :attr:`least` and :attr:`most`. Elements rest under parts that want nothing, but
        where these share elements with others.

        Args:
            pose: (worlds, parts, 3).
            present: (worlds, parts) bool.
            wanted: (worlds, parts, 3) x, y, and angular acceleration times radius of gyration.
            gain: (worlds, rows * columns) what the elements make of their phasors; None: all that they are told.
            spread: (worlds, rows * columns) expected error of an element's push over its size; None:
                :data:`vibgym.allocation.projections.SPREAD`.
        """
        surface, worlds = self.surface, len(pose)
        push = np.empty((worlds, surface.rows, surface.columns, 2))
        usual = self._usual
        if usual.shape[1] < worlds:
            usual = self._usual = np.repeat(usual[:, :1], worlds, axis=1)
        gain, spread = usual[0] if gain is None else gain, usual[1] if spread is None else spread
        pieces = new_pieces(surface, self.parts)  # anew, since several threads may use an allocator
        work = new_work(len(self.parts), surface.rows * surface.columns, len(pieces.part))
        given = (np.ascontiguousarray(each) for each in (pose, present, wanted, gain, spread))
        serve(self.outlines, self._limits, *given, pieces, work, push)
        return push

    def actions(
        self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, gain: np.ndarray | None = None
    ) -> np.ndarray:
        """``"phasor"`` actions (worlds, n) float32 that do what :meth:`pushes` says."""
        return self.commands(self.pushes(pose, present, wanted, gain))

    def commands(self, push: np.ndarray) -> np.ndarray:
        """``"phasor"`` actions (worlds, n) float32 of pushes (worlds, rows, columns, 2)."""
        if self._made_up is not None:
            width, inverse = self._made_up
            share = np.sqrt((push**2).sum(axis=-1, keepdims=True)) / width
            inside = (share > 0.0) & (share < 1.0)
            share[~inside] = 1.0
            push = push * (inverse(share) / share)
        return (-push[..., ::-1]).astype(np.float32).reshape(len(push), -1)
