"""Starts of parts: scattered over the surface, in a heap and in touch, or in a pattern.

A start depends only on the uniform numbers that the environment draws. Where no random pose is free after a number of tries,
parts are placed on a lattice, for which there is room.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.physics.contacts.hulls import hull_gap, part_gap, place_hulls, wall_gap
from vibgym.registry import Registry
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings
from vibgym.tasks.patterns import Pattern


def pose_of_absent(surface: Surface) -> np.ndarray:
    """Return the pose (3,) of parts that are not in an episode: beside the surface."""
    return np.array([-surface.width, -surface.depth, 0.0])


def lattice(low: np.ndarray, high: np.ndarray, radius: float, gap: float) -> np.ndarray:
    """Return centres (n, 2) of circles of ``radius`` in a rectangle, at least ``gap`` apart, m, on a square lattice.

    They are spread evenly, column by column, each from the bottom to the top.
    """
    axes = []
    for least, most in zip(low, high, strict=True):
        length = most - least - 2.0 * radius
        count = math.floor(length / (2.0 * radius + gap) + 1e-9) + 1 if length > -1e-12 else 0
        middle = 0.5 * (least + most)
        axes.append(middle + max(length, 0.0) * (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(count)))
    x, y = np.meshgrid(*axes, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])


TRIES = 20
"""Random poses, or directions of approach, for each part."""

CLEAR = 0.002
"""Smallest distance between scattered parts, m."""

TOUCH = 1e-6
"""Parts closer than this are in touch, m. Approaching parts stop at half of it."""

MAX_STEPS = 200
"""Of one approach; a handful is usual."""


class Room(NamedTuple):
    """The surface, for the drawing kernels."""

    width: float  # m
    depth: float  # m
    # (n, 2) m, centres of cells that hold any part, column by column, each from the bottom to the top
    cells: np.ndarray
    clear: float  # m, smallest distance between scattered parts


@jit
def is_clear(hulls, placed, pose, order, count, clear):
    """Return whether the part ``order[count]`` is at least ``clear`` from those before it; all are placed."""
    part = order[count]
    for k in range(count):
        other = order[k]
        dx, dy = pose[other, 0] - pose[part, 0], pose[other, 1] - pose[part, 1]
        reach = hulls.radius[part] + hulls.radius[other] + clear
        if dx * dx + dy * dy < reach * reach and not part_gap(hulls, placed, part, other) >= clear:
            return False
    return True


@jit
def scatter(hulls, room, order, count, numbers, placed, cells, pose):
    """Place the parts ``order[:count]`` at random, each wholly on the surface and clear of the others.

    Args:
        numbers: (parts, TRIES, 3) uniform.
        placed: scratch, as ``hulls.corner``.
        cells: scratch, (cells of the room,) int64.
        pose: (parts, 3), overwritten for these parts.
    """
    for k in range(count):
        part, fits = order[k], False
        radius = hulls.radius[part]
        for t in range(numbers.shape[1]):
            pose[part, 0] = radius + (room.width - 2.0 * radius) * numbers[part, t, 0]
            pose[part, 1] = radius + (room.depth - 2.0 * radius) * numbers[part, t, 1]
            pose[part, 2] = math.pi * (2.0 * numbers[part, t, 2] - 1.0)
            place_hulls(hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], placed)
            if is_clear(hulls, placed, pose, order, k, room.clear):
                fits = True
                break
        if not fits:
            spread(room, order, count, numbers, cells, pose)
            return


@jit
def spread(room, order, count, numbers, cells, pose):
    """Place the parts in random cells of the lattice, with random headings."""
    for k in range(cells.shape[0]):
        cells[k] = k
    for k in range(count):
        part = order[k]
        other = min(k + int(numbers[part, 0, 0] * (cells.shape[0] - k)), cells.shape[0] - 1)
        cells[k], cells[other] = cells[other], cells[k]
        pose[part, 0], pose[part, 1] = room.cells[cells[k], 0], room.cells[cells[k], 1]
        pose[part, 2] = math.pi * (2.0 * numbers[part, 0, 2] - 1.0)


@jit
def slide(hulls, placed, pose, order, count, ux, uy, length):
    """Move the part ``order[count]`` along ``(ux, uy)`` until it touches one of those before it, ``length`` m at most.

    Conservative advancement: along the direction of their gap two hulls cannot meet before they have closed it. Changes the
    part's pose and placed corners; returns whether it touches.
    """
    part = order[count]
    travelled = 0.0
    for _ in range(MAX_STEPS):
        place_hulls(hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], placed)
        smallest, step = math.inf, length - travelled
        for k in range(count):
            other = order[k]
            for a in range(hulls.owner[part], hulls.owner[part + 1]):
                for b in range(hulls.owner[other], hulls.owner[other + 1]):
                    gap, nx, ny = hull_gap(hulls, placed, a, b)
                    smallest = min(smallest, gap)
                    rate = nx * ux + ny * uy
                    if rate > 0.0:
                        step = min(step, (gap - 0.5 * TOUCH) / rate)
        if smallest < TOUCH:
            return smallest >= 0.0
        if travelled >= length:
            return False
        pose[part, 0] += step * ux
        pose[part, 1] += step * uy
        travelled += step
    return False


@jit
def is_on_surface(hulls, placed, part, room):
    """Return whether a placed part lies wholly on the surface."""
    for wall in range(4):
        if not wall_gap(hulls, placed, part, wall, room.width, room.depth) >= 0.0:
            return False
    return True


@jit
def heap(hulls, room, order, count, numbers, placed, pose):
    """Place the parts ``order[:count]`` in one heap: each moves towards the first from afar and stops where it touches.

    The first lies near a random point. A part that would overhang the surface tries another direction and heading.

    Args: as for :func:`scatter`, but for numbers: (parts, TRIES, 2) uniform.
    """
    largest = 0.0
    for k in range(count):
        largest = max(largest, hulls.radius[order[k]])
    first = order[0]
    margin = largest * (0.5 + math.sqrt(count))
    for axis in range(2):
        size = room.width if axis == 0 else room.depth
        edge = min(max(margin, hulls.radius[first]), 0.5 * size)
        pose[first, axis] = edge + (size - 2.0 * edge) * numbers[first, 0, axis]
    pose[first, 2] = math.pi * (2.0 * numbers[first, 1, 0] - 1.0)
    place_hulls(hulls, first, pose[first, 0], pose[first, 1], pose[first, 2], placed)
    far = room.width + room.depth + 4.0 * largest
    for k in range(1, count):
        part, fits = order[k], False
        for t in range(numbers.shape[1]):
            ux, uy = math.cos(2.0 * math.pi * numbers[part, t, 0]), math.sin(2.0 * math.pi * numbers[part, t, 0])
            pose[part, 0], pose[part, 1] = pose[first, 0] - far * ux, pose[first, 1] - far * uy
            pose[part, 2] = math.pi * (2.0 * numbers[part, t, 1] - 1.0)
            touches = slide(hulls, placed, pose, order, k, ux, uy, far)
            if touches and is_on_surface(hulls, placed, part, room):
                fits = True
                break
        if not fits:
            push_together(hulls, room, order, count, numbers, placed, pose)
            return


@jit
def push_together(hulls, room, order, count, numbers, placed, pose):
    """Place the parts in the first cells of the lattice and push each to the left, and at the border down, until it touches.

    Cells are filled column by column, so that parts move within the lattice and their cells are free.
    """
    for k in range(count):
        part = order[k]
        pose[part, 0], pose[part, 1] = room.cells[k, 0], room.cells[k, 1]
        pose[part, 2] = math.pi * (2.0 * numbers[part, 0, 1] - 1.0)
        if not slide(hulls, placed, pose, order, k, -1.0, 0.0, room.cells[k, 0] - room.cells[0, 0]):
            slide(hulls, placed, pose, order, k, 0.0, -1.0, room.cells[k, 1] - room.cells[0, 1])


@jit(allocates=True)
def heap_starts(hulls, room, order, count, tries, pose):
    """Draw the poses of the present parts of n worlds, each in one heap.

    Args:
        order: (n, parts) int64, the present parts first, in the order in which they are placed.
        count: (n,) number of present parts.
        tries: (n, parts, TRIES, numbers of a try) uniform.
        pose: (n, parts, 3), overwritten for present parts.
    """
    placed = np.empty_like(hulls.corner)
    for world in range(pose.shape[0]):
        heap(hulls, room, order[world], count[world], tries[world], placed, pose[world])


@jit(allocates=True)
def scatter_starts(hulls, room, order, count, tries, pose):
    """Draw the poses of the present parts of n worlds, scattered. Args: as for :func:`heap_starts`."""
    placed, cells = np.empty_like(hulls.corner), np.empty(room.cells.shape[0], np.int64)
    for world in range(pose.shape[0]):
        scatter(hulls, room, order[world], count[world], tries[world], placed, cells, pose[world])


class DrawnParts(BaseSettings):
    """What tasks with several parts draw for every episode."""

    parts: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] | None = None
    """Smallest and largest number of parts present, which are drawn; None: all."""


class Starts(ABC):
    """Draws which parts are present in an episode, and where they start. Subclasses draw the poses.

    Args:
        surface, parts: the scene.
        number: smallest and largest number of parts present, which are drawn; None: all.
        apart: m, distance between parts for which the surface must have room.
        clear: m, smallest distance between scattered parts.
        settings: of the start.

    Attributes:
        most: largest number of parts in an episode.
        draws: uniform numbers per episode.

    Raises:
        ValueError: a bad number, or too little room.
    """

    class Settings(BaseSettings):
        """Settings of starts; none."""

    settings: Settings
    draws: int

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        number: tuple[int, int] | None = None,
        apart: float = 0.0,
        clear: float = CLEAR,
        settings: Settings | None = None,
    ) -> None:
        self.settings = type(self).Settings() if settings is None else settings
        self.surface, self.parts, self.apart, self.clear = surface, tuple(parts), apart, clear
        self.fewest, self.most = (len(parts), len(parts)) if number is None else number
        if not self.fewest <= self.most <= len(parts):
            allowed = f"[low, high] with whole numbers 1 <= low <= high <= {len(parts)}"
            raise checks.refuse("randomize.parts", [self.fewest, self.most], allowed)

    @abstractmethod
    def poses(self, uniform: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Return poses (n, parts, 3) of the parts that are present (n, parts), from ``uniform`` (n, draws) in [0, 1)."""

    def draw(self, uniform: np.ndarray, present: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (n, parts, 3) and the parts that are present (n, parts), from ``uniform`` (n, draws) in [0, 1).

        Args:
            present: (n, parts) bool; None: drawn.
        """
        present = self.draw_present(uniform) if present is None else np.array(present)
        return np.where(present[..., None], self.poses(uniform, present), pose_of_absent(self.surface)), present

    def draw_present(self, uniform: np.ndarray) -> np.ndarray:
        """Return the parts of each episode (n, parts), drawn from the first ``1 + parts`` columns of ``uniform``."""
        if self.fewest == len(self.parts):
            return np.ones((len(uniform), self.fewest), dtype=bool)
        count = self.fewest + (uniform[:, 0] * (self.most - self.fewest + 1)).astype(np.int64)
        rank = uniform[:, 1 : 1 + len(self.parts)].argsort(axis=1, kind="stable").argsort(axis=1, kind="stable")
        return rank < np.minimum(count, self.most)[:, None]


class Scattered(Starts):
    """Random poses, 2 mm apart or more."""

    NUMBERS: ClassVar[int] = 3
    """Uniform numbers of one try."""

    PLACE: ClassVar[Callable[..., None]] = staticmethod(scatter_starts)
    """Kernel that draws the poses."""

    def __init__(self, *scene: Any, **settings: Any) -> None:
        super().__init__(*scene, **settings)
        surface, parts = self.surface, self.parts
        self.draws = 1 + len(parts) * (1 + TRIES * self.NUMBERS)
        gap = max(self.clear, self.apart)
        radius = max(part.radius for part in parts)
        cells = lattice(np.zeros(2), np.array([surface.width, surface.depth]), radius, gap)
        if len(cells) < self.most:
            names = ", ".join(dict.fromkeys(part.name for part in parts))
            got = f"{self.most} parts ({names}) of radius up to {radius:.4g} m, {1e3 * gap:.3g} mm apart"
            allowed = f"at most {len(cells)} on this surface, {surface.width:g} x {surface.depth:g} m"
            raise checks.refuse("parts", got, allowed)
        self._hulls, self._room = hulls_of(parts), Room(surface.width, surface.depth, cells, self.clear)

    def poses(self, uniform: np.ndarray, present: np.ndarray) -> np.ndarray:
        worlds, parts = present.shape
        pose = np.zeros((worlds, parts, 3))
        order = np.where(present, uniform[:, 1 : 1 + parts], 1.0).argsort(axis=1, kind="stable")
        tries = np.ascontiguousarray(uniform[:, 1 + parts :]).reshape(worlds, parts, TRIES, self.NUMBERS)
        self.PLACE(self._hulls, self._room, order, present.sum(axis=1), tries, pose)
        return pose


class Crowded(Scattered):
    """One heap, in touch."""

    NUMBERS, PLACE = 2, staticmethod(heap_starts)

    def __init__(self, *scene: Any, **settings: Any) -> None:
        super().__init__(*scene, clear=0.0, **settings)


class Arranged(Starts):
    """A pattern, such as ``{"kind": "pattern", "gap_mm": 5.0, "rows": 2}``.

    The places of parts in a lattice are drawn; given poses belong to their parts.
    """

    class Settings(Pattern.Settings, Starts.Settings):
        """Settings of the pattern."""

    settings: Settings

    def __init__(self, *scene: Any, **settings: Any) -> None:
        super().__init__(*scene, **settings)
        self.pattern = Pattern(self.surface, self.parts, self.settings, "start")
        self.draws = 1 + 2 * len(self.parts) + self.pattern.draws

    def poses(self, uniform: np.ndarray, present: np.ndarray) -> np.ndarray:
        worlds, parts = present.shape
        goals = self.pattern.draw(uniform[:, 1 + 2 * parts :])
        if not self.pattern.shuffles:
            return self.pattern.own(goals, present)
        mixed = uniform[:, 1 + parts : 1 + 2 * parts].argsort(axis=1, kind="stable")
        return goals[np.arange(worlds)[:, None], mixed]


STARTS: Registry[type[Starts]] = Registry("start", {"scattered": Scattered, "crowded": Crowded, "pattern": Arranged})
"""Values of ``start=``: a name, or a mapping with ``kind`` and settings."""
