"""Phasors of all elements from the pushes that all parts require.

Near rest a part's acceleration is the mean of the pushes of the elements under it, weighted by the area on each, and its
angular acceleration follows from their moments (first-order average, thesis eqs. 5.60 and 5.61). Parts that share elements are
allocated together.

Below the dead zone's width d an element moves less than commanded, or not at all. In a soft dead zone the command is raised
to compensate. In a hard one, elements rest or move with an amplitude of at least d, some in opposite directions
(:mod:`vibgym.allocation.projections`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from vibgym import checks
from vibgym.actuators import DataSheet
from vibgym.allocation.cut import Pieces, effects, new_pieces, outlines_of, reaches
from vibgym.allocation.projections import SPREAD, Limits, Problem, Scratch, allocate, new_scratch, start_table
from vibgym.kernels.jit import jit
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers

MARGIN = 0.1
"""Margin above a hard dead zone, as a share of it, for the spread of the elements."""

INVERSES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {"soft": np.sqrt, "cubic": np.cbrt}
"""Command over d for an amplitude below d, for dead zones that turn an amplitude a into ``a^2 / d`` or ``a^3 / d^2``."""


def strongest(surface: Surface, sheet: DataSheet) -> float:
    """Return the largest amplitude of the actuators over the surface's."""
    assert surface.max_amplitude is not None
    return min(sheet.limit / surface.max_amplitude, 1.0) if surface.max_amplitude > 0.0 else 1.0


