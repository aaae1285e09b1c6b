"""Follow: go along a path, on time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import HOLD_PERIODS, Start, Task, looks_same_after
from vibgym.tasks.episode import Episode, Relations
from vibgym.tasks.paths import DrawnPaths, GivenPaths, route
from vibgym.tasks.paths.given import with_headings
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.pursuit import PursuitScoring


class Follow(Task):
    """The centre within 5 mm and the heading within 5 degrees of a goal that moves along a path, all the way to its end.

    Each part, there may be several, has a path of its own and starts where it begins. The goal starts from rest, speeds up,
    keeps its speed, and slows down to rest at the end, where it stays. Success is that every step has ended within these
    tolerances, and that ten periods have passed at the end. Headings count modulo the part's symmetry.

    ``paths`` is a list with a mapping for each part, or a mapping for paths that are drawn for every episode (the default):

    | ``shape`` | its own keys |
    |---|---|
    | ``"circle"`` | ``centre``, ``radius``; ``start``: the angle at which it begins; ``laps``, ``clockwise`` |
    | ``"square"`` | ``centre``, ``side``; ``turn``: of its sides; ``corner``, ``laps``, ``clockwise`` |
    | ``"polyline"`` | ``points``; ``corner``; ``closed``, and ``laps`` if it is |
    | ``"figure_eight"`` | ``centre``, ``radius`` of both circles; ``turn``: of the line of centres; ``laps``, ``clockwise`` |
    | none: drawn | ``shapes``: some of ``"circle"``, ``"square"``, ``"figure_eight"`` |

    Lengths are in m, or in mm in keys with ``_mm``; angles in rad, or in degrees with ``_deg``. All of them also have

    - ``speed``, m/s: by default half of the part's top speed (0.15 m/s), a third where it turns with its path;
    - ``acceleration``, m/s^2, at both ends: by default a quarter of what the part can do from rest, or what bends there allow;
    - ``heading``: ``"kept"``, as at the start (default), or ``"along"``: the part turns with its path. Its heading is the mean
      direction of the path over the part's size, since no part can turn at once where a line meets an arc.

    Corners are rounded with the radius ``corner``, m, and the speed stays the same there. By default the radius is the
    smallest with which a corner takes no more than half of the amplitude that a straight line leaves. Drawn
    paths keep parts 46.8 mm apart for all headings: an element's largest dimension plus twice the tolerance. Given paths must
    keep them 36.8 mm apart.

    Args:
        surface: the table.
        parts: the parts.
        paths: see above.
        hold: see :class:`vibgym.tasks.Task`; it is at the end of the path.

    Raises:
        ValueError: a bad setting; a path that leaves the surface, or is faster, or bends or speeds up more, than its part can
            follow with 90 % of the largest amplitude (:class:`vibgym.tasks.paths.Reach`); parts that would come too
            near; no room for paths to be drawn.
    """

    # Time costs less over an episode than a fall, so that falling does not pay.
    TERMS = {**PoseTask.TERMS, "time": ("time", 0.005)}
    FEATURES = (
        "present", "element", "heading", "position", "way", "way_coarse", "way_fine", "turn", "turn_coarse", "turn_fine",
        "velocity", "spin", "gap", "neighbour", "goal_velocity", "goal_spin", "way_ahead", "turn_ahead",
    )  # fmt: skip
    HAS_WALLS = False
    has_goal = True
    goal_moves = True
    position_tolerance = 0.005
    heading_tolerance = math.radians(5.0)

    def __init__(self, surface: Surface, parts: Sequence[Part], *, paths: Any = None, hold: int = HOLD_PERIODS) -> None:
        super().__init__(surface, parts, hold=hold)
        apart = self._apart = math.sqrt(2.0) * surface.element_size
        if paths is None or isinstance(paths, Mapping):
            drawn = DrawnPaths(surface, parts, paths or {}, apart + 2.0 * self.position_tolerance)
            self.paths: DrawnPaths | GivenPaths = drawn
        elif checks.listed(paths):
            self.paths = GivenPaths(surface, parts, paths, apart)
        else:
            allowed = "a list with a mapping for each part, or a mapping for paths that are drawn"
            raise checks.refuse("paths", paths, allowed)
        self.draws, self.lasts = self.paths.draws, self.paths.lasts

    def heading_period(self, part: Part) -> float:
        return looks_same_after(part)

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
            # Headings that are kept come from the number that draws them without this wish, too: the last one of a part.
            last = uniform.reshape(len(uniform), len(self.parts), -1)[..., -1]
            return self._start(with_headings(routes, last), present)

        return start

    def _start(self, paths: np.ndarray, present: np.ndarray | None) -> Start:
        there = np.ones(paths.shape[:2], dtype=bool) if present is None else present
        goal = np.empty((*paths.shape[:2], 3))
        route.first_poses(paths, np.empty(len(route.MOTION)), goal)
        beside = np.array([-self.surface.width, -self.surface.depth, 0.0])
        return Start(np.where(there[..., None], goal, beside), there, goal, paths)

    def put_down(self, start: Start, pose: np.ndarray) -> Start:
        away = np.hypot(*np.moveaxis(pose - start.goal, -1, 0)[:2])
        far = start.present & (away > self.position_tolerance)
        if far.any():
            begin = start.goal[far][0, :2].round(6).tolist()
            allowed = f"centres within {1e3 * self.position_tolerance:g} mm of where the path begins, {begin}"
            raise checks.refuse("options['pose']", pose[far][0].tolist(), allowed)
        paths, goal = start.paths.copy(), start.goal.copy()
        kept = paths[:, :, 0, route.ALONG] == 0.0
        # A heading that is kept is the one that the part has at the start.
        goal[..., 2] = np.where(kept, pose[..., 2], goal[..., 2])
        paths[:, :, 0, route.HEADING] = np.where(kept, pose[..., 2], paths[:, :, 0, route.HEADING])
        return start._replace(pose=pose, goal=goal, paths=paths)

    def scoring(self, state: State, periods: int) -> PursuitScoring:
        return PursuitScoring(self, state, periods, self.surface.period, self.paths.shape)

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        return f"{self.name}   error {1e3 * episode.position_error[world]:.2f} mm"
