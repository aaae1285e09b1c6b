"""What real elements make of a command: late, in steps, not below the dead zone, each a little differently, some not at all.

A commanded phasor ``(C, S)`` becomes the one that acts, element by element: its amplitude is rounded to the resolution and
limited, the dead zone takes what is small, and the element's own gain and phase error turn and scale the rest. Only the
elements under a part are looked at, when a kernel asks for them (:func:`vibgym.physics.core.drive.element_phasor`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout, Pinned
from vibgym.physics.core.noise import normals, uniforms

FORMS = ("hard", "soft", "cubic")
"""What becomes of an amplitude ``a`` below the dead zone ``d``: nothing, ``a^2 / d``, ``a^3 / d^2``; larger ones stay."""

HARD, SOFT, CUBIC = range(len(FORMS))

ROUNDING = 1e-6
"""Of commands in float32, with room."""

NUMBERS = ("dead_zone", "limit", "resolution")
"""Columns of :attr:`Hardware.number`."""

DEAD_ZONE, LIMIT, RESOLUTION = range(len(NUMBERS))

_SPREAD, _FAULTS = range(2)  # second word of the counter: what a number is drawn for


class Hardware(NamedTuple):
    """The elements of all worlds, pinned in memory; amplitudes as ``a_v w^2``, m/s^2."""

    source: np.ndarray  # (worlds,) int64, row of the commands on record that acts now; -1: none yet, the elements rest
    # (worlds, rows, columns, 4): gain as a complex number, and the phasor of one that obeys no command
    element: np.ndarray
    number: np.ndarray  # (worlds, NUMBERS)
    form: int  # of the dead zone
    top: float  # upper limit of every element's amplitude, for all gains


HARDWARE: Layout[Hardware] = Layout("HARDWARE", __name__)
hardware_at = HARDWARE.at

# Kernels that take drives are compiled for a hardware record, so a placeholder replaces absent hardware.
_NONE = Pinned(
    HARDWARE, Hardware(np.zeros(0, dtype=np.int64), np.zeros((0, 0, 0, 4)), np.zeros((0, len(NUMBERS))), HARD, 0.0)
)

NO_HARDWARE = HARDWARE.none(_NONE.record)
"""Address in drives that go through no hardware."""


@borrowing
def realised_amplitude(amplitude, dead_zone, form):
    """What becomes of an amplitude behind a dead zone; see :data:`FORMS`. At exactly its width rounding decides nothing."""
    if amplitude >= (1.0 - ROUNDING) * dead_zone:
        return amplitude
    if form == HARD:
        return 0.0
    share = amplitude / dead_zone
    return amplitude * share if form == SOFT else amplitude * share * share


@borrowing
def realise(hardware, world, row, column, c, s):
    """The phasor that an element makes of a commanded one, m/s^2."""
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


@borrowing
def draw_elements(hardware, worlds, key, spread, faulty):
    """Give every element of some worlds its own gain, phase error and faults.

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
