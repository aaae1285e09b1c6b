"""Phasor ``(C, S)`` of each element's vertical motion, computed from commands where a part needs it.

With ``A = a_v w^2`` the normal acceleration over an element is ``g - C cos wt + S sin wt``, where ``C = A cos(alpha)`` and
``S = A sin(alpha)`` (m/s^2). It is linear in ``(C, S)``; lift-off is the disc ``C^2 + S^2 = g^2``.

A :class:`Drive` stores the commands of a batch of worlds. One record with a mode serves all kinds of commands, so kernels are
compiled once. A part rests on about nine of 256 elements, so only these are converted, once per call (:class:`Phasors`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, is_given
from vibgym.physics.core.hardware import NO_HARDWARE, hardware_at, realise

FIELD_STRENGTHS = 6
"""Strengths per part in :func:`field_drive`: uniform x, uniform y, squeeze x, squeeze y, radial, tangential."""

NOWHERE = 1e300
"""Centre of a part without commands: its squared distance is infinite, but it is finite for snapshots."""

POLAR, ELEMENT, PHASOR, PATCH, FIELD, CARTESIAN = range(6)
"""Modes of a drive; see the function of that name, such as :func:`polar_drive`."""

_NO_VALUES = np.zeros((0, 0), dtype=np.float32)
_NO_MOTION = np.zeros((0, 0, 0))
_NO_ORIGIN = np.zeros((0, 0, 0), dtype=np.int64)


class Drive(NamedTuple):
    """Motion of the elements in a batch of worlds; fields that a mode does not use are empty.

    Made by :func:`polar_drive`, :func:`element_drive`, :func:`phasor_drive`, :func:`patch_drive` and :func:`field_drive`.
    """

    mode: int
    values: np.ndarray = _NO_VALUES  # (worlds, n) float32, numbers in [-1, 1] (clipped): all modes but POLAR
    amplitude: np.ndarray = _NO_MOTION  # (worlds, rows, columns) m: POLAR; C, m/s^2: CARTESIAN
    phase: np.ndarray = _NO_MOTION  # (worlds, rows, columns) rad: POLAR; S, m/s^2: CARTESIAN
    origin: np.ndarray = _NO_ORIGIN  # (worlds, parts, 2) int64, row and column of a patch's first element: PATCH
    # (worlds, parts, 2), of the parts; PATCH: rows, columns in elements; FIELD: x, y in m
    centre: np.ndarray = _NO_MOTION
    size: int = 0  # elements along a side of a patch: PATCH
    columns: int = 0  # of the surface: ELEMENT, PHASOR
    full_scale: float = 0.0  # a_v w^2 at the largest amplitude, m/s^2: all modes but POLAR
    angular_frequency: float = 0.0  # rad/s: POLAR
    element_size: float = 0.0  # m: FIELD
    reach: float = 0.0  # m, at which squeeze, radial and tangential fields are at full strength: FIELD
    hardware: int = NO_HARDWARE  # address of pinned Hardware, with the rows of commands in effect


DRIVE: Layout[Drive] = Layout("DRIVE", __name__)
drive_at = DRIVE.at


def _plain(values: Any, kind: type) -> np.ndarray:
    """Return the values as a writeable array in C order, the layout that kernels are compiled for."""
    if isinstance(values, np.ndarray) and values.dtype == kind and values.flags.carray:
        return values
    return np.array(values, dtype=kind, order="C")


def polar_drive(amplitude: np.ndarray, phase: np.ndarray, angular_frequency: float) -> Drive:
    """Return a drive of amplitude ``a_v`` (m) and phase ``alpha`` (rad) of every element, each (worlds, rows, columns)."""
    amplitude, phase = _plain(amplitude, np.float64), _plain(phase, np.float64)
    return Drive(POLAR, amplitude=amplitude, phase=phase, angular_frequency=float(angular_frequency))


def cartesian_drive(c: np.ndarray, s: np.ndarray) -> Drive:
    """Return a drive of ``C`` and ``S`` of every element, each (worlds, rows, columns), m/s^2."""
    return Drive(CARTESIAN, amplitude=_plain(c, np.float64), phase=_plain(s, np.float64))


def element_drive(values: np.ndarray, columns: int, full_scale: float) -> Drive:
    """Return a drive of amplitude [-1, 1] -> [0, largest] and phase [-1, 1] -> [-pi, pi] of every element.

    Args:
        values: (worlds, rows * columns * 2) float32.
        columns: of the surface.
        full_scale: ``a_v w^2`` at the largest amplitude, m/s^2.
    """
    return Drive(ELEMENT, _plain(values, np.float32), columns=int(columns), full_scale=float(full_scale))


def phasor_drive(values: np.ndarray, columns: int, full_scale: float) -> Drive:
    """Return a drive of amplitude times (cos, sin) of phase of every element, clipped to the unit disc.

    Args: see :func:`element_drive`.
    """
    return Drive(PHASOR, _plain(values, np.float32), columns=int(columns), full_scale=float(full_scale))


def patch_drive(values: np.ndarray, origin: np.ndarray, centre: np.ndarray, size: int, full_scale: float) -> Drive:
    """Return a drive of phasors of the k x k elements around each part; all others are at rest.

    An element in several patches belongs to the part whose centre is nearest to the element's centre, ties to the lower index.
    A part whose centre is :data:`NOWHERE` has no elements.

    Args:
        values: (worlds, parts * k * k * 2) float32, rows first.
        origin: (worlds, parts, 2) row and column of each patch's first element.
        centre: (worlds, parts, 2) of each part along rows and columns, in elements.
        size: k.
        full_scale: m/s^2.
    """
    origin, centre = _plain(origin, np.int64), _plain(centre, np.float64)
    values, full_scale = _plain(values, np.float32), float(full_scale)
    return Drive(PATCH, values, origin=origin, centre=centre, size=int(size), full_scale=full_scale)


def field_drive(values: np.ndarray, centre: np.ndarray, element_size: float, reach: float, full_scale: float) -> Drive:
    """Return a drive of strengths of the basic fields (:mod:`vibgym.fields`) around each part, on the whole surface.

    The field's vector at an element's centre (thesis fig. 4.4) is the direction of the element's push. Each element belongs to
    the part whose centre is nearest, ties to the lower index. A part whose centre is :data:`NOWHERE` has no elements; without
    any part the elements are at rest.

    Args:
        values: (worlds, parts * FIELD_STRENGTHS) float32.
        centre: (worlds, parts, 2) x and y of each part, m.
        element_size: m.
        reach: m, distance at which squeeze, radial and tangential fields are at full strength.
        full_scale: m/s^2.
    """
    values, centre = _plain(values, np.float32), _plain(centre, np.float64)
    full_scale, element_size, reach = float(full_scale), float(element_size), float(reach)
    return Drive(FIELD, values, centre=centre, full_scale=full_scale, element_size=element_size, reach=reach)


@jit
def pinned_drive(address):
    """Return the drive pinned at an address as a record; a reference to this copy is faster to read than the pinned one."""
    drive = drive_at(address)
    return Drive(
        drive.mode, drive.values, drive.amplitude, drive.phase, drive.origin, drive.centre, drive.size, drive.columns,
        drive.full_scale, drive.angular_frequency, drive.element_size, drive.reach, drive.hardware,
    )  # fmt: skip


@jit
def _clipped(value):
    return min(max(np.float64(value), -1.0), 1.0)


@jit
def unit_phasor(first, second, full_scale):
    """Return the phasor of a vector, clipped to the unit disc, m/s^2."""
    length = math.sqrt(first * first + second * second)
    scale = full_scale / max(length, 1.0)
    return first * scale, second * scale


@jit
def push_phasor(push_x, push_y, full_scale):
    """Return the phasor that pushes a resting part along ``(push_x, push_y)``; length 1 is full amplitude.

    Near rest the mean acceleration is ``-(mu / 2) (S, C)`` to first order (thesis eqs. 5.60 and 5.61 at zero velocity).
    """
    return unit_phasor(-push_y, -push_x, full_scale)


@jit
def _polar(drive, world, row, column):
    normal = drive.amplitude[world, row, column] * drive.angular_frequency * drive.angular_frequency
    phase = drive.phase[world, row, column]
    return normal * math.cos(phase), normal * math.sin(phase)


@jit
def _element(drive, world, at):
    normal = 0.5 * (1.0 + _clipped(drive.values[world, at])) * drive.full_scale
    phase = math.pi * _clipped(drive.values[world, at + 1])
    return normal * math.cos(phase), normal * math.sin(phase)


@jit
def _phasor(drive, world, at):
    return unit_phasor(_clipped(drive.values[world, at]), _clipped(drive.values[world, at + 1]), drive.full_scale)


@jit
def _patch(drive, world, row, column):
    size = drive.size
    part, nearest = -1, math.inf
    for k in range(drive.centre.shape[1]):
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
    return _phasor(drive, world, ((part * size + i) * size + j) * 2)


@jit
def _field(drive, world, row, column):
    part, nearest = -1, math.inf
    for k in range(drive.centre.shape[1]):
        # In elements: sharing a product with the lines below would change the rounding.
        dx = column + 0.5 - drive.centre[world, k, 0] / drive.element_size
        dy = row + 0.5 - drive.centre[world, k, 1] / drive.element_size
        square = dx * dx + dy * dy
        if square < nearest:
            part, nearest = k, square
    if part < 0:
        return 0.0, 0.0
    values, at = drive.values, part * FIELD_STRENGTHS
    dx = (column + 0.5) * drive.element_size - drive.centre[world, part, 0]
    dy = (row + 0.5) * drive.element_size - drive.centre[world, part, 1]
    far = max(math.sqrt(dx * dx + dy * dy), drive.reach)
    radial = _clipped(values[world, at + 4]) / far
    tangential = _clipped(values[world, at + 5]) / far
    squeeze_x = _clipped(values[world, at + 2]) * _clipped(dx / drive.reach)
    squeeze_y = _clipped(values[world, at + 3]) * _clipped(dy / drive.reach)
    return push_phasor(
        _clipped(values[world, at]) - squeeze_x - radial * dx - tangential * dy,
        _clipped(values[world, at + 1]) - squeeze_y - radial * dy + tangential * dx,
        drive.full_scale,
    )


@jit
def _commanded(drive, world, row, column):
    if drive.mode == POLAR:
        return _polar(drive, world, row, column)
    if drive.mode == ELEMENT:
        return _element(drive, world, (row * drive.columns + column) * 2)
    if drive.mode == PHASOR:
        return _phasor(drive, world, (row * drive.columns + column) * 2)
    if drive.mode == PATCH:
        return _patch(drive, world, row, column)
    if drive.mode == FIELD:
        return _field(drive, world, row, column)
    return drive.amplitude[world, row, column], drive.phase[world, row, column]


@jit
def commands_equal(drive, world, row, column, last_row, last_column):
    """Return whether the raw commands of all elements of a box, corners included, are equal.

    Conservative: different commands may still give the same phasor.
    """
    if is_given(drive.hardware):
        return False
    others = 0
    if drive.mode == POLAR or drive.mode == CARTESIAN:
        amplitude, phase = drive.amplitude[world], drive.phase[world]
        first, second = amplitude[row, column], phase[row, column]
        for i in range(row, last_row + 1):
            for j in range(column, last_column + 1):
                others += (amplitude[i, j] != first) | (phase[i, j] != second)
        return others == 0
    if drive.mode == ELEMENT or drive.mode == PHASOR:
        values, width = drive.values[world], 2 * drive.columns
        first, second = values[row * width + 2 * column], values[row * width + 2 * column + 1]
        for i in range(row, last_row + 1):
            for j in range(i * width + 2 * column, i * width + 2 * last_column + 2, 2):
                others += (values[j] != first) | (values[j + 1] != second)
        return others == 0
    return False


@jit
def element_phasor(drive, world, row, column):
    """Return ``(C, S)`` in m/s^2 of the element at ``(row, column)`` in ``world``."""
    source = world
    if is_given(drive.hardware):
        source = hardware_at(drive.hardware).source[world]
    c, s = 0.0, 0.0
    if source >= 0:
        c, s = _commanded(drive, source, row, column)
    if is_given(drive.hardware):
        c, s = realise(hardware_at(drive.hardware), world, row, column, c, s)
    return c, s


@jit
def all_phasors(drive, phasors, first=0):
    """Fill ``phasors`` (worlds, rows, columns, 2) with every element's ``(C, S)``, of the worlds from ``first`` on."""
    for world in range(phasors.shape[0]):
        for row in range(phasors.shape[1]):
            for column in range(phasors.shape[2]):
                c, s = element_phasor(drive, first + world, row, column)
                phasors[world, row, column, 0] = c
                phasors[world, row, column, 1] = s


