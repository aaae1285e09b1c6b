"""Push: parts that the elements drive push one that they do not drive to a pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import bound, reference
from vibgym.physics.contacts.hulls import load_hulls, place_hulls
from vibgym.physics.core.records import State
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import Length
from vibgym.tasks.base import Start, Task
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.scoring import Scoring, Stage
from vibgym.tasks.starts import pose_of_absent

MARGIN = 0.025
"""m between the circle of a pushed part or its goal and the borders, so that pushers can get behind it."""

CLEAR = 0.002
"""m between the circles of parts at the start."""

TRIES = 12
"""Random positions tried for each pusher; then it starts in a corner."""


class Push(Task):
    """Every part that the elements do not move, within 5 mm and 5 degrees of its goal for ten periods; none has fallen.

    Such a part has a ``coupling`` of 0: friction brakes it, and only the other parts can push it. The others have no goals and
    are the only ones that actions control. By default two discs push a T of 72 mm, as in PushT (Chi et al., RSS 2023), and all
    borders have walls. Headings count modulo a part's symmetry. ``info["coverage"]`` is the share of the goal's area that
    the pushed part covers.

    Raises:
        ValueError: if there are no pushers, or not exactly one part to push, or a part does not fit on the surface.
    """

    class Settings(Task.Settings):
        """Settings of Push."""

        slots: ClassVar[None] = None

        near: Length | None = Field(default=None, gt=0.0)
        """Largest distance of a goal from its part's start; None: it may be anywhere."""

        near_deg: float | None = Field(default=None, gt=0.0, le=180.0)
        """Largest turn of a goal from its part's start, degrees; None: any."""

    settings: Settings

    TERMS = {
        **PoseTask.TERMS,
        "time": ("time", 0.005),  # a whole episode of it costs less than a fall
        "reach": ("reach", 0.5),  # without it, pushers that never touch the part get no reward at all
    }
    FEATURES = ("present", "kind", *PoseTask.FEATURES, "gap", "neighbour")
    DEFAULT_PARTS = ()
    has_goal = True
    position_tolerance = 0.005
    heading_tolerance = math.radians(5.0)
    modulo_symmetry = True

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        self.scored = ~self.driven
        if self.scored.sum() != 1 or not self.driven.any():
            got = f"{int(self.scored.sum())} parts with coupling 0, and {int(self.driven.sum())} others"
            raise checks.refuse("parts", got, "one part with coupling 0, which is pushed, and at least one that pushes")
        near, turn = self.settings.near, self.settings.near_deg
        self.near = math.hypot(surface.width, surface.depth) if near is None else near
        self.turn = math.radians(180.0 if turn is None else turn)
        self.pushed, self.pushers = int(np.flatnonzero(self.scored)[0]), np.flatnonzero(self.driven)
        size, radius = np.array([surface.width, surface.depth]), self.parts[self.pushed].radius
        if 2.0 * radius > size.min():
            got = f"a pushed part of radius {radius:.4g} m"
            raise checks.refuse("parts", got, f"at most {0.5 * size.min():g} m on this surface")
        edge = radius + MARGIN
        self.low = np.minimum(edge, 0.5 * size)
        self.high = size - self.low
        largest = max(self.parts[k].radius for k in self.pushers)
        if len(self.pushers) > 4 or math.hypot(*(self.low - largest)) < edge - MARGIN + largest + CLEAR:
            got = f"{len(self.pushers)} parts of radius up to {largest:.4g} m that push"
            raise checks.refuse("parts", got, "at most four, for each of which there is room in a corner")
        self.draws = 6 + 3 * TRIES * len(self.pushers)

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        shape = len(uniform), len(self.parts)
        there = np.ones(shape, dtype=bool) if present is None else present
        pose, goal = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        own = pose[:, self.pushed]
        own[:, :2] = self.low + (self.high - self.low) * uniform[:, :2]
        own[:, 2] = math.pi * (2.0 * uniform[:, 2] - 1.0)
        goal[:, self.pushed] = self._goals(own, uniform[:, 3:6])
        tries = uniform[:, 6:].reshape(len(uniform), len(self.pushers), TRIES, 3)
        for k, part in enumerate(self.pushers.tolist()):
            self._put_pusher(k, part, tries[:, k], pose)
        pose = np.where(there[..., None], pose, pose_of_absent(self.surface))
        return Start(pose, there, np.where(there[..., None], goal, 0.0))

    def _goals(self, pose: np.ndarray, uniform: np.ndarray) -> np.ndarray:
        """Return goals (n, 3) of the pushed part at ``pose`` (n, 3), uniform over the allowed ones, from ``uniform`` (n, 3)."""
        low, high = np.maximum(self.low, pose[:, :2] - self.near), np.minimum(self.high, pose[:, :2] + self.near)
        displacement = low + (high - low) * uniform[:, :2] - pose[:, :2]
        length = np.hypot(displacement[:, 0], displacement[:, 1])[:, None]
        # corners of the square go onto the circle
        displacement = displacement * np.minimum(1.0, self.near / np.maximum(length, 1e-12))
        return np.column_stack([pose[:, :2] + displacement, pose[:, 2] + self.turn * (2.0 * uniform[:, 2] - 1.0)])

    def _put_pusher(self, number: int, part: int, tries: np.ndarray, pose: np.ndarray) -> None:
        """Place a pusher at random clear of the others, else in the corner of its number; in place.

        Args:
            tries: (n, TRIES, 3) uniform.
        """
        radius, size = self.parts[part].radius, np.array([self.surface.width, self.surface.depth])
        corner, *corners = (np.where([k & 1, k >> 1], size - radius, radius) for k in range(number, len(self.pushers)))
        place = np.tile(corner, (len(pose), 1))
        placed = np.zeros(len(pose), dtype=bool)
        before = [self.pushed, *self.pushers[:number].tolist()]
        reach = np.array([self.parts[k].radius for k in before]) + radius + CLEAR
        for t in range(TRIES):
            at = radius + (size - 2.0 * radius) * tries[:, t, :2]
            clear = (np.hypot(*np.moveaxis(at[:, None] - pose[:, before, :2], -1, 0)) > reach).all(axis=1)
            for other in corners:  # which later pushers may need
                clear &= np.hypot(*(at - other).T) > 2.0 * radius + CLEAR
            place = np.where((clear & ~placed)[:, None], at, place)
            placed |= clear
        pose[:, part, :2], pose[:, part, 2] = place, math.pi * (2.0 * tries[:, 0, 2] - 1.0)

    def scoring(self, state: State, periods: int) -> CoverageScoring:
        return CoverageScoring(self, state, periods)


