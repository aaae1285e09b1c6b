"""Imperfect elements: latency, resolution, limits, dead zone, gain and phase errors, faults.

A commanded phasor ``(C, S)`` becomes the actual one element by element: its amplitude is rounded to the resolution, limited and
passed through the dead zone; the element's gain and phase error scale and rotate the result. Only the elements under a part are
computed, when a kernel reads them (:func:`vibgym.physics.core.drive.element_phasor`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, Pinned
from vibgym.physics.core.noise import normals, uniforms

FORMS = ("hard", "soft", "cubic")
"""Amplitude that results from ``a`` below the dead zone ``d``: 0, ``a^2 / d``, ``a^3 / d^2``; larger ones are unchanged."""

HARD, SOFT, CUBIC = range(len(FORMS))

ROUNDING = 1e-6
"""Relative tolerance for commands in float32."""

NUMBERS = ("dead_zone", "limit", "resolution")
"""Columns of :attr:`Hardware.number`."""

DEAD_ZONE, LIMIT, RESOLUTION = range(len(NUMBERS))

_SPREAD, _FAULTS = range(2)  # second word of the counter


class Hardware(NamedTuple):
    """Imperfect elements of all worlds, pinned in memory; amplitudes are ``a_v w^2``, m/s^2."""

    source: np.ndarray  # (worlds,) int64, row of the drive in effect (latency); -1: none yet, the elements are at rest
    # (worlds, rows, columns, 4): complex gain, and the phasor of an element that is stuck
    element: np.ndarray
    number: np.ndarray  # (worlds, NUMBERS)
    form: int  # of the dead zone
    top: float  # upper limit of the actual amplitudes


HARDWARE: Layout[Hardware] = Layout("HARDWARE", __name__)
hardware_at = HARDWARE.at

# Kernels that take drives are compiled for a hardware record, so a placeholder replaces absent hardware.
_NONE = Pinned(
    HARDWARE, Hardware(np.zeros(0, dtype=np.int64), np.zeros((0, 0, 0, 4)), np.zeros((0, len(NUMBERS))), HARD, 0.0)
)

NO_HARDWARE = HARDWARE.none(_NONE.record)
"""Address in drives of ideal elements."""


@jit
def realised_amplitude(amplitude, dead_zone, form):
    """Return the amplitude after a dead zone, see :data:`FORMS`; amplitudes within ``ROUNDING`` of its width are unchanged."""
    if amplitude >= (1.0 - ROUNDING) * dead_zone:
        return amplitude
    if form == HARD:
        return 0.0
    share = amplitude / dead_zone
    return amplitude * share if form == SOFT else amplitude * share * share


@jit
def realise(hardware, world, row, column, c, s):
    """Return the actual phasor of an element for a commanded one, m/s^2."""
    number, element = hardware.number, hardware.element
    square = c * c + s * s
    real, imaginary = 0.0, 0.0
    if square > 0.0:
        commanded = math.sqrt(square)
        amplitude = commanded
        if number[world, RESOLUTION] > 0.0:
            amplitude = number[world, RESOLUTION] * math.floor(amplitude / number[world, RESOLUTION] + 0.5)
        amplitude = min(amplitude, number[world, LIMIT])
        scale = realised_amplitude(amplitude, number[world, DEAD_ZONE], hardware.form) / commanded
        gain_c, gain_s = element[world, row, column, 0], element[world, row, column, 1]
        real, imaginary = scale * (gain_c * c - gain_s * s), scale * (gain_s * c + gain_c * s)
    real, imaginary = real + element[world, row, column, 2], imaginary + element[world, row, column, 3]
    square = real * real + imaginary * imaginary
    if square > hardware.top * hardware.top:
        scale = hardware.top / math.sqrt(square)
        real, imaginary = scale * real, scale * imaginary
    return real, imaginary


@jit
def draw_elements(hardware, worlds, key, spread, faulty):
    """Draw gain, phase error and faults of every element of some worlds.

    Args:
        hardware: address of a pinned :class:`Hardware`, whose elements are overwritten; limits must be set.
        worlds: (n,) index.
        key: (n, 2) of the random numbers.
        spread: (n, 2) standard deviations of the gain (1) and of the phase (rad).
        faulty: (n, 2) shares of elements that are dead, and that are stuck at a random phasor.
    """
    element, number = hardware_at(hardware).element, hardware_at(hardware).number
    for k in range(worlds.shape[0]):
        world = worlds[k]
        for row in range(element.shape[1]):
            for column in range(element.shape[2]):
                own = element[world, row, column]
                first, second, _, _ = normals(key[k], row, column, _SPREAD, 0)
                gain, turn = max(1.0 + spread[k, 0] * first, 0.0), spread[k, 1] * second
                own[0], own[1], own[2], own[3] = gain * math.cos(turn), gain * math.sin(turn), 0.0, 0.0
                if faulty[k, 0] + faulty[k, 1] > 0.0:
                    fate, strength, phase, _ = uniforms(key[k], row, column, _FAULTS, 0)
                    if fate < faulty[k, 0] + faulty[k, 1]:
                        own[0], own[1] = 0.0, 0.0
                    if faulty[k, 0] <= fate < faulty[k, 0] + faulty[k, 1]:
                        amplitude = strength * number[world, LIMIT]
                        own[2] = amplitude * math.cos(2.0 * math.pi * phase)
                        own[3] = amplitude * math.sin(2.0 * math.pi * phase)