class Allocator:
    """Computes phasors of the elements from the pushes that parts require, within the actuator limits.

    A push is a mean acceleration as a fraction of what full amplitude gives at rest.

    Args:
        surface, parts: the scene.
        sheet: largest amplitude, dead zone and resolution of the elements.
        threads: None uses all processors of this process; results do not depend on it.

    Attributes:
        most: largest amplitude, over the surface's.
        least: smallest one of elements that move, likewise.
        gyration: (parts,) radii of the first world's parts, m.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], sheet: DataSheet, threads: int | None = None) -> None:
        self.surface, self.parts = surface, Kinds.of(parts)
        self.outlines = outlines_of(surface, self.parts)
        self.gyration = np.sqrt([part.gyration for part in self.parts])
        largest = surface.max_amplitude
        assert largest is not None
        self.most, self.least, self._made_up = strongest(surface, sheet), 0.0, None
        if sheet.dead_zone > 0.0 and sheet.dead_zone_form == "hard":
            # Commands are rounded to the resolution before the dead zone applies.
            least = ((1.0 + MARGIN) * sheet.dead_zone + 0.5 * sheet.resolution) / largest
            self.least = min(least, self.most)
        elif sheet.dead_zone > 0.0:
            self._made_up = sheet.dead_zone / largest, INVERSES[sheet.dead_zone_form]
        self._threads = workers.available_threads() if threads is None else checks.count("threads", threads, most=4096)
        self._scratch = workers.Pool(partial(_scratch, surface, self.parts))
        self._limits = Limits(self.least, self.most, start_table(self.least))
        # Gain and spread, (2, 1, elements)
        self._usual = np.tile([[[1.0]], [[SPREAD]]], surface.rows * surface.columns)

    def pushes(
        self,
        pose: np.ndarray,
        present: np.ndarray,
        wanted: np.ndarray,
        gain: np.ndarray | None = None,
        spread: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the feasible pushes (worlds, rows, columns, 2) whose effect is nearest to the wanted one.

        Each is zero or has a length between :attr:`least` and :attr:`most`. Elements rest under parts for which nothing is
        wanted, unless these share elements with others.

        Args:
            pose: (worlds, parts, 3).
            present: (worlds, parts) bool.
            wanted: (worlds, parts, 3) x, y, and angular acceleration times radius of gyration.
            gain: (worlds, rows * columns) gains from commanded to actual phasors; None: all 1.
            spread: (worlds, rows * columns) expected error of an element's push over its size; None:
                :data:`vibgym.allocation.projections.SPREAD`.
        """
        surface = self.surface
        push = np.empty((len(pose), surface.rows, surface.columns, 2))
        self._allocate(push, pose, present, wanted, gain, spread)
        return push

    def _allocate(
        self,
        push: np.ndarray,
        pose: np.ndarray,
        present: np.ndarray,
        wanted: np.ndarray,
        gain: np.ndarray | None,
        spread: np.ndarray | None = None,
        as_phasors: bool = False,
    ) -> None:
        """Overwrite ``push`` (worlds, ...) with :meth:`pushes`, or with their phasors."""
        usual = self._usual
        gain, spread = usual[0] if gain is None else gain, usual[1] if spread is None else spread
        arrays = (np.ascontiguousarray(array) for array in (pose, present, wanted, gain, spread))
        problem = Problem(self.outlines, self._limits, *arrays)
        by_element = push.reshape(len(push), -1, 2)

        def work(start: int, stop: int) -> None:
            self._scratch.lend(lambda scratch: allocate(start, stop, problem, *scratch, by_element, as_phasors))

        workers.share(work, len(push), self._threads)

    def effect(
        self, pose: np.ndarray, present: np.ndarray, push: np.ndarray, gain: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the effect of pushes on the parts near rest, (worlds, parts, 3), like ``wanted`` of :meth:`pushes`.

        Args:
            pose, present, gain: see :meth:`pushes`.
            push: (worlds, rows, columns, 2), of :meth:`pushes`.
        """
        worlds = len(push)
        effect = np.empty((worlds, len(self.parts), 3))
        arrays = (np.ascontiguousarray(array) for array in (pose, present, push.reshape(worlds, -1, 2)))
        gain = np.ascontiguousarray(self._usual[0] if gain is None else gain)
        effects(self.outlines, *arrays, gain, new_pieces(self.surface, self.parts), effect)
        return effect

    def reach(self, pose: np.ndarray) -> np.ndarray:
        """Return the largest push that turns each part near rest (worlds, parts), irrespective of the mean push.

        All elements under it push at :attr:`most`, each perpendicular to its lever.
        """
        reach = np.empty(pose.shape[:2])
        present = np.ones(reach.shape, dtype=bool)
        reaches(self.outlines, np.ascontiguousarray(pose), present, new_pieces(self.surface, self.parts), reach)
        return self.most * reach

    def actions(
        self,
        pose: np.ndarray,
        present: np.ndarray,
        wanted: np.ndarray,
        gain: np.ndarray | None = None,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return ``"phasor"`` actions (worlds, n) float32 of the pushes that :meth:`pushes` returns.

        Args:
            out: (worlds, n) float32 memory for the result; None: new memory.
        """
        if out is None:
            out = np.empty((len(pose), 2 * self.surface.rows * self.surface.columns), dtype=np.float32)
        if self._made_up is None:
            self._allocate(out, pose, present, wanted, gain, as_phasors=True)
        else:
            out[...] = self.commands(self.pushes(pose, present, wanted, gain))
        return out

    def commands(self, push: np.ndarray) -> np.ndarray:
        """Return ``"phasor"`` actions (worlds, n) float32 of pushes (worlds, rows, columns, 2)."""
        if self._made_up is not None:
            width, inverse = self._made_up
            share = np.sqrt((push**2).sum(axis=-1, keepdims=True)) / width
            inside = (share > 0.0) & (share < 1.0)
            share[~inside] = 1.0
            push = push * (inverse(share) / share)
        action = np.empty((len(push), math.prod(push.shape[1:])), dtype=np.float32)
        turn_round(np.ascontiguousarray(push).reshape(-1), action.reshape(-1))
        return action


@jit
def turn_round(push, action):
    """Write pushes (n,) x, y, x, y, ... as phasors ``-(y, x)``, float32, into ``action``."""
    for k in range(0, push.shape[0], 2):
        action[k], action[k + 1] = -push[k + 1], -push[k]


def _scratch(surface: Surface, parts: Kinds) -> tuple[Pieces, Scratch]:
    """Return scratch memory of one thread."""
    pieces = new_pieces(surface, parts)
    return pieces, new_scratch(len(parts), surface.rows * surface.columns, len(pieces.part))