class CoverageScoring(Scoring):
    """Measures the share of the goal that the pushed part covers."""

    MEASURED = ("coverage",)

    def __init__(self, task: Push, state: State, periods: int) -> None:
        super().__init__(task.rules(periods), task.part_kinds, state)
        self._pushed = task.pushed

    def measure(self) -> list[Stage]:
        pose, coverage = self.state.pose, self.measured["coverage"]
        return [bound(goal_coverage, hulls_of(self._parts), self._pushed, pose, self.episode.goal, coverage)]


@jit
def copy_corners(hulls, piece, placed, corners):
    """Write the corners of a placed convex piece into ``corners``; returns their number."""
    first, count = hulls.first[piece], hulls.first[piece + 1] - hulls.first[piece]
    for k in range(count):
        corners[k, 0], corners[k, 1] = placed[first + k, 0], placed[first + k, 1]
    return count


@jit
def clip(corners, count, ax, ay, bx, by, result):
    """Clip a convex polygon to the left of the line from a to b (Sutherland & Hodgman, 1974); returns the number of corners."""
    left = 0
    for k in range(count):
        px, py = corners[k, 0], corners[k, 1]
        qx, qy = corners[(k + 1) % count, 0], corners[(k + 1) % count, 1]
        p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
        if p >= 0.0:
            result[left, 0], result[left, 1] = px, py
            left += 1
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = p / (p - q)
            result[left, 0], result[left, 1] = px + share * (qx - px), py + share * (qy - py)
            left += 1
    return left


@jit
def area(corners, count):
    """Return the area of a polygon, m^2; positive if counter-clockwise."""
    total = 0.0
    for k in range(count):
        j = (k + 1) % count
        total += corners[k, 0] * corners[j, 1] - corners[k, 1] * corners[j, 0]
    return 0.5 * total


@jit
def shared_area(hulls, a, placed, b, aimed, one, other, spare):
    """Return the area, m^2, that piece ``a`` of a placed part shares with piece ``b`` of its goal; last three: scratch."""
    count, edges = copy_corners(hulls, a, placed, one), copy_corners(hulls, b, aimed, other)
    for k in range(edges):
        j = (k + 1) % edges
        count = clip(one, count, other[k, 0], other[k, 1], other[j, 0], other[j, 1], spare)
        for corner in range(count):
            one[corner, 0], one[corner, 1] = spare[corner, 0], spare[corner, 1]
    return area(one, count) if count > 2 else 0.0


@jit
def shared_by_discs(radius, distance):
    """Return the area that two discs of the same radius share, m^2."""
    if distance >= 2.0 * radius:
        return 0.0
    half = 0.5 * distance
    return 2.0 * radius * radius * math.acos(half / radius) - distance * math.sqrt(radius * radius - half * half)


@jit(allocates=True)
def goal_coverage(hulls, part, pose, goal, coverage, worlds):
    """Compute the share of a part's goal that it covers, (worlds,), of ``worlds`` (n,).

    Args:
        part: index.
        pose, goal: (worlds, parts, 3) m, m, rad.
        coverage: (worlds,), overwritten.
    """
    hulls = reference(hulls)
    most = 2 * hulls.corner.shape[0]  # clipping adds at most one corner for every edge
    one, other, spare = np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2))
    placed, aimed = np.empty_like(hulls.corner), np.empty_like(hulls.corner)
    for k in range(worlds.shape[0]):
        w, shared, whole = worlds[k], 0.0, 0.0
        load_hulls(hulls, w)
        first, last = hulls.owner[part], hulls.owner[part + 1]
        for piece in range(first, last):
            whole += area(one, copy_corners(hulls, piece, hulls.corner, one))
        place_hulls(hulls, part, pose[w, part, 0], pose[w, part, 1], pose[w, part, 2], placed)
        place_hulls(hulls, part, goal[w, part, 0], goal[w, part, 1], goal[w, part, 2], aimed)
        for a in range(first, last):
            for b in range(first, last):
                shared += shared_area(hulls, a, placed, b, aimed, one, other, spare)
        if whole > 0.0:
            coverage[w] = shared / whole
        else:  # a disc: one corner, rounded
            distance = math.hypot(goal[w, part, 0] - pose[w, part, 0], goal[w, part, 1] - pose[w, part, 1])
            coverage[w] = shared_by_discs(hulls.rounding[first], distance) / (math.pi * hulls.rounding[first] ** 2)