@jit
def limit_phasors(phasors, limit, c, s):
    """Copy phasors (worlds, rows, columns, 2) into ``c`` and ``s``, longer ones shortened to ``limit`` (m/s^2)."""
    for world in range(phasors.shape[0]):
        for row in range(phasors.shape[1]):
            for column in range(phasors.shape[2]):
                real, imaginary = phasors[world, row, column, 0], phasors[world, row, column, 1]
                square = real * real + imaginary * imaginary
                scale = limit / math.sqrt(square) if square > limit * limit else 1.0
                c[world, row, column], s[world, row, column] = scale * real, scale * imaginary


@jit
def follow_phasors(drive, keep, reached, c, s):
    """Compute the response of the elements to their phasors with a first-order lag, for a period.

    Args:
        keep: (worlds, 2) shares of the distance to the phasor that are left at the period's end, and in its mean.
        reached: (worlds, rows, columns, 2) phasors at the period's start, m/s^2, overwritten with those at its end.
        c, s: (worlds, rows, columns) overwritten with the means of the period.
    """
    for world in range(reached.shape[0]):
        end, mean = keep[world, 0], keep[world, 1]
        for row in range(reached.shape[1]):
            for column in range(reached.shape[2]):
                real, imaginary = element_phasor(drive, world, row, column)
                dc, ds = reached[world, row, column, 0] - real, reached[world, row, column, 1] - imaginary
                c[world, row, column], s[world, row, column] = real + mean * dc, imaginary + mean * ds
                reached[world, row, column, 0], reached[world, row, column, 1] = real + end * dc, imaginary + end * ds


