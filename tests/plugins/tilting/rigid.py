"""Helpers of the tests of the tilting model."""

from __future__ import annotations

import math

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

LARGE = Surface(rows=40, columns=40)
MIDDLE = 0.52
STEEL, ALUMINIUM = shipped_part("steel_block"), shipped_part("aluminium_block")
DISC = Part.disc(0.02, friction=0.6, height=0.012, name="squat disc")
KITE = Part.polygon([[0, 0], [0.05, 0], [0.06, 0.03], [0.02, 0.05]], friction=0.3, height=0.03, name="kite")
PARTS = [STEEL, ALUMINIUM, DISC, KITE]


def leans(angles: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return tilts (n, 1, 2) rad by these angles (n,) in random directions."""
    way = np.random.default_rng(seed).uniform(-math.pi, math.pi, len(angles))
    return (angles * np.stack([np.cos(way), np.sin(way)])).T[:, None, :]


def in_the_middle(simulator: Simulator, seed: int = 0) -> None:
    """Place parts at a point with random headings, sliding in place."""
    rng, parts = np.random.default_rng(seed), len(simulator.parts)
    pose = np.full((simulator.worlds, parts, 3), MIDDLE)
    pose[..., 0] += 0.08 * (np.arange(parts) - 0.5 * (parts - 1))
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (simulator.worlds, parts))
    idle = [np.append(simulator.surface.idle_velocity(part.friction), 0.0) for part in simulator.parts]
    simulator.reset(pose, np.array(idle))
