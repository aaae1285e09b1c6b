"""Two phases for patterns too tight to be entered one by one: the planner to the pattern drawn apart, then all close in.

The pattern is drawn apart along the table and across it, each as far as there is room and no farther than it takes to let a
part pass (:func:`drawn_apart`). One that fills the table's width is also slanted, so that parts in a column, which cannot be
drawn apart, lie beside gaps. From there all parts go straight to their goals at once: the distances shrink together, and no
part obstructs another. The second phase begins before all parts are in place: as soon as the straight paths from the present
positions are free of collisions (:func:`may_close`), checked every step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field

from vibgym import Part, Surface
from vibgym.kernels.jit import exact, jit
from vibgym.physics.contacts.hulls import part_gap, place_hulls
from vibgym.policies.classical import planner
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.motion_choice import INSTANTS, INTERVAL, set_velocity
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.steering import LawChoice, SteeringMemory
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import Length
from vibgym.simulation import threads as workers

SCALES = 25  # candidate stretches along each axis
EDGE = 0.001  # m, distance of parts from the border in the pattern drawn apart
SLANTS = 13  # candidate slants of patterns that fill the table's width, and stretches across it
NARROW = 0.010  # m between parts, below which a pattern is slanted as well


def drawn_apart(
    surface: Surface, parts: Sequence[Part], goal: np.ndarray, heading: np.ndarray, apart: float
) -> np.ndarray:
    """Return places (parts, 2) m of the pattern stretched along and across the table, and moved to where it fits.

    Of all stretches with distances ``apart`` it is the one with the shortest way back; without any, the one with the largest
    distance. Where that is less than :data:`NARROW`, slanted patterns are tried as well. Distances are those of the parts'
    bounding rectangles.

    Args:
        surface: the table.
        parts: the present ones.
        goal: (parts, 2) m.
        heading: (parts,) rad, at the goals.
        apart: m.
    """
    if len(parts) < 2:
        return goal.copy()
    half = np.array([_half(part, angle) for part, angle in zip(parts, heading, strict=True)])
    size, span = np.array([surface.width, surface.depth]), np.ptp(goal, axis=0)
    room = size - 2.0 * (half.max(axis=0) + EDGE)
    offset = goal - (goal.min(axis=0) + 0.5 * span)
    one, other = np.triu_indices(len(goal), 1)
    between, both = offset[one] - offset[other], half[one] + half[other]
    enough = [_enough(between[:, axis], both[:, axis].max() + apart) for axis in range(2)]
    most = np.maximum(np.minimum(room / np.maximum(span, 1e-9), enough), 1.0)
    stretch = np.array(np.meshgrid(*(np.linspace(1.0, largest, SCALES) for largest in most), [0.0], indexing="ij"))
    best, distance = _best(stretch.reshape(3, -1), between, both, span, room, apart)
    if distance < min(apart, NARROW):
        steepest = (both[:, 0].max() + apart) / max(
            np.abs(between[:, 1][np.abs(between[:, 1]) > 1e-4]).min(initial=math.inf), 1e-9
        )
        slants = np.linspace(0.0, steepest, SLANTS)
        long = np.linspace(1.0, max(min(room[0] / max(span[0], 1e-9), 2.0 * enough[0]), 1.0), SCALES)
        stretch = np.array(np.meshgrid(long, np.linspace(1.0, most[1], SLANTS), slants, indexing="ij"))
        best, distance = _best(stretch.reshape(3, -1), between, both, span, room, apart)
    place = goal - offset + np.column_stack([best[0] * offset[:, 0] + best[2] * offset[:, 1], best[1] * offset[:, 1]])
    short = np.maximum(half + EDGE - place, 0.0).max(axis=0) - np.maximum(place - (size - half - EDGE), 0.0).max(axis=0)
    return place + short


def _enough(between: np.ndarray, apart: float) -> float:
    """Return the stretch that brings the centres of the nearest neighbours along an axis ``apart`` (m)."""
    away = np.abs(between)
    near = away[away > 1e-4].min(initial=math.inf)
    return apart / near if near < math.inf else 1.0


def _best(
    stretch: np.ndarray, between: np.ndarray, both: np.ndarray, span: np.ndarray, room: np.ndarray, apart: float
) -> tuple[np.ndarray, float]:
    """Return the best of stretches (3, n), along, across and slant (shift along over position across), and its distance."""
    distance = np.full(stretch.shape[1], -math.inf)
    k = choose_stretch(stretch, between, both, span, room, apart, distance)
    return stretch[:, k], float(distance[k])


@exact
def choose_stretch(stretch, between, both, span, room, apart, distance):
    """Return the index of the best stretch; the arguments are those of :func:`_best`.

    Args:
        distance: (n,) m, of the stretches; overwritten, but not of those that are too wide or certainly not the best.
    """
    most = -math.inf
    for k in range(stretch.shape[1]):
        along, across, slant = stretch[0, k], stretch[1, k], stretch[2, k]
        if k > 0 and along * span[0] + slant * span[1] > room[0] + 1e-9:  # the first leaves the pattern unchanged
            continue
        least = math.inf
        for pair in range(len(between)):
            x, y = between[pair, 0], between[pair, 1]
            beside = abs(along * x + slant * y) - both[pair, 0]
            least = min(least, max(beside, across * abs(y) - both[pair, 1]))
            if least < min(apart, most) - 1e-9:
                break
        else:
            distance[k] = least
            most = max(most, least)
    best, nearest = 0, math.inf
    for k in range(stretch.shape[1]):
        if distance[k] >= min(apart, most) - 1e-9:
            away = math.hypot(
                (stretch[0, k] - 1.0) * span[0] + stretch[2, k] * span[1], (stretch[1, k] - 1.0) * span[1]
            )
            if away < nearest:
                best, nearest = k, away
    return best


def _half(part: Part, heading: float) -> np.ndarray:
    """Return half of the extents (2,) m along and across the table of a part with ``heading`` (rad)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.abs(part.outline @ np.array([[cosine, sine], [-sine, cosine]])).max(axis=0)


