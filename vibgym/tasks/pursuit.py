"""Episodes whose goals move along paths: where the goals are at each instant, and how far off them the parts have been."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout, Pinned, bound
from vibgym.physics.core.records import State
from vibgym.tasks.episode import AWAY, BARRED, MOTION, PREVIEW, TURNED, Episode, Relations, Rules, Start
from vibgym.tasks.paths import route
from vibgym.tasks.scoring import Scoring, Stage

if TYPE_CHECKING:
    from vibgym.tasks.base import Task

LINE_SPACING = 0.004
"""m between the points of a path in a picture."""

MOST_LINE = 4000

RMS, LARGEST, LEFT = range(3)  # of Pursuit.error


class Pursuit(NamedTuple):
    """Progress along the paths of all worlds, pinned in memory and changed in place."""

    path: np.ndarray  # (worlds, parts, rows, 6), see vibgym.tasks.paths.route
    clock: np.ndarray  # (worlds,) int64, periods since the episode's start
    looks: np.ndarray  # (worlds,) int64, ends of steps at which errors were noted
    squares: np.ndarray  # (worlds, parts) m^2, sum of the squared distances to the goal at these
    error: np.ndarray  # (worlds, 3): rms of the part that was worst (m), largest (m), 1: a tolerance has been left
    motion: np.ndarray  # (9,) scratch
    periods: int  # of a step
    period: float  # s
    episode: Episode
    relations: Relations
    rules: Rules


PURSUIT: Layout[Pursuit] = Layout("PURSUIT", __name__)
pursuit_at = PURSUIT.at


@borrowing
def place_goals(all_of, world):
    """Put the goals of one world where its clock says, with their motion."""
    episode, motion, period = all_of.episode, all_of.motion, all_of.period
    time = all_of.clock[world] * period
    waiting = all_of.error[world, LEFT] > 0.0
    for i in range(episode.goal.shape[1]):
        path, goal, reported = all_of.path[world, i], episode.goal[world, i], episode.motion[world, i]
        # The tolerance makes the last sample of a path of a whole number of periods its end, despite rounding.
        if episode.present[world, i] and time < route.duration(path[0]) - 1e-9 * period:
            waiting = True
        route.motion_at(path, time, motion)
        for axis in range(3):
            goal[axis], reported[axis] = motion[axis], motion[3 + axis]
        for ahead in range(1, PREVIEW + 1):
            route.motion_at(path, (all_of.clock[world] + ahead) * period, motion)
            for axis in range(3):
                reported[3 * ahead + axis] = motion[axis] - goal[axis]
    episode.flag[world, BARRED] = waiting


@borrowing
def begin_pursuit(pursuit, worlds):
    """Start the clocks of ``worlds`` (n,), whose paths and parts have been set.

    Args:
        pursuit: address of a pinned :class:`Pursuit`.
    """
    all_of = pursuit_at(pursuit)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        all_of.clock[world], all_of.looks[world] = 0, 0
        for i in range(all_of.squares.shape[1]):
            all_of.squares[world, i] = 0.0
        for i in range(3):
            all_of.error[world, i] = 0.0
        place_goals(all_of, world)


@borrowing
def move_goals(pursuit, worlds):
    """Move the goals of ``worlds`` (n,) on by one step."""
    all_of = pursuit_at(pursuit)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        all_of.clock[world] += all_of.periods
        place_goals(all_of, world)


@borrowing
def note_errors(pursuit, worlds):
    """Note how far the parts of ``worlds`` (n,) are from their goals at a step's end, by relations that are up to date."""
    all_of = pursuit_at(pursuit)
    error, tolerance, present = all_of.relations.error, all_of.rules.tolerance, all_of.episode.present
    for k in range(worlds.shape[0]):
        world = worlds[k]
        all_of.looks[world] += 1
        worst, noted = 0.0, all_of.error[world]
        for i in range(error.shape[1]):
            if not present[world, i]:
                continue
            ex, ey = error[world, i, 0], error[world, i, 1]
            square = ex * ex + ey * ey
            away = math.sqrt(square)
            all_of.squares[world, i] += square
            worst = max(worst, all_of.squares[world, i])
            noted[LARGEST] = max(noted[LARGEST], away)
            if away > tolerance[i, AWAY] or abs(error[world, i, 2]) > tolerance[i, TURNED]:
                noted[LEFT] = 1.0
        noted[RMS] = math.sqrt(worst / all_of.looks[world])


class PursuitScoring(Scoring):
    """Scores episodes whose goals move along the paths of their starts.

    An episode cannot succeed while a goal moves, nor after a part has left the tolerances at the end of some step.

    Args:
        task: with its parts.
        state: true state of the worlds.
        periods: oscillation periods of a step.
        period: s of one.
        shape: of a world's paths, (parts, rows, 6).
    """

    def __init__(self, task: Task, state: State, periods: int, period: float, shape: tuple[int, int, int]) -> None:
        super().__init__(task, state, periods, MOTION)
        worlds, parts = state.pose.shape[:2]
        still = np.zeros(shape)
        # Until the first reset all goals stand at the origin.
        still[:, 0] = [route.SMALL, 1.0, 1.0, 1.0, 0.0, 0.0]
        self._pursuit = Pursuit(
            path=np.tile(still, (worlds, 1, 1, 1)),
            clock=np.zeros(worlds, dtype=np.int64),
            looks=np.zeros(worlds, dtype=np.int64),
            squares=np.zeros((worlds, parts)),
            error=np.zeros((worlds, 3)),
            motion=np.zeros(len(route.MOTION)),
            periods=periods,
            period=period,
            episode=self.episode,
            relations=self.relations,
            rules=self._rules,
        )
        self._pinned = self._with_scratch()

    def own_state(self) -> dict[str, np.ndarray]:
        record = self._pursuit
        return {
            "paths": record.path, "clock": record.clock, "looks": record.looks, "squares": record.squares,
            "path_errors": record.error,
        }  # fmt: skip

    def facts(self) -> dict[str, np.ndarray]:
        error = self._pursuit.error
        return {"path_error": error[:, RMS], "largest_path_error": error[:, LARGEST]}

    def lines(self, world: int) -> list[np.ndarray]:
        lines = []
        for path in self._pursuit.path[world]:
            count = int(min(path[0, route.LENGTH] / LINE_SPACING + 2, MOST_LINE))
            lines.append(route.sample(path, np.linspace(0.0, route.duration(path[0]), count))[:, :2])
        return lines

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        self._pursuit.path[worlds], self.episode.present[worlds] = start.paths, start.present
        begin_pursuit(self._pinned.address, worlds)
        super().begin(worlds, start)

    def stages(self) -> list[Stage]:
        pursuit = self._with_scratch()
        return [bound(move_goals, pursuit), *super().stages(), bound(note_errors, pursuit)]

    def _with_scratch(self) -> Pinned[Pursuit]:
        """What one thread needs."""
        return Pinned(PURSUIT, self._pursuit._replace(motion=np.zeros(len(route.MOTION))))
