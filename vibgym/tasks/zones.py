"""Zones where the kinds of parts shall end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.lattice import lattice

ZONE_COLUMNS = 6
"""Elements along x of a default zone, which spans the surface's height."""

ROUNDING = 1e-9  # m, that a zone may stick out: borders are products of a size and a number of elements


def default_zones(surface: Surface, names: Sequence[str]) -> dict[str, tuple[float, float, float, float]]:
    """End zones of six columns: the first kind's at the left, the second's at the right, the third's in the middle.

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


def zones_from(value: Any, surface: Surface, names: Sequence[str]) -> np.ndarray:
    """Zones of all kinds, (kinds, 4): x_low, y_low, x_high, y_high, m.

    Args:
        value: a mapping from kind to those four numbers; None for the default.

    Raises:
        ValueError: a kind is unknown or has no zone, or a zone is empty, not on the surface or overlaps another one.
    """
    value = default_zones(surface, names) if value is None else value
    if not isinstance(value, Mapping):
        raise checks.refuse("zones", value, "a mapping from kind to [x_low, y_low, x_high, y_high] in m")
    for name in value:
        if name not in names:
            raise checks.unknown("kind in zones", name, names)
    for name in names:
        if name not in value:
            raise checks.missing(f"zones[{name!r}]", "every kind of part requires a zone")
    zones = np.array([_rectangle(f"zones[{name!r}]", value[name], surface) for name in names])
    for k, name in enumerate(names):
        for j in range(k):
            low, high = np.maximum(zones[k, :2], zones[j, :2]), np.minimum(zones[k, 2:], zones[j, 2:])
            if (high - low > ROUNDING).all():
                raise checks.conflict(f"zones[{name!r}] overlaps zones[{names[j]!r}]")
    return zones


def _rectangle(name: str, value: Any, surface: Surface) -> np.ndarray:
    allowed = f"[x_low, y_low, x_high, y_high] in m on the surface, {surface.width:g} x {surface.depth:g} m"
    four = getattr(value, "shape", None) == (4,) or (isinstance(value, Sequence) and len(value) == 4)
    if isinstance(value, str) or not four:
        raise checks.refuse(name, value, allowed)
    zone = np.array(checks.array(name, value, (4,)))
    if not (zone[:2] < zone[2:]).all():
        raise checks.refuse(name, list(value), "a rectangle with x_low < x_high and y_low < y_high")
    if (zone[:2] < -ROUNDING).any() or zone[2] > surface.width + ROUNDING or zone[3] > surface.depth + ROUNDING:
        raise checks.refuse(name, list(value), allowed)
    return zone


def check_room(zones: np.ndarray, parts: Sequence[Part], names: Sequence[str], kind: np.ndarray, most: int) -> None:
    """Whether each zone holds its parts, by a lattice of circles around them.

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
            raise checks.refuse(
                f"zones[{name!r}]",
                f"{number} parts of radius {radius:.4g} m in {zones[k].round(6).tolist()}",
                f"at most {fit} parts in this zone",
            )
