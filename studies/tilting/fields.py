"""How far the planar model is from the one above it on random fields, and how far that is from itself: ``python -m
studies.tilting fields``.

After a second, medians over fields: against the planar model, twice the steps, other ramps, another restitution.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

SURFACE = Surface(rows=24, columns=24)
PARTS = ("aluminium_block", "steel_block")
AMPLITUDES = (1.0, 0.25, 0.1)
PERIODS = 25
AGAINST: dict[str, dict[str, Any]] = {
    "planar": {"model": "planar"},
    "twice the steps": {"steps": 400},
    "ramps of 1 mm": {"ramp_mm": 1.0},
    "ramps of 10 mm": {"ramp_mm": 10.0},
    "restitution 0.5": {"restitution": 0.5},
}


def ends(part: Part, amplitude: np.ndarray, phase: np.ndarray, seed: int, **settings: Any) -> np.ndarray:
    """(worlds, 3) poses after a second."""
    rng, worlds = np.random.default_rng(seed), len(phase)
    pose = np.zeros((worlds, 1, 3))
    pose[..., :2] = 0.5 * SURFACE.width + SURFACE.element_size * rng.uniform(-0.5, 0.5, (worlds, 1, 2))
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, 1))
    simulator = Simulator(SURFACE, part, worlds=worlds, **{"model": "tilting", **settings})
    simulator.reset(pose, np.append(SURFACE.idle_velocity(part.friction), 0.0))
    simulator.advance(amplitude, phase, PERIODS)
    return simulator.pose[:, 0]


def main(worlds: int = 48, seed: int = 300_000) -> None:
    """Print the gaps."""
    rng = np.random.default_rng(seed)
    shape = worlds, SURFACE.rows, SURFACE.columns
    share, phase = rng.uniform(0, 1, shape), rng.uniform(-math.pi, math.pi, shape)
    for name in PARTS:
        for amplitude in AMPLITUDES:
            a_v = amplitude * (SURFACE.max_amplitude or 0.0) * share
            ours = ends(shipped_part(name), a_v, phase, seed)
            print(f"{name}, {amplitude:g} of the amplitude, median of {worlds}:")
            for against, settings in AGAINST.items():
                gap = ours - ends(shipped_part(name), a_v, phase, seed, **settings)
                place, turn = np.median(np.hypot(gap[:, 0], gap[:, 1])), np.median(np.abs(gap[:, 2]))
                print(f"  {against:16} {1e3 * place:6.2f} mm {math.degrees(turn):6.2f} deg", flush=True)
