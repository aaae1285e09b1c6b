"""Square lattices of centres that keep parts apart: starts, room in zones, targets."""

from __future__ import annotations

import math

import numpy as np


def lattice(low: np.ndarray, high: np.ndarray, radius: float, gap: float) -> np.ndarray:
    """Centres (n, 2) of circles of ``radius`` at least ``gap`` apart in a rectangle, m: as many as a square lattice holds.

    They are spread evenly, column by column, each from the bottom to the top.
    """
    axes = []
    for least, most in zip(low, high, strict=True):
        length = most - least - 2.0 * radius
        count = math.floor(length / (2.0 * radius + gap) + 1e-9) + 1 if length > -1e-12 else 0
        middle = 0.5 * (least + most)
        axes.append(middle + max(length, 0.0) * (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(count)))
    x, y = np.meshgrid(*axes, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])