class Phasors(NamedTuple):
    """Cache of the phasors under parts, a slot each: a direct-mapped cache by row and column modulo its size.

    The size is a power of two and at least a part's extent in elements, so elements under a part do not share an entry.
    """

    coupling: np.ndarray  # (slots,) share of the elements' vertical motion that reaches the part
    element: np.ndarray  # (slots, size * size) element of each entry, ``row << 32 | column``, -1: none
    c: np.ndarray  # (slots, size, size) m/s^2
    s: np.ndarray


def new_phasors(slots: int, across: int, coupling: float = 1.0) -> Phasors:
    """Allocate a cache for parts that extend over up to ``across`` elements along an axis."""
    size = 1 << max(across - 1, 0).bit_length()
    shape = slots, size, size
    return Phasors(np.full(slots, coupling), np.full((slots, size * size), -1), np.zeros(shape), np.zeros(shape))


@jit
def clear_phasors(phasors, slot):
    """Clear the entries of a slot."""
    for k in range(phasors.element.shape[1]):  # one loop, which becomes one call of memset
        phasors.element[slot, k] = -1


@jit
def phasor_under(phasors, slot, drive, world, row, column):
    """Return ``(C, S)`` in m/s^2 of the element at ``(row, column)`` in ``world``, times the coupling of a slot's part."""
    size = phasors.c.shape[1]
    i, j = row & (size - 1), column & (size - 1)
    element, entry = row << 32 | column, i * size + j
    if phasors.element[slot, entry] != element:
        phasors.element[slot, entry] = element
        c, s = element_phasor(drive, world, row, column)
        phasors.c[slot, i, j], phasors.s[slot, i, j] = phasors.coupling[slot] * c, phasors.coupling[slot] * s
    return phasors.c[slot, i, j], phasors.s[slot, i, j]
