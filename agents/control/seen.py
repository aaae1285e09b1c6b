"""What the flat state observation says, back in SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.observations import SPIN_SCALE, STATE_SIZE
from vibgym.scene import Part, Surface


@dataclass(frozen=True)
class Seen:
    """A batch of observations: arrays of (batch,) or (batch, 2)."""

    centre: np.ndarray  # m
    heading: np.ndarray  # rad, modulo the part's symmetry; 0 for a disc
    error: np.ndarray  # goal minus centre, m
    turn: np.ndarray  # goal minus heading, rad; 0 where it does not count
    velocity: np.ndarray  # mean over the last period, m/s
    spin: np.ndarray  # rad/s
    single: bool  # whether one observation without batch axis was given


def see(observation: Any, surface: Surface, part: Part) -> Seen:
    """Decode one flat state observation or a batch of them.

    Raises:
        ValueError: the array is not (18,) or (batch, 18).
    """
    values = np.asarray(observation, dtype=np.float64)
    if values.ndim not in (1, 2) or values.shape[-1] != STATE_SIZE:
        raise checks.refuse("observation", f"array of shape {values.shape}", f"shape (..., {STATE_SIZE})")
    rows = np.atleast_2d(values)
    size = np.array([surface.width, surface.height])
    return Seen(
        centre=0.5 * (rows[:, 4:6] + 1.0) * size,
        heading=np.arctan2(rows[:, 3], rows[:, 2]) / max(part.symmetry, 1),
        error=rows[:, 6:8] * size.max(),
        turn=rows[:, 12] * 2.0 * math.pi,
        velocity=rows[:, 15:17] * max(surface.table_speed, 1e-3),
        spin=rows[:, 17] * SPIN_SCALE,
        single=values.ndim == 1,
    )


def started(state: Any, episode_start: np.ndarray | None, batch: int) -> np.ndarray:
    """(batch,) bool: whose episode has just begun."""
    if state is None:
        return np.ones(batch, dtype=bool)
    if episode_start is None:
        return np.zeros(batch, dtype=bool)
    return np.broadcast_to(np.asarray(episode_start, dtype=bool), (batch,))
