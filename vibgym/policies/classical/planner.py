"""Local fields with a plan: targets are given out, and parts keep their distance on the way and make way for each other.

The thesis's rule is that parts stay farther apart than the largest dimension of an element, so that none shares an element
(section 4.1). Every step each part chooses among simple motions beside those of the others
(:mod:`.motion_choice`). Who has the longest way left chooses first and has right of way: it reckons less for
coming near the others than they for coming near it, so they move aside, those that have arrived first of all. Where parts have
hardly moved for a while far from their targets they lose patience: the spacing rule counts less, and right of way more, until
one of them goes ahead.

Where goals are nearer together than the rule, it asks no more of two parts than their goals have room for, as they near them.
Parts that leave the table go to the far end of their own kind's gate, each at the height at which it comes, and who is nearest
to the gate has right of way.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.hulls import all_gaps
from vibgym.policies.classical import steering
from vibgym.policies.classical.law import lead_of
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.classical.motion_choice import STAY, Preferences, Scene, choose_motions
from vibgym.policies.classical.steering import Steering
from vibgym.policies.classical.targets import Targets
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.scene.outlines import convex_hull
from vibgym.simulation import threads as workers
from vibgym.tasks.swap import exchange_goals

LOGGER = logging.getLogger("vibgym")

ARRIVED = 0.020  # m from the target
SLOW = 0.050  # m/s
CALMING = 0.5  # s of waiting that are forgotten in a second of motion
ACCELERATION = 0.8  # share of the largest push that parts are expected to gain speed by
BRAKING = 0.6  # share of the largest acceleration at which parts are expected to slow down
SWAP_GAIN = 0.010  # m, minimum gain of a swap, so that two parts do not swap targets repeatedly
NEARING = 0.5
"""m that two parts keep beyond the distance of their goals for each m that is left of their ways."""

SERVED = 0.036
"""m between goals below which some or all episodes fail: a warning says so."""

LEAST_SPACING, LEAST_SAFE = 1e-3, 5e-4
"""m, to which the spacing rule and the safe distance shrink at goals, at least."""


class Memory(NamedTuple):
    """What the planner hands on from step to step."""

    target: np.ndarray  # (batch, parts, 2) m
    motion: np.ndarray  # (batch, parts) int64, of vibgym.policies.classical.motion_choice
    waited: np.ndarray  # (batch, parts) s
    room: (
        np.ndarray
    )  # (batch, parts, parts) m, distance of two parts at their targets; infinite where it is not looked at
    steering: steering.Memory


@dataclass(frozen=True)
class Spacing:
    """How parts keep their distance.

    Raises:
        ValueError: a bad value.
    """

    # s, price of a second in touch for breaking the spacing rule; it grows with the square of the distance lacking
    soft: float = 3.0
    hard: float = 20.0  # s, price of a second in touch for coming nearer than ``safe``
    safe: float = 0.010  # m, distance that is kept where there is no room for more
    yielding: float = 0.3  # share of these prices that a part reckons for those over which it has right of way
    calm: float = 0.5  # s of waiting after which patience is halved
    faithful: float = 0.02  # s, what another motion must be better than the last one
    edge: float = 0.026  # m, distance of centres from the surface's border
    inset: float = 0.020  # m, distance of targets from the other borders of their zones

    def __post_init__(self) -> None:
        limits = {
            "safe": {"above": 0.0},
            "calm": {"above": 0.0},
            "edge": {"above": 0.0},
            "yielding": {"least": 0.0, "most": 1.0},
        }
        for name in (each.name for each in fields(self)):
            value = checks.number(name, getattr(self, name), **limits.get(name, {"least": 0.0}))
            object.__setattr__(self, name, value)  # the class is frozen


class PlannerPolicy(Steering):
    """Local fields whose targets are given out and whose parts keep their distance on the way.

    Parts with goal poses of their own have their targets; the others' are places in their zones, or far enough apart.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Spacing`; ``law``, ``action`` and ``learn`` of :class:`Steering`; and that law's own.

    Raises:
        ValueError: a task that asks for no place, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        own = {each.name: settings.pop(each.name) for each in fields(Spacing) if each.name in settings}
        super().__init__(info, **settings)
        info.check_places("planner")
        surface, plant, self.spacing = info.surface, info.plant, Spacing(**own)
        edge = min(self.spacing.edge, 0.5 * surface.width, 0.5 * surface.depth)
        self.targets = Targets(info, edge, self.spacing.inset, 2.0 * self.slack)
        if type(self) is PlannerPolicy and info.goal_gap is not None and info.goal_gap < SERVED:
            text = "goals of %s are %.3g mm apart: below %g mm the planner jams, since parts that have arrived are in the way"
            LOGGER.warning(f"{text}; policy 'two_phases' does not", info.name, 1e3 * info.goal_gap, 1e3 * SERVED)
        self.tight = info.has_goal and not info.goal_moves and len(info.parts) > 1
        self.hulls, self.threads = hulls_of(info.parts), workers.available_threads()
        # Parts without zones may all swap targets: apart is apart.
        self.kind = self.targets.kind if info.zones is not None else np.zeros(len(info.parts), dtype=np.int64)
        self.inner = np.array([covered(part.outline) for part in info.parts])
        self.lead = lead_of(self.law, info, 0.5 * plant.top_speed)
        self.preferences = Preferences(
            width=surface.width,
            depth=surface.depth,
            edge=edge,
            top_speed=plant.top_speed,
            acceleration=ACCELERATION * plant.push.min(),
            braking=BRAKING * plant.push.min(),
            approach=1.0 / self.lead,
            soft=self.spacing.soft,
            hard=self.spacing.hard,
            yielding=self.spacing.yielding,
        )

    def initial(self, batch: int) -> Memory:
        """Memory at the very start, before anything has been seen."""
        shape = (batch, len(self.info.parts))
        room = np.full((*shape, shape[1]), np.inf)
        return Memory(np.zeros((*shape, 2)), np.full(shape, STAY), np.zeros(shape), room, self.begin(batch))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is a :class:`Memory`."""
        measured = Measured.of(observation, self.info)
        memory, new = recall(state, episode_start, self.initial(1), len(measured.centre), measured.arrived)
        measured = self.expected(measured, memory.steering)
        memory = self.aim(measured, memory, new)
        velocity, waited = self.choose(measured, memory)
        action, steered = self.steer(measured, self.lead * velocity, memory.steering)
        return action, memory._replace(waited=waited, steering=steered)

    def aim(self, measured: Measured, memory: Memory, new: np.ndarray) -> Memory:
        """The memory with the targets of this step, in episodes of which those of ``new`` (batch,) have just begun."""
        centre, present, target = measured.centre, measured.present, memory.target
        if self.info.has_goal:
            target = centre + measured.way
            if self.tight and new.any():
                memory.room[new] = self.distances(target[new], (measured.heading + measured.turn)[new], present[new])
        elif self.info.flows:
            target = self.targets.leaving(centre)
        else:
            for world in np.flatnonzero(new):
                target[world] = self.targets.give(centre[world], present[world])
            exchange_goals(self.kind, present, np.ascontiguousarray(centre), target, SWAP_GAIN, np.arange(len(target)))
        return memory._replace(target=target)

    def distances(self, target: np.ndarray, heading: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Distances (n, parts, parts) m of parts at ``target`` (n, parts, 2) m with ``heading`` (n, parts) rad; infinite of
        absent ones."""
        room = np.empty((*heading.shape, heading.shape[1]))
        all_gaps(self.hulls, np.concatenate([target, heading[..., None]], axis=-1), room)
        return np.where(present[:, :, None] & present[:, None], room, np.inf)

    def choose(self, measured: Measured, memory: Memory) -> tuple[np.ndarray, np.ndarray]:
        """Set velocities (batch, parts, 2), m/s, and for how long parts have waited (batch, parts), s; ``memory.motion`` is
        overwritten."""
        period, way = self.info.step_time, np.sqrt(((memory.target - measured.centre) ** 2).sum(axis=-1))
        stuck = (way > ARRIVED) & (np.sqrt((measured.velocity**2).sum(axis=-1)) < SLOW)
        waited = np.where(stuck, memory.waited + period, np.maximum(memory.waited - CALMING * period, 0.0))
        scene, faithful = self.scene(measured, memory.target, memory.room, waited), self.spacing.faithful
        velocity = np.empty_like(scene.centre)

        def choose(start: int, stop: int) -> None:
            choose_motions(start, stop, self.preferences, self.hulls, scene, faithful, memory.motion, velocity)

        workers.share(choose, len(velocity), self.threads)
        return velocity, waited

    def scene(self, measured: Measured, target: np.ndarray, room: np.ndarray, waited: np.ndarray) -> Scene:
        """The parts at this instant, which go to ``target`` (batch, parts, 2) m, where they have ``room`` (batch, parts, parts)
        m, and have ``waited`` (batch, parts) s."""
        centre, rules = np.ascontiguousarray(measured.centre), self.spacing
        way = np.sqrt(((target - centre) ** 2).sum(axis=-1))
        room = room + NEARING * (way[:, :, None] + way[:, None])
        return Scene(
            present=measured.present,
            centre=centre,
            velocity=np.ascontiguousarray(measured.velocity),
            facing=np.stack([np.cos(measured.heading), np.sin(measured.heading)], axis=-1),
            target=np.ascontiguousarray(target),
            patience=1.0 / (1.0 + (waited / rules.calm) ** 2),
            order=np.argsort(self.right_of_way(way), axis=1, kind="stable"),
            spacing=np.clip(room, LEAST_SPACING, self.targets.spacing),
            safe=np.clip(0.5 * room, LEAST_SAFE, rules.safe),
            inner=self.inner,
        )

    def right_of_way(self, way: np.ndarray) -> np.ndarray:
        """(batch, parts), the smaller the sooner a part chooses, by the ways that are left, m."""
        return way if self.info.flows else -way

    def acted(self, memory: Any, proposed: np.ndarray, done: np.ndarray) -> Any:
        """See :meth:`vibgym.policies.classical.steering.Steering.acted`."""
        return memory._replace(steering=super().acted(memory.steering, proposed, done))


def covered(outline: np.ndarray) -> float:
    """Radius (m) of the circle about the origin within the convex hull of points (n, 2); 0 where there is none."""
    corners = convex_hull(outline)
    edge = np.roll(corners, -1, axis=0) - corners
    inward = (
        corners[:, 0] * edge[:, 1] - corners[:, 1] * edge[:, 0]
    )  # counter-clockwise: twice the area with the origin
    return max(float((inward / np.hypot(edge[:, 0], edge[:, 1])).min()), 0.0)
