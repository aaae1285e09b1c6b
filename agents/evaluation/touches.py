"""Counts collisions: pairs of parts newly in touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym.envs.shared import Truth
from vibgym.scene import Part
from vibgym.scene.hulls import gaps_between
from vibgym.tasks.episode import TOUCHING


class Touches:
    """Pairs that come into touch, seen once a step.

    A pair is in touch where the parts' outlines are closer than 0.1 mm at the end of a step; it counts whenever it is now and
    was not a step ago. What touches and parts again within a step is not seen. Pairs in touch at the start do not count.

    Args:
        parts: of every world.
        worlds: number of worlds.
    """

    def __init__(self, parts: Sequence[Part], worlds: int) -> None:
        self.parts = parts
        self.one, self.other = np.triu_indices(len(parts), 1)
        self.touching = np.zeros((worlds, len(self.one)), dtype=bool)

    def new(self, truth: Truth, some: np.ndarray) -> np.ndarray:
        """(worlds,) pairs in touch now that were not when last asked.

        Args:
            truth: the state now.
            some: (worlds,) bool, where pairs are in touch at all; none are elsewhere.
        """
        worlds = np.flatnonzero(some & np.isfinite(truth.pose).all(axis=(1, 2)))
        touching = np.zeros_like(self.touching)
        if len(worlds):
            gaps = gaps_between(self.parts, truth.pose[worlds])
            there = truth.present[worlds] & ~truth.fallen[worlds]
            touching[worlds] = gaps[:, self.one, self.other] < TOUCHING
            touching[worlds] &= there[:, self.one] & there[:, self.other]
        found = (touching & ~self.touching).sum(axis=1)
        self.touching = touching
        return found
