"""Actions: float32 boxes in [-1, 1] and the drive each one means."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.physics.core.drive import FIELD_STRENGTHS, Drive, element_drive, field_drive, patch_drive, phasor_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface


def patch_size(surface: Surface, part: Part) -> int:
    """Elements along a side of the square patch that always covers ``part``, wherever its centre lies."""
    across = math.ceil(2.0 * part.radius / surface.element_size) + 1
    return min(across, max(surface.rows, surface.columns))


def largest_patch(surface: Surface, parts: Sequence[Part]) -> int:
    """Elements along a side of the square patch that covers any of ``parts``."""
    return max(patch_size(surface, part) for part in parts)


class Action(ABC):
    """Base: the shape, the space, the check, and :meth:`drive`.

    Args:
        surface: the table.
        parts: the parts of a world, one or several.
    """

    shape: tuple[int, ...]

    def __init__(self, surface: Surface, parts: Part | Sequence[Part]) -> None:
        self.surface = surface
        self.parts = (parts,) if isinstance(parts, Part) else tuple(parts)
        self.full_scale = surface.full_scale

    @property
    def space(self) -> spaces.Box:
        """Box of one world."""
        return spaces.Box(-1.0, 1.0, self.shape, np.float32)

    def check(self, action: Any, worlds: int | None) -> np.ndarray:
        """The batch as contiguous float32 (worlds, *shape); worlds None: one action without that axis, as a batch of 1.

        Raises:
            ValueError: wrong shape, not numbers, NaN or infinity.
        """
        expected = self.shape if worlds is None else (worlds, *self.shape)
        allowed = f"real numbers of shape {expected}"
        try:
            values = np.asarray(action)
        except ValueError:  # rows of different lengths
            raise checks.refuse("action", action, allowed) from None
        if values.shape != expected or values.dtype.kind not in "fiu":
            raise checks.refuse("action", f"array of shape {values.shape} and type {values.dtype}", allowed)
        if worlds is None:
            values = values[None]
        if not np.isfinite(values).all():
            bad = np.argwhere(~np.isfinite(values))[0].tolist()
            raise checks.refuse("action", f"{float(values[tuple(bad)])} at {bad}", "finite numbers")
        # Clip in the given type: a float64 beyond float32's range would turn into infinity.
        if values.dtype != np.float32:
            values = np.clip(values, -1.0, 1.0)
        return np.ascontiguousarray(values, dtype=np.float32)

    @abstractmethod
    def drive(self, action: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> Drive:
        """The drive that a checked batch means.

        Args:
            action: (worlds, *shape).
            pose: (worlds, parts, 3) of the parts.
            gone: (worlds, parts) whether a part has fallen or is not there: it commands nothing.
        """


class Element(Action):
    """(rows, columns, 2): amplitude [-1, 1] -> [0, max_amplitude] and phase [-1, 1] -> [-pi, pi] of every element."""

    def __init__(self, surface: Surface, parts: Part | Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns, 2)

    def drive(self, action: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> Drive:
        return element_drive(action.reshape(len(action), -1), self.surface.columns, self.full_scale)


class Phasor(Action):
    """(rows, columns, 2): amplitude x (cos, sin) phase of every element; longer vectors are shortened to length 1."""

    def __init__(self, surface: Surface, parts: Part | Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns, 2)

    def drive(self, action: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> Drive:
        return phasor_drive(action.reshape(len(action), -1), self.surface.columns, self.full_scale)


class Patch(Action):
    """(parts, k, k, 2): phasors of the k x k elements around each part, rows first; all others at rest.

    k suits the largest part. An element in several patches obeys the part whose centre is nearest to the element's centre,
    of parts equally near the one with the lower index. Parts that have fallen or are not there command nothing.
    """

    def __init__(self, surface: Surface, parts: Part | Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.size = largest_patch(surface, self.parts)
        self.shape = (len(self.parts), self.size, self.size, 2)

    def drive(self, action: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> Drive:
        centre = pose[:, :, 1::-1] / self.surface.element_size
        first = np.floor(centre + (0.5 - 0.5 * self.size))
        centre[gone] = np.inf
        return patch_drive(action.reshape(len(action), -1), first.astype(np.int64), centre, self.size, self.full_scale)


class Field(Action):
    """(parts, 6): strengths of the fields around each part: uniform x, y, squeeze x, y, radial, tangential.

    The fields are those of :mod:`vibgym.fields` centred on the part, with a reach of half the patch (k / 2 elements, k for
    the largest part). Every element obeys the part whose centre is nearest to the element's centre, of parts equally near
    the one with the lower index. Parts that have fallen or are not there command nothing.
    """

    def __init__(self, surface: Surface, parts: Part | Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (len(self.parts), FIELD_STRENGTHS)
        self.reach = 0.5 * largest_patch(surface, self.parts) * surface.element_size

    def drive(self, action: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> Drive:
        centre = pose[:, :, :2].copy()  # the pose moves on, the field stays where it was
        centre[gone] = np.inf
        values = action.reshape(len(action), -1)
        return field_drive(values, centre, self.surface.element_size, self.reach, self.full_scale)


ACTIONS: dict[str, type[Action]] = {"element": Element, "phasor": Phasor, "patch": Patch, "field": Field}
