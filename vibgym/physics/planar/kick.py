"""Disturbances: when something tips a part, by how much, and what a planar model makes of it.

Parts are struck at random, independently: the times between are exponential. With a model that holds parts above the plane, a
struck part is let go from a tilt. A planar model gives it at once what friction under one corner makes of that until it has
landed: a kick of spin and velocity, normal, with deviations that grow with the root of the tilt, fitted to what the other model
does (``python -m studies.tilting kick``). Its heading does not jump: all of what a tilt does to it in a second comes of the
spin.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing
from vibgym.physics.core.noise import normals, uniforms

SPIN, SPEED = 0.57, 0.0057
"""Deviations of spin (rad/s) and of each component of velocity (m/s), per root of a degree of tilt."""


@borrowing
def next_wait(key, part, count, rate):
    """s until a part is struck again, for the ``count``-th time."""
    u, _, _, _ = uniforms(key, part, count, 0, 0)
    return -math.log(u) / rate if rate > 0.0 else math.inf


@borrowing
def begin_waiting(worlds, key, rate, wait, count):
    """Draw when the parts of some worlds (n,) are struck first.

    Args:
        key: (worlds, 2) of the worlds' generators.  rate: 1/s.
        wait, count: (worlds, parts) s until then, and how often each has been struck; overwritten.
    """
    for k in range(worlds.shape[0]):
        world = worlds[k]
        for part in range(wait.shape[1]):
            count[world, part] = 0
            wait[world, part] = next_wait(key[world], part, 0, rate)


@borrowing
def strike_parts(key, rate, low, high, span, away, wait, count, lean, kick):
    """Strike those parts whose time has come within ``span`` s.

    Args:
        key: (worlds, 2).  rate: 1/s.  low, high: rad, range of the tilt.
        away: (worlds, parts) bool: parts that cannot be struck.
        wait, count: (worlds, parts), see :func:`begin_waiting`; changed.
        lean: (worlds, parts, 2) rad, overwritten with the rotation vectors by which struck parts are tilted, and noughts.
        kick: (worlds, parts, 3) likewise, m/s, m/s, rad/s.

    Returns:
        Whether any part is struck.
    """
    struck = False
    for world in range(wait.shape[0]):
        for part in range(wait.shape[1]):
            lean[world, part, 0] = lean[world, part, 1] = 0.0
            for k in range(3):
                kick[world, part, k] = 0.0
            wait[world, part] -= span
            if wait[world, part] > 0.0:
                continue
            n = count[world, part]
            count[world, part] = n + 1
            wait[world, part] = max(wait[world, part] + next_wait(key[world], part, n + 1, rate), 0.0)
            if away[world, part]:
                continue
            struck = True
            _, u, v, _ = uniforms(key[world], part, n, 0, 0)
            tilt, way = low + (high - low) * u, 2.0 * math.pi * v
            lean[world, part, 0], lean[world, part, 1] = tilt * math.cos(way), tilt * math.sin(way)
            a, b, c, _ = normals(key[world], part, n, 1, 0)
            root = math.sqrt(math.degrees(tilt))
            kick[world, part, 0], kick[world, part, 1] = SPEED * root * a, SPEED * root * b
            kick[world, part, 2] = SPIN * root * c
    return struck
