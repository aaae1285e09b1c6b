"""Sort and Singulate: several parts in zones, or at a distance from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import Start, Task
from vibgym.tasks.starts import STARTS, DrawnParts, Starts, lattice

Zones = dict[str, tuple[float, float, float, float]]
"""Zone of each kind: x_low, y_low, x_high, y_high; m."""


class ArrangedTask(Task):
    """Base class of tasks with several parts whose starts are drawn by :class:`vibgym.tasks.Starts`.

    They have room for parts :attr:`apart`, where a subclass sets it first.

    Raises:
        ValueError: a bad start, or too little room on the surface.
    """

    class Settings(Task.Settings):
        """Settings of tasks whose starts are drawn."""

        start: str | dict[str, Any] = "scattered"
        """Name of a start in ``vibgym.tasks.starts.STARTS``, or a mapping with ``kind`` and its settings."""

        randomize: DrawnParts = DrawnParts()
        """Number of parts in an episode."""

    settings: Settings

    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 3
    TERMS = {
        "distance": ("distance", 1.0),
        "inside": ("inside", 1.0),
        "clearance": ("clearance", 1.0),
        "time": ("time", 0.003),  # costs less over an episode than a fall, so that falling does not pay
        "success": ("success", 5.0),
        "fallen": ("fallen", 5.0),
    }
    FEATURES = (
        "present", "kind", "element", "heading", "position", "way", "way_coarse", "velocity", "spin", "gap", "neighbour"
    )  # fmt: skip

    RANDOMIZED = ("parts",)

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        scene = surface, self.parts, self.settings.randomize.parts, self.apart
        self.starts: Starts = STARTS.make("start", self.settings.start, *scene)
        self.draws = self.starts.draws

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        pose, there = self.starts.draw(uniform, present)
        return Start(pose, there, np.zeros_like(pose))


class Sort(ArrangedTask):
    """Every present part's centre inside its kind's zone and slower than 20 mm/s; none has fallen.

    The speed is that of the mean velocity over the last period: a part that slides in place circles at 37 mm/s.
    """

    class Settings(ArrangedTask.Settings):
        """Settings of Sort."""

        zones: Zones | None = None
        """Goal zone of each kind: [x_low, y_low, x_high, y_high], m; None: zones at the ends."""

    settings: Settings
    speed_limit = 0.020

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        zones = self.settings.zones
        self.zones = zones_from(default_zones(surface, self.kinds) if zones is None else zones, surface, self.kinds)
        check_room(self.zones, self.parts, self.kinds, self.kind, self.starts.most)


class Singulate(ArrangedTask):
    """All distances between present parts above the largest dimension of an element, sqrt(2) x element_size; none has fallen.

    Then no two parts touch the same element (thesis, section 4.1). Parts start in one heap, in touch.
    """

    class Settings(ArrangedTask.Settings):
        """Settings of Singulate."""

        start: ClassVar[str] = "crowded"

    settings: Settings

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        self.apart = math.sqrt(2.0) * surface.element_size
        super().__init__(surface, parts, settings)


ZONE_COLUMNS = 6
"""Elements along x of a default zone, which spans the surface's height."""

ROUNDING = 1e-9  # m, that a zone may stick out: borders are products of a size and a number of elements


def default_zones(surface: Surface, names: Sequence[str]) -> Zones:
    """Return zones of six columns: the first kind's at the left, the second's at the right, the third's in the middle.

    Raises:
        ValueError: the surface has too few columns.
    """
    needed = ZONE_COLUMNS * len(names)
    if surface.columns < needed:
        got = f"the default for {len(names)} kinds on {surface.columns} columns"
        raise checks.refuse("zones", got, f"at least {needed} columns, or zones of your own")
    last = surface.columns - ZONE_COLUMNS
    firsts = (0, last, last // 2)
    size = surface.element_size
    return {
        name: (size * first, 0.0, size * (first + ZONE_COLUMNS), surface.depth)
        for name, first in zip(names, firsts, strict=False)
    }


def zones_from(value: Zones, surface: Surface, names: Sequence[str]) -> np.ndarray:
    """Return the zones of all kinds, (kinds, 4): x_low, y_low, x_high, y_high, m.

    Raises:
        ValueError: a kind is unknown or has no zone, or a zone is empty, not on the surface or overlaps another one.
    """
    for name in value:
        if name not in names:
            raise checks.unknown("kind in zones", name, names)
    for name in names:
        if name not in value:
            raise checks.missing(f"zones.{name}", "every kind of part requires a zone")
    zones = np.array([value[name] for name in names], dtype=np.float64)
    for name, zone in zip(names, zones, strict=True):
        if not (zone[:2] < zone[2:]).all():
            raise checks.refuse(f"zones.{name}", zone.tolist(), "a rectangle with x_low < x_high and y_low < y_high")
        if (zone[:2] < -ROUNDING).any() or zone[2] > surface.width + ROUNDING or zone[3] > surface.depth + ROUNDING:
            allowed = f"on the surface, x in [0, {surface.width:g}] m and y in [0, {surface.depth:g}] m"
            raise checks.refuse(f"zones.{name}", zone.tolist(), allowed)
    for k, name in enumerate(names):
        for j in range(k):
            low, high = np.maximum(zones[k, :2], zones[j, :2]), np.minimum(zones[k, 2:], zones[j, 2:])
            if (high - low > ROUNDING).all():
                raise checks.conflict(f"zones.{name} overlaps zones.{names[j]}")
    return zones


def check_room(zones: np.ndarray, parts: Sequence[Part], names: Sequence[str], kind: np.ndarray, most: int) -> None:
    """Check that each zone has room for its parts, by a lattice of circles around them.

    Args:
        most: number of parts that may be present at once.

    Raises:
        ValueError: a zone is too small.
    """
    for k, name in enumerate(names):
        own = [part for part, its in zip(parts, kind, strict=True) if its == k]
        radius, number = max(part.radius for part in own), min(len(own), most)
        fit = len(lattice(zones[k, :2], zones[k, 2:], radius, 0.0))
        if fit < number:
            got = f"{number} parts of radius {radius:.4g} m in {zones[k].round(6).tolist()}"
            raise checks.refuse(f"zones.{name}", got, f"at most {fit} parts in this zone")
