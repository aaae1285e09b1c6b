"""What each element does: the phasor ``(C, S)`` of its vertical motion, read where a part needs it.

With ``A = a_v w^2`` the normal acceleration over an element is ``g - C cos wt + S sin wt``, where ``C = A cos(alpha)`` and
``S = A sin(alpha)`` (m/s^2): linear in ``(C, S)``, and lift-off is the disc ``C^2 + S^2 = g^2``.

A drive says how the phasors of a batch of worlds are written down. Each form is a named tuple with its own reader, and
:func:`element_phasor` picks the reader when the kernel is compiled. Nothing is converted for the whole surface: a part
rests on about nine of 256 elements, so only these are read, once per call.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload

from vibgym.physics.core.jit import OPTIONS, jit

FIELD_STRENGTHS = 6
"""Length of one part's row in :class:`FieldDrive`: uniform x, uniform y, squeeze x, squeeze y, radial, tangential."""


class PolarDrive(NamedTuple):
    """Amplitude ``a_v`` (m) and phase ``alpha`` (rad) of every element."""

    amplitude: np.ndarray  # (worlds, rows, columns), any strides
    phase: np.ndarray  # (worlds, rows, columns), any strides
    angular_frequency: float  # rad/s


class ElementDrive(NamedTuple):
    """Amplitude and phase of every element as actions in [-1, 1] (clipped)."""

    action: np.ndarray  # (worlds, rows, columns, 2) float32
    full_scale: float  # a_v w^2 at the largest amplitude, m/s^2


class PhasorDrive(NamedTuple):
    """Amplitude times (cos, sin) of phase of every element, shortened to the unit disc."""

    action: np.ndarray  # (worlds, rows, columns, 2) float32
    full_scale: float  # m/s^2


class PatchDrive(NamedTuple):
    """Phasors of the k x k elements around each part, all others at rest.

    An element in several patches obeys the part whose centre is nearest to the element's centre; ties go to the lower index.
    A part whose centre is infinitely far away commands nothing.
    """

    action: np.ndarray  # (worlds, parts, k, k, 2) float32
    origin: np.ndarray  # (worlds, parts, 2) row and column of the patch's first element
    centre: (
        np.ndarray
    )  # (worlds, parts, 2) of the part, along rows and columns, in elements; infinite: commands nothing
    full_scale: float  # m/s^2


class FieldDrive(NamedTuple):
    """Strengths of the basic fields around each part, on the whole surface: those of :mod:`vibgym.fields`.

    The field's vector at an element's centre (thesis fig. 4.4) is the direction in which the element shall push:
    ``reach`` is the distance at which squeeze, radial and tangential fields are at full strength. Every element obeys the
    part whose centre is nearest to its own; ties go to the lower index. A part whose centre is infinitely far away commands
    nothing, and where none commands the elements rest.
    """

    action: np.ndarray  # (worlds, parts, 6) float32
    centre: np.ndarray  # (worlds, parts, 2) x and y, m; infinite: commands nothing
    element_size: float  # m
    reach: float  # m
    full_scale: float  # m/s^2


@jit
def _clip(value, low, high):
    return min(max(value, low), high)


@jit
def unit_phasor(first, second, full_scale):
    """Phasor of a vector in the unit disc; longer vectors are shortened to it."""
    length = math.sqrt(first * first + second * second)
    scale = full_scale / max(length, 1.0)
    return first * scale, second * scale


@jit
def push_phasor(push_x, push_y, full_scale):
    """Phasor that pushes a resting part along ``(push_x, push_y)``; length 1 is full amplitude.

    Near rest the mean acceleration is ``-(mu / 2) (S, C)`` to first order (thesis eqs. 5.60 and 5.61 at zero velocity).
    """
    return unit_phasor(-push_y, -push_x, full_scale)


@jit
def _polar(drive, world, row, column):
    normal = drive.amplitude[world, row, column] * drive.angular_frequency * drive.angular_frequency
    phase = drive.phase[world, row, column]
    return normal * math.cos(phase), normal * math.sin(phase)


