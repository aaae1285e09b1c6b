"""Colours of the picture: phase as hue on a perceptually even wheel, amplitude as strength of colour."""

from __future__ import annotations

import numpy as np

PAPER = (255, 255, 255)
FRAME = (71, 78, 92)
GAP = (206, 210, 216)
REST = (237, 239, 241)
INK = (38, 44, 56)
MUTED = (108, 115, 128)
PARTS = ((52, 60, 76), (196, 90, 36), (120, 70, 160), (250, 247, 238))
"""Fill of each kind of part, darker than any element; the last one is lighter than any moving element.

They are distinguishable from each other and from the field in every kind of colour vision.
"""

HUES = 720
HUE_OF_PHASE_0 = np.radians(-15.0)
"""Maps left and right, the long axis of the table, to orange and blue, which red-green colour blindness distinguishes."""


def is_light(colour: tuple[int, ...]) -> bool:
    """Return whether text on ``colour`` (r, g, b) must be dark."""
    return sum(colour) >= 384


def _oklch(lightness: np.ndarray | float, chroma: np.ndarray | float, hue: np.ndarray) -> np.ndarray:
    """Return Oklch colours as sRGB (..., 3) in [0, 1]; ``hue`` in rad."""
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    medium = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = np.stack(
        [
            4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short,
            -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short,
            -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short,
        ],
        axis=-1,
    ).clip(0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def _wheel(lightness: float, chroma: float) -> np.ndarray:
    """Return colours (HUES, 3) of equally spaced phases, 0 to 255."""
    hue = np.linspace(0.0, 2.0 * np.pi, HUES, endpoint=False) + HUE_OF_PHASE_0
    # Green is lighter than red: distinguishable without the hue.
    return 255.0 * _oklch(lightness + 0.065 * np.cos(hue - np.radians(150.0)), chroma, hue)


_FULL = _wheel(0.78, 0.125)
_ARROW = _wheel(0.36, 0.075)


def _lookup(table: np.ndarray, phasors: np.ndarray) -> np.ndarray:
    phase = np.arctan2(phasors[..., 1], phasors[..., 0])
    return table[np.rint(phase * (HUES / (2.0 * np.pi))).astype(np.int64) % HUES]


def element_colours(phasors: np.ndarray) -> np.ndarray:
    """Return background colours (..., 3) uint8 of elements with ``phasors`` (..., 2), fractions of full scale."""
    strength = np.hypot(phasors[..., 0], phasors[..., 1]).clip(0.0, 1.0)[..., None]
    return np.rint(REST + strength * (_lookup(_FULL, phasors) - REST)).astype(np.uint8)


def arrow_colours(phasors: np.ndarray) -> np.ndarray:
    """Return arrow colours (..., 3) uint8: a dark shade of the element's own hue."""
    return np.rint(_lookup(_ARROW, phasors)).astype(np.uint8)
