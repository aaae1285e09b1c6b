"""Lanes along the table: through gates (:class:`FeedingPolicy`), and both ways past one another (:class:`CrossingPolicy`).

Through gates: parts have velocities instead of targets. Parts farther along have right of way, and those behind keep a
distance that grows on the way to the gate. Across the table parts change to the lane of their kind where there is room.

Both ways: parts that meet others keep to the right, turn straight, and choose velocities in order of right of way
(:mod:`.traffic`). A part on the wrong side changes to its own as soon as there is room; oncoming parts wait or move to the
border. Where no parts meet and one has waited off its goal, :mod:`.two_phases` brings the parts to their goals.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical import planner
from vibgym.policies.classical.law import lead_of
from vibgym.policies.classical.measured import Measured, recall, wrap
from vibgym.policies.classical.steering import Steering
from vibgym.policies.classical.traffic import Crowd, Rules, choose_velocities
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation import threads as workers


@dataclass(frozen=True)
class Traffic:
    """How parts keep their distance.

    Raises:
        ValueError: a bad value.
    """

    near: float = 0.003  # m, distance that parts keep at the inlet
    spare: float = 0.004  # m, that parts keep at the gate beyond what it asks for
    along: float = 0.12  # s, in which a lack of distance along the table is made up for
    across: float = 0.20  # s, in which parts go to the middle of their lanes
    beside: float = 0.006  # m, distance to those beside
    slip: float = 0.3  # most velocity across the table over the top speed

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, checks.number(each.name, getattr(self, each.name), above=0.0))


class FeedingPolicy(Steering):
    """Lanes along the table in which parts keep apart: to the gates of a task whose parts come and go.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Traffic`; ``law``, ``action`` and ``learn`` of :class:`Steering`; and that law's own.

    Raises:
        ValueError: a task whose parts stay, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        own = {each.name: settings.pop(each.name) for each in fields(Traffic) if each.name in settings}
        settings.setdefault("law", "pose")
        super().__init__(info, **settings)
        if not info.flows or info.zones is None:
            raise info.unsupported("lanes", "a task whose parts leave through gates, such as Feed")
        self.traffic, zones = Traffic(**own), info.zones[list(info.kind)]
        self.top = info.plant.top_speed
        self.lead = lead_of(self.law, info, 0.5 * self.top)
        self.lane = 0.5 * (zones[:, 1] + zones[:, 3])
        self.gate = zones[:, 0]
        self.inlet = float(2.0 * max(part.radius for part in info.parts))
        self.outline = [part.outline for part in info.parts]
        self.spacing = float(np.sqrt(2.0) * info.surface.element_size)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is :class:`.steering.Memory`."""
        measured = Measured.of(observation, self.info)
        memory, _ = recall(state, episode_start, self.begin(1), len(measured.centre), measured.arrived)
        measured = self.expected(measured, memory)
        return self.steer(measured, self.lead * self.velocity(measured), memory)

    def reach(self, heading: np.ndarray) -> np.ndarray:
        """(batch, parts, 2) m, how far parts reach from their centres along and across the table."""
        cosine, sine = np.abs(np.cos(heading)), np.abs(np.sin(heading))
        half = np.array([np.abs(outline).max(axis=0) for outline in self.outline])
        return np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)

    def velocity(self, measured: Measured) -> np.ndarray:
        """Set velocities (batch, parts, 2), m/s."""
        traffic, centre, top = self.traffic, measured.centre, self.top
        reach = self.reach(measured.heading)
        between = centre[:, None] - centre[:, :, None]  # of part i (first axis) to part j
        gap = np.abs(between) - reach[:, :, None] - reach[:, None]
        there = measured.present[:, :, None] & measured.present[:, None] & ~np.eye(centre.shape[1], dtype=bool)
        # The part that is farther along has priority.
        ahead = there & (
            (between[..., 0] > 0.0) | ((between[..., 0] == 0.0) & np.triu(np.ones(gap.shape[1:3], bool), 1))
        )
        way = np.clip((centre[..., 0] - self.inlet) / (0.5 * (self.gate - self.inlet)), 0.0, 1.0)
        wanted = traffic.near + way * (self.spacing + traffic.spare - traffic.near)
        along, across = gap[..., 0], gap[..., 1]
        in_way = ahead & (across < traffic.beside)
        follow = measured.velocity[:, None, :, 0] + (along - wanted[:, :, None]) / traffic.along
        vx = np.minimum(top, np.where(in_way, follow, np.inf).min(axis=2))
        vy = np.clip((self.lane - centre[..., 1]) / traffic.across, -traffic.slip * top, traffic.slip * top)
        # No part approaches one beside it: the one behind gives way.
        beside = ahead & (along < traffic.near)
        room = np.maximum(across - traffic.beside, 0.0) / traffic.along
        up, down = beside & (between[..., 1] > 0.0), beside & (between[..., 1] <= 0.0)
        vy = np.minimum(vy, np.where(up, room, np.inf).min(axis=2))
        vy = np.maximum(vy, -np.where(down, room, np.inf).min(axis=2))
        vx = np.clip(vx, 0.0, np.sqrt(np.maximum(top**2 - vy**2, 0.0)))
        return np.stack([vx, vy], axis=-1)


@dataclass(frozen=True)
class Passing:
    """How parts pass one another.

    Raises:
        ValueError: a bad value.
    """

    near: float = 0.003  # m, distance that parts keep
    ahead: float = 0.35  # s that parts look ahead
    meeting: float = 4.0  # price of meeting at once, over that of rest for one that would like to go at the top speed
    yields: float = 0.3  # share of that which a part reckons for those over which it has right of way
    steady: float = 0.1  # price of a velocity that is the top speed away from the present one
    over: float = 0.004  # m, that parts may stick out of the surface
    side: float = 0.8  # most velocity towards the own side of the table over the top speed
    hold: float = 0.13  # m between centres, along the table, that those keep who meet one on the wrong side
    hold_across: float = 0.052  # m between centres, across the table, within which they do
    patience: float = 0.15  # s that a part waits off its goal, without oncoming parts, until a planner takes over
    crosses: float = 0.15  # m along the table to the goal, from which on others may come towards a part
    turn_at: float = 0.060  # m from the goal, where parts turn to its heading

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, checks.number(each.name, getattr(self, each.name), above=0.0))


class CrossingPolicy(TwoPhasesPolicy):
    """Lanes along the table in which parts keep apart: both ways past one another.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Passing`, and of :class:`.two_phases.TwoPhasesPolicy`.

    Raises:
        ValueError: a task whose parts have no goal poses, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        own = {each.name: settings.pop(each.name) for each in fields(Passing) if each.name in settings}
        if not info.has_goal or info.goal_moves:
            required = "a task whose parts have fixed goal poses, such as Swap, or leave through gates, such as Feed"
            raise info.unsupported("lanes", required)
        super().__init__(info, **settings)
        self.passing = passing = Passing(**own)
        self.top = info.plant.top_speed
        self.half = np.array([np.abs(part.outline).max(axis=0) for part in info.parts])
        self.rules = Rules(
            info.surface.width, info.surface.depth, self.top, passing.over, passing.near, 1.0 / self.lead, passing.ahead,
            passing.meeting, passing.yields, passing.steady,
        )  # fmt: skip

    def choose(self, measured: Measured, memory: planner.Memory) -> tuple[np.ndarray, np.ndarray]:
        """Set velocities, as planners have them; in worlds where parts meet those of traffic."""
        velocity, waited = super().choose(measured, memory)
        wanted, first, meets = self.wanted(measured)
        crossing, patience = meets.any(axis=1), self.passing.patience
        patient = np.where(measured.present, waited, 0.0).max(axis=1) < patience
        # Once lost without any parts meeting, patience is not regained.
        waited = np.where((crossing | patient)[:, None], waited, np.maximum(waited, patience))
        some = np.flatnonzero(crossing | patient)
        if len(some):
            velocity[some] = self.pass_by(measured, wanted, first, some)
        return velocity, waited

    def pass_by(self, measured: Measured, wanted: np.ndarray, first: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Velocities (n, parts, 2) of the parts of some worlds that fit to one another, m/s; see :meth:`wanted`."""
        crowd = Crowd(
            present=measured.present[worlds],
            centre=np.ascontiguousarray(measured.centre[worlds]),
            reach=self.reach(measured.heading[worlds]),
            wanted=np.ascontiguousarray(wanted[worlds]),
            order=np.argsort(first[worlds], axis=1, kind="stable"),
            pose=measured.pose[worlds],
        )
        chosen = measured.velocity[worlds]

        def choose(start: int, stop: int) -> None:
            choose_velocities(start, stop, self.rules, self.hulls, crowd, chosen)

        workers.share(choose, len(worlds), self.threads)
        return chosen

    def reach(self, heading: np.ndarray) -> np.ndarray:
        """(batch, parts, 2) m, how far parts reach from their centres along and across the table."""
        cosine, sine, half = np.abs(np.cos(heading)), np.abs(np.sin(heading)), self.half
        return np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)

    def _turn(self, measured: Measured) -> np.ndarray:
        far = np.hypot(*np.moveaxis(measured.way, -1, 0)) > self.passing.turn_at
        return np.where(far, -wrap(measured.heading, self.symmetry), super()._turn(measured))

    def wanted(self, measured: Measured) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What parts would like.

        Returns:
            Velocities (batch, parts, 2), m/s; (batch, parts) numbers, least of those who go first; (batch, parts) bool, whether
            some come towards a part.
        """
        x, y, way, passing = measured.centre[..., 0], measured.centre[..., 1], measured.way, self.passing
        away = np.hypot(way[..., 0], way[..., 1])
        speed = np.minimum(away / self.lead, self.top)
        straight = (speed / np.maximum(away, 1e-12))[..., None] * way
        # Which way a part goes, as long as it is far from its goal along the table.
        side = np.where((np.abs(way[..., 0]) > passing.crosses) & measured.present, np.sign(way[..., 0]), 0.0)
        between = x[:, None] - x[:, :, None]
        oncoming = (between * side[:, :, None] > 0.0) & (side[:, None] * side[:, :, None] < 0.0)
        meets: np.ndarray = np.asarray(oncoming.any(axis=2))
        width, quarter, most = self.half[:, 1], 0.25 * self.info.surface.depth, passing.side * self.top
        room = np.maximum(quarter - width, 0.0)  # off the middle of a half
        middle = 2.0 * quarter - side * quarter
        across = np.clip(y, middle - room, middle + room) - y
        vy = np.clip(across / self.lead, -most, most)
        # Who is on the wrong side gets out of the way, and who comes towards it waits for that, or makes room at the border.
        wrong = (np.abs(across) > width) & (side != 0.0)
        before, apart = oncoming & (wrong[:, None] | wrong[:, :, None]), np.abs(between)
        beside = np.abs(y[:, None] - y[:, :, None]) < passing.hold_across
        free = np.maximum(apart - passing.hold, 0.0) / (2.0 * self.lead)
        free = np.where(before & beside, free, np.inf).min(axis=2)
        aside = (before & (apart < 2.0 * passing.hold)).any(axis=2)
        vy = np.where(aside, np.clip((middle - side * room - y) / self.lead, -most, most), vy)
        vy = np.where(wrong, np.sign(across) * most, vy)
        vx = side * np.minimum(np.sqrt(np.maximum(self.top**2 - vy**2, 0.0)), free)
        length = self.info.surface.width + self.info.surface.depth
        progress = np.where(side > 0.0, self.info.surface.width - x, x)
        first = np.where(meets, np.where(wrong, length, 0.0) + progress, 3.0 * length - away)
        return np.where(meets[..., None], np.stack([vx, vy], axis=-1), straight), first, meets
