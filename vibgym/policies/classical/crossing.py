"""Lanes both ways: parts that meet others on their way keep to their side of the table, and all choose velocities that fit.

As long as some come towards it, a part keeps to the right, as the drivers of most countries do: those that go to the right end
to the lower half, the others to the upper one. Who is on the wrong side goes to its own as soon as there is room; who comes
towards it waits, or makes room at the border. All turn straight on the way, so that they take little of the width. Which
velocity a part gets of those that are near the one that it would like is :mod:`.traffic`'s business; those in front have right
of way. Where nobody meets anybody any more, and somebody has waited for a moment off its goal, the two phases of
:mod:`.two_phases` bring the parts to their goals.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical import planner
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.traffic import Crowd, Rules, choose_velocities
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation import threads as workers


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
    patience: float = (
        0.15  # s that a part waits off its goal, with nobody coming towards it, until a planner takes over
    )
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
            allowed = "tasks whose parts have goal poses that stay, such as Swap, or leave through gates, such as Feed"
            raise checks.refuse("policy 'lanes'", f"the task {info.name}", allowed)
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
        # Patience that is lost when nobody meets anybody any more does not come back.
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
