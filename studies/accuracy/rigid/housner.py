"""Housner's rocking block: energy left after the impact on the other edge.

A block of width 2b and height 2h on rough ground rocks on one edge, then on the other. If it does not bounce, conservation of
angular momentum about the new edge leaves ``(1 - 1.5 sin^2 a)^2`` of the energy, ``tan a = b/h`` (Housner 1963).
"""

from __future__ import annotations

import math

import numpy as np

from studies.accuracy.rigid.body import prism
from studies.accuracy.rigid.motion import STEP, Track, level, simulate, touching

HALF_WIDTH = 0.01  # m
GRAVITY = 9.81
ROUGH = 5.0  # friction that prevents slip


def expected(slenderness: float) -> float:
    """Return the share of the energy that is left, for a ratio of height to width."""
    return (1.0 - 1.5 / (1.0 + slenderness**2)) ** 2


def measured(slenderness: float, sag: float = 5e-8, step: float = STEP, share: float = 0.5) -> float:
    """Return the same share for the reference: from rest to rest, over one impact.

    Args:
        slenderness: height over width.
        sag: m, of the contact points.  step: s.
        share: initial tilt over the balance angle.
    """
    height = 2.0 * slenderness * HALF_WIDTH
    outline = HALF_WIDTH * np.array([[-1, -1.5], [1, -1.5], [1, 1.5], [-1, 1.5]])
    block = prism(outline, height, ROUGH, corners_only=True)
    ground = level(1, 1, size=1.0, amplitude=0.0, gravity=GRAVITY)
    balance = math.atan(1.0 / slenderness)
    start = touching(block, ground, 0.5, 0.5, 0.0, share * balance, 0.0)
    track = simulate(block, ground, start, 0.4, step=step, interval=5e-4, sag=sag, restitution=0.0)
    side = np.array([_lean(track, k) for k in range(len(track.time))])
    over = int(np.argmax(side < 0.0))
    rest = over + int(np.argmin(side[over : over + _first_return(side[over:])]))
    radius, before, after = math.hypot(HALF_WIDTH, height / 2), side[0], -side[rest]
    return _potential(radius, balance, after) / _potential(radius, balance, before)


def _lean(track: Track, k: int) -> float:
    a, b, c, d = track.attitude[k]
    return math.atan2(2 * (b * d + a * c), 1 - 2 * (b * b + c * c))


def _first_return(side: np.ndarray) -> int:
    """Return the number of samples that the block stays on its second corner."""
    back = np.nonzero(side > 0.0)[0]
    return int(back[0]) if len(back) else len(side)


def _potential(radius: float, balance: float, lean: float) -> float:
    return radius * (math.cos(balance - lean) - math.cos(balance))
