"""Local fields with a plan: targets are given out, and parts keep their distance on the way and make way for each other.

The thesis's rule is that parts stay farther apart than the largest dimension of an element, so that none shares an element
(section 4.1). Every step each part chooses among simple motions beside those of the others
(:mod:`.motion_choice`). Who has the longest way left chooses first and has right of way: it reckons less for
coming near the others than they for coming near it, so they move aside, those that have arrived first of all. Where parts have
hardly moved for a while far from their targets they lose patience: the spacing rule counts less, and right of way more, until
one of them goes ahead.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical import steering
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.classical.motion_choice import STAY, Preferences, Scene, choose_motions
from vibgym.policies.classical.plant import plant_of
from vibgym.policies.classical.steering import Steering
from vibgym.policies.classical.targets import Targets, swap
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.simulation import threads as workers

ARRIVED = 0.020  # m from the target
SLOW = 0.050  # m/s
CALMING = 0.5  # s of waiting that are forgotten in a second of motion
BRAKING = 0.6  # share of the largest acceleration at which parts are expected to slow down
SWAP_GAIN = 0.010  # m, lest two parts swap targets to and fro


class Memory(NamedTuple):
    """What the planner hands on from step to step."""

    target: np.ndarray  # (batch, parts, 2) m
    motion: np.ndarray  # (batch, parts) int64, of vibgym.policies.classical.motion_choice
    waited: np.ndarray  # (batch, parts) s
    steering: steering.Memory


class PlannerPolicy(Steering):
    """Local fields whose targets are given out and whose parts keep their distance on the way.

    Parts with goal poses of their own have their targets; the others' are places in their zones, or far enough apart.

    Args:
        info: task, scene and step time.
        soft: s, price of a second in touch for breaking the spacing rule; it grows with the square of the distance lacking.
        hard: s, price of a second in touch for coming nearer than ``safe``.
        safe: m, distance that is kept where there is no room for more.
        yielding: share of these prices that a part reckons for those over which it has right of way.
        calm: s of waiting after which patience is halved.
        faithful: s, what another motion must be better than the last one.
        edge: m, distance of centres from the surface's border.
        inset: m, distance of targets from the other borders of their zones.
        **law: ``law`` and ``action`` of :class:`Steering`, and that law's settings.

    Raises:
        ValueError: a task that asks for no place, or a bad argument.
    """

    def __init__(
        self,
        info: TaskInfo,
        *,
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
        super().__init__(info, **law)
        info.check_places("planner")
        surface, plant = info.surface, plant_of(info)
        self.calm = checks.number("calm", calm, above=0.0)
        self.faithful = checks.number("faithful", faithful, least=0.0)
        edge = min(checks.number("edge", edge, above=0.0), 0.5 * surface.width, 0.5 * surface.depth)
        self.targets = Targets(info, edge, checks.number("inset", inset, least=0.0), 2.0 * self.slack)
        self.hulls, self.threads = hulls_of(info.parts), workers.available_threads()
        # Parts without zones may all swap targets: apart is apart.
        self.kind = self.targets.kind if info.zones is not None else np.zeros(len(info.parts), dtype=np.int64)
        self.preferences = Preferences(
            width=surface.width,
            depth=surface.depth,
            edge=edge,
            top_speed=plant.top_speed,
            acceleration=0.8 * plant.push.min(),
            braking=BRAKING * plant.push.min(),
            approach=1.0 / self.law.lead,
            spacing=self.targets.spacing,
            safe=checks.number("safe", safe, above=0.0),
            soft=checks.number("soft", soft, least=0.0),
            hard=checks.number("hard", hard, least=0.0),
            yielding=checks.number("yielding", yielding, least=0.0, most=1.0),
        )

    def initial(self, batch: int) -> Memory:
        """Memory at the very start, before anything has been seen."""
        shape = (batch, len(self.info.parts))
        return Memory(np.zeros((*shape, 2)), np.full(shape, STAY), np.zeros(shape), self.begin(batch))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is a :class:`Memory`."""
        measured, period = Measured.of(observation, self.info), self.info.step_time
        batch = len(measured.centre)
        (target, motion, waited, steered), new = recall(state, episode_start, self.initial(1), batch)
        measured = self.expected(measured, steered)
        centre, present = np.ascontiguousarray(measured.centre), measured.present
        if self.info.has_goal:
            target = centre + measured.way
        else:
            for world in np.flatnonzero(new):
                target[world] = self.targets.give(centre[world], present[world])
            swap(self.kind, present, centre, target, SWAP_GAIN)

        way = np.sqrt(((target - centre) ** 2).sum(axis=-1))
        stuck = (way > ARRIVED) & (np.sqrt((measured.velocity**2).sum(axis=-1)) < SLOW)
        waited = np.where(stuck, waited + period, np.maximum(waited - CALMING * period, 0.0))
        scene = Scene(
            present=present,
            centre=centre,
            velocity=np.ascontiguousarray(measured.velocity),
            facing=np.stack([np.cos(measured.heading), np.sin(measured.heading)], axis=-1),
            target=target,
            patience=1.0 / (1.0 + (waited / self.calm) ** 2),
            order=np.argsort(-way, axis=1, kind="stable"),
        )
        velocity = np.empty_like(centre)

        def choose(start: int, stop: int) -> None:
            choose_motions(start, stop, self.preferences, self.hulls, scene, self.faithful, motion, velocity)

        workers.share(choose, batch, self.threads)
        action, steered = self.steer(measured, self.law.lead * velocity, steered)
        return action, Memory(target, motion, waited, steered)

    def acted(self, memory: Any, said: np.ndarray, done: np.ndarray) -> Any:
        """See :meth:`vibgym.policies.classical.steering.Steering.acted`."""
        return memory._replace(steering=super().acted(memory.steering, said, done))
