"""Lanes through the gates: every part to the lane of its kind, and along it at full speed, with room to the one ahead.

No part has a target: it has a velocity, as a car in traffic has. Whoever is farther along goes first, and those behind make
room: along the table they keep a distance to what is in their way, which grows on the way to the gate from next to nothing to
what the gate asks for; across it they change to their lane wherever nobody is beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.law import lead_of
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.classical.steering import Steering
from vibgym.policies.task_info import TaskInfo


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
            raise checks.refuse(
                "policy 'lanes'", f"the task {info.name}", "tasks whose parts leave through gates, such as Feed"
            )
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
        # Whoever is farther along goes first.
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
        # Nobody moves nearer to one that is beside: the one behind makes room.
        beside = ahead & (along < traffic.near)
        room = np.maximum(across - traffic.beside, 0.0) / traffic.along
        up, down = beside & (between[..., 1] > 0.0), beside & (between[..., 1] <= 0.0)
        vy = np.minimum(vy, np.where(up, room, np.inf).min(axis=2))
        vy = np.maximum(vy, -np.where(down, room, np.inf).min(axis=2))
        vx = np.clip(vx, 0.0, np.sqrt(np.maximum(top**2 - vy**2, 0.0)))
        return np.stack([vx, vy], axis=-1)
