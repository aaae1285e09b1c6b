"""Parts let go from a tilt on level ground, and the same parts undisturbed: what the tilt has done to them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, Simulator, Surface

SURFACE = Surface(rows=32, columns=32)
"""Large enough that nothing comes near a border within a second."""


class Track(NamedTuple):
    """What a tilt has changed, at the end of every period; against the same part undisturbed."""

    tilt: np.ndarray  # (periods, worlds) rad
    heading: np.ndarray  # (periods, worlds) rad
    way: np.ndarray  # (periods, worlds, 2) m
    spin: np.ndarray  # (periods, worlds) rad/s
    velocity: np.ndarray  # (periods, worlds, 2) m/s, mean of the period


def starts(part: Part, worlds: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Poses (worlds, 1, 3) in the middle of the table, any heading, and velocities of a part that idles."""
    pose = np.zeros((worlds, 1, 3))
    pose[..., :2] = 0.5 * SURFACE.width
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, 1))
    return pose, np.append(SURFACE.idle_velocity(part.friction), 0.0)


def leans(tilt: float, worlds: int, rng: np.random.Generator) -> np.ndarray:
    """(worlds, 1, 2) rad, tilts in any direction."""
    way = rng.uniform(-math.pi, math.pi, (worlds, 1))
    return tilt * np.stack([np.cos(way), np.sin(way)], axis=-1)


def release(part: Part, tilt: float, share: float, worlds: int, periods: int, seed: int, **knobs: Any) -> Track:
    """Let a part go from a tilt (rad) while all plates move alike with a share of the largest amplitude.

    ``knobs``: of the model.
    """
    rng = np.random.default_rng(seed)
    pose, velocity = starts(part, worlds, rng)
    struck, calm = (Simulator(SURFACE, part, worlds=worlds, model="tilting", **knobs) for _ in range(2))
    for each in (struck, calm):
        each.reset(pose, velocity)
    struck.tip(slice(None), leans(tilt, worlds, rng))
    return follow(struck, calm, share, rng.uniform(-math.pi, math.pi), periods)


def kicked(part: Part, kick: np.ndarray, share: float, phase: float, periods: int) -> Track:
    """What a kick (turn, velocity x and y, spin) at once does to a part of the planar model."""
    rng = np.random.default_rng(0)
    pose, velocity = starts(part, 1, rng)
    struck, calm = (Simulator(SURFACE, part) for _ in range(2))
    calm.reset(pose, velocity)
    struck.reset(pose + [0.0, 0.0, kick[0]], velocity + kick[1:])
    return follow(struck, calm, share, phase, periods)


def follow(struck: Simulator, calm: Simulator, share: float, phase: float, periods: int) -> Track:
    """Advance both alike and note how they differ."""
    amplitude = share * (SURFACE.max_amplitude or 0.0)
    seen = []
    for _ in range(periods):
        for each in (struck, calm):
            each.advance(amplitude, phase)
        pose, velocity = struck.pose - calm.pose, struck.velocity - calm.velocity
        mean = struck.mean_velocity - calm.mean_velocity
        seen.append((struck.tilt[:, 0], pose[:, 0, 2], pose[:, 0, :2], velocity[:, 0, 2], mean[:, 0, :2]))
    return Track(*(np.array(each) for each in zip(*seen, strict=True)))
