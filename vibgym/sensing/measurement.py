"""Samples of a sensor, readings and measurements: what the stages of sensing exchange."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface


class Sampling:
    """Scene and samples of a sensor, for the sensor itself and its effects.

    Args:
        surface: the table.
        parts: the parts of every world.
        worlds: number of worlds.
        periods: oscillation periods of a step.

    Attributes:
        kinds: of the parts.  parts: of the first world.
        step: s of a step.
        sampled: (n,) indices of the sampled worlds: all, or at a reset the restarted ones. Readings of others are not used.
        samples: (worlds,) int64, samples since the episode's start; the one before its first step is 0.
        key: (worlds, 2) int64, key of the effects' random numbers in this episode.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], worlds: int, periods: int) -> None:
        self.surface, self.parts, self.worlds = surface, tuple(parts), worlds
        self.kinds = Kinds.of(parts)
        self.periods, self.step = periods, periods * surface.period
        self.sampled = self._everyone = np.arange(worlds)
        self.samples = np.zeros(worlds, dtype=np.int64)
        self.key = np.zeros((worlds, 2), dtype=np.int64)


class Reading(NamedTuple):
    """One sample of a sensor; the next sample overwrites it."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad; always finite, undefined where a part was not seen
    mean_velocity: np.ndarray  # (worlds, parts, 3) m/s, m/s, rad/s, likewise
    gone: np.ndarray  # (worlds, parts) bool, parts that are not on the surface
    seen: np.ndarray  # (worlds, parts) bool, whether this sample has measured the part


class Measurement(NamedTuple):
    """Measured state of the parts of all worlds; the next step overwrites it."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period, m/s, m/s, rad/s
    gone: np.ndarray  # (worlds, parts) bool, parts that are not on the surface
    age: np.ndarray  # (worlds, parts) int64, periods since the sample of the part's last reading
    sigma: np.ndarray  # (worlds, parts, 3) estimated standard deviation of the pose, m, m, rad
    # (worlds, parts, 2) m/s, change of the velocity by contacts over the last period; 0: not sensed
    pushed: np.ndarray


def new_reading(worlds: int, parts: int) -> Reading:
    """Return arrays for ``worlds`` worlds."""
    shape = (worlds, parts)
    return Reading(
        np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=bool), np.ones(shape, dtype=bool)
    )


def new_measurement(worlds: int, parts: int) -> Measurement:
    """Return arrays for ``worlds`` worlds."""
    shape = (worlds, parts)
    return Measurement(
        np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64),
        np.zeros((*shape, 3)), np.zeros((*shape, 2)),
    )  # fmt: skip
