"""Side view of the table with magnified heights: plates and the bottoms of the parts on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibgym.rendering import colours

HEIGHT = 110
"""Pixels of the strip."""

MAGNIFIED = 20.0
"""Heights over lengths."""

FINE = 3
"""The strip is drawn this many times larger and scaled down, which smooths edges."""

GROUND = 84
"""Pixels from the strip's top to plates at mid-stroke."""

THICK = 3
"""Pixels of a part's bottom."""


@dataclass(frozen=True)
class Side:
    """A world from the side.

    Attributes:
        bottoms: corners of the bottom of each part, (n, 3) m; not drawn unless finite.
        plates: (k, 3) m, smallest and largest x and height of the plates under parts.
    """

    bottoms: Sequence[np.ndarray]
    plates: np.ndarray


def strip(
    side: Side, width: int, left: int, length: float, pixels_per_metre: float, tints: list[tuple[int, ...]]
) -> np.ndarray:
    """Return the picture (HEIGHT, width, 3) uint8.

    Args:
        width: pixels.  left: pixels from the picture's border to the table's.
        length: m, of the table.
        tints: (r, g, b) of each part.
    """
    import pygame  # an extra

    from vibgym.rendering import legend

    fine = pygame.Surface((FINE * width, FINE * HEIGHT), 0, 32)
    fine.fill(colours.PAPER)
    scale = FINE * pixels_per_metre

    def placed(x: float, z: float) -> tuple[float, float]:
        return FINE * left + scale * x, FINE * GROUND - MAGNIFIED * scale * z

    pygame.draw.line(fine, colours.GAP, placed(0.0, 0.0), placed(length, 0.0), FINE)
    for low, high, z in side.plates.tolist():
        (begin, top), (end, _) = placed(low, z), placed(high, z)
        pygame.draw.rect(fine, colours.GAP, (begin + FINE, top, end - begin - 2 * FINE, FINE * (HEIGHT - 4) - top))
    for bottom, tint in zip(side.bottoms, tints, strict=True):
        if np.isfinite(bottom).all():
            points = [placed(x, z) for x, _, z in bottom.tolist()]
            pygame.draw.polygon(fine, tint, points)  # the projection of a flat convex bottom is convex
            pygame.draw.polygon(fine, [round(0.45 * channel) for channel in tint], points, THICK * FINE)
    small = pygame.transform.smoothscale(fine, (width, HEIGHT))
    small.blit(legend.render_text(f"From the side, heights {MAGNIFIED:g} times as large", 15, colours.INK), (left, 4))
    return np.frombuffer(bytearray(pygame.image.tobytes(small, "RGB")), dtype=np.uint8).reshape(HEIGHT, width, 3)
