"""What a sensor reads, and what is known after it: two records that every stage of sensing passes on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Reading(NamedTuple):
    """What one look of a sensor gave; not to be kept, since a later look overwrites it."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad; always finite, and meaningless where a part was not seen
    mean_velocity: np.ndarray  # (worlds, parts, 3) m/s, m/s, rad/s, likewise
    gone: np.ndarray  # (worlds, parts) bool, parts that are not on the surface
    seen: np.ndarray  # (worlds, parts) bool, whether this look has measured the part


class Measurement(NamedTuple):
    """What is known of the parts of all worlds; not to be kept, since the next step overwrites it."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period, m/s, m/s, rad/s
    gone: np.ndarray  # (worlds, parts) bool, parts that are not on the surface
    age: np.ndarray  # (worlds, parts) int64, periods since the sample of the part's last reading
    sigma: np.ndarray  # (worlds, parts, 3) standard deviation that the pose is thought to have, m, m, rad
    pushed: (
        np.ndarray
    )  # (worlds, parts, 2) m/s, by which contacts have changed the velocity over the last period; 0: not sensed


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
