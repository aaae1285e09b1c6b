"""Actions: flat float32 boxes in [-1, 1], and what each one commands."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.physics.core.drive import (
    FIELD_STRENGTHS,
    NOWHERE,
    Drive,
    element_drive,
    field_drive,
    patch_drive,
    phasor_drive,
)
from vibgym.registry import Registry
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement


def patch_size(surface: Surface, parts: Sequence[Part]) -> int:
    """Elements along a side of the square patch that always covers any of ``parts``, wherever its centre lies."""
    across = math.ceil(2.0 * max(part.radius for part in parts) / surface.element_size) + 1
    return min(across, max(surface.rows, surface.columns))


class Action(ABC):
    """Base: what the numbers mean, the flat space, the check, and the command.

    An action of your own is a subclass with ``shape`` and :meth:`command`; ``vibgym.envs.ACTIONS.register`` gives it a name.

    Args:
        surface: the table.
        parts: the parts of a world.

    Attributes:
        shape: says what the numbers mean; the space is flat, in C order of it.
        size: how many numbers.
    """

    shape: tuple[int, ...]

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        self.surface = surface
        self.parts = tuple(parts)
        self.full_scale = surface.full_scale

    @property
    def size(self) -> int:
        """How many numbers an action has."""
        return math.prod(self.shape)

    @property
    def space(self) -> spaces.Box:
        """Flat box of one world: most learners take no other."""
        return spaces.Box(-1.0, 1.0, (self.size,), np.float32)

    def check(self, action: Any, worlds: int | None) -> np.ndarray:
        """The batch as contiguous float32 (worlds, size).

        Args:
            action: (worlds, size) or (worlds, *shape).
            worlds: None: one action without that axis, as a batch of 1.

        Raises:
            ValueError: wrong shape, not numbers, NaN or infinity.
        """
        lead = () if worlds is None else (worlds,)
        flat, shaped = (*lead, self.size), (*lead, *self.shape)
        try:
            values = np.asarray(action)
        except ValueError:  # rows of different lengths
            raise checks.refuse("action", action, f"real numbers of shape {flat} or {shaped}") from None
        if values.shape not in (flat, shaped) or values.dtype.kind not in "fiu":
            got = f"array of shape {values.shape} and type {values.dtype}"
            raise checks.refuse("action", got, f"real numbers of shape {flat} or {shaped}")
        if not np.isfinite(values).all():
            bad = np.argwhere(~np.isfinite(values))[0].tolist()
            raise checks.refuse("action", f"{float(values[tuple(bad)])} at {bad}", "finite numbers")
        # Clip in the given type: a float64 beyond float32's range would turn into infinity.
        if values.dtype != np.float32:
            values = np.clip(values, -1.0, 1.0)
        return np.ascontiguousarray(values, dtype=np.float32).reshape(-1, self.size)

    @abstractmethod
    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        """What a checked batch asks of the elements.

        Args:
            values: (worlds, size).
            measurement: where the parts are, as far as is known; parts that are gone command nothing.
        """


class Element(Action):
    """(rows, columns, 2): amplitude [-1, 1] -> [0, max_amplitude] and phase [-1, 1] -> [-pi, pi] of every element."""

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns, 2)

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        return element_drive(values, self.surface.columns, self.full_scale)


class Phasor(Action):
    """(rows, columns, 2): amplitude x (cos, sin) phase of every element; longer vectors are shortened to length 1."""

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns, 2)

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        return phasor_drive(values, self.surface.columns, self.full_scale)


class Patch(Action):
    """(parts, k, k, 2): phasors of the k x k elements around each part, rows first; all others at rest.

    k suits the largest part. An element in several patches obeys the part whose centre is nearest to the element's centre,
    of parts equally near the one with the lower index. Parts that are gone command nothing.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.side = patch_size(surface, self.parts)
        self.shape = (len(self.parts), self.side, self.side, 2)

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        centre = measurement.pose[:, :, 1::-1] / self.surface.element_size
        first = np.floor(centre + (0.5 - 0.5 * self.side))
        centre[measurement.gone] = NOWHERE
        return patch_drive(values, first.astype(np.int64), centre, self.side, self.full_scale)


class Field(Action):
    """(parts, 6): strengths of the fields around each part: uniform x, y, squeeze x, y, radial, tangential.

    The fields are those of :mod:`vibgym.fields` centred on the part, with a reach of half the patch (k / 2 elements, k for
    the largest part). Every element obeys the part whose centre is nearest to the element's centre, of parts equally near
    the one with the lower index. Parts that are gone command nothing.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (len(self.parts), FIELD_STRENGTHS)
        self.reach = 0.5 * patch_size(surface, self.parts) * surface.element_size

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        centre = measurement.pose[:, :, :2].copy()  # the pose moves on, the field stays where it was
        centre[measurement.gone] = NOWHERE
        return field_drive(values, centre, self.surface.element_size, self.reach, self.full_scale)


ACTIONS: Registry[type[Action]] = Registry(
    "action", {"element": Element, "phasor": Phasor, "patch": Patch, "field": Field}
)
"""Actions by name; ``ACTIONS.register(name, cls)`` adds one of your own."""
