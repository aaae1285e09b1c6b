"""Cost of assigning objects of an image to parts, from predicted positions and shapes (thesis eqs. 5.32 and 5.33).

Differences are weighted by their expected size. Kinds differ by area and elongation.
"""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing

FAR = 1e9
"""Cost of pairs that cannot be."""

NO_PAIR = 60.0
"""Cost of a part without an object: a pair that costs more is none."""


@borrowing
def nearest_heading(angle, apart, near):
    """Return the one of the equivalent headings ``angle + k apart`` nearest to ``near``."""
    return angle + apart * math.floor((near - angle) / apart + 0.5)


@borrowing
def unlikeness(away, gate, area, spread, elongation, grain, traits, kind):
    """Return cost of taking an object for a part: squared differences over what they may be; FAR beyond what can be.

    Args:
        away: m, from where the part is expected.
        gate: m, within which it must be.
        area, spread, elongation: of the object, m^2, m^2, 1, were it of this kind.
        grain: m, size of a pixel: areas are known to a fraction of the outline's length times it.
    """
    if not (away < gate and area > 0.0 and spread > 0.0):
        return FAR
    finest = 0.02 + 0.1 * traits.edge[kind] * grain / traits.area[kind]
    place = 3.0 * away / gate
    size = math.log(area / traits.area[kind]) / finest
    width = math.log(spread / traits.spread[kind]) / finest
    form = (elongation - traits.elongation[kind]) / finest
    cost = place * place + size * size + 0.5 * width * width + 0.5 * form * form
    return cost if abs(size) < 8.0 and cost < NO_PAIR else FAR
