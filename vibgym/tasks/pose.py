"""Transport, Align and Rotate: bring one part to a goal pose."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import Task
from vibgym.tasks.episode import Start, wrapped

PATIENT_TERMS = {
    "distance": ("distance", 1.0),
    "approach": ("approach", 1.0),
    "turn": ("turn", 1.0),
    "alignment": ("alignment", 1.0),
    "within": ("within", 0.003),  # a part in its place loses no time
    "time": ("time", 0.003),  # costs less over an episode than a fall, so that falling does not pay
    "success": ("success", 5.0),
    "fallen": ("fallen", 5.0),
}
"""Terms of the reward of tasks with a goal pose for each of several parts."""


class PoseTask(Task):
    """One part with a goal pose. Subclasses set tolerances and draw start and goal from uniform numbers.

    Raises:
        ValueError: the part is too large to start on the surface without overhang.
    """

    class Settings(Task.Settings):
        """Settings of tasks with one part."""

        slots: ClassVar[None] = None

    settings: Settings

    MAX_PARTS = 1
    TERMS = {
        "distance": ("distance", 1.0),
        "approach": ("approach", 1.0),
        "turn": ("turn", 1.0),
        "alignment": ("alignment", 1.0),
        "inside": ("within", 0.1),
        "time": ("time", 0.02),
        "success": ("success", 5.0),
        "fallen": ("fallen", 5.0),
    }
    FEATURES = (
        "element", "heading", "position", "way", "way_coarse", "way_fine", "turn", "turn_coarse", "turn_fine",
        "velocity", "spin",
    )  # fmt: skip
    HAS_WALLS = False
    has_goal = True

    FALL_REWARD: ClassVar[float] = -50.0
    """Goal reward of a fall: worse than a discounted episode (0.98) of steps outside the tolerances."""

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        self._margin = self.parts[0].radius
        self._room = np.array([surface.width - 2.0 * self._margin, surface.depth - 2.0 * self._margin])
        room = min(surface.width, surface.depth) / 2
        for part in self.parts:
            if part.radius > room:
                got = f"{part.name!r} with radius {part.radius:g} m"
                raise checks.refuse("parts", got, f"a radius of at most {room:g} m on this surface")

    @abstractmethod
    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return start and goal poses, each (n, 3), from ``uniform`` (n, draws) in [0, 1)."""

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        pose, goal = self.draw(uniform)
        there = np.ones((len(pose), 1), dtype=bool) if present is None else present
        return Start(pose[:, None, :], there, goal[:, None, :])

    def somewhere(self, uniform: np.ndarray) -> np.ndarray:
        """Return positions (n, 2) at which the part lies wholly on the surface, from ``uniform`` (n, 2)."""
        return self._margin + self._room * uniform

    def _anywhere(self, uniform: np.ndarray) -> np.ndarray:
        """Return poses (n, 3) at any position and heading at which the part lies wholly on the surface, from (n, 3)."""
        pose = np.empty((len(uniform), 3))
        pose[:, :2], pose[:, 2] = self.somewhere(uniform[:, :2]), 2.0 * math.pi * uniform[:, 2] - math.pi
        return pose

    def goal_size(self) -> int:
        """Return the length of achieved and desired goals: position, and heading where it counts."""
        return 3 if self.has_heading else 2

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """Return the goal reward: 0 within tolerance, -1 outside, :attr:`FALL_REWARD` where ``info["fallen"]`` is true.

        Args:
            achieved_goal, desired_goal: (..., goal_size) x, y (m) and, where it counts, heading (rad).
            info: a mapping, a sequence of mappings (one a row), or None.

        Returns:
            float64 array of the leading shape.
        """
        size = self.goal_size()
        achieved, desired = np.asarray(achieved_goal, dtype=np.float64), np.asarray(desired_goal, dtype=np.float64)
        for name, value in (("achieved_goal", achieved), ("desired_goal", desired)):
            if value.ndim == 0 or value.shape[-1] != size:
                raise checks.refuse(name, f"array of shape {value.shape}", f"shape (..., {size})")
        difference = desired - achieved
        outside = np.empty(difference.shape[:-1], dtype=bool)
        periods, rows = self._heading_periods(), difference.size // size
        if len(periods) not in (1, rows):
            raise checks.conflict("compute_reward requires a goal for each world where shapes are drawn")
        tolerances = (self.position_tolerance, self.heading_tolerance, periods)
        misses_goal(np.ascontiguousarray(difference.reshape(-1, size)), *tolerances, outside.reshape(-1))
        fallen = np.broadcast_to(_fallen(info), outside.shape)
        return np.where(fallen, self.FALL_REWARD, -outside.astype(np.float64))

    def _heading_periods(self) -> np.ndarray:
        """Return the heading periods of the worlds, (n,); one where all are the same."""
        kinds = self.part_kinds
        periods = np.array([self.heading_period(kind) for kind in kinds.every])[kinds.kind[:, 0]]
        return periods[:1] if (periods == periods[0]).all() else periods


@jit
def misses_goal(difference, position_tolerance, heading_tolerance, heading_period, result):
    """Compute whether poses miss their goals.

    Args:
        difference: (n, 2) goal minus pose, m, or (n, 3) with the heading, rad.
        heading_period: (n,) or (1,) rad, see :class:`Rules`.
        result: (n,) bool, overwritten.
    """
    for k in range(difference.shape[0]):
        away = math.sqrt(difference[k, 0] * difference[k, 0] + difference[k, 1] * difference[k, 1])
        period = heading_period[min(k, heading_period.shape[0] - 1)]
        turned = abs(wrapped(difference[k, 2], period)) if difference.shape[1] > 2 else 0.0
        result[k] = away > position_tolerance or turned > heading_tolerance


def _fallen(info: Any) -> np.ndarray:
    if isinstance(info, dict):
        return np.asarray(info.get("fallen", False), dtype=bool)
    if info is None or len(info) == 0:
        return np.asarray(False)
    return np.array([bool(entry.get("fallen", False)) for entry in info])


class Transport(PoseTask):
    """The centre within 5 mm of a goal position anywhere on the surface; the heading is free."""

    position_tolerance = 0.005
    draws = 5

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start = self._anywhere(uniform[:, 0:3])
        return start, np.column_stack([self.somewhere(uniform[:, 3:5]), start[:, 2]])


class Align(PoseTask):
    """The centre within 2 mm and the heading within 3 degrees of a goal pose anywhere on the surface.

    Headings count modulo the part's symmetry (180 degrees for a rectangle).
    """

    position_tolerance = 0.002
    heading_tolerance = math.radians(3.0)
    modulo_symmetry = True
    draws = 6

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._anywhere(uniform[:, [0, 1, 4]]), self._anywhere(uniform[:, [2, 3, 5]])


class Rotate(PoseTask):
    """Turn by a signed angle up to a full turn, ending within 5 mm of the start and 2 degrees of the unwrapped angle."""

    position_tolerance = 0.005
    heading_tolerance = math.radians(2.0)
    draws = 4

    def heading_period(self, part: Part) -> float:
        return 0.0  # a full turn is not the same as none

    def goal_from(self, start: Start, pose: np.ndarray) -> np.ndarray:
        return start.goal + (pose - start.pose)  # in place, wherever that is

    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start = self._anywhere(uniform[:, 0:3])
        goal = start.copy()
        goal[:, 2] += 4.0 * math.pi * uniform[:, 3] - 2.0 * math.pi
        return start, goal
