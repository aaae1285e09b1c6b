"""Local fields with a plan: targets are given out, and parts keep their distance on the way and make way for each other.

The thesis's rule is that parts stay farther apart than the largest dimension of an element, so that none shares an element
(section 4.1). Every step each part chooses among simple motions beside those of the others (:mod:`agents.control.motions`).
Who has the longest way left chooses first and has right of way: it reckons less for coming near the others than they for coming
near it, so they move aside, those that have arrived first of all. Where parts have stood for a while far from their targets
they lose patience: the spacing rule counts less, and right of way more, until one of them goes ahead.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from agents.control.crowd_seen import see_crowd
from agents.control.local_fields import LocalFieldsPolicy
from agents.control.motions import STAY, Rules, choose_motions
from agents.control.seen import started
from agents.control.slots import Slots, swap
from agents.policy import Situation
from vibgym import checks
from vibgym.scene.hulls import hulls_of

ARRIVED = 0.020  # m from the target
STANDING = 0.050  # m/s
CALMING = 0.5  # s of waiting that are forgotten in a second of motion
SWAP_GAIN = 0.010  # m, lest two parts swap targets to and fro


class Memory(NamedTuple):
    """What the planner hands on from step to step."""

    target: np.ndarray  # (worlds, parts, 2) m
    motion: np.ndarray  # (worlds, parts) int64, of agents.control.motions
    waited: np.ndarray  # (worlds, parts) s


class PlannerPolicy(LocalFieldsPolicy):
    """Local fields whose targets are given out and whose parts keep their distance on the way, as "phasor" actions.

    Args:
        situation: task, surface and parts.
        soft: s, price of a second in touch for breaking the spacing rule; it grows with the square of the distance lacking.
        hard: s, price of a second in touch for coming nearer than ``safe``.
        safe: m, distance that is kept where there is no room for more.
        yielding: share of these prices that a part reckons for those over which it has right of way.
        calm: s of waiting after which patience is halved.
        faithful: s, what another motion must be better than the last one.
        edge: m, distance of centres from the surface's border.
        inset: m, distance of targets from the other borders of their zones.
        **law: ``rule``, ``response``, ``braking``, ``approach`` of :class:`LocalFieldsPolicy`.

    Raises:
        ValueError: a task for one part, or a bad argument.
    """

    name = "planner"

    def __init__(
        self,
        situation: Situation,
        soft: float = 3.0,
        hard: float = 20.0,
        safe: float = 0.010,
        yielding: float = 0.3,
        calm: float = 0.5,
        faithful: float = 0.02,
        edge: float = 0.026,
        inset: float = 0.020,
        **law: Any,
    ) -> None:
        super().__init__(situation, **law)
        surface = situation.surface
        self.calm = checks.number("calm", calm, above=0.0)
        self.faithful = checks.number("faithful", faithful, least=0.0)
        edge = min(checks.number("edge", edge, above=0.0), 0.5 * surface.width, 0.5 * surface.height)
        self.slots = Slots(situation, edge, checks.number("inset", inset, least=0.0))
        self.hulls = hulls_of(situation.parts)
        # Parts without zones may all swap targets: apart is apart.
        self.kind = self.slots.kind if situation.zones is not None else np.zeros(len(situation.parts), dtype=np.int64)
        self.rules = Rules(
            width=surface.width,
            height=surface.height,
            edge=edge,
            top_speed=self.top_speed,
            acceleration=0.8 * self.push.min(),
            braking=self.braking * self.push.min(),
            approach=self.approach,
            spacing=self.slots.spacing,
            safe=checks.number("safe", safe, above=0.0),
            soft=checks.number("soft", soft, least=0.0),
            hard=checks.number("hard", hard, least=0.0),
            yielding=checks.number("yielding", yielding, least=0.0, most=1.0),
        )

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Phasors from the measured poses and mean velocities; the state is a :class:`Memory`."""
        seen = see_crowd(observation, self.situation)
        new = started(state, episode_start, len(seen.centre))
        if state is None:
            state = Memory(seen.centre, np.empty(seen.present.shape, np.int64), np.empty(seen.present.shape))
        target, motion, waited = (array.copy() for array in state)
        motion[new], waited[new] = STAY, 0.0
        for world in np.flatnonzero(new):
            target[world] = self.slots.give(seen.centre[world], seen.present[world])
        swap(self.kind, seen.present, seen.centre, target, SWAP_GAIN)

        way = np.sqrt(((target - seen.centre) ** 2).sum(axis=-1))
        period = self.situation.surface.period
        stuck = (way > ARRIVED) & (np.sqrt((seen.velocity**2).sum(axis=-1)) < STANDING)
        waited = np.where(stuck, waited + period, np.maximum(waited - CALMING * period, 0.0))
        patience = 1.0 / (1.0 + (waited / self.calm) ** 2)
        order = np.argsort(-way, axis=1, kind="stable")
        turned = np.stack([np.cos(seen.heading), np.sin(seen.heading)], axis=-1)
        velocity = np.empty_like(seen.centre)
        choose_motions(
            self.rules,
            self.hulls,
            seen.present,
            order,
            np.ascontiguousarray(seen.centre),
            turned,
            np.ascontiguousarray(seen.velocity),
            target,
            patience,
            self.faithful,
            motion,
            velocity,
        )
        return self.steer(seen, velocity), Memory(target, motion, waited)
