"""Targets for several parts: places of a lattice, far enough apart, given out so that the longest way is short."""

from __future__ import annotations

import math

import numpy as np

from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.starts import lattice

SHIFTS = 9
"""How many shifts along the table are tried of the lattice that takes a heap apart."""

SPARE = 1.003
"""Pitch of the lattice over the smallest that keeps the spacing rule."""

BEFORE = 0.04
"""m before their gates that parts wait which are not yet at its height."""


def places(low: np.ndarray, high: np.ndarray, size: np.ndarray, spacing: float, least: int) -> np.ndarray:
    """Centres (n, 2) m, at least ``least``, for parts of ``size`` (2,) m that lie straight: ``spacing`` apart if there is room.

    Where there is not, rows or columns are added until they suffice, each where it costs the least distance.
    """
    middle = 0.5 * (low + high)
    low, high = np.minimum(low, middle), np.maximum(high, middle)  # no room at all is room for one in the middle
    pitch = SPARE * (size + spacing)
    while True:
        centres = pitch * lattice(low / pitch, high / pitch, 0.0, 1.0)
        if len(centres) >= least:
            return centres
        # The pitch that gains a column, or a row.
        tight = (high - low) / [len(np.unique(column)) for column in centres.T]
        k = int(np.argmax(tight / size))
        pitch[k] = tight[k]


def assign(centre: np.ndarray, free: np.ndarray) -> np.ndarray:
    """One of the free places (n, 2) m for each centre (n, 2) m; the cubes of the ways add up to the least, so none is long."""
    from scipy.optimize import linear_sum_assignment  # of the extra "policies"

    way = np.sqrt(((centre[:, None] - free) ** 2).sum(axis=-1))
    return free[linear_sum_assignment(way**3)[1]]


class Targets:
    """Gives targets to all parts of a world.

    Args:
        info: surface, parts, kinds and zones.
        edge: m, distance of targets from the surface's border.
        inset: m, distance from the other borders of a zone.
        slack: m, by how much more than they have to be parts shall be apart, because they do not come to rest just there.

    Attributes:
        spacing: m, distance that parts keep: the largest dimension of an element, so that none shares one, or what is asked.
        room: m, distance that targets have, where there is room.
    """

    def __init__(self, info: TaskInfo, edge: float, inset: float, slack: float = 0.0) -> None:
        if not info.has_goal:
            import scipy.optimize  # noqa: F401  -- missed here, where it is, and not in the first episode
        surface, parts = info.surface, info.parts
        self.zones, self.kind = info.zones, np.array(info.kind)
        self.spacing = max(math.sqrt(2.0) * surface.element_size, info.apart or 0.0)
        self.room = self.spacing + slack
        radius = np.array([part.radius for part in parts])
        edge = min(edge, radius.max())  # small surfaces and zones hold parts by their circles, as these rectangles do
        self.low, self.high = np.full(2, edge), np.array([surface.width, surface.depth]) - edge
        # Twice the reach from the centre, on the larger side, so that parts of any shape in neighbouring places are clear.
        self.size = np.array([2.0 * np.abs(part.outline).max(axis=0) for part in parts])
        self.places = []
        for kind, zone in enumerate(() if info.zones is None else info.zones):
            own = self.kind == kind
            border = min(inset, radius[own].max())
            low, high = np.maximum(zone[:2] + border, self.low), np.minimum(zone[2:] - border, self.high)
            self.places.append(places(low, high, self.size[own].max(axis=0), self.room, int(own.sum())))

    def give(self, centre: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Targets (parts, 2) m of one world's parts at ``centre`` (parts, 2) m; absent parts stay."""
        target = centre.copy()
        if self.zones is None:
            target[present] = self._apart(centre[present])
        for kind, free in enumerate(self.places):
            own = present & (self.kind == kind)
            target[own] = assign(centre[own], free)
        return target

    def leaving(self, centre: np.ndarray) -> np.ndarray:
        """Targets (batch, parts, 2) m at the far end of each part's gate, where each comes: no two are the same.

        Who is not yet at the height of its own gate goes there first, before the gates (:data:`BEFORE`).
        """
        assert self.zones is not None
        zone = self.zones[self.kind]
        inset = np.minimum(self.size[:, 1], 0.5 * (zone[:, 3] - zone[:, 1]))
        height = np.clip(centre[..., 1], zone[:, 1] + 0.5 * inset, zone[:, 3] - 0.5 * inset)
        there = (centre[..., 1] > zone[:, 1]) & (centre[..., 1] < zone[:, 3])
        return np.stack([np.where(there, zone[:, 2], zone[:, 0] - BEFORE), height], axis=-1)

    def _apart(self, centre: np.ndarray) -> np.ndarray:
        """Places of the lattice, shifted along the table so that the longest way is shortest."""
        free = places(self.low, self.high, self.size.max(axis=0), self.room, len(centre))
        pitch = self.size[:, 0].max() + self.room
        best, least = free, math.inf
        for shift in np.linspace(-0.5, 0.5, SHIFTS) * pitch:
            moved = free + [shift, 0.0]
            moved = moved[(moved[:, 0] >= self.low[0] - 1e-9) & (moved[:, 0] <= self.high[0] + 1e-9)]
            if len(moved) >= len(centre):
                target = assign(centre, moved)
                longest = np.sqrt(((target - centre) ** 2).sum(axis=-1)).max(initial=0.0)
                if longest < least:
                    best, least = target, longest
        return best if least < math.inf else assign(centre, free)
