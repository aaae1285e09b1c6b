"""The worlds' conditions, which the physics takes as they are: factors on friction and mass, and the table's incline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks

LEAST_FACTOR, MOST_FACTOR = 0.01, 100.0
"""On friction and on mass."""


class Conditions(NamedTuple):
    """Conditions of n worlds."""

    friction: np.ndarray  # (n, parts) factor on both coefficients of friction between part and table
    mass: np.ndarray  # (n, parts) factor on mass and inertia
    incline: np.ndarray  # (n, 2) m/s^2, constant acceleration of what lies on the table
    patches: np.ndarray  # (n, rows, columns) factor of every element on friction, or (n, 1, 1): of all of them

    @property
    def strongest(self) -> np.ndarray:
        """(n, parts) largest factor on friction that a part can meet."""
        return self.friction * self.patches.max(axis=(1, 2), initial=0.0)[:, None]

    @property
    def stronger(self) -> str:
        """Which of the two factors on friction is the larger one: what an error about too much of it names."""
        larger = self.patches.max(initial=0.0) > self.friction.max(initial=0.0)
        return "patches" if larger else "friction"

    @property
    def slope(self) -> np.ndarray:
        """(n,) m/s^2, magnitude of the incline."""
        return np.hypot(self.incline[:, 0], self.incline[:, 1])


def conditions_of(
    now: Conditions, given: Mapping[str, Any], elements: tuple[int, int], gravity: float, where: str
) -> Conditions:
    """Checked conditions; what is None stays as it is ``now``.

    Args:
        elements: rows and columns of the surface.
        gravity: m/s^2, which an incline cannot exceed.
        where: how errors name an argument, with ``{}`` for the condition's own name.

    Raises:
        ValueError: a number that is not finite or out of its range, or a shape that does not fit.
    """

    def factor(name: str, shape: tuple[int, ...]) -> np.ndarray:
        if given[name] is None:
            return getattr(now, name)
        return checks.array(where.format(name), given[name], shape, least=LEAST_FACTOR, most=MOST_FACTOR)

    incline = (
        now.incline
        if given["incline"] is None
        else checks.array(where.format("incline"), given["incline"], now.incline.shape)
    )
    patches = factor("patches", (len(now.friction), *elements))
    found = Conditions(factor("friction", now.friction.shape), factor("mass", now.mass.shape), incline, patches)
    steep = ~(found.slope <= gravity * (1.0 + 1e-12))
    if steep.any():
        allowed = f"accelerations (x, y) of at most {gravity:g} m/s^2 together, the table's gravity"
        raise checks.refuse(where.format("incline"), found.incline[steep][0].tolist(), allowed)
    return found


def worlds_from(worlds: Any, count: int) -> np.ndarray:
    """Indices of worlds from a mask, a slice, or one or several indices.

    Raises:
        ValueError: none of these, or an index that no world has.
    """
    if isinstance(worlds, slice):
        return np.arange(count)[worlds]
    allowed = f"a mask of shape ({count},), or indices from 0 to {count - 1}"
    try:
        given = np.asarray(worlds)
    except (TypeError, ValueError, RecursionError):  # rows of different lengths
        raise checks.refuse("worlds", worlds, allowed) from None
    if given.dtype == bool and given.shape == (count,):
        return np.flatnonzero(given)
    if given.size == 0 and given.ndim == 1:
        return np.zeros(0, dtype=np.int64)
    if given.dtype.kind not in "iu" or given.ndim > 1 or given.min() < 0 or given.max() >= count:
        raise checks.refuse("worlds", worlds, allowed)
    return np.atleast_1d(given)
