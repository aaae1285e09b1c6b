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
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from vibgym import checks
from vibgym.actuators import DataSheet
from vibgym.allocation.cut import effects, new_pieces, outlines_of, reaches
from vibgym.allocation.projections import SPREAD, Limits, Problem, allocate, new_scratch, start_table, turn_round
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers

MARGIN = 0.1
"""Margin above a hard dead zone, as a share of it, for the spread of the elements."""

POWERS: Mapping[str, int] = {"soft": 2, "cubic": 3}
"""Powers p of dead zones that turn an amplitude a below their width d into ``a^p / d^(p - 1)``."""


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
        problem: arguments of the kernels, with gains of 1 and the usual spread.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], sheet: DataSheet, threads: int | None = None) -> None:
        self.surface, self.parts = surface, Kinds.of(parts)
        self.outlines = outlines_of(surface, self.parts)
        self.gyration = np.sqrt([part.gyration for part in self.parts])
        largest = surface.max_amplitude
        assert largest is not None
        self.most, self.least, soft, power = strongest(surface, sheet), 0.0, 0.0, 1.0
        if sheet.dead_zone > 0.0 and sheet.dead_zone_form == "hard":
            # Commands are rounded to the resolution before the dead zone applies.
            least = ((1.0 + MARGIN) * sheet.dead_zone + 0.5 * sheet.resolution) / largest
            self.least = min(least, self.most)
        elif sheet.dead_zone > 0.0:
            soft, power = sheet.dead_zone / largest, 1.0 / POWERS[sheet.dead_zone_form] - 1.0
        self._threads = workers.available_threads() if threads is None else checks.count("threads", threads, most=4096)
        self._scratch = workers.Pool(partial(new_scratch, surface, self.parts))
        limits = Limits(self.least, self.most, start_table(self.least), soft=soft, power=power)
        gain = np.ones((1, surface.rows * surface.columns))
        self.problem = Problem(self.outlines, limits, gain, SPREAD * gain)

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
        usual = self.problem
        gain, spread = usual.gain if gain is None else gain, usual.spread if spread is None else spread
        pose, present, wanted, gain, spread = map(np.ascontiguousarray, (pose, present, wanted, gain, spread))
        problem = usual._replace(gain=gain, spread=spread)
        push = np.empty((len(pose), 2 * self.surface.rows * self.surface.columns))

        def work(start: int, stop: int) -> None:
            self._scratch.lend(lambda scratch: allocate(start, stop, problem, pose, present, wanted, scratch, push))

        workers.share(work, len(push), self._threads)
        return push.reshape(len(pose), self.surface.rows, self.surface.columns, 2)

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
        arrays = map(np.ascontiguousarray, (pose, present, push.reshape(worlds, -1, 2)))
        gain = self.problem.gain if gain is None else np.ascontiguousarray(gain)
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
        self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, gain: np.ndarray | None = None
    ) -> np.ndarray:
        """Return ``"phasor"`` actions (worlds, n) float32 of the pushes that :meth:`pushes` returns."""
        return self.commands(self.pushes(pose, present, wanted, gain))

    def commands(self, push: np.ndarray) -> np.ndarray:
        """Return ``"phasor"`` actions (worlds, n) float32 of pushes (worlds, rows, columns, 2)."""
        action = np.empty((len(push), math.prod(push.shape[1:])), dtype=np.float32)
        turn_round(self.problem.limits, np.ascontiguousarray(push).reshape(-1), action.reshape(-1))
        return action
