"""Local fields that keep the parts apart."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from agents.classical.crowd_seen import see_crowd
from agents.classical.local_fields import TOP_SPEED, LocalFieldsPolicy
from agents.classical.motions import WAIT, Rules, choose_motions
from agents.classical.seen import started
from agents.classical.slots import Slots, swap
from agents.policy import Situation
from vibgym.scene.hulls import hulls_of


class Memory(NamedTuple):
    """What the planner hands on from step to step."""

    target: np.ndarray  # (worlds, parts, 2) m
    motion: np.ndarray  # (worlds, parts) int64


class PlannerPolicy(LocalFieldsPolicy):
    """Local fields and a plan."""

    def __init__(self, situation: Situation, soft: float = 1.0, hard: float = 20.0, yielding: float = 0.3, safe: float = 0.010,
                 faithful: float = 0.05, edge: float = 0.026, inset: float = 0.02, turn=1.0, **law: Any) -> None:
        super().__init__(situation, **law)
        surface = situation.surface
        self.slots = Slots(situation, edge, inset)
        self.hulls = hulls_of(situation.parts)
        self.faithful = faithful
        self.rules = Rules(
            width=surface.width, height=surface.height, edge=edge, top_speed=TOP_SPEED,
            acceleration=0.8 * self.push.min(), braking=self.braking * self.push.min(), approach=self.approach,
            spacing=self.slots.spacing, safe=safe, soft=soft, hard=hard, yielding=yielding,
        )

    def predict(self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True) -> tuple[np.ndarray, Any]:
        seen = see_crowd(observation, self.situation)
        new = started(state, episode_start, len(seen.centre))
        if state is None:
            target, motion = seen.centre.copy(), np.full(seen.present.shape, WAIT + 2)
        else:
            target, motion = state.target.copy(), state.motion.copy()
        for world in np.flatnonzero(new):
            target[world] = self.slots.give(seen.centre[world], seen.present[world])
            motion[world] = WAIT + 2
        kind = self.slots.kind if self.situation.zones is not None else np.zeros_like(self.slots.kind)
        swap(kind, seen.present, seen.centre, target, 0.01)
        way = np.sqrt(((target - seen.centre) ** 2).sum(axis=-1))
        order = np.argsort(-way, axis=1, kind="stable")
        turned = np.stack([np.cos(seen.heading), np.sin(seen.heading)], axis=-1)
        velocity = np.empty_like(seen.centre)
        choose_motions(self.rules, self.hulls, seen.present, order, seen.centre, turned, seen.velocity, target, self.faithful, motion, velocity)
        return self.steer(seen, velocity), Memory(target, motion)
