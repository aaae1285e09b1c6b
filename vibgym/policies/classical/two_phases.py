"""Two phases for patterns too tight to be entered one by one: the planner to the pattern drawn apart, then all close in.

The pattern is drawn apart along the table and across it, each as far as there is room and no farther than it takes to let a
part pass (:func:`drawn_apart`). From there everybody goes straight to its goal at once: the distances shrink together, and
nobody is in the way of anybody. That begins before everybody is there: as soon as straight ways from where the parts are lead
past one another (:func:`may_close`), which is asked every step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, checks
from vibgym._numba.jit import borrowing, jit
from vibgym.physics.collision.hulls import part_gap, place_hulls
from vibgym.policies.classical import planner
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.classical.motion_choice import INSTANTS, INTERVAL, set_velocity
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.task_info import TaskInfo
from vibgym.scene import Surface
from vibgym.simulation import threads as workers

SCALES = 25
"""Stretches along each axis that are tried."""

EDGE = 0.001
"""m that parts keep from the border in the pattern drawn apart."""

SUBSTEPS = 5
"""Of an interval between two instants of a prediction."""

SPIN = 4.0
"""rad/s, by which parts are expected to turn at least."""


class Memory(NamedTuple):
    """What is handed on from step to step."""

    plan: planner.Memory
    apart: np.ndarray  # (batch, parts, 2) m, places of the pattern drawn apart, minus goals
    goals: np.ndarray  # (batch, parts, parts) m, distances at the goals
    closing: np.ndarray  # (batch,) bool, in the second phase
    stuck: np.ndarray  # (batch,) s in the second phase in which nobody has moved, with somebody off


@dataclass(frozen=True)
class Closing:
    """How far the pattern is drawn apart, and when all close in.

    Raises:
        ValueError: a bad value.
    """

    apart: float = 0.020  # m between parts in the pattern drawn apart, where there is room
    margin: float = 0.004  # m between parts on their straight ways, where their goals have room
    give_up: float = (
        1.0  # s of standstill in the second phase, with a part off its goal, after which the first begins anew
    )

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, checks.number(each.name, getattr(self, each.name), above=0.0))


class TwoPhasesPolicy(PlannerPolicy):
    """The planner to the pattern drawn apart, then straight to the goals; see the module.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Closing`; and of :class:`.planner.PlannerPolicy`, whose ``law`` is ``"pose"`` here.

    Raises:
        ValueError: a task without goal poses that stay, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        own = {each.name: settings.pop(each.name) for each in fields(Closing) if each.name in settings}
        super().__init__(info, **{"law": "pose", "edge": 0.018, **settings})
        if not info.has_goal or info.goal_moves:
            allowed = "tasks whose parts have goal poses that stay, such as Pack"
            raise checks.refuse("policy 'two_phases'", f"the task {info.name}", allowed)
        self.settings = Closing(**own)

    def initial(self, batch: int) -> Any:
        """Memory at the very start, before anything has been seen."""
        parts = len(self.info.parts)
        apart, goals = np.zeros((batch, parts, 2)), np.full((batch, parts, parts), np.inf)
        return Memory(super().initial(batch), apart, goals, np.zeros(batch, dtype=bool), np.zeros(batch))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is a :class:`Memory`."""
        measured = Measured.of(observation, self.info)
        memory, new = recall(state, episode_start, self.initial(1), len(measured.centre))
        plan = memory.plan
        measured = self.expected(measured, plan.steering)
        goal = measured.centre + measured.way
        for world in np.flatnonzero(new):
            self.begin_world(world, measured, goal, memory)
        self.switch(measured, goal, memory)
        closing = memory.closing[:, None, None]
        plan = plan._replace(target=np.where(closing, goal, goal + memory.apart))
        velocity, waited = self.choose(measured, plan)
        way = np.where(closing, measured.way, self.lead * velocity)
        action, steered = self.steer(measured, way, plan.steering)
        return action, memory._replace(plan=plan._replace(waited=waited, steering=steered))

    def begin_world(self, world: int, measured: Measured, goal: np.ndarray, memory: Memory) -> None:
        """Draw the pattern of a world apart, whose episode has just begun."""
        there = np.flatnonzero(measured.present[world])
        heading = measured.heading[world] + measured.turn[world]
        parts = [self.info.parts[k] for k in there]
        place = drawn_apart(self.info.surface, parts, goal[world, there], heading[there], self.settings.apart)
        memory.apart[world] = 0.0
        memory.apart[world, there] = place - goal[world, there]
        one = slice(world, world + 1)
        memory.goals[one] = self.distances(goal[one], heading[None], measured.present[one])
        memory.plan.room[one] = self.distances(goal[one] + memory.apart[one], heading[None], measured.present[one])
        memory.closing[world], memory.stuck[world] = False, 0.0

    def switch(self, measured: Measured, goal: np.ndarray, memory: Memory) -> None:
        """Begin the second phase where straight ways lead to the goals, and end it where nobody gets on; in place."""
        rules = self.settings
        waiting = np.flatnonzero(~memory.closing)
        free = np.zeros(len(goal), dtype=bool)
        scene = self.scene(measured, goal, memory.goals, memory.plan.waited)

        def ask(start: int, stop: int) -> None:
            may_close(waiting[start:stop], self.preferences, self.hulls, scene, measured.heading, measured.turn,
                      memory.goals, rules.margin, free)  # fmt: skip

        workers.share(ask, len(waiting), self.threads)
        memory.closing[free] = True

    def acted(self, memory: Any, said: np.ndarray, done: np.ndarray) -> Any:
        """See :meth:`vibgym.policies.classical.steering.Steering.acted`."""
        return memory._replace(plan=super().acted(memory.plan, said, done))


def drawn_apart(
    surface: Surface, parts: Sequence[Part], goal: np.ndarray, heading: np.ndarray, apart: float
) -> np.ndarray:
    """Places (parts, 2) m of a pattern that is stretched along and across the table, and moved to where it fits.

    Of all stretches that leave the parts ``apart`` it is the one with the shortest way back; where none does, the one that
    leaves them farthest apart. Distances are those of the rectangles along the table that hold the parts.

    Args:
        surface: the table.
        parts: those that are there.
        goal: (parts, 2) m.
        heading: (parts,) rad, at the goals.
        apart: m.
    """
    if len(parts) < 2:
        return goal.copy()
    half = np.array([_half(part, angle) for part, angle in zip(parts, heading, strict=True)])
    size, low = np.array([surface.width, surface.depth]), goal.min(axis=0)
    one, other = np.triu_indices(len(goal), 1)
    between, both = np.abs(goal[one] - goal[other]), half[one] + half[other]
    gaps, scales = [], []
    for axis in range(2):
        span = np.ptp(goal[:, axis])
        room = size[axis] - 2.0 * (half[:, axis].max() + EDGE)
        # No farther than it takes to bring neighbours so far apart.
        near = between[:, axis][between[:, axis] > 1e-4]
        enough = (both[:, axis].max() + apart) / near.min() if len(near) else 1.0
        most = max(min(room / max(span, 1e-9), enough), 1.0)
        scales.append(np.linspace(1.0, most, SCALES))
        gaps.append(scales[-1][:, None] * between[:, axis] - both[:, axis])
    distance = np.maximum(gaps[0][:, None], gaps[1][None]).min(axis=2)  # (along, across)
    middle = low + 0.5 * np.ptp(goal, axis=0)
    away = np.hypot(
        *np.meshgrid(*((scale - 1.0) * np.ptp(goal[:, k]) for k, scale in enumerate(scales)), indexing="ij")
    )
    good = distance >= min(apart, distance.max()) - 1e-9
    i, j = np.unravel_index(int(np.where(good, away, np.inf).argmin()), away.shape)
    place = middle + np.array([scales[0][i], scales[1][j]]) * (goal - middle)
    short = np.maximum(half + EDGE - place, 0.0).max(axis=0) - np.maximum(place - (size - half - EDGE), 0.0).max(axis=0)
    return place + short


def _half(part: Part, heading: float) -> np.ndarray:
    """(2,) m, how far a part reaches along and across the table."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.abs(part.outline @ np.array([[cosine, sine], [-sine, cosine]])).max(axis=0)


@jit
def may_close(worlds, wants, hulls, scene, heading, turn, goals, margin, free):
    """Whether all parts of ``worlds`` (n,) may go straight to their goals at once.

    Args:
        wants, hulls: see :mod:`.motion_choice`.
        scene: whose targets are the goals.
        heading, turn: (worlds, parts) rad, now and still to go.
        goals: (worlds, parts, parts) m, distances at the goals.
        margin: m that they keep on the way, or half of what they have at the goals.
        free: (worlds,) bool, overwritten for these.
    """
    parts = heading.shape[1]
    paths, placed = np.empty((parts, INSTANTS, 2)), np.empty_like(hulls.corner)
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for p in range(parts):
            if scene.present[w, p]:
                go_straight(wants, scene.centre[w, p], scene.velocity[w, p], scene.target[w, p], paths[p])
        free[w] = True
        for t in range(INSTANTS):
            for p in range(parts):
                if scene.present[w, p]:
                    left = max(abs(turn[w, p]) - SPIN * INTERVAL * (t + 1), 0.0)
                    angle = heading[w, p] + np.sign(turn[w, p]) * (abs(turn[w, p]) - left)
                    place_hulls(hulls, p, paths[p, t, 0], paths[p, t, 1], angle, placed)
            if not clear(hulls, placed, scene.present[w], paths, t, goals[w], margin):
                free[w] = False
                break


@borrowing
def go_straight(wants, centre, velocity, target, path):
    """Places (INSTANTS, 2) m of a part that goes straight to its target, overwritten; in steps that the law's gain allows."""
    x, y, vx, vy = centre[0], centre[1], velocity[0], velocity[1]
    step = INTERVAL / SUBSTEPS
    for k in range(INSTANTS):
        for _ in range(SUBSTEPS):
            wx, wy = set_velocity(wants, 0, 0.0, x, y, target[0], target[1])
            ax, ay = wx - vx, wy - vy
            share = min(wants.acceleration * step / max(math.sqrt(ax * ax + ay * ay), 1e-12), 1.0)
            x, y = x + step * (vx + 0.5 * share * ax), y + step * (vy + 0.5 * share * ay)
            vx, vy = vx + share * ax, vy + share * ay
        path[k, 0], path[k, 1] = x, y


@borrowing
def clear(hulls, placed, present, paths, t, goals, margin):
    """Whether all parts of a world keep their distance at an instant; they are placed."""
    for p in range(paths.shape[0]):
        if not present[p]:
            continue
        for q in range(p):
            if not present[q]:
                continue
            least = min(margin, 0.5 * goals[p, q])
            dx, dy = paths[p, t, 0] - paths[q, t, 0], paths[p, t, 1] - paths[q, t, 1]
            far = hulls.radius[p] + hulls.radius[q] + least
            if dx * dx + dy * dy < far * far and part_gap(hulls, placed, p, q) < least:
                return False
    return True
