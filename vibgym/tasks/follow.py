"""Follow: goals that move along paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, Pinned, bound
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import route
from vibgym.tasks.base import Task
from vibgym.tasks.episode import AWAY, BARRED, MOTION, PREVIEW, TURNED, Episode, Relations, Rules, Start
from vibgym.tasks.paths import DrawnPaths, GivenPaths, with_headings
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.scoring import Scoring, Stage
from vibgym.tasks.starts import pose_of_absent


class Follow(Task):
    """The centre within 5 mm and the heading within 5 degrees of a goal that moves along a path, all the way to its end.

    Each part has its own path and starts at its beginning. The goal accelerates from rest, keeps its speed, and decelerates to
    rest at the end. Success: every step has ended within these tolerances, the last ten periods at the end of the path.
    Headings count modulo the part's symmetry.

    ``paths`` is a list with a mapping for each part, or a mapping for paths that are drawn for every episode (the default):

    | ``shape`` | keys |
    |---|---|
    | ``"circle"`` | ``centre``, ``radius``; ``start``: the angle at which it begins; ``laps``, ``clockwise`` |
    | ``"square"`` | ``centre``, ``side``; ``turn``: of its sides; ``corner``, ``laps``, ``clockwise`` |
    | ``"polyline"`` | ``points``; ``corner``; ``closed``, and ``laps`` if it is |
    | ``"figure_eight"`` | ``centre``, ``radius`` of both circles; ``turn``: of the line of centres; ``laps``, ``clockwise`` |
    | none: drawn | ``shapes``: some of ``"circle"``, ``"square"``, ``"figure_eight"`` |

    Lengths are in m, or in mm in keys with ``_mm``; angles in rad, or in degrees with ``_deg``. All shapes also have

    - ``speed``, m/s: by default half of the part's top speed (0.15 m/s), a third where it turns with its path;
    - ``acceleration``, m/s^2, at both ends: by default a quarter of what the part can do from rest, or what bends there allow;
    - ``heading``: ``"kept"``, as at the start (default), or ``"along"``: the part turns with its path. Its heading is the mean
      direction of the path over the part's size.

    Corners are rounded with the radius ``corner``, m, at constant speed. By default a corner takes half of the amplitude that a
    straight line leaves. Drawn paths keep parts 46.8 mm apart for all headings: an element's largest dimension plus twice the
    tolerance. Given paths must keep them 36.8 mm apart.

    Args:
        surface: the table.
        parts: the parts.
        settings: of the task; the hold is at the end of the path.

    Raises:
        ValueError: a bad setting of a path; a path that leaves the surface, or that its part cannot follow with 90 % of the
            largest amplitude (:class:`vibgym.tasks.paths.Reach`); parts that would come too near; no room for drawn paths.
    """

    class Settings(Task.Settings):
        """Settings of Follow."""

        slots: ClassVar[None] = None

        paths: tuple[dict[str, Any], ...] | dict[str, Any] = {}
        """A mapping for the path of each part, or one for paths that are drawn."""

    settings: Settings

    TERMS = {**PoseTask.TERMS, "time": ("time", 0.005)}  # a whole episode of it costs less than a fall
    FEATURES = (
        "present", "element", "heading", "position", "way", "way_coarse", "way_fine", "turn", "turn_coarse", "turn_fine",
        "velocity", "spin", "gap", "neighbour", "goal_velocity", "goal_spin", "way_ahead", "turn_ahead",
    )  # fmt: skip
    HAS_WALLS = False
    has_goal = True
    goal_moves = True
    position_tolerance = 0.005
    heading_tolerance = math.radians(5.0)
    modulo_symmetry = True

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        paths, apart = self.settings.paths, math.sqrt(2.0) * surface.element_size
        if isinstance(paths, tuple):
            self.paths: DrawnPaths | GivenPaths = GivenPaths(surface, parts, paths, apart)
        else:
            self.paths = DrawnPaths(surface, parts, paths, apart + 2.0 * self.position_tolerance)
        self._apart = apart
        self.draws, self.lasts = self.paths.draws, self.paths.lasts

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        return self._start(self.paths.draw(uniform), present)

    def starts_along(self, name: str, paths: Any, longest: float) -> Callable[[np.ndarray, np.ndarray | None], Start]:
        if not checks.listed(paths):
            raise checks.refuse(name, paths, "a list with a mapping for each part")
        given, rows = GivenPaths(self.surface, self.parts, paths, self._apart, name), self.paths.shape[1]
        if given.lasts > longest:
            raise checks.refuse(name, f"{given.lasts:.4g} s", f"at most {longest:.4g} s: an episode without the hold")
        if given.shape[1] > rows:
            allowed = f"at most {rows - 2} lines and arcs each, as many as the environment's own paths have room for"
            raise checks.refuse(name, f"paths of up to {given.shape[1] - 2} lines and arcs", allowed)
        routes = np.stack([route.padded(each, rows) for each in given.routes])

        def start(uniform: np.ndarray, present: np.ndarray | None) -> Start:
            # Kept headings are drawn by the same number as without this option: the last one of a part.
            last = uniform.reshape(len(uniform), len(self.parts), -1)[..., -1]
            return self._start(with_headings(routes, last), present)

        return start

    def _start(self, paths: np.ndarray, present: np.ndarray | None) -> Start:
        there = np.ones(paths.shape[:2], dtype=bool) if present is None else present
        goal = np.empty((*paths.shape[:2], 3))
        route.first_poses(paths, np.empty(len(route.MOTION)), goal)
        pose = np.where(there[..., None], goal, pose_of_absent(self.surface))
        return Start(pose, there, goal, paths)

    def put_down(self, start: Start, pose: np.ndarray) -> Start:
        away = np.hypot(*np.moveaxis(pose - start.goal, -1, 0)[:2])
        far = start.present & (away > self.position_tolerance)
        if far.any():
            begin = start.goal[far][0, :2].round(6).tolist()
            allowed = f"centres within {1e3 * self.position_tolerance:g} mm of where the path begins, {begin}"
            raise checks.refuse("options['pose']", pose[far][0].tolist(), allowed)
        paths, goal = start.paths.copy(), start.goal.copy()
        kept = paths[:, :, 0, route.ALONG] == 0.0
        # A kept heading is that of the part at the start.
        goal[..., 2] = np.where(kept, pose[..., 2], goal[..., 2])
        paths[:, :, 0, route.HEADING] = np.where(kept, pose[..., 2], paths[:, :, 0, route.HEADING])
        return start._replace(pose=pose, goal=goal, paths=paths)

    def scoring(self, state: State, periods: int) -> PursuitScoring:
        return PursuitScoring(self, state, periods)

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        return f"{self.name}   error {1e3 * episode.position_error[world]:.2f} mm"


LINE_SPACING = 0.004
"""m between the points of a path in a picture."""

MOST_LINE = 4000

RMS, LARGEST, LEFT = range(3)  # of Pursuit.error


class Pursuit(NamedTuple):
    """Progress along the paths of all worlds, pinned in memory and changed in place."""

    path: np.ndarray  # (worlds, parts, rows, 6), see vibgym.tasks.route
    clock: np.ndarray  # (worlds,) int64, periods since the episode's start
    looks: np.ndarray  # (worlds,) int64, number of steps
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


@jit
def place_goals(record, world):
    """Set the goals of one world, and their motion, at the time of its clock."""
    episode, motion, period = record.episode, record.motion, record.period
    time = record.clock[world] * period
    waiting = record.error[world, LEFT] > 0.0
    for i in range(episode.goal.shape[1]):
        path, goal, reported = record.path[world, i], episode.goal[world, i], episode.motion[world, i]
        # The tolerance makes the last sample of a path of a whole number of periods its end, despite rounding.
        if episode.present[world, i] and time < route.duration(path[0]) - 1e-9 * period:
            waiting = True
        route.motion_at(path, time, motion)
        for axis in range(3):
            goal[axis], reported[axis] = motion[axis], motion[3 + axis]
        for ahead in range(1, PREVIEW + 1):
            route.motion_at(path, (record.clock[world] + ahead) * period, motion)
            for axis in range(3):
                reported[3 * ahead + axis] = motion[axis] - goal[axis]
    episode.flag[world, BARRED] = waiting


@jit
def begin_pursuit(pursuit, worlds):
    """Start the clocks of ``worlds`` (n,), whose paths and parts have been set.

    Args:
        pursuit: address of a pinned :class:`Pursuit`.
    """
    record = pursuit_at(pursuit)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        record.clock[world], record.looks[world] = 0, 0
        for i in range(record.squares.shape[1]):
            record.squares[world, i] = 0.0
        for i in range(3):
            record.error[world, i] = 0.0
        place_goals(record, world)


@jit
def move_goals(pursuit, worlds):
    """Move the goals of ``worlds`` (n,) on by one step."""
    record = pursuit_at(pursuit)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        record.clock[world] += record.periods
        place_goals(record, world)


@jit
def record_errors(pursuit, worlds):
    """Record the distances of the parts of ``worlds`` (n,) to their goals after a step; relations must be up to date."""
    record = pursuit_at(pursuit)
    error, tolerance, present = record.relations.error, record.rules.tolerance, record.episode.present
    for k in range(worlds.shape[0]):
        world = worlds[k]
        record.looks[world] += 1
        worst, noted = 0.0, record.error[world]
        for i in range(error.shape[1]):
            if not present[world, i]:
                continue
            ex, ey = error[world, i, 0], error[world, i, 1]
            square = ex * ex + ey * ey
            away = math.sqrt(square)
            record.squares[world, i] += square
            worst = max(worst, record.squares[world, i])
            noted[LARGEST] = max(noted[LARGEST], away)
            if away > tolerance[i, AWAY] or abs(error[world, i, 2]) > tolerance[i, TURNED]:
                noted[LEFT] = 1.0
        noted[RMS] = math.sqrt(worst / record.looks[world])


class PursuitScoring(Scoring):
    """Scores episodes whose goals move along the paths of their starts.

    An episode cannot succeed while a goal moves, nor after a part was outside the tolerances at the end of a step.
    """

    def __init__(self, task: Follow, state: State, periods: int) -> None:
        super().__init__(task.rules(periods), task.hulls, state, motion=MOTION)
        worlds, parts = state.pose.shape[:2]
        still = np.zeros(task.paths.shape)
        # Until the first reset all goals are at the origin.
        still[:, 0] = [route.SMALL, 1.0, 1.0, 1.0, 0.0, 0.0]
        self._pursuit = Pursuit(
            path=np.tile(still, (worlds, 1, 1, 1)),
            clock=np.zeros(worlds, dtype=np.int64),
            looks=np.zeros(worlds, dtype=np.int64),
            squares=np.zeros((worlds, parts)),
            error=np.zeros((worlds, 3)),
            motion=np.zeros(len(route.MOTION)),
            periods=periods,
            period=task.surface.period,
            episode=self.episode,
            relations=self.relations,
            rules=self.rules,
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
        return [bound(move_goals, pursuit), *super().stages(), bound(record_errors, pursuit)]

    def _with_scratch(self) -> Pinned[Pursuit]:
        """Return the pursuit with scratch memory for one thread."""
        return Pinned(PURSUIT, self._pursuit._replace(motion=np.zeros(len(route.MOTION))))
