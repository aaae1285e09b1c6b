"""What the state observation of several parts says, back in SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.policy import Situation
from vibgym import checks
from vibgym.envs.crowd_observations import BLOCK_SIZE
from vibgym.envs.observations import LEAST_SPEED, SPIN_SCALE


@dataclass(frozen=True)
class CrowdSeen:
    """A batch of observations: arrays of (batch, parts) or (batch, parts, 2). Those of absent parts are meaningless."""

    present: np.ndarray  # bool
    centre: np.ndarray  # m
    heading: np.ndarray  # rad, modulo the part's symmetry; 0 for a disc
    velocity: np.ndarray  # mean over the last period, m/s
    spin: np.ndarray  # rad/s
    gap: np.ndarray  # distance to the nearest other part, m; capped at 0.3 m
    single: bool  # whether one observation without batch axis was given


def see_crowd(observation: Any, situation: Situation) -> CrowdSeen:
    """Decode one flat state observation of several parts or a batch of them.

    Raises:
        ValueError: the array is not (slots x 20,) or (batch, slots x 20).
    """
    values = np.asarray(observation, dtype=np.float64)
    expected = situation.state_size
    if values.ndim not in (1, 2) or values.shape[-1] != expected:
        raise checks.refuse("observation", f"array of shape {values.shape}", f"shape (..., {expected})")
    surface, parts = situation.surface, situation.parts
    blocks = values.reshape(-1, expected // BLOCK_SIZE, BLOCK_SIZE)[:, : len(parts)]
    symmetry = np.array([max(part.symmetry, 1) for part in parts])
    turns = np.array([part.symmetry > 0 for part in parts])
    return CrowdSeen(
        present=blocks[..., 0] > 0.5,
        centre=0.5 * (blocks[..., 8:10] + 1.0) * np.array([surface.width, surface.height]),
        heading=np.where(turns, np.arctan2(blocks[..., 7], blocks[..., 6]) / symmetry, 0.0),
        velocity=blocks[..., 14:16] * max(surface.table_speed, LEAST_SPEED),
        spin=blocks[..., 16] * SPIN_SCALE,
        gap=np.arctanh(np.minimum(blocks[..., 17], 1.0 - 1e-7)) * math.sqrt(2.0) * surface.element_size,
        single=values.ndim == 1,
    )


def wrap(angle: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
    """Angles to the nearest equivalent one of parts with this symmetry, within +-pi / symmetry, rad."""
    period = 2.0 * math.pi / np.maximum(symmetry, 1)
    return angle - period * np.round(angle / period)
