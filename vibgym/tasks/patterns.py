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

from vibgym import checks
from vibgym.scene.hulls import gaps_between
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.assignment import give_out
from vibgym.tasks.base import kinds_by_name, setting_in_si

GAP = 0.002
"""m between the parts of a lattice, unless it says another."""

ROUNDING = 1e-9  # m, by which a pattern may stick out, or overlap: its places are sums and products


class Pattern:
    """Goal poses for the parts of an episode.

    Args:
        surface, parts: the scene.
        name: of the argument whose settings these are, for errors.
        pattern: poses [x, y, heading], m and rad, in place of a lattice: a list with one for each part; or a mapping from kind
            to a list with at least one for each of its parts.
        rows, columns: of the lattice, across and along the table. By default as many rows as the square root of the number of
            parts, rounded down, or what there is room for; and as many columns as these need.
        gap: m between neighbours; ``gap_mm`` in mm.
        heading: rad, of the lattice and of each part in it; ``heading_deg`` in degrees.
        place: [x, y] of the lattice's middle, m; ``place_mm`` in mm; None: drawn wherever the lattice lies on the surface.

    Attributes:
        pose: (goals, 3) m, m, rad, about the place.
        of_kind: (goals,) int64, the kind whose parts may have each goal.
        low, high: (2,) m, where the place may lie.
        gap: m, least distance between goals; None of a single one.
        draws: uniform numbers for an episode.
        shuffles: whether any part fits into any place: in a lattice.

    Raises:
        ValueError: a bad setting; a pattern that does not fit on the surface or overlaps; fewer goals than parts.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        name: str = "task_settings",
        *,
        pattern: Any = None,
        rows: int | None = None,
        columns: int | None = None,
        gap: float | None = None,
        gap_mm: float | None = None,
        heading: float | None = None,
        heading_deg: float | None = None,
        place: Any = None,
        place_mm: Any = None,
    ) -> None:
        self._name, self._surface, self._parts = name, surface, tuple(parts)
        self._kinds, self._kind = kinds_by_name(parts)
        # How many parts of the same kind stand before each part: it has the goal of that number among its kind's.
        self._rank = np.array([(self._kind[:k] == kind).sum() for k, kind in enumerate(self._kind)])
        distance = setting_in_si(name, "gap", gap, gap_mm, default=GAP, least=0.0)
        turn = setting_in_si(name, "heading", heading, heading_deg, unit="_deg")
        if pattern is not None:
            others = {"rows": rows, "columns": columns, "gap": gap, "gap_mm": gap_mm, "heading": heading,
                      "heading_deg": heading_deg, "place": place, "place_mm": place_mm}  # fmt: skip
            for key, value in others.items():
                if value is not None:
                    raise checks.conflict(f"{name}: {key!r} and 'pattern' exclude each other")
            self.pose, self.of_kind = self._given(pattern)
            self.low = self.high = np.zeros(2)
            self._check(self.pose, f"{name}['pattern']", pattern)
        else:
            self.pose, self.of_kind = self._lattice(rows, columns, distance, turn)
            self.low, self.high = self._places(place, place_mm)
        gap = float(gaps_between(self._bodies(), self.pose[None]).min())
        self.gap = gap if math.isfinite(gap) else None
        self.shuffles = pattern is None
        self.drawn = pattern is None and place is None and place_mm is None
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

    def free(self, goals: np.ndarray, present: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Goals (n, parts, 3), given out within each kind: as many as there are parts, the first ones, so that none stays open.

        Args:
            goals: (n, goals, 3).  present: (n, parts) bool.  pose: (n, parts, 3) of the parts.
        """
        result = np.zeros_like(pose)
        for kind in range(len(self._kinds)):
            own, places = self._kind == kind, np.flatnonzero(self.of_kind == kind)
            number = np.cumsum(present & own, axis=1) - 1  # of each present part among those of its kind
            taken = goals[np.arange(len(pose))[:, None], places[np.clip(number, 0, len(places) - 1)]]
            result = np.where((present & own)[..., None], taken, result)
        return self.again(result, present, pose)

    def again(self, goal: np.ndarray, present: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """The goals (n, parts, 3) that parts have, given out anew within each kind for other ``pose`` (n, parts, 3)."""
        result = np.array(goal)
        give_out(self._kind, present, np.ascontiguousarray(pose), result)
        return result

    def _lattice(self, rows: Any, columns: Any, gap: float, heading: float) -> tuple[np.ndarray, np.ndarray]:
        """Poses about the lattice's middle, and their kinds."""
        parts, name = self._parts, self._name
        size = np.max([2.0 * np.abs(part.outline).max(axis=0) for part in parts], axis=0)
        pitch = size + gap
        if rows is None and columns is not None:
            rows = -(-len(parts) // checks.count(f"{name}['columns']", columns, most=10_000))
        if rows is None:
            reach = abs(math.sin(heading)) * self._surface.width + abs(math.cos(heading)) * self._surface.depth
            room = math.floor((reach + gap + ROUNDING) / pitch[1])
            rows = max(min(math.isqrt(len(parts)), room), 1)
        rows = checks.count(f"{name}['rows']", rows, most=10_000)
        columns = -(-len(parts) // rows) if columns is None else columns
        columns = checks.count(f"{name}['columns']", columns, most=10_000)
        if rows * columns < len(parts):
            raise checks.refuse(
                f"{name}['columns']", columns, f"at least {-(-len(parts) // rows)}: {len(parts)} parts in {rows} rows"
            )
        index = np.arange(len(parts))
        at = np.column_stack([index // rows, index % rows]) * pitch
        at -= 0.5 * (at.min(axis=0) + at.max(axis=0))
        cosine, sine = math.cos(heading), math.sin(heading)
        turned = at @ np.array([[cosine, sine], [-sine, cosine]])
        return np.column_stack([turned, np.full(len(parts), heading)]), np.sort(self._kind)

    def _given(self, pattern: Any) -> tuple[np.ndarray, np.ndarray]:
        """Poses that are given, and their kinds."""
        name = f"{self._name}['pattern']"
        if isinstance(pattern, Mapping):
            for kind in pattern:
                if kind not in self._kinds:
                    raise checks.unknown(f"kind in {name}", kind, self._kinds)
            lists = [(f"{name}[{kind!r}]", pattern.get(kind, [])) for kind in self._kinds]
            needed = [int((self._kind == k).sum()) for k in range(len(self._kinds))]
        elif checks.listed(pattern):
            lists, needed = [(name, pattern)], [len(self._parts)]
        else:
            raise checks.refuse(name, pattern, "a list of poses [x, y, heading], or a mapping from kind to such lists")
        poses = []
        for (where, given), count in zip(lists, needed, strict=True):
            if not checks.listed(given) or len(given) < count:
                got = f"{len(given)} goals" if checks.listed(given) else given
                raise checks.refuse(where, got, f"at least {count} goals [x, y, heading], as many as there are parts")
            poses.append(np.array(checks.array(where, given, (len(given), 3))))
        if isinstance(pattern, Mapping):
            return np.concatenate(poses), np.repeat(np.arange(len(poses)), [len(each) for each in poses])
        return poses[0][: len(self._parts)], self._kind.copy()

    def _places(self, place: Any, place_mm: Any) -> tuple[np.ndarray, np.ndarray]:
        """Where the lattice's middle may lie."""
        name = self._name
        if place is not None and place_mm is not None:
            raise checks.conflict(f"{name}: 'place' and 'place_mm' exclude each other")
        if place is not None or place_mm is not None:
            key, value, unit = ("place", place, 1.0) if place_mm is None else ("place_mm", place_mm, 1e-3)
            middle = unit * np.array(checks.array(f"{name}[{key!r}]", value, (2,)))
            self._check(self.pose + [*middle, 0.0], f"{name}[{key!r}]", value)
            return middle, middle
        corners = self._corners(self.pose)
        low, high = -corners.min(axis=0), np.array([self._surface.width, self._surface.depth]) - corners.max(axis=0)
        middle = 0.5 * (low + high)
        if (low > high + ROUNDING).any():
            self._check(self.pose + [*middle, 0.0], self._name, None)
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
