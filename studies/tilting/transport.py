"""Uniform transport of a rigid part against the planar model: ``python -m studies.tilting transport``.

On plates that all move alike even pressure is exact, so the planar model with fine steps is the reference.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from studies.tilting.states import kept_above_the_plane
from vibgym import Simulator, Surface
from vibgym.scene.parts import shipped_part

SURFACE = Surface(rows=40, columns=40)
STEPS = 100, 200, 400
START = 0.52, 0.3, 0.3
"""m, m, rad."""

PERIODS = 25


def transported(name: str = "steel_block", **settings: Any) -> np.ndarray:
    """(3,) m and rad, way of a part in a second at full amplitude; above the plane all along, if that is the model."""
    part = shipped_part(name)
    simulator = Simulator(SURFACE, part, **{"model": "tilting", **settings})
    simulator.reset([[START]], [[[*SURFACE.idle_velocity(part.friction), 0.0]]])
    rigid = simulator.model == "tilting"
    if rigid:
        simulator.tip(0, 0.0)
    for _ in range(PERIODS):
        if rigid:
            kept_above_the_plane(simulator)
        simulator.advance(SURFACE.max_amplitude, math.pi)
    return simulator.pose[0, 0] - START


def errors(name: str = "steel_block") -> tuple[np.ndarray, float]:
    """(len(STEPS),) m that the way is off, by steps a period, and the length of the way in m."""
    exact = transported(name, model="planar", steps=40, substeps=8)[:2]
    away = [float(np.hypot(*(transported(name, steps=steps)[:2] - exact))) for steps in STEPS]
    return np.array(away), float(np.hypot(*exact))


def main() -> None:
    """Print the table."""
    for name in ("aluminium_block", "steel_block"):
        away, way = errors(name)
        orders = np.log2(away[:-1] / away[1:])
        print(f"{name}, way of {1e3 * way:.2f} mm:")
        for steps, each in zip(STEPS, away, strict=True):
            print(f"  {steps} steps: off by {1e6 * each:.3f} um, {100.0 * each / way:.4f} %")
        print(f"  order in the step: {', '.join(f'{order:.2f}' for order in orders)}", flush=True)
