"""What laws know of the parts as plants: how hard they can be pushed, and how friction brakes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.allocation.allocator import strongest
from vibgym.envs.features import LEAST_SPEED
from vibgym.policies.task_info import TaskInfo

TOP_SLIP = 0.71
"""Speed of a part on elements at full amplitude, over the table's: 0.30 m/s on the prototype."""

DRAG_GROWTH = 0.8
"""Near the top speed friction brakes more and pushes less than near rest: ``1 + 0.8 s^2`` fits the first-order averages' ratio
within 4 %, ``s`` being the speed over the table's."""


class Plant(NamedTuple):
    """The parts near rest, by the first-order averages."""

    strength: float  # largest amplitude of the elements over the surface's
    push: np.ndarray  # (parts,) m/s^2, of all elements at that amplitude
    turn_push: np.ndarray  # (parts,) rad/s^2, the same over the radius of gyration
    drag: np.ndarray  # (parts,) 1/s, rate at which friction brakes
    top_speed: float  # m/s


def plant_of(info: TaskInfo) -> Plant:
    """Of a task's surface, parts and hardware."""
    surface, strength = info.surface, strongest(info.surface, info.hardware)
    friction = np.array([part.friction for part in info.parts])
    push = strength * 0.5 * friction * surface.full_scale
    return Plant(
        strength=strength,
        push=push,
        turn_push=push / np.sqrt([part.gyration for part in info.parts]),
        drag=0.5 * friction * surface.gravity / max(surface.table_speed, LEAST_SPEED),
        top_speed=top_slip(strength) * surface.table_speed,
    )


def top_slip(strength: float) -> float:
    """Speed of a part over the table's on elements at a share of full amplitude: where friction takes what they give."""
    if strength == 1.0:
        return TOP_SLIP
    given = strength * TOP_SLIP * (1.0 + DRAG_GROWTH * TOP_SLIP**2)
    slip = given
    for _ in range(20):  # Newton's method; the left side is convex, so it converges from above
        slip -= (slip * (1.0 + DRAG_GROWTH * slip**2) - given) / (1.0 + 3.0 * DRAG_GROWTH * slip**2)
    return slip
