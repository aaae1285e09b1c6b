"""Records and units of drawings; lengths in mm."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.scene.parts import StablePose

UNITS = {
    "um": 1e-3, "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1e3,
    "mil": 0.0254, "in": 25.4, "ft": 304.8, "px": 25.4 / 96.0, "pt": 25.4 / 72.0,
}  # fmt: skip
"""Unit of a drawing -> mm."""

GAP = 0.1
"""Ends of strokes that are farther apart than this share of the tolerance are not joined."""


class Fault(NamedTuple):
    """A fault of a drawing.

    Attributes:
        text: one line.
        place: (2,) mm, where a picture marks it; None if that is not known.
    """

    text: str
    place: np.ndarray | None = None


def refusal(faults: Sequence[Fault], lines: Sequence[np.ndarray] = ()) -> checks.Refused:
    """Return the error for all faults of a drawing, whose line names the first one.

    Args:
        faults: at least one; the attribute ``faults`` of the error.
        lines: (n, 2) mm each, what could be read; the attribute ``lines`` of the error.
    """
    others = f"; and {len(faults) - 1} other faults" if len(faults) > 2 else "; and another fault" * (len(faults) - 1)
    error = checks.conflict(faults[0].text + others)
    error.faults, error.lines = tuple(faults), tuple(lines)
    return error


@dataclass(frozen=True)
class Solid:
    """A mesh as it lies.

    Attributes:
        height, centre_height, volume: mm, mm, mm^3.
        resting: area of the faces on the table over the area of the outline with its holes; 1 for a prism.
        offset: distance of the centre of mass from the centre of the outline's area, mm; 0 for a prism.
        gyration: inertia about the vertical axis through the centre of mass over mass, mm^2.
        poses: stable ones, most probable first.
    """

    height: float
    centre_height: float
    volume: float
    resting: float
    offset: float
    gyration: float
    poses: tuple[StablePose, ...]


@dataclass(frozen=True)
class Drawing:
    """Outline of a part from a file.

    Attributes:
        rim: (n, 2) mm, outer outline.
        holes: (n, 2) mm each.
        radius: mm, if the rim is a circle within the tolerance and there are no holes; else None.
        skipped: what the drawing contains and the part does not, such as text, hidden lines or bridged gaps -> number.
        solid: of a mesh; None for flat drawings.
    """

    rim: np.ndarray
    holes: tuple[np.ndarray, ...] = ()
    radius: float | None = None
    skipped: Mapping[str, int] = field(default_factory=dict)
    solid: Solid | None = None


def factor_of(named: str | None, units: str | None, missing: str) -> float:
    """Return mm per unit of a drawing.

    Args:
        named: unit in the file, a key of :data:`UNITS`, or None.
        units: the argument ``units``, which replaces it.
        missing: why the file does not name its unit, for the error.

    Raises:
        ValueError: neither.

    Warns:
        UserWarning: both and different.
    """
    unit = named if units is None else units
    if unit is None:
        raise checks.conflict(f"unknown units: {missing}; give units=, one of {', '.join(UNITS)}")
    if named is not None and named != unit:
        warnings.warn(f"units={units!r} replaces {named!r}, the unit of the file", stacklevel=8)
    return UNITS[unit]
