"""Actions of the elements around each part: patches of phasors, and fields."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym.envs.actions import ACTIONS, Action
from vibgym.kernels.jit import exact
from vibgym.physics.core.drive import FIELD_STRENGTHS, NOWHERE, Drive, field_drive, patch_drive
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement


def patch_size(surface: Surface, parts: Sequence[Part]) -> int:
    """Return the side, in elements, of the smallest square patch that covers any of ``parts`` at any position."""
    across = math.ceil(2.0 * max(part.radius for part in Kinds.of(parts).every) / surface.element_size) + 1
    return min(across, max(surface.rows, surface.columns))


@exact
def follow_patches(pose, gone, element_size, shift, origin, centre):
    """Write first row and column of the parts' patches, and their centres in elements, which are nowhere for parts gone.

    Args:
        pose: (worlds, parts, 3) m, m, rad.
        gone: (worlds, parts) bool.
        element_size: m.
        shift: from a centre to the first element, elements; rounded down.
        origin, centre: (worlds, parts, 2), overwritten.
    """
    for w in range(pose.shape[0]):
        for part in range(pose.shape[1]):
            for k in range(2):
                at = pose[w, part, 1 - k] / element_size
                origin[w, part, k] = math.floor(at + shift)
                centre[w, part, k] = NOWHERE if gone[w, part] else at


class Patch(Action):
    """(parts, k, k, 2): phasors of the k x k elements around each part, rows first; all others at rest.

    k is that of the largest part. An element in several patches belongs to the part with the nearest centre; ties go to the
    lower index. Parts that are gone have no elements.
    """

    by_part = True

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.side = patch_size(surface, self.parts)
        self.shape = (len(self.parts), self.side, self.side, 2)

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        if self._drive is None:
            shape = measurement.pose.shape[:2]
            origin, centre = np.zeros((*shape, 2), dtype=np.int64), np.zeros((*shape, 2))
            self._drive = patch_drive(values, origin, centre, self.side, self.full_scale)
        drive, shift = self._drive, 0.5 - 0.5 * self.side
        follow_patches(measurement.pose, measurement.gone, self.surface.element_size, shift, drive.origin, drive.centre)
        if drive.values is not values:
            self._drive = drive._replace(values=values)
        return self._drive


class Field(Action):
    """(parts, 6): strengths of the fields around each part: uniform x, y, squeeze x, y, radial, tangential.

    The fields are those of :mod:`vibgym.fields` centred on the part, with a reach of k / 2 elements, k as for :class:`Patch`.
    Every element belongs to the part with the nearest centre; ties go to the lower index. Parts that are gone have no elements.
    """

    by_part = True

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (len(self.parts), FIELD_STRENGTHS)
        self.reach = 0.5 * patch_size(surface, self.parts) * surface.element_size

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        if self._drive is None:
            centre = np.zeros((*measurement.pose.shape[:2], 2))
            self._drive = field_drive(values, centre, self.surface.element_size, self.reach, self.full_scale)
        drive = self._drive
        drive.centre[...] = measurement.pose[:, :, :2]  # a copy: the field keeps its position during the step
        drive.centre[measurement.gone] = NOWHERE
        if drive.values is not values:
            self._drive = drive._replace(values=values)
        return self._drive


ACTIONS.register("patch", Patch)
ACTIONS.register("field", Field)
