"""The band under the table that explains the picture. Needs pygame."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pygame

from vibgym.rendering import colours, shapes

HEIGHT = 64
"""Height of the band in pixels."""

WHEEL = 52
"""Diameter of the colour wheel in pixels."""

_FINE = 4
_BARS = np.outer(10.0 ** np.arange(-4, 2), [1.0, 2.0, 5.0]).ravel()


@lru_cache(maxsize=32)
def _font(size: int) -> pygame.font.Font:
    pygame.font.init()
    return pygame.font.Font(None, size)


def render_text(line: str, size: int, colour: tuple[int, ...]) -> pygame.Surface:
    """Render ``line`` on a transparent surface, in pygame's font, which is the same on every platform."""
    # Scaled down from a larger size: at small ones, rounding to pixels spoils the font's spacing.
    try:
        text = _font(_FINE * size).render(line, True, colour)
    except pygame.error:  # pygame was quit after the font was loaded
        _font.cache_clear()
        text = _font(_FINE * size).render(line, True, colour)
    return pygame.transform.smoothscale(
        text, (math.ceil(text.get_width() / _FINE), math.ceil(text.get_height() / _FINE))
    )


def wheel() -> pygame.Surface:
    """Draw the colour disc of phasors: each at the direction of its push, zero in the centre."""
    size = WHEEL * _FINE
    at = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    right, down = np.meshgrid(at, at, indexing="ij")
    # An element pushes towards (-S, -C) with y up.
    phasors = np.stack([down, -right], axis=-1)
    fine = pygame.Surface((size, size), pygame.SRCALPHA, 32)
    pygame.surfarray.blit_array(fine, colours.element_colours(phasors))
    alpha = pygame.surfarray.pixels_alpha(fine)
    alpha[:] = np.where(np.hypot(right, down) <= 0.99, 255, 0)
    del alpha  # it locks the surface
    centre, turns = 0.5 * size, np.arange(8) * (np.pi / 4.0)
    outward = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    arrows = shapes.arrow_outlines(centre + 0.3 * centre * outward, 0.52 * centre * outward, 0.03 * size)
    tips = np.stack([outward[:, 1], -outward[:, 0]], axis=1)
    for arrow, colour in zip(arrows, colours.arrow_colours(tips), strict=True):
        pygame.draw.polygon(fine, colour.tolist(), arrow)
    return pygame.transform.smoothscale(fine, (WHEEL, WHEEL))


def _scale_bar(surface: pygame.Surface, left: int, middle: int, pixels_per_metre: float, longest: float) -> int:
    """Draw a bar of a round length and its label; returns the label's right end."""
    length = _BARS[_BARS * pixels_per_metre <= longest].max(initial=_BARS[0])
    right = left + round(length * pixels_per_metre)
    pygame.draw.line(surface, colours.MUTED, (left, middle), (right, middle), 2)
    for x in (left, right):
        pygame.draw.line(surface, colours.MUTED, (x, middle - 4), (x, middle + 4), 2)
    label = render_text(f"{1000.0 * length:g} mm", 18, colours.MUTED)
    surface.blit(label, (right + 10, middle - label.get_height() // 2))
    return right + 10 + label.get_width()


def draw(surface: pygame.Surface, top: int, margin: int, pixels_per_metre: float) -> int:
    """Draw scale bar, wheel and its explanation below ``top``; returns the width left for the caption.

    What does not fit beside the rest is left out: first the explanation, then the wheel.
    """
    middle = top + HEIGHT // 2
    bar_end = _scale_bar(surface, margin, middle + 15, pixels_per_metre, min(130.0, 0.3 * surface.get_width()))
    edge = surface.get_width() - margin
    if edge - WHEEL < bar_end + margin:
        return edge - margin
    surface.blit(wheel(), (edge - WHEEL, middle - WHEEL // 2))
    edge -= WHEEL + 14
    lines = ("Colour and arrow: where an element pushes (its phase)", "Pale colour, short arrow: small amplitude")
    labels = [render_text(line, 18, colours.MUTED) for line in lines]
    if edge - max(label.get_width() for label in labels) >= max(bar_end, 0.4 * surface.get_width()):
        for label, y in zip(labels, (middle - 11, middle + 11), strict=True):
            surface.blit(label, (edge - label.get_width(), y - label.get_height() // 2))
        edge -= max(label.get_width() for label in labels) + margin
    return edge - margin
