"""Observations of many parts: a block of numbers for each, or an image."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym.envs.observations import COARSE, LEAST_SPEED, PIXELS, SPIN_SCALE
from vibgym.physics.core.jit import jit
from vibgym.rendering.raster import rasterise_many
from vibgym.scene.surface import Surface
from vibgym.tasks.crowd import CrowdScore
from vibgym.tasks.many import ManyTask

BLOCK_SIZE = 20
KIND_VALUES = (255, 170, 85)
"""Brightness of the first, second and third kind in an image."""


@jit
def _unit(value):
    return min(max(value, -1.0), 1.0)


@jit
def blocks(pose, mean_velocity, way, gap, neighbour, present, kind, symmetry, size, scales, out):
    """Write every world's blocks into ``out`` (worlds, slots, BLOCK_SIZE) float32.

    Args:
        kind, symmetry: (parts,) int64.
        size: (2,) m, of the surface.
        scales: (5,) element size (m), scale of the way (m), speed (m/s), spin (rad/s), scale of the gap (m).
    """
    longer = max(size[0], size[1])
    element, coarse, speed, spin, near = scales[0], scales[1], scales[2], scales[3], scales[4]
    for w in range(pose.shape[0]):
        out[w] = 0.0
        for p in range(pose.shape[1]):
            if not present[w, p]:
                continue
            block = out[w, p]
            block[0] = 1.0
            block[1 + kind[p]] = 1.0
            for axis in range(2):
                at = pose[w, p, axis] / element
                block[4 + axis] = 2.0 * (at - math.floor(at)) - 1.0
                block[8 + axis] = _unit(2.0 * pose[w, p, axis] / size[axis] - 1.0)
                block[10 + axis] = _unit(way[w, p, axis] / longer)
                block[12 + axis] = math.tanh(way[w, p, axis] / coarse)
                block[14 + axis] = _unit(mean_velocity[w, p, axis] / speed)
            block[6] = math.cos(symmetry[p] * pose[w, p, 2])
            block[7] = math.sin(symmetry[p] * pose[w, p, 2])
            block[16] = _unit(mean_velocity[w, p, 2] / spin)
            block[17] = math.tanh(gap[w, p] / near)
            other = neighbour[w, p]
            if other >= 0:
                dx, dy = pose[w, other, 0] - pose[w, p, 0], pose[w, other, 1] - pose[w, p, 1]
                apart = math.sqrt(dx * dx + dy * dy)
                if apart > 0.0:
                    block[18], block[19] = dx / apart, dy / apart


class CrowdStateObservation:
    """One flat float32 box of slots x 20 numbers in [-1, 1] (table in :class:`vibgym.envs.VibgymEnv`).

    Part p is in slot p. The block of an absent part, or of a slot without a part, is all 0.
    """

    def __init__(self, surface: Surface, task: ManyTask) -> None:
        self.slots, self.kind = task.slots, task.kind
        self.size = np.array([surface.width, surface.height])
        self.symmetry = np.array([part.symmetry for part in task.parts])
        speed, largest = max(surface.table_speed, LEAST_SPEED), math.sqrt(2.0) * surface.element_size
        self.scales = np.array([surface.element_size, COARSE, speed, SPIN_SCALE, largest])

    @property
    def space(self) -> spaces.Space:
        """Space of one world."""
        return spaces.Box(-1.0, 1.0, (self.slots * BLOCK_SIZE,), np.float32)

    def observe(self, pose: np.ndarray, mean_velocity: np.ndarray, goal: np.ndarray, score: CrowdScore) -> Any:
        """A fresh batch of observations."""
        out = np.empty((len(pose), self.slots, BLOCK_SIZE), dtype=np.float32)
        blocks(
            pose,
            mean_velocity,
            score.way,
            score.gap,
            score.neighbour,
            score.present,
            self.kind,
            self.symmetry,
            self.size,
            self.scales,
            out,
        )
        return out.reshape(len(pose), -1)


class CrowdImageObservation:
    """uint8 image (rows x 6, columns x 6, 3), row 0 at the largest y.

    Channel 0: the parts, 255 for the first kind, 170 for the second and 85 for the third. Channel 1: the zones, with the
    values of their kinds. Channel 2: checkerboard of the elements, and the parts' heading marks.
    """

    def __init__(self, surface: Surface, task: ManyTask) -> None:
        self.surface = surface
        outlines = [np.array(part.outline) for part in task.parts]
        self.outline = np.concatenate(outlines)
        self.first = np.cumsum([0, *(len(outline) for outline in outlines)])
        values = np.array(KIND_VALUES, dtype=np.uint8)
        self.value = values[task.kind]
        self.zones = np.zeros((0, 4)) if task.zones is None else task.zones
        self.zone_value = values[: len(self.zones)]
        self.shape = (surface.rows * PIXELS, surface.columns * PIXELS, 3)

    @property
    def space(self) -> spaces.Space:
        """Space of one world."""
        return spaces.Box(0, 255, self.shape, np.uint8)

    def observe(self, pose: np.ndarray, mean_velocity: np.ndarray, goal: np.ndarray, score: CrowdScore) -> Any:
        """A fresh batch of observations."""
        image = np.empty((len(pose), *self.shape), dtype=np.uint8)
        surface = self.surface
        rasterise_many(
            pose,
            score.present,
            self.outline,
            self.first,
            self.value,
            self.zones,
            self.zone_value,
            surface.rows,
            surface.columns,
            surface.element_size,
            PIXELS,
            image,
        )
        return image


CROWD_OBSERVATIONS: dict[str, Any] = {"state": CrowdStateObservation, "image": CrowdImageObservation}
