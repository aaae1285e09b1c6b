"""Impulse disturbances: times and magnitudes of random tilts of parts, and the equivalent impulse in a planar model.

Disturbances of a part are a Poisson process. The tilting model releases the part from a tilt. A planar model instead changes
spin and velocity by the effect of friction under one corner until the part has landed: normal deviates whose standard
deviations grow with the root of the tilt, fitted to the tilting model (``python -m studies.tilting impulse``).
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.physics.core.noise import normals, uniforms

SPIN, SPEED = 0.57, 0.0057
"""Standard deviations of spin (rad/s) and each component of velocity (m/s), per root of a degree of tilt."""


@jit
def next_wait(key, part, count, rate):
    """Return the time until a part's disturbance number ``count``, s."""
    u, _, _, _ = uniforms(key, part, count, 0, 0)
    return -math.log(u) / rate if rate > 0.0 else math.inf


@jit
def begin_waiting(worlds, key, rate, wait, count):
    """Draw the times of the first disturbance of each part of some worlds (n,).

    Args:
        key: (worlds, 2) of the worlds' generators.  rate: 1/s.
        wait, count: (worlds, parts) s until the next disturbance, and number of disturbances so far; overwritten.
    """
    for k in range(worlds.shape[0]):
        world = worlds[k]
        for part in range(wait.shape[1]):
            count[world, part] = 0
            wait[world, part] = next_wait(key[world], part, 0, rate)


@jit
def disturb_parts(key, rate, low, high, span, away, wait, count, lean, impulse):
    """Disturb the parts whose waiting time ends within ``span`` s.

    Args:
        key: (worlds, 2).  rate: 1/s.  low, high: rad, range of the tilt.
        away: (worlds, parts) bool: parts that cannot be disturbed.
        wait, count: (worlds, parts), see :func:`begin_waiting`; changed.
        lean: (worlds, parts, 2) rad, overwritten with the tilts' rotation vectors; zero without disturbance.
        impulse: (worlds, parts, 3) m/s, m/s, rad/s, overwritten with changes of velocity; zero without disturbance.

    Returns:
        Whether any part is disturbed.
    """
    disturbed = False
    for world in range(wait.shape[0]):
        for part in range(wait.shape[1]):
            lean[world, part, 0] = lean[world, part, 1] = 0.0
            for k in range(3):
                impulse[world, part, k] = 0.0
            wait[world, part] -= span
            if wait[world, part] > 0.0:
                continue
            n = count[world, part]
            count[world, part] = n + 1
            wait[world, part] = max(wait[world, part] + next_wait(key[world], part, n + 1, rate), 0.0)
            if away[world, part]:
                continue
            disturbed = True
            _, u, v, _ = uniforms(key[world], part, n, 0, 0)
            tilt, way = low + (high - low) * u, 2.0 * math.pi * v
            lean[world, part, 0], lean[world, part, 1] = tilt * math.cos(way), tilt * math.sin(way)
            a, b, c, _ = normals(key[world], part, n, 1, 0)
            root = math.sqrt(math.degrees(tilt))
            impulse[world, part, 0], impulse[world, part, 1] = SPEED * root * a, SPEED * root * b
            impulse[world, part, 2] = SPIN * root * c
    return disturbed
