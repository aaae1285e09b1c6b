"""Parts, drives and starts of the studies, in the terms of the product and of the reference."""

from __future__ import annotations

import math

import numpy as np

from studies.accuracy.rigid.body import Body, prism
from studies.accuracy.rigid.motion import Start, touching
from studies.accuracy.rigid.plates import Plates, level
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

BLOCKS = ("aluminium_block", "steel_block")
TRANSPORT = math.radians(270.0)
"""Phase of the vertical motion that carries parts along +x, thesis section 3.4."""

FIRST_SEED = 300_000


def body_of(part: Part, **options: object) -> Body:
    """A part with straight edges as the reference takes it, of uniform density."""
    return prism(part.outline, part.height, part.friction, mass=part.mass, **options)  # pyright: ignore[reportArgumentType]


def plates_of(surface: Surface, c: np.ndarray, s: np.ndarray, ramp: float) -> Plates:
    """A surface under a drive, ``c`` and ``s`` (rows, columns) in m/s^2."""
    return Plates(
        c, s, surface.element_size, surface.horizontal_amplitude, surface.angular_frequency, surface.gravity, ramp
    )


def transport(surface: Surface, share: float) -> Plates:
    """One wide plate on the surface's motion, at a share of the largest vertical amplitude."""
    scale = share * surface.full_scale
    return level(
        1, 1, scale * math.cos(TRANSPORT), scale * math.sin(TRANSPORT), size=4.0, amplitude=surface.horizontal_amplitude,
        frequency=surface.angular_frequency, gravity=surface.gravity, ramp=0.0,
    )  # fmt: skip


def tilted_starts(body: Body, plates: Plates, tilt: float, count: int, velocity: np.ndarray) -> list[Start]:
    """Bodies in the middle of one wide plate, tilted by ``tilt`` rad towards evenly spread directions, touching it.

    They move as they would if they slid in place, and their headings are drawn.
    """
    rng = np.random.default_rng(FIRST_SEED)
    found = []
    for k in range(count):
        heading = rng.uniform(-math.pi, math.pi)
        lean = heading + 2.0 * math.pi * (k + rng.uniform()) / count
        found.append(touching(body, plates, 2.0, 2.0, heading, tilt, lean, (float(velocity[0]), float(velocity[1]))))
    return found
