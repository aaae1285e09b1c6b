"""Averaged motion of a sliding part: its drag, push and lead, for controllers, filters, paths, bounds, fields and tasks.

Friction brakes a part at a constant rate. Under an acceleration ``u`` by the elements, x, y and heading each follow

    p' = v,   v' = -c v + u        c = mu g / (2 a_h w)

near rest (first-order averages over a period, thesis eqs. 5.60 and 5.61 at small speed). Faster parts are braked more and
pushed less: :func:`means`. The inverse at any speed, to second order, is :mod:`vibgym.allocation.frictional`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.physics.averaged.averages import friction_rate
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.averages_tables import first_order

MIN_SPEED = 1e-3
"""m/s, lower bound of the table's speed in the model."""

TOP_SLIP = 0.71
"""Speed of a part on elements at full amplitude, over the table's: 0.30 m/s on the prototype."""

NODES = 1000
"""Of :func:`means`."""

DRAG_GROWTH = 0.8
"""Ratio of drag to push near the top speed, relative to rest: ``1 + 0.8 s^2`` with ``s`` the speed over the table's, within 4 %
of the first-order averages."""


class Sliding(NamedTuple):
    """Linear model of the parts near rest."""

    strength: float  # largest amplitude of the elements over the surface's
    push: np.ndarray  # (parts,) m/s^2, of all elements at that amplitude
    turn_push: np.ndarray  # (parts,) rad/s^2, the same over the radius of gyration
    drag: np.ndarray  # (parts,) 1/s, c
    top_speed: float  # m/s


def plant_of(surface: Surface, parts: Sequence[Part], strength: float = 1.0) -> Sliding:
    """Return the model of parts on a surface whose elements reach a share ``strength`` of its largest amplitude."""
    push = strength * 0.5 * reached(parts) * np.array([part.friction for part in parts]) * surface.full_scale
    return Sliding(
        strength=strength,
        push=push,
        turn_push=push / np.sqrt([part.gyration for part in parts]),
        drag=drag_of(surface, parts),
        top_speed=top_slip(strength) * surface.table_speed,
    )


def reached(parts: Sequence[Part]) -> np.ndarray:
    """Return the share (parts,) of the elements' motion that reaches each part; 1, unused, for parts of zero coupling."""
    return np.array([part.coupling or 1.0 for part in parts])


def drag_of(surface: Surface, parts: Sequence[Part]) -> np.ndarray:
    """Return (parts,) 1/s, the rates ``c`` at which friction brakes parts near rest."""
    friction = np.array([part.friction for part in parts])
    return getattr(friction_rate, "py_func", friction_rate)(
        friction, surface.gravity, max(surface.table_speed, MIN_SPEED)
    )


def top_slip(strength: float) -> float:
    """Return the steady speed of a part over the table's on elements at a share ``strength`` of full amplitude."""
    if strength == 1.0:
        return TOP_SLIP
    linear = strength * TOP_SLIP * (1.0 + DRAG_GROWTH * TOP_SLIP**2)
    slip = linear
    for _ in range(20):  # Newton's method; the left side is convex, so it converges from above
        slip -= (slip * (1.0 + DRAG_GROWTH * slip**2) - linear) / (1.0 + 3.0 * DRAG_GROWTH * slip**2)
    return slip


def lead_angle(surface: Surface, friction: float) -> float:
    """Return the angle by which the push of a vibrating element leads its first-order direction, rad.

    To first order in ``eps = mu g / (a_h w^2)`` the direction does not depend on friction; in simulation, a part at rest is
    pushed at about ``1.6 atan(eps)``.
    """
    checks.instance("surface", surface, Surface)
    friction = checks.number("friction", friction, least=0.0)
    if surface.horizontal_amplitude == 0.0:
        return 0.0
    acceleration = surface.horizontal_amplitude * surface.angular_frequency**2
    return 1.6 * math.atan(friction * surface.gravity / acceleration)


@functools.cache
def means() -> np.ndarray:
    """Return the speed over the table's, in [0, 1), and drag, push across and push along the velocity there, (4, nodes).

    Over the friction: an acceleration of ``mu g`` by gravity brakes a part by ``mu g`` times the drag, and elements that
    accelerate it by at most ``mu a_v w^2`` push it by that times the others, 1/2 at rest.
    """
    s = np.arange(NODES) / NODES
    return np.concatenate([s[None], first_order(s)[:3]])


@jit
def motion(drag, time):
    """Return ``way, fall, left`` of the solution after ``time``: ``p + way v + fall u`` and ``left v + way u``."""
    left = math.exp(-drag * time)
    way = (1.0 - left) / drag if drag * time > 1e-9 else time
    fall = (time - way) / drag if drag * time > 1e-4 else 0.5 * time * time
    return way, fall, left