SUBSTEPS = 5  # integration steps between two instants of a prediction
TURN = math.radians(30.0)  # heading error below which parts that close in turn at once, since that takes up least room
THERE = 0.002  # m from its place in the pattern drawn apart, within which a part has arrived
EXCHANGED = 0.005  # m, displacement of a goal in a step, above which parts have exchanged theirs
SPIN = 4.0  # rad/s, lower limit of the predicted spin


class Phase(NamedTuple):
    """The own memory of :class:`TwoPhasesPolicy`."""

    plan: planner.TargetPlan
    goal: np.ndarray  # (batch, parts, 2) m
    apart: np.ndarray  # (batch, parts, 2) m, places of the pattern drawn apart minus goals
    goals: np.ndarray  # (batch, parts, parts) m, distances at the goals
    closing: np.ndarray  # (batch,) bool, in the second phase
    stuck: np.ndarray  # (batch,) s in the second phase without motion, with parts off their goals


class TwoPhasesPolicy(PlannerPolicy):
    """The planner to the pattern drawn apart, then straight to the goals; see the module.

    Raises:
        ValueError: a task without fixed goal poses, or a bad setting of the law.
    """

    class Settings(PlannerPolicy.Settings):
        """How far the pattern is drawn apart, when all parts close in, and the planner's settings."""

        law: LawChoice = "pose"
        edge: Length = Field(default=0.018, gt=0.0)
        soft: float = Field(default=0.5, ge=0.0)
        safe: Length = Field(default=0.004, gt=0.0)

        apart: Length = Field(default=0.036, gt=0.0)
        """Between parts in the pattern drawn apart, where there is room."""

        margin: Length = Field(default=0.004, gt=0.0)
        """Between parts on their straight paths, far from their goals."""

        growth: float = Field(default=0.03, gt=0.0)
        """Of the margin, m per m of remaining displacement, on top of ``share``."""

        share: float = Field(default=0.5, gt=0.0)
        """Of the distance of two goals."""

        give_up: float = Field(default=1.0, gt=0.0)
        """Standstill with a part off its goal after which the first phase starts again, s."""

        doubt: Length = Field(default=0.006, gt=0.0)
        """Overlap on straight paths above which it does as well."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        if not info.has_goal or info.goal_moves:
            raise info.unsupported("two_phases", "a task whose parts have fixed goal poses, such as Pack")

    def initial(self, batch: int) -> SteeringMemory:
        """Return the memory at the start of an episode."""
        parts, memory = len(self.info.parts), super().initial(batch)
        goal, apart = np.zeros((2, batch, parts, 2))
        goals, closing = np.full((batch, parts, parts), np.inf), np.zeros(batch, dtype=bool)
        return memory._replace(own=Phase(memory.own, goal, apart, goals, closing, np.zeros(batch)))

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """See :meth:`.steering.Steering.act`."""
        phase, goal = memory.own, measured.centre + measured.displacement
        moved = measured.present & (np.hypot(*np.moveaxis(goal - phase.goal, -1, 0)) > EXCHANGED)
        for world in np.flatnonzero(new | moved.any(axis=1)).tolist():
            self.begin_world(world, measured, goal, phase)
        phase.goal[...] = goal
        self.switch(measured, goal, phase)
        closing = phase.closing[:, None, None]
        plan = phase.plan._replace(target=np.where(closing, goal, goal + phase.apart))
        # Parts that go straight need no plan.
        planned = replace(measured, present=measured.present & ~phase.closing[:, None])
        velocity, waited = self.choose(planned, plan)
        displacement = np.where(closing, measured.displacement, self.lead * velocity)
        turns = phase.closing[:, None] & (np.abs(measured.heading_error) < TURN)
        phase = phase._replace(plan=plan._replace(waited=waited))
        return self.steer(measured, displacement, memory._replace(own=phase), turns)

    def begin_world(self, world: int, measured: Measured, goal: np.ndarray, phase: Phase) -> None:
        """Draw the pattern of a world apart, at the start of its first phase."""
        there = np.flatnonzero(measured.present[world])
        heading = measured.heading[world] + measured.heading_error[world]
        parts = [self.info.parts[k] for k in there]
        place = drawn_apart(self.info.surface, parts, goal[world, there], heading[there], self.settings.apart)
        phase.apart[world] = 0.0
        phase.apart[world, there] = place - goal[world, there]
        one = slice(world, world + 1)
        phase.goals[one] = self.distances(goal[one], heading[None], measured.present[one])
        phase.plan.room[one] = self.distances(goal[one] + phase.apart[one], heading[None], measured.present[one])
        phase.closing[world], phase.stuck[world] = False, 0.0

    def switch(self, measured: Measured, goal: np.ndarray, phase: Phase) -> None:
        """Start the second phase where straight paths to the goals are free, and the first where they are not; in place."""
        info, rules = self.info, self.settings
        off = (np.hypot(*np.moveaxis(measured.displacement, -1, 0)) > info.position_tolerance) | (
            np.abs(measured.heading_error) > info.heading_tolerance
        )
        moves = np.hypot(*np.moveaxis(measured.velocity, -1, 0)) > planner.SLOW
        stands = phase.closing & (off & measured.present).any(axis=1) & ~(moves & measured.present).any(axis=1)
        phase.stuck[:] = np.where(stands, phase.stuck + info.step_time, 0.0)
        scene = self.scene(measured, goal, phase.goals, phase.plan.waited)

        def ask(start: int, stop: int) -> None:
            may_close(start, stop, self.preferences, self.hulls, scene, measured.heading, measured.heading_error, phase.goals,
                      (rules.margin, rules.growth, rules.share, rules.doubt), phase.closing)  # fmt: skip

        workers.share(ask, len(goal), self.threads)
        phase.closing[phase.stuck >= rules.give_up] = False
        # In a pattern that fills the width, parts side by side are too near, but their distance cannot grow: close in.
        away = np.hypot(*np.moveaxis(measured.displacement + phase.apart, -1, 0)) > THERE
        waits = (away | (np.abs(measured.heading_error) > info.heading_tolerance)) & measured.present
        phase.closing[~waits.any(axis=1)] = True


@jit(allocates=True)
def may_close(start, stop, wants, hulls, scene, heading, heading_error, goals, margins, free):
    """Determine whether all parts of each world may go straight to their goals at once.

    Args:
        start, stop: first world, and the one after the last.
        wants, hulls: see :mod:`.motion_choice`.
        scene: whose targets are the goals.
        heading, heading_error: (worlds, parts) rad, now and still to go.
        goals: (worlds, parts, parts) m, distances at the goals.
        margins: distance that two parts keep: its maximum, m; share of the remaining displacements, and of the goals' distance;
            allowed overlap of parts that go straight already, m.
        free: (worlds,) bool, whether the parts go straight already; overwritten.
    """
    parts = heading.shape[1]
    paths, placed = np.empty((parts, INSTANTS, 3)), np.empty_like(hulls.corner)
    for w in range(start, stop):
        for p in range(parts):
            if scene.present[w, p]:
                go_straight(wants, scene.centre[w, p], scene.velocity[w, p], scene.target[w, p], paths[p])
        least, free[w] = -margins[3] if free[w] else math.inf, True
        for t in range(INSTANTS):
            for p in range(parts):
                if scene.present[w, p]:
                    left = max(abs(heading_error[w, p]) - SPIN * INTERVAL * (t + 1), 0.0)
                    angle = heading[w, p] + np.sign(heading_error[w, p]) * (abs(heading_error[w, p]) - left)
                    place_hulls(hulls, p, paths[p, t, 0], paths[p, t, 1], angle, placed)
            if not clear(hulls, placed, scene.present[w], paths, t, goals[w], margins, least):
                free[w] = False
                break


@jit
def go_straight(wants, centre, velocity, target, path):
    """Predict the path of a part that goes straight to its target, in steps small enough for the law.

    Args:
        path: (INSTANTS, 3) m, places and distances to the target; overwritten.
    """
    x, y, vx, vy = centre[0], centre[1], velocity[0], velocity[1]
    step = INTERVAL / SUBSTEPS
    for k in range(INSTANTS):
        for _ in range(SUBSTEPS):
            wx, wy = set_velocity(wants, 0, 0.0, x, y, target[0], target[1])
            ax, ay = wx - vx, wy - vy
            share = min(wants.acceleration * step / max(math.sqrt(ax * ax + ay * ay), 1e-12), 1.0)
            x, y = x + step * (vx + 0.5 * share * ax), y + step * (vy + 0.5 * share * ay)
            vx, vy = vx + share * ax, vy + share * ay
        dx, dy = x - target[0], y - target[1]
        path[k, 0], path[k, 1], path[k, 2] = x, y, math.sqrt(dx * dx + dy * dy)


@jit
def clear(hulls, placed, present, paths, t, goals, margins, most):
    """Return whether all parts of a world, whose hulls are placed, keep their distance at an instant."""
    for p in range(paths.shape[0]):
        if not present[p]:
            continue
        for q in range(p):
            if not present[q]:
                continue
            left = paths[p, t, 2] + paths[q, t, 2]
            least = min(margins[0], margins[1] * left + margins[2] * goals[p, q], most)
            dx, dy = paths[p, t, 0] - paths[q, t, 0], paths[p, t, 1] - paths[q, t, 1]
            far = hulls.radius[p] + hulls.radius[q] + least
            if dx * dx + dy * dy < far * far and part_gap(hulls, placed, p, q) < least:
                return False
    return True
