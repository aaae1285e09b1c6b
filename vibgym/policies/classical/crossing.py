"""Lanes both ways: parts that meet others on their way keep to their side of the table, and all choose velocities that fit.

Parts with goal poses go straight to them. As long as some come towards it, a part keeps to the right, as the drivers of most
countries do: those that go to the right end to the lower half, the others to the upper one. All turn straight on the way, so
that they take little of the width, and to their goals' headings when they are near. Which velocity a part gets of those that
are near the one that it would like is :mod:`.traffic`'s business; right of way has who is farthest from its goal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical import steering
from vibgym.policies.classical.law import lead_of
from vibgym.policies.classical.measured import Measured, recall, wrap
from vibgym.policies.classical.steering import Steering
from vibgym.policies.classical.traffic import Crowd, Rules, choose_velocities
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.simulation import threads as workers


class Memory(NamedTuple):
    """What is handed on from step to step."""

    velocity: np.ndarray  # (batch, parts, 2) m/s, that the parts have chosen
    steering: steering.Memory


@dataclass(frozen=True)
class Passing:
    """How parts pass one another.

    Raises:
        ValueError: a bad value.
    """

    near: float = 0.004  # m, distance that parts keep
    ahead: float = 0.5  # s that parts look ahead
    meeting: float = 4.0  # price of meeting at once, over that of rest for one that would like to go at the top speed
    yielding: float = 0.3  # share of that which a part reckons for those over which it has right of way
    faithful: float = 0.1  # price of a velocity that is the top speed away from the last one
    edge: float = 0.004  # m, that parts may stick out of the surface
    side: float = 0.5  # most velocity towards the own side of the table over the top speed
    hold: float = 0.120  # m between centres, along the table, that those keep who meet one on the wrong side
    hold_across: float = 0.052  # m between centres, across the table, within which they do
    turn_at: float = 0.060  # m from the goal, where parts turn to its heading

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, checks.number(each.name, getattr(self, each.name), least=0.0))
        for name in ("ahead", "near"):
            checks.number(name, getattr(self, name), above=0.0)


class CrossingPolicy(Steering):
    """Lanes both ways, see the module.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Passing`; ``law``, ``action`` and ``learn`` of :class:`Steering`; and that law's own.

    Raises:
        ValueError: a task whose parts have no goal poses, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        own = {each.name: settings.pop(each.name) for each in fields(Passing) if each.name in settings}
        settings.setdefault("law", "pose")
        super().__init__(info, **settings)
        if not info.has_goal or info.goal_moves:
            allowed = "tasks whose parts have goal poses that stay, such as Swap, or leave through gates, such as Feed"
            raise checks.refuse("policy 'lanes'", f"the task {info.name}", allowed)
        self.passing, self.top, self.threads = Passing(**own), info.plant.top_speed, workers.available_threads()
        passing = self.passing
        self.hulls = hulls_of(info.parts)
        self.lead = lead_of(self.law, info, 0.5 * self.top)
        self.half = np.array([np.abs(part.outline).max(axis=0) for part in info.parts])
        self.rules = Rules(
            info.surface.width, info.surface.depth, self.top, passing.edge, passing.near, 1.0 / self.lead, passing.ahead,
            passing.meeting, passing.yielding, passing.faithful,
        )  # fmt: skip

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is a :class:`Memory`."""
        measured, parts = Measured.of(observation, self.info), len(self.info.parts)
        batch = len(measured.centre)
        initial = Memory(np.zeros((1, parts, 2)), self.begin(1))
        (velocity, steered), _ = recall(state, episode_start, initial, batch)
        measured = self.expected(measured, steered)
        away = np.sqrt((measured.way**2).sum(axis=-1))
        wanted, first = self.wanted(measured, away)
        crowd = Crowd(
            present=measured.present,
            centre=np.ascontiguousarray(measured.centre),
            reach=self.reach(measured.heading),
            wanted=wanted,
            order=np.argsort(first, axis=1, kind="stable"),
            pose=measured.pose,
        )

        def choose(start: int, stop: int) -> None:
            choose_velocities(start, stop, self.rules, self.hulls, crowd, velocity)

        workers.share(choose, batch, self.threads)
        straight = -wrap(measured.heading, self.symmetry)
        turn = np.where(away < self.passing.turn_at, measured.turn, straight)
        action, steered = self.steer(replace(measured, turn=turn), self.lead * velocity, steered)
        return action, Memory(velocity, steered)

    def reach(self, heading: np.ndarray) -> np.ndarray:
        """(batch, parts, 2) m, how far parts reach from their centres along and across the table."""
        cosine, sine, half = np.abs(np.cos(heading)), np.abs(np.sin(heading)), self.half
        return np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)

    def wanted(self, measured: Measured, away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (batch, parts, 2) that parts would like to have, m/s, and (batch, parts), least of who goes first."""
        x, y, way = measured.centre[..., 0], measured.centre[..., 1], measured.way
        speed = np.minimum(away / self.lead, self.top)
        straight = (speed / np.maximum(away, 1e-12))[..., None] * way
        # Which way a part goes, as long as it is far from its goal along the table.
        side = np.where((np.abs(way[..., 0]) > self.passing.turn_at) & measured.present, np.sign(way[..., 0]), 0.0)
        ahead = (x[:, None] - x[:, :, None]) * side[:, :, None] > 0.0
        meets = ((side[:, None] * side[:, :, None] < 0.0) & ahead).any(axis=2)
        width, quarter = self.half[:, 1], 0.25 * self.info.surface.depth
        room = np.maximum(quarter - width, 0.0)  # off the middle of a half
        middle = 2.0 * quarter - side * quarter
        across = np.clip(y, middle - room, middle + room) - y
        vy = np.clip(across / self.lead, -self.passing.side * self.top, self.passing.side * self.top)
        # Who is on the wrong side gets out of the way first, and who comes towards it waits for that.
        wrong = (np.abs(across) > self.half[:, 1]) & (side != 0.0)
        before = ahead & (side[:, None] * side[:, :, None] < 0.0) & (wrong[:, None] | wrong[:, :, None])
        beside = np.abs(y[:, None] - y[:, :, None]) < self.passing.hold_across
        between = np.abs(x[:, None] - x[:, :, None])
        free = np.where(before & beside, np.maximum(between - self.passing.hold, 0.0) / (2.0 * self.lead), np.inf).min(axis=2)
        aside = (before & (between < 2.0 * self.passing.hold)).any(axis=2)  # makes room at the border
        most = self.passing.side * self.top
        vy = np.where(aside & ~wrong, np.clip((middle - side * room - y) / self.lead, -most, most), vy)
        vy = np.where(wrong, np.sign(across) * most, vy)
        vx = side * np.minimum(np.sqrt(np.maximum(self.top**2 - vy**2, 0.0)), free)
        wanted = np.where(meets[..., None], np.stack([vx, vy], axis=-1), straight)
        length = self.info.surface.width + self.info.surface.depth
        progress = np.where(side > 0.0, self.info.surface.width - x, x)
        first = np.where(meets, np.where(wrong, length, 0.0) + progress, 3.0 * length - away)
        return np.ascontiguousarray(wanted), first
