"""Measured order of convergence: the planar model's error over its steps, where motion is smooth and where it is not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.accuracy import errors
from studies.accuracy.candidates import prepare_model
from studies.accuracy.ladder import lever
from studies.accuracy.scenes import Scene, scene_from

SMOOTH = {
    "name": "one element, always sliding",
    "surface": {"rows": 1, "columns": 1, "element_size": 4.0},
    "part": {"shape": "rectangle", "length": 0.050, "width": 0.035, "friction": 0.6},
    "worlds": 16,
    "periods": 10,
    "start": {"spin": [-1.0, 1.0]},
    "drive": {"kind": "uniform"},
}
EDGES = {
    "name": "random field, edges crossed",
    "part": "aluminium_block",
    "worlds": 64,
    "periods": 10,
    "drive": {"kind": "random"},
}
STICKING = {
    "name": "caught and let go within a period",
    "surface": {"horizontal_amplitude": 3e-4, "rows": 1, "columns": 1, "element_size": 4.0},
    "part": {"shape": "rectangle", "length": 0.050, "width": 0.035, "friction": 0.5, "static_friction": 0.58},
    "worlds": 32,
    "periods": 10,
    "drive": {"kind": "uniform", "phase": 0.7},
}


@dataclass(frozen=True)
class Order:
    """Of one scene.

    Attributes:
        scene: in words.
        steps: Runge-Kutta steps per period.
        errors: median strong error at each, m.
        order: slope of the logarithms, fitted by least squares.
        wanted: the least order that the model is held to, or None.
    """

    scene: str
    steps: tuple[int, ...]
    errors: tuple[float, ...]
    order: float
    wanted: float | None

    @property
    def passed(self) -> bool:
        """Whether it is what it is held to."""
        return self.wanted is None or self.order >= self.wanted


def fitted_order(steps: tuple[int, ...], found: tuple[float, ...]) -> float:
    """Minus the slope of log error over log steps; NaN where an error is zero or not finite."""
    if not all(0.0 < each < math.inf for each in found):
        return math.nan
    return -float(np.polyfit(np.log(steps), np.log(found), 1)[0])


def measured_order(scene: Scene, steps: tuple[int, ...], substeps: int, wanted: float | None) -> Order:
    """Halving steps, against steps eight times finer than the finest."""
    finest = prepare_model(scene, "planar", {"steps": 8 * steps[-1], "substeps": substeps}, threads=2)().pose
    found = []
    for count in steps:
        pose = prepare_model(scene, "planar", {"steps": count, "substeps": substeps}, threads=2)().pose
        found.append(errors.spread(errors.strong_errors(pose, finest, lever(scene))).median)
    total = tuple(substeps * each for each in steps)
    return Order(scene.name, total, tuple(found), fitted_order(total, tuple(found)), wanted)


def measured_orders() -> list[Order]:
    """Of all three scenes."""

    return [
        measured_order(scene_from(SMOOTH, "smooth"), (32, 45, 64, 90, 128), 1, 3.8),
        measured_order(scene_from(EDGES, "edges"), (8, 11, 16, 23, 32, 45, 64), 4, None),
        measured_order(scene_from(STICKING, "sticking"), (16, 23, 32, 45, 64, 90, 128), 2, 1.8),
    ]
