"""Patterns of goal poses: a lattice of parts with a gap between them, or poses that are given one by one.

A lattice fills column by column from the bottom to the top, the first kind first, and is turned as a whole by its heading. Its
pitch is what the largest part takes up along and across, and the gap. Where parts of a kind are as good as one another, goals
are given out at the episode's start: the cubes of the ways within each kind add up to the least, so that none is long.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.scene.hulls import gaps_between
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import Angle, BaseSettings, Length
from vibgym.tasks.base import kinds_by_name

Goals = tuple[tuple[float, float, float], ...]
"""Poses x, y, heading; m, m, rad."""

MAX_ROWS = 10_000

ROUNDING = 1e-9  # m, by which a pattern may stick out, or overlap: its places are sums and products


class Pattern:
    """Goal poses for the parts of an episode.

    Args:
        surface, parts: the scene.
        settings: of the pattern; None: the defaults.
        name: of the argument whose settings these are, for errors.

    Attributes:
        pose: (goals, 3) m, m, rad, about the place.
        of_kind: (goals,) int64, the kind whose parts may have each goal.
        low, high: (2,) m, where the place may lie.
        gap: m, least distance between goals; None of a single one.
        draws: uniform numbers for an episode.
        shuffles: whether any part fits into any place: in a lattice.

    Raises:
        ValueError: a pattern that does not fit on the surface or overlaps; fewer goals than parts.
    """

    class Settings(BaseSettings):
        """Settings of a pattern."""

        pattern: Goals | dict[str, Goals] | None = None
        """Poses [x, y, heading], m and rad, in place of a lattice: a list with one for each part; or a mapping from kind to a
        list with at least one for each of its parts."""

        rows: int | None = Field(default=None, ge=1, le=MAX_ROWS)
        """Rows of the lattice, across the table. By default the square root of the number of parts, rounded down, or what there
        is room for."""

        columns: int | None = Field(default=None, ge=1, le=MAX_ROWS)
        """Columns of the lattice, along the table; by default as many as the rows need."""

        gap: Length = Field(default=0.002, ge=0.0)
        """Distance between neighbours in the lattice."""

        heading: Angle = 0.0
        """Heading of the lattice and of each part in it."""

        place: tuple[Length, Length] | None = None
        """Position [x, y] of the lattice's middle; None: drawn wherever the lattice lies on the surface."""

        @model_validator(mode="after")
        def _one_or_the_other(self) -> Pattern.Settings:
            for name in ("rows", "columns", "gap", "heading", "place"):
                if self.pattern is not None and name in self.model_fields_set and getattr(self, name) is not None:
                    raise checks.conflict(f"{name!r} and 'pattern' exclude each other")
            return self

    def __init__(
        self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None, name: str = "task_settings"
    ) -> None:
        self.settings = own = Pattern.Settings() if settings is None else settings
        self._name, self._surface, self._parts = name, surface, tuple(parts)
        self._kinds, self._kind = kinds_by_name(parts)
        # How many parts of the same kind stand before each part: it has the goal of that number among its kind's.
        self._rank = np.array([(self._kind[:k] == kind).sum() for k, kind in enumerate(self._kind)])
        if own.pattern is not None:
            self.pose, self.of_kind = self._given(own.pattern)
            self.low = self.high = np.zeros(2)
            self._check(self.pose, f"{name}.pattern", own.pattern)
        else:
            self.pose, self.of_kind = self._lattice(own)
            self.low, self.high = self._places(own.place)
        gap = float(gaps_between(self._bodies(), self.pose[None]).min())
        self.gap = gap if math.isfinite(gap) else None
        self.shuffles = own.pattern is None
        self.drawn = own.pattern is None and own.place is None
        self.draws = 2 if self.drawn else 0

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """All goals of n episodes (n, goals, 3), from ``uniform`` (n, draws) in [0, 1)."""
        goals = np.tile(self.pose, (len(uniform), 1, 1))
        place = self.low + (self.high - self.low) * uniform if self.drawn else self.low
        goals[..., :2] += np.broadcast_to(place, (len(uniform), 2))[:, None]
        return goals

    def own(self, goals: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Return the goal (n, parts, 3) of each part, by its rank within its kind (absent parts included); zeros if absent.

        Args:
            goals: (n, goals, 3).  present: (n, parts) bool.
        """
        at = [np.flatnonzero(self.of_kind == kind)[rank] for kind, rank in zip(self._kind, self._rank, strict=True)]
        return np.where(present[..., None], goals[:, at], 0.0)

    def first(self, goals: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Return goals (n, parts, 3): the first ones of each kind, as many as it has present parts, so that none stays open.

        Args:
            goals: (n, goals, 3).  present: (n, parts) bool.
        """
        result = np.zeros((*present.shape, 3))
        for kind in range(len(self._kinds)):
            own, places = self._kind == kind, np.flatnonzero(self.of_kind == kind)
            number = np.cumsum(present & own, axis=1) - 1  # of each present part among those of its kind
            taken = goals[np.arange(len(goals))[:, None], places[np.clip(number, 0, len(places) - 1)]]
            result = np.where((present & own)[..., None], taken, result)
        return result

    def _lattice(self, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
        """Poses about the lattice's middle, and their kinds."""
        parts, rows, columns = self._parts, settings.rows, settings.columns
        gap, heading = settings.gap, settings.heading
        size = np.max([2.0 * np.abs(part.outline).max(axis=0) for part in parts], axis=0)
        pitch = size + gap
        if rows is None and columns is not None:
            rows = -(-len(parts) // columns)
        if rows is None:
            reach = abs(math.sin(heading)) * self._surface.width + abs(math.cos(heading)) * self._surface.depth
            room = math.floor((reach + gap + ROUNDING) / pitch[1])
            rows = max(min(math.isqrt(len(parts)), room), 1)
        needed = -(-len(parts) // rows)
        if columns is not None and columns < needed:
            allowed = f"at least {needed}: {len(parts)} parts in {rows} rows"
            raise checks.refuse(f"{self._name}.columns", columns, allowed)
        index = np.arange(len(parts))
        at = np.column_stack([index // rows, index % rows]) * pitch
        at -= 0.5 * (at.min(axis=0) + at.max(axis=0))
        cosine, sine = math.cos(heading), math.sin(heading)
        turned = at @ np.array([[cosine, sine], [-sine, cosine]])
        return np.column_stack([turned, np.full(len(parts), heading)]), np.sort(self._kind)

    def _given(self, pattern: Goals | Mapping[str, Goals]) -> tuple[np.ndarray, np.ndarray]:
        """Poses that are given, and their kinds."""
        name = f"{self._name}.pattern"
        if isinstance(pattern, Mapping):
            for kind in pattern:
                if kind not in self._kinds:
                    raise checks.unknown(f"kind in {name}", kind, self._kinds)
            lists = [(f"{name}.{kind}", pattern.get(kind, ())) for kind in self._kinds]
            needed = [int((self._kind == k).sum()) for k in range(len(self._kinds))]
        else:
            lists, needed = [(name, pattern)], [len(self._parts)]
        for (where, goals), count in zip(lists, needed, strict=True):
            if len(goals) < count:
                allowed = f"at least {count} goals [x, y, heading], as many as there are parts"
                raise checks.refuse(where, f"{len(goals)} goals", allowed)
        poses = [np.array(goals, dtype=np.float64) for _, goals in lists]
        if isinstance(pattern, Mapping):
            return np.concatenate(poses), np.repeat(np.arange(len(poses)), [len(pose) for pose in poses])
        return poses[0][: len(self._parts)], self._kind.copy()

    def _places(self, place: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray]:
        """Where the lattice's middle may lie."""
        if place is not None:
            self._check(self.pose + [*place, 0.0], f"{self._name}.place", place)
            return np.array(place), np.array(place)
        corners = self._corners(self.pose)
        low, high = -corners.min(axis=0), np.array([self._surface.width, self._surface.depth]) - corners.max(axis=0)
        middle = 0.5 * (low + high)
        low, high = np.minimum(low, middle), np.maximum(high, middle)
        self._check(self.pose + [*middle, 0.0], self._name, None)
        return low, high

    def _bodies(self) -> list[Part]:
        """A part for each goal: any of its kind's."""
        return [self._parts[int(np.flatnonzero(self._kind == kind)[0])] for kind in self.of_kind]

    def _corners(self, pose: np.ndarray) -> np.ndarray:
        """(n, 2) m, corners of the outlines of parts at the goals."""
        cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        turns = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], axis=1)
        outlines = [
            here[:2] + part.outline @ turn.T for part, here, turn in zip(self._bodies(), pose, turns, strict=True)
        ]
        return np.concatenate(outlines)

    def _check(self, pose: np.ndarray, name: str, value: Any) -> None:
        """Refuse goals that stick out of the surface, or overlap."""
        corners, surface = self._corners(pose), self._surface
        size = corners.max(axis=0) - corners.min(axis=0)
        what = f"{len(pose)} goals that take {size[0]:.4g} x {size[1]:.4g} m" if value is None else value
        if (corners < -ROUNDING).any() or (corners > np.array([surface.width, surface.depth]) + ROUNDING).any():
            raise checks.refuse(name, what, f"goals wholly on this surface, {surface.width:g} x {surface.depth:g} m")
        gaps = gaps_between(self._bodies(), pose[None])[0]
        if gaps.min() < -ROUNDING:
            one, other = sorted(int(k) for k in np.unravel_index(int(gaps.argmin()), gaps.shape))
            raise checks.conflict(f"{name}: goals {one} and {other} overlap by {-1e3 * gaps.min():.3g} mm")