@jit
def _element(drive, world, row, column):
    amplitude = _clip(np.float64(drive.action[world, row, column, 0]), -1.0, 1.0)
    phase = math.pi * _clip(np.float64(drive.action[world, row, column, 1]), -1.0, 1.0)
    normal = 0.5 * (1.0 + amplitude) * drive.full_scale
    return normal * math.cos(phase), normal * math.sin(phase)


@jit
def _phasor(drive, world, row, column):
    first = _clip(np.float64(drive.action[world, row, column, 0]), -1.0, 1.0)
    second = _clip(np.float64(drive.action[world, row, column, 1]), -1.0, 1.0)
    return unit_phasor(first, second, drive.full_scale)


@jit
def _patch(drive, world, row, column):
    size = drive.action.shape[2]
    part, nearest = -1, math.inf
    for k in range(drive.action.shape[1]):
        i = row - drive.origin[world, k, 0]
        j = column - drive.origin[world, k, 1]
        if i >= 0 and j >= 0 and i < size and j < size:
            dy = row + 0.5 - drive.centre[world, k, 0]
            dx = column + 0.5 - drive.centre[world, k, 1]
            square = dx * dx + dy * dy
            if square < nearest:
                part, nearest = k, square
    if part < 0:
        return 0.0, 0.0
    i = row - drive.origin[world, part, 0]
    j = column - drive.origin[world, part, 1]
    first = _clip(np.float64(drive.action[world, part, i, j, 0]), -1.0, 1.0)
    second = _clip(np.float64(drive.action[world, part, i, j, 1]), -1.0, 1.0)
    return unit_phasor(first, second, drive.full_scale)


@jit
def _field(drive, world, row, column):
    part, nearest = -1, math.inf
    for k in range(drive.action.shape[1]):
        # In elements: a product shared with the lines below would be rounded differently, for a single part as well.
        dx = column + 0.5 - drive.centre[world, k, 0] / drive.element_size
        dy = row + 0.5 - drive.centre[world, k, 1] / drive.element_size
        square = dx * dx + dy * dy
        if square < nearest:
            part, nearest = k, square
    if part < 0:
        return 0.0, 0.0
    strength = drive.action[world, part]
    dx = (column + 0.5) * drive.element_size - drive.centre[world, part, 0]
    dy = (row + 0.5) * drive.element_size - drive.centre[world, part, 1]
    far = max(math.sqrt(dx * dx + dy * dy), drive.reach)
    radial = _clip(np.float64(strength[4]), -1.0, 1.0) / far
    turn = _clip(np.float64(strength[5]), -1.0, 1.0) / far
    squeeze_x = _clip(np.float64(strength[2]), -1.0, 1.0) * _clip(dx / drive.reach, -1.0, 1.0)
    squeeze_y = _clip(np.float64(strength[3]), -1.0, 1.0) * _clip(dy / drive.reach, -1.0, 1.0)
    return push_phasor(
        _clip(np.float64(strength[0]), -1.0, 1.0) - squeeze_x - radial * dx - turn * dy,
        _clip(np.float64(strength[1]), -1.0, 1.0) - squeeze_y - radial * dy + turn * dx,
        drive.full_scale,
    )


READERS: dict[type, Any] = {
    PolarDrive: _polar,
    ElementDrive: _element,
    PhasorDrive: _phasor,
    PatchDrive: _patch,
    FieldDrive: _field,
}


def element_phasor(drive: Any, world: int, row: int, column: int) -> tuple[float, float]:
    """``(C, S)`` in m/s^2 of the element at ``(row, column)`` in ``world``."""
    return READERS[type(drive)](drive, world, row, column)


@overload(element_phasor, jit_options=OPTIONS)
def _element_phasor(drive, world, row, column):
    if not isinstance(drive, types.NamedTuple):
        return None
    reader = READERS[drive.instance_class]

    def read(drive, world, row, column):
        return reader(drive, world, row, column)

    return read


@jit
def all_phasors(drive, phasors):
    """Fill ``phasors`` (worlds, rows, columns, 2) with every element's ``(C, S)``, for pictures and tests."""
    for world in range(phasors.shape[0]):
        for row in range(phasors.shape[1]):
            for column in range(phasors.shape[2]):
                c, s = element_phasor(drive, world, row, column)
                phasors[world, row, column, 0] = c
                phasors[world, row, column, 1] = s
