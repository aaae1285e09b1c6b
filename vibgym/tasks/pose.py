"""Tasks that ask one part to reach a pose: the common core of Transport, Align and Rotate.

A task draws start and goal from uniform numbers (so that a batch of worlds is drawn at once, whichever generator each
world has), and scores every step in one compiled pass over the worlds.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.core.jit import jit
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import Start, Task

HOLD_STEPS = 10
"""Steps in a row within tolerance that make success."""

TERMS = ("distance", "approach", "turn", "alignment", "inside", "time", "success", "fallen")
"""Reward terms in order. Each is bounded by 1 in magnitude, but for success (5) and fallen (-5)."""

DISTANCE_SCALE = 0.1  # m of progress that earn the term's full reward
APPROACH_SCALE = 0.010  # m
TURN_SCALE = 1.0  # rad
ALIGNMENT_SCALE = 0.15  # rad
INSIDE_BONUS = 0.1
TIME_COST = 0.02
SUCCESS_REWARD = 5.0


class Rules(NamedTuple):
    """What the scoring kernel knows of the task."""

    position_tolerance: float  # m
    heading_tolerance: float  # rad; infinite where heading does not count
    heading_period: float  # rad; headings that differ by it are the same; 0: headings are not wrapped


class Score(NamedTuple):
    """Progress of every world, changed in place by :func:`score`."""

    error: np.ndarray  # (worlds, 3) goal minus pose: x, y (m), heading (rad)
    distance: np.ndarray  # (worlds,) m
    held: np.ndarray  # (worlds,) int64, steps in a row within tolerance
    success: np.ndarray  # (worlds,) bool
    ended: np.ndarray  # (worlds,) bool: success, fallen or diverged
    terms: np.ndarray  # (worlds, len(TERMS))
    reward: np.ndarray  # (worlds,)


def new_score(worlds: int) -> Score:
    """Arrays for ``worlds`` worlds."""
    return Score(
        error=np.zeros((worlds, 3)),
        distance=np.zeros(worlds),
        held=np.zeros(worlds, dtype=np.int64),
        success=np.zeros(worlds, dtype=bool),
        ended=np.zeros(worlds, dtype=bool),
        terms=np.zeros((worlds, len(TERMS))),
        reward=np.zeros(worlds),
    )


@jit
def heading_difference(rules, difference):
    """Heading error in [-period / 2, period / 2], or as it is for headings that are not wrapped; 0 if it does not count."""
    if not math.isfinite(rules.heading_tolerance):
        return 0.0
    if rules.heading_period > 0.0:
        return difference - rules.heading_period * math.floor(difference / rules.heading_period + 0.5)
    return difference


@jit
def _limited(value):
    return min(max(value, -1.0), 1.0)


@jit
def measure(rules, pose, goal, world, result):
    """Write the errors of one world; start of an episode and first half of :func:`score`."""
    ex, ey = goal[world, 0] - pose[world, 0, 0], goal[world, 1] - pose[world, 0, 1]
    result.error[world, 0], result.error[world, 1] = ex, ey
    result.error[world, 2] = heading_difference(rules, goal[world, 2] - pose[world, 0, 2])
    result.distance[world] = math.sqrt(ex * ex + ey * ey)


@jit
def begin(rules, pose, goal, worlds, result):
    """Start the episodes of ``worlds`` (index array)."""
    for k in range(worlds.shape[0]):
        world = worlds[k]
        measure(rules, pose, goal, world, result)
        result.held[world] = 0
        result.success[world] = False
        result.ended[world] = False
        result.terms[world] = 0.0
        result.reward[world] = 0.0


@jit
def score(rules, pose, goal, fallen, diverged, result):
    """Score one step of every world against the one before: errors, success, reward terms and their sum."""
    for world in range(pose.shape[0]):
        distance_before, turn_before = result.distance[world], abs(result.error[world, 2])
        measure(rules, pose, goal, world, result)
        distance, turn = result.distance[world], abs(result.error[world, 2])
        inside = distance <= rules.position_tolerance and turn <= rules.heading_tolerance
        down = fallen[world, 0]
        result.held[world] = result.held[world] + 1 if inside and not (down or diverged[world]) else 0
        success = result.held[world] >= HOLD_STEPS
        result.success[world] = success
        result.ended[world] = success or down or diverged[world]
        terms = result.terms[world]
        terms[0] = _limited((distance_before - distance) / DISTANCE_SCALE)
        terms[1] = math.tanh(distance_before / APPROACH_SCALE) - math.tanh(distance / APPROACH_SCALE)
        terms[2] = _limited((turn_before - turn) / TURN_SCALE)
        terms[3] = math.tanh(turn_before / ALIGNMENT_SCALE) - math.tanh(turn / ALIGNMENT_SCALE)
        terms[4] = INSIDE_BONUS if inside else 0.0
        terms[5] = -TIME_COST
        terms[6] = SUCCESS_REWARD if success else 0.0
        terms[7] = -SUCCESS_REWARD if down else 0.0
        total = 0.0
        for k in range(terms.shape[0]):
            total += terms[k]
        result.reward[world] = total


class PoseTask(Task):
    """One part and a goal pose. Subclasses set tolerances and draw start and goal.

    Args:
        surface: the table.
        part: the part to move.

    Raises:
        ValueError: the part is too large to start on the surface without overhang.
    """

    position_tolerance: ClassVar[float]  # m
    heading_tolerance: ClassVar[float] = math.inf  # rad
    draws: ClassVar[int]
    TERMS = TERMS

    FALL_REWARD: ClassVar[float] = -50.0
    """Goal reward of the step that ends on the floor: worse than a discounted episode (0.98) of steps outside."""

    def __init__(self, surface: Surface, part: Part) -> None:
        self.surface = surface
        self.part = part
        self.parts = (part,)
        room = min(surface.width, surface.height) / 2
        if part.radius > room:
            raise checks.refuse(
                "parts",
                f"{part.name!r} with radius {part.radius:g} m",
                f"a radius of at most {room:g} m on this surface",
            )
        self.rules = Rules(self.position_tolerance, self.heading_tolerance, self.heading_period())

    @classmethod
    def build(cls, surface: Surface, parts: Sequence[Part], settings: Mapping[str, Any]) -> PoseTask:
        return cls(surface, parts[0])

    @property
    def has_heading(self) -> bool:
        """Whether the heading counts."""
        return math.isfinite(self.heading_tolerance)

    def heading_period(self) -> float:
        """Turn that leaves the goal the same, rad; 0 where headings are not wrapped."""
        return 2.0 * math.pi

    @abstractmethod
    def draw(self, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Start and goal poses, each (n, 3), from ``uniform`` (n, draws) in [0, 1)."""

    def start(self, uniform: np.ndarray) -> Start:
        pose, goal = self.draw(uniform)
        return Start(pose[:, None, :], np.ones((len(pose), 1), dtype=bool), goal)

    def new_score(self, worlds: int) -> Score:
        return new_score(worlds)

    def begin(self, state: State, start: Start, goal: np.ndarray, worlds: np.ndarray, result: Score) -> None:
        begin(self.rules, state.pose, goal, worlds, result)

    def score(self, state: State, goal: np.ndarray, result: Score) -> None:
        score(self.rules, state.pose, goal, state.fallen, state.diverged, result)

    def facts(self, state: State, result: Score) -> dict[str, np.ndarray]:
        facts = {"is_success": result.success, "position_error": result.distance}
        if self.has_heading:
            facts["heading_error"] = np.abs(result.error[:, 2])
        return {**facts, "fallen": state.fallen[:, 0], "diverged": state.diverged}

    def caption(self, result: Score, world: int) -> str:
        text = f"{type(self).__name__}   distance {1e3 * result.distance[world]:.1f} mm"
        if self.has_heading:
            text += f"   heading {np.degrees(result.error[world, 2]):+.1f} deg to go"
        return text

    def somewhere(self, uniform: np.ndarray) -> np.ndarray:
        """Positions (n, 2) at which the part lies wholly on the surface, from ``uniform`` (n, 2)."""
        margin = self.part.radius
        room = np.array([self.surface.width - 2.0 * margin, self.surface.height - 2.0 * margin])
        return margin + room * uniform

    def goal_size(self) -> int:
        """Length of achieved and desired goals: position, and heading where it counts."""
        return 3 if self.has_heading else 2

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """Goal reward: 0 within tolerance, -1 outside, :attr:`FALL_REWARD` where ``info`` says the part has fallen.

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
        outside = np.hypot(difference[..., 0], difference[..., 1]) > self.position_tolerance
        if self.has_heading:
            turn = difference[..., 2]
            period = self.rules.heading_period
            if period > 0.0:
                turn = turn - period * np.floor(turn / period + 0.5)
            outside = outside | (np.abs(turn) > self.heading_tolerance)
        fallen = np.broadcast_to(_fallen(info), outside.shape)
        return np.where(fallen, self.FALL_REWARD, -outside.astype(np.float64))


def _fallen(info: Any) -> np.ndarray:
    if isinstance(info, dict):
        return np.asarray(info.get("fallen", False), dtype=bool)
    if info is None or len(info) == 0:
        return np.asarray(False)
    return np.array([bool(each.get("fallen", False)) for each in info])
