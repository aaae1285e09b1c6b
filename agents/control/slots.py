"""Targets for several parts: slots of a lattice, far enough apart, given out so that the longest way is short."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from agents.policy import Situation

SHIFTS = 9
"""Places tried along the table for the lattice that takes a heap apart."""

SPARE = 1.003
"""Pitch of the lattice over the smallest that keeps the spacing rule."""


def axis(low: float, high: float, pitch: float) -> np.ndarray:
    """As many points between ``low`` and ``high`` as keep ``pitch``, spread from end to end; one in the middle if none fit."""
    count = math.floor((high - low) / pitch + 1e-9) + 1 if high > low else 1
    return np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])


def lattice(low: np.ndarray, high: np.ndarray, size: np.ndarray, spacing: float, least: int) -> np.ndarray:
    """Centres (n, 2) m, at least ``least``, for parts of ``size`` (2,) m that lie straight: ``spacing`` apart if there is room.

    Where there is not, rows or columns are added until they suffice, each where it costs the least distance.
    """
    pitch = SPARE * (size + spacing)
    while True:
        x, y = axis(low[0], high[0], pitch[0]), axis(low[1], high[1], pitch[1])
        if len(x) * len(y) >= least:
            return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        tight = (high - low) / np.array([len(x), len(y)])  # the pitch that gains a column, or a row
        k = int(np.argmax(tight / size))
        pitch[k] = tight[k]


def assign(centre: np.ndarray, slots: np.ndarray) -> np.ndarray:
    """One slot (n, 2) m for each centre (n, 2) m; the cubes of the ways add up to the least, so none is long."""
    way = np.sqrt(((centre[:, None] - slots) ** 2).sum(axis=-1))
    return slots[linear_sum_assignment(way**3)[1]]


class Slots:
    """Gives targets to all parts of a world.

    Args:
        situation: surface, parts, kinds and zones.
        edge: m, distance of targets from the surface's border.
        inset: m, distance from the other borders of a zone.
    """

    def __init__(self, situation: Situation, edge: float, inset: float) -> None:
        surface = situation.surface
        self.situation = situation
        self.kind = np.array(situation.kind)
        self.spacing = math.sqrt(2.0) * surface.element_size
        radius = np.array([part.radius for part in situation.parts])
        edge = min(
            edge, radius.max()
        )  # small surfaces and zones hold parts by their circles, and so do these rectangles
        self.low, self.high = np.full(2, edge), np.array([surface.width, surface.height]) - edge
        # Twice the reach from the centre, on the larger side, so that parts of any shape in neighbouring slots are clear.
        self.size = np.array([2.0 * np.abs(part.outline).max(axis=0) for part in situation.parts])
        self.slots = []
        if situation.zones is not None:
            for kind, zone in enumerate(situation.zones):
                own = self.kind == kind
                border = min(inset, radius[own].max())
                low, high = np.maximum(zone[:2] + border, self.low), np.minimum(zone[2:] - border, self.high)
                self.slots.append(lattice(low, high, self.size[own].max(axis=0), self.spacing, int(own.sum())))

    def give(self, centre: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Targets (parts, 2) m of one world's parts at ``centre`` (parts, 2) m; absent parts stay."""
        target = centre.copy()
        if self.situation.zones is None:
            target[present] = self._apart(centre[present])
            return target
        for kind, slots in enumerate(self.slots):
            own = present & (self.kind == kind)
            target[own] = assign(centre[own], slots)
        return target

    def _apart(self, centre: np.ndarray) -> np.ndarray:
        """Slots of the lattice, shifted along the table so that the longest way is shortest."""
        slots = lattice(self.low, self.high, self.size.max(axis=0), self.spacing, len(centre))
        pitch = self.size[:, 0].max() + self.spacing
        best, least = slots, math.inf
        for shift in np.linspace(-0.5, 0.5, SHIFTS) * pitch:
            moved = slots + [shift, 0.0]
            moved = moved[(moved[:, 0] >= self.low[0] - 1e-9) & (moved[:, 0] <= self.high[0] + 1e-9)]
            if len(moved) >= len(centre):
                target = assign(centre, moved)
                longest = np.sqrt(((target - centre) ** 2).sum(axis=-1)).max(initial=0.0)
                if longest < least:
                    best, least = target, longest
        return best if least < math.inf else assign(centre, slots)


def swap(kind: np.ndarray, present: np.ndarray, centre: np.ndarray, target: np.ndarray, gain: float) -> None:
    """Let parts of a kind swap targets, in place, where their ways, each cubed with ``gain`` (m) more, then add up to less.

    Args:
        centre, target: (worlds, parts, 2) m.
    """

    def way(i: int, j: int) -> np.ndarray:
        return np.sqrt(((centre[:, i] - target[:, j]) ** 2).sum(axis=-1))

    for i in range(len(kind)):
        for j in range(i):
            if kind[i] != kind[j]:
                continue
            now, then = way(i, i) ** 3 + way(j, j) ** 3, (way(i, j) + gain) ** 3 + (way(j, i) + gain) ** 3
            better = present[:, i] & present[:, j] & (then < now)
            target[better, i], target[better, j] = target[better, j], target[better, i]
