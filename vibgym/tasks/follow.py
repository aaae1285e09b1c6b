"""Follow: goals that move along paths, which are given as settings or drawn for every episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, Pinned, bound
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import read
from vibgym.tasks import paths
from vibgym.tasks.base import Task
from vibgym.tasks.episode import AWAY, BARRED, MOTION, PREVIEW, TURNED, Episode, Relations, Rules, Start
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.scoring import Scoring, Stage
from vibgym.tasks.starts import pose_of_absent

Name = Literal["circle", "square", "figure_eight"]

LARGEST_RADIUS, SMALLEST_SHARE = 0.1, 0.4
"""m, largest radius (or half a side); smallest one over the largest one that fits."""

ROOM = 1.2
"""Smallest radius (or half a side) over that of a corner."""

NUMBERS = 7
"""Uniform numbers of a path: shape, size, place in x and y, start, direction, heading."""

PIECES = 9

INSTANTS = 1000
"""Samples of the effort of a path."""

AROUND = {"circle": 2.0 * math.pi, "square": 8.0, "figure_eight": 4.0 * math.pi}
"""Length of a path over its radius (or half a side), at most."""


class DrawnSettings(paths.PathSettings):
    """Settings of drawn paths."""

    shapes: tuple[Name, ...] = Field(default=("circle", "square", "figure_eight"), min_length=1)


class DrawnPaths:
    """Paths of random shape, size, place, start and direction. Each part has its own cell of the surface.

    Args:
        surface, parts: the scene.
        settings: a mapping of :class:`DrawnSettings`.
        apart: m, minimum distance between parts that the cells ensure, for all headings.

    Attributes:
        draws: uniform numbers per episode.  lasts: s, duration of the longest possible path.

    Raises:
        ValueError: a bad setting, or no room for a path that the parts can follow.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Any, apart: float) -> None:
        known = read(DrawnSettings, settings, "paths")
        self.parts, self._shapes = tuple(parts), list(dict.fromkeys(known.shapes))
        reach = [paths.Reach(surface, part) for part in parts]
        self._header, self._corner = paths.profile("paths", known, reach)
        self._cells = self._cells_of(surface, apart, ROOM * self._corner)
        self.draws = NUMBERS * len(self.parts)
        self.shape = (len(self.parts), PIECES + 2, 6)
        rate = float(self._header[paths.ACCELERATION])
        most = paths.bisected(0.0, rate, lambda value: self._effort(reach, value) <= paths.EFFORT)
        if known.acceleration is not None and most < rate * (1.0 - 1e-6):
            allowed = f"a number > 0 and <= {most:.4g} m/s^2 for these parts and bends"
            raise checks.refuse("paths.acceleration", rate, allowed)
        self._header[paths.ACCELERATION] = most
        longest = max(
            AROUND[name] * radii.max() for name, radii in zip(self._shapes, self._radii(self._cells)[1], strict=True)
        )
        self.lasts = float(paths.duration(np.array([longest, *self._header[1:]])))

    def _effort(self, reach: Sequence[paths.Reach], rate: float) -> float:
        """Return the largest effort of all paths with the smallest radii, which are the hardest, at this acceleration."""
        number = np.zeros((len(self._shapes), len(self.parts), NUMBERS))
        number[..., 0] = (np.arange(len(self._shapes))[:, None] + 0.5) / len(self._shapes)
        routes = self.draw(number.reshape(len(self._shapes), -1))
        routes[:, :, 0, paths.ACCELERATION] = rate
        shapes_and_parts = np.ndindex(routes.shape[:2])
        return max(
            reach[part].most_effort(paths.sampled(routes[shape, part], INSTANTS)) for shape, part in shapes_and_parts
        )

    def _radii(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest radius (or half a side) of each shape in each cell, (shapes, n) from cells (n, 4)."""
        size = cells[:, 2:] - cells[:, :2]
        short, long = 0.5 * size.min(axis=1), 0.5 * size.max(axis=1)
        radii = [np.minimum(short, 0.5 * long) if name == "figure_eight" else short for name in self._shapes]
        most = np.minimum(radii, max(LARGEST_RADIUS, ROOM * self._corner))
        return np.maximum(SMALLEST_SHARE * most, np.minimum(most, ROOM * self._corner)), most

    def _cells_of(self, surface: Surface, apart: float, least: float) -> np.ndarray:
        """Return the largest cells (parts, 4) of the parts' centres: x_low, y_low, x_high, y_high."""
        radius = max(part.radius for part in self.parts)
        size, best, largest = np.array([surface.width, surface.depth]), -math.inf, np.zeros((0, 4))
        for columns in range(1, len(self.parts) + 1):
            count = np.array([columns, math.ceil(len(self.parts) / columns)])
            step = (size + apart) / count  # from cell to cell
            cell = step - 2.0 * radius - apart
            if cell.min() <= 0.0:
                continue
            k = np.arange(len(self.parts))
            low = radius + np.column_stack([k // count[1], k % count[1]]) * step
            cells = np.concatenate([low, low + cell], axis=1)
            most = self._radii(cells)[1].min()
            if most > best:
                best, largest = most, cells
        if best < least:
            got = f"{len(self.parts)} parts of radius up to {radius:.4g} m"
            allowed = (
                f"as many as have room for paths of radius {1e3 * least:.4g} mm, {1e3 * apart:.4g} mm apart, on "
                f"{surface.width:g} x {surface.depth:g} m; slower paths need less"
            )
            raise checks.refuse("parts", got, allowed)
        return largest

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Return routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
        n, parts = len(uniform), len(self.parts)
        number = uniform.reshape(n, parts, NUMBERS)
        choice = np.minimum((len(self._shapes) * number[..., 0]).astype(int), len(self._shapes) - 1)
        low, high = (radii[choice, np.arange(parts)] for radii in self._radii(self._cells))
        radius = low + (high - low) * number[..., 1]
        names = np.array(self._shapes)[choice]
        circle, square, eight = (names == name for name in ("circle", "square", "figure_eight"))
        # A figure of eight lies along the longer side of its cell.
        size = self._cells[:, 2:] - self._cells[:, :2]
        wide = np.array([size[:, 0] >= size[:, 1], size[:, 0] < size[:, 1]]).T
        reach = radius[..., None] * np.where(eight[..., None] & wide, 2.0, 1.0)
        centre = self._cells[:, :2] + reach + np.maximum(size - 2.0 * reach, 0.0) * number[..., 2:4]
        sign = np.where(number[..., 5] < 0.5, 1.0, -1.0)

        # A circle begins anywhere, a square in the middle of any side, a figure of eight at its centre, either way.
        turn = 2.0 * math.pi * number[..., 4]
        quarter = 0.5 * math.pi * np.floor(4.0 * number[..., 4])
        half = np.where(wide[:, 0], 0.5 * math.pi, 0.0) + math.pi * np.floor(2.0 * number[..., 4])
        begin = np.where(circle, turn, quarter)
        out = np.where(eight, 0.0, radius)
        direction = np.where(eight, half, begin + sign * 0.5 * math.pi)
        x, y = centre[..., 0] + out * np.cos(begin), centre[..., 1] + out * np.sin(begin)

        lengths, curvatures = np.zeros((2, n, parts, PIECES))
        side, corner = 2.0 * (radius - self._corner), np.full_like(radius, self._corner)
        for k in range(PIECES):
            straight = 0.5 * side if k in (0, PIECES - 1) else side
            lengths[..., k] = np.where(square, straight if k % 2 == 0 else 0.5 * math.pi * corner, 0.0)
            curvatures[..., k] = np.where(square, 0.0 if k % 2 == 0 else sign / corner, 0.0)
        around = np.where(square, 0.0, 2.0 * math.pi * radius)
        lengths[..., 0] = np.where(square, lengths[..., 0], around)
        curvatures[..., 0] = np.where(square, 0.0, sign / radius)
        lengths[..., 1] = np.where(eight, around, lengths[..., 1])
        curvatures[..., 1] = np.where(eight, -sign / radius, curvatures[..., 1])

        each_part = (np.stack([x, y, direction], axis=2), lengths, curvatures, np.tile(self._header, (n, parts, 1)))
        made = paths.routes(*(values.reshape(n * parts, -1) for values in each_part))
        return paths.turn_kept(made.reshape(n, parts, PIECES + 2, 6), number[..., 6])


SPACING = 1e-3
"""m, largest distance between the points at which a path is checked."""

MAX_PLACES = 200_000
"""Points of one path: 200 m."""

SLACK = 1e-9


class GivenPaths:
    """The same paths in all episodes; only kept headings are drawn.

    Args:
        surface, parts: the scene.
        settings: a mapping for each part, see :class:`vibgym.tasks.Follow`.
        apart: m, required minimum distance between parts at all times and for all headings.
        argument: name for errors.
        rows: least number of rows of the routes.

    Attributes:
        draws: uniform numbers per episode.  lasts: s, duration of the longest path.
        routes: (parts, rows, 6), see :mod:`vibgym.tasks.paths`; kept headings are 0.  shape: of these.

    Raises:
        ValueError: a bad setting, a path that leaves the surface or that its part cannot follow, or two that come too near.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        settings: Sequence[Any],
        apart: float,
        argument: str = "paths",
        rows: int = 0,
    ) -> None:
        if len(settings) != len(parts):
            raise checks.refuse(argument, f"{len(settings)} paths", f"one for each of {len(parts)} parts")
        self.surface, self.parts, self._argument = surface, tuple(parts), argument
        made = [self._route(f"{argument}[{k}]", value, part) for k, (value, part) in enumerate(zip(settings, parts))]
        rows = max(rows, *(len(route) for route in made))
        self.routes = np.stack([paths.padded(route, rows) for route in made])
        self.shape = (len(parts), rows, 6)
        self.lasts = max(float(paths.duration(route[0])) for route in made)
        self.draws = len(parts)
        self._check_apart(apart)

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Return routes (n, parts, rows, 6) from ``uniform`` (n, draws)."""
        return paths.turn_kept(np.tile(self.routes, (len(uniform), 1, 1, 1)), uniform)

    def _route(self, name: str, value: Any, part: Part) -> np.ndarray:
        shape, reach = paths.shape_from(value, name), paths.Reach(self.surface, part)
        header, corner = paths.profile(name, shape, [reach])
        with checks.within(name, "."):
            course = shape.course(getattr(shape, "corner", None) or corner)
        route = paths.routes(*(np.array([values], dtype=np.float64) for values in (*course, header)))[0]
        self._check_place(name, shape, route, part)
        speed, at_speed = float(header[paths.SPEED]), route.copy()

        def fits(speed: float) -> bool:
            at_speed[0, paths.SPEED] = speed
            return reach.most_effort(_closely(at_speed)) <= paths.EFFORT

        fastest = paths.bisected(0.0, speed, fits)
        if fastest < speed * (1.0 - 1e-6):
            why = "its bends and ramps need more acceleration than there is"
            allowed = f"at most {fastest:.4g} m/s for {part.name!r} on this surface: {why}"
            raise checks.refuse(f"{name}.speed", f"{speed:.4g} m/s", allowed)
        return route

    def _check_place(self, name: str, shape: paths.Shape, path: np.ndarray, part: Part) -> None:
        """Check that the part stays on the surface; errors name the size, or the place if the path would fit elsewhere."""
        place, margin = _closely(path)[:, :2], part.radius - SLACK
        room = np.array([self.surface.width, self.surface.depth])
        off = ((place < margin) | (place > room - margin)).any(axis=1)
        if off.any():
            key = shape.SIZE if (np.ptp(place, axis=0) > room - 2.0 * margin).any() else shape.PLACE
            low, high = part.radius, room - part.radius
            allowed = (
                f"a path on which {part.name!r} lies wholly on the surface for every heading: "
                f"x in [{low:.4g}, {high[0]:.4g}] and y in [{low:.4g}, {high[1]:.4g}] m"
            )
            raise checks.refuse(f"{name}.{key}", f"a path through {place[off][0].round(4).tolist()}", allowed)

    def _check_apart(self, apart: float) -> None:
        """Check that no two circumscribed circles come near at any instant."""
        speed = max(path[0, paths.SPEED] for path in self.routes)
        count = min(int(self.lasts * speed / SPACING) + 100, MAX_PLACES)
        times = np.linspace(0.0, self.lasts, count)
        places = [paths.sample(path, times)[:, :2] for path in self.routes]
        for k, part in enumerate(self.parts):
            for j in range(k):
                gap = np.hypot(*(places[k] - places[j]).T) - part.radius - self.parts[j].radius
                if gap.min() < apart - SLACK:
                    at = f"of that of {self._argument}[{j}] at {times[gap.argmin()]:.2f} s"
                    got = f"a path on which the part comes within {1e3 * gap.min():.4g} mm {at}"
                    allowed = f"at least {1e3 * apart:.4g} mm between parts at all times, for all headings"
                    raise checks.refuse(f"{self._argument}[{k}]", got, allowed)


def _closely(path: np.ndarray) -> np.ndarray:
    """Return the motion (n, 9) along a path at points at most :data:`SPACING` apart."""
    return paths.sampled(path, min(int(path[0, paths.LENGTH] / SPACING) + 100, MAX_PLACES))


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

    The hold is at the end of the path.

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
        chosen, apart = self.settings.paths, math.sqrt(2.0) * surface.element_size
        if isinstance(chosen, tuple):
            self.paths: DrawnPaths | GivenPaths = GivenPaths(surface, parts, chosen, apart)
        else:
            self.paths = DrawnPaths(surface, parts, chosen, apart + 2.0 * self.position_tolerance)
        self._apart = apart
        self.draws, self.lasts = self.paths.draws, self.paths.lasts

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        return self._start(self.paths.draw(uniform), present)

    def start_along(
        self, name: str, settings: Any, longest: float, uniform: np.ndarray, present: np.ndarray | None
    ) -> Start:
        """Return starts as :meth:`start`, for goals that move along given paths.

        Args:
            name: of the argument, for errors.
            settings: a mapping for each path.
            longest: largest duration of the paths, s.

        Raises:
            ValueError: invalid paths.
        """
        if not checks.listed(settings):
            raise checks.refuse(name, settings, "a list with a mapping for each part")
        rows = self.paths.shape[1]
        fixed = GivenPaths(self.surface, self.parts, settings, self._apart, name, rows)
        if fixed.lasts > longest:
            raise checks.refuse(name, f"{fixed.lasts:.4g} s", f"at most {longest:.4g} s: an episode without the hold")
        if fixed.shape[1] > rows:
            allowed = f"at most {rows - 2} lines and arcs each, as many as the environment's own paths have room for"
            raise checks.refuse(name, f"paths of up to {fixed.shape[1] - 2} lines and arcs", allowed)
        # Kept headings are drawn by the same number as without this option: the last one of a part.
        last = uniform.reshape(len(uniform), len(self.parts), -1)[..., -1]
        return self._start(fixed.draw(last), present)

    def _start(self, routes: np.ndarray, present: np.ndarray | None) -> Start:
        there = np.ones(routes.shape[:2], dtype=bool) if present is None else present
        goal = np.empty((*routes.shape[:2], 3))
        paths.first_poses(routes, goal)
        pose = np.where(there[..., None], goal, pose_of_absent(self.surface))
        return Start(pose, there, goal, routes)

    def place(self, start: Start, pose: np.ndarray) -> Start:
        away = np.hypot(*np.moveaxis(pose - start.goal, -1, 0)[:2])
        far = start.present & (away > self.position_tolerance)
        if far.any():
            begin = start.goal[far][0, :2].round(6).tolist()
            allowed = f"centres within {1e3 * self.position_tolerance:g} mm of where the path begins, {begin}"
            raise checks.refuse("options['pose']", pose[far][0].tolist(), allowed)
        routes, goal = start.paths.copy(), start.goal.copy()
        kept = routes[:, :, 0, paths.ALONG] == 0.0
        # A kept heading is that of the part at the start.
        goal[..., 2] = np.where(kept, pose[..., 2], goal[..., 2])
        routes[:, :, 0, paths.HEADING] = np.where(kept, pose[..., 2], routes[:, :, 0, paths.HEADING])
        return start._replace(pose=pose, goal=goal, paths=routes)

    def scoring(self, state: State, periods: int) -> PursuitScoring:
        return PursuitScoring(self, state, periods)

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        return f"{self.name}   error {1e3 * episode.position_error[world]:.2f} mm"


LINE_SPACING = 0.004
"""m between the points of a path in a picture."""

MAX_LINE = 4000

RMS, LARGEST, LEFT = range(3)  # of Pursuit.error


class Pursuit(NamedTuple):
    """Progress along the paths of all worlds, pinned in memory and changed in place."""

    path: np.ndarray  # (worlds, parts, rows, 6), see vibgym.tasks.paths
    clock: np.ndarray  # (worlds,) int64, periods since the episode's start
    looks: np.ndarray  # (worlds,) int64, number of steps
    squares: np.ndarray  # (worlds, parts) m^2, sum of the squared distances to the goal at these
    error: np.ndarray  # (worlds, 3): rms of the part that was worst (m), largest (m), 1: a tolerance has been left
    period: float  # s
    episode: Episode
    relations: Relations
    rules: Rules


PURSUIT: Layout[Pursuit] = Layout("PURSUIT", __name__)
pursuit_at = PURSUIT.at


@jit
def place_goals(record, world, motion):
    """Set the goals of one world, and their motion, at the time of its clock; ``motion`` (9,) is scratch."""
    episode, period = record.episode, record.period
    time = record.clock[world] * period
    waiting = record.error[world, LEFT] > 0.0
    for i in range(episode.goal.shape[1]):
        path, goal, reported = record.path[world, i], episode.goal[world, i], episode.motion[world, i]
        # The tolerance makes the last sample of a path of a whole number of periods its end, despite rounding.
        if episode.present[world, i] and time < paths.duration(path[0]) - 1e-9 * period:
            waiting = True
        paths.motion_at(path, time, motion)
        for axis in range(3):
            goal[axis], reported[axis] = motion[axis], motion[3 + axis]
        for ahead in range(1, PREVIEW + 1):
            paths.motion_at(path, (record.clock[world] + ahead) * period, motion)
            for axis in range(3):
                reported[3 * ahead + axis] = motion[axis] - goal[axis]
    episode.flag[world, BARRED] = waiting


@jit(allocates=True)
def move_goals(pursuit, periods, worlds):
    """Move the goals of ``worlds`` (n,) on by some periods.

    Args:
        pursuit: address of a pinned :class:`Pursuit`.
    """
    record, motion = pursuit_at(pursuit), np.empty(len(paths.INSTANT))
    for k in range(worlds.shape[0]):
        record.clock[worlds[k]] += periods
        place_goals(record, worlds[k], motion)


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
        super().__init__(task.rules(periods), task.part_kinds, state, motion=MOTION)
        worlds, parts = state.pose.shape[:2]
        still = np.zeros(task.paths.shape)
        # Until the first reset all goals are at the origin.
        still[:, 0] = [paths.SMALL, 1.0, 1.0, 1.0, 0.0, 0.0]
        pursuit = Pursuit(
            path=np.tile(still, (worlds, 1, 1, 1)),
            clock=np.zeros(worlds, dtype=np.int64),
            looks=np.zeros(worlds, dtype=np.int64),
            squares=np.zeros((worlds, parts)),
            error=np.zeros((worlds, 3)),
            period=task.surface.period,
            episode=self.episode,
            relations=self.relations,
            rules=self.rules,
        )
        self._pursuit = Pinned(PURSUIT, pursuit)

    def custom_state(self) -> dict[str, np.ndarray]:
        record = self._pursuit.record
        return {
            "paths": record.path, "clock": record.clock, "looks": record.looks, "squares": record.squares,
            "path_errors": record.error,
        }  # fmt: skip

    def info(self) -> dict[str, np.ndarray]:
        error = self._pursuit.record.error
        return {"path_error": error[:, RMS], "largest_path_error": error[:, LARGEST]}

    def lines(self, world: int) -> list[np.ndarray]:
        lines = []
        for path in self._pursuit.record.path[world]:
            count = int(min(path[0, paths.LENGTH] / LINE_SPACING + 2, MAX_LINE))
            lines.append(paths.sampled(path, count)[:, :2])
        return lines

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        record, self.episode.present[worlds] = self._pursuit.record, start.present
        record.path[worlds], record.clock[worlds], record.looks[worlds] = start.paths, 0, 0
        record.squares[worlds], record.error[worlds] = 0.0, 0.0
        move_goals(self._pursuit.address, 0, worlds)
        super().begin(worlds, start)

    def stages(self) -> list[Stage]:
        move, record = bound(move_goals, self._pursuit, self.rules.periods), bound(record_errors, self._pursuit)
        return [move, *super().stages(), record]
