"""Counts collisions: pairs of parts newly in touch."""

from __future__ import annotations

import numpy as np

from vibgym.envs.core import Core
from vibgym.physics.collision.hulls import all_gaps
from vibgym.tasks import ManyTask
from vibgym.tasks.crowd import TOUCHING


class Touches:
    """Pairs that come into touch, seen once a step.

    A pair is in touch where the parts' outlines are closer than 0.1 mm at the end of a step; it counts whenever it is now and
    was not a step ago. What touches and parts again within a step is not seen. Pairs in touch at the start do not count.

    Args:
        core: freshly reset worlds of a task for several parts.
    """

    def __init__(self, core: Core) -> None:
        assert isinstance(core.task, ManyTask)
        self.core, self.hulls = core, core.task.hulls
        self.present = core.score.present.copy()
        self.one, self.other = np.triu_indices(len(core.parts), 1)
        self.touching = np.zeros((core.worlds, len(self.one)), dtype=bool)
        self.new()

    def new(self) -> np.ndarray:
        """(worlds,) pairs in touch now that were not when last asked."""
        state = self.core.simulator.state
        worlds = np.flatnonzero(self.core.score.touching)  # in the others no pair is
        gaps = np.empty((len(worlds), *2 * (len(self.core.parts),)))
        all_gaps(self.hulls, np.ascontiguousarray(state.pose[worlds]), gaps)
        there = self.present[worlds] & ~state.fallen[worlds]
        touching = np.zeros_like(self.touching)
        touching[worlds] = gaps[:, self.one, self.other] < TOUCHING
        touching[worlds] &= there[:, self.one] & there[:, self.other]
        found = (touching & ~self.touching).sum(axis=1)
        self.touching = touching
        return found
