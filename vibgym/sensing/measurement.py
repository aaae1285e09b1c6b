"""Readings of sensors and measurements: records that the stages of sensing exchange."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


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
