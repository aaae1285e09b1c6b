"""Planner for several parts: it assigns targets, and parts keep their distance and make way for each other.

The thesis's rule is that parts stay farther apart than the largest dimension of an element, so that none shares an element
(section 4.1). Every step each part chooses among simple motions beside those of the others (:mod:`.motion_choice`). The part
with the longest displacement left chooses first and has right of way: its price for coming near others is lower than theirs
for coming near it, so they move aside, parts that have arrived first. Parts that have hardly moved for a while far from their
targets lose patience: the spacing rule counts less, and right of way more, until one of them goes ahead.

Where goals are nearer together than the rule, it requires no more of two parts than the distance of their goals as they
approach them. Parts that leave the table go to the far end of their kind's gate, each at its own height, and the part nearest
to the gate has right of way.
"""

from __future__ import annotations

import logging
import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from vibgym.physics.contacts.hulls import all_gaps
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.motion_choice import STAY, Preferences, Scene, choose_motions
from vibgym.policies.classical.steering import Steering, SteeringMemory
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.scene.outlines import convex_hull, inner_distance
from vibgym.settings import Length
from vibgym.simulation import threads as workers
from vibgym.tasks.assignment import exchange_goals
from vibgym.tasks.starts import lattice

LOGGER = logging.getLogger("vibgym")

SHIFTS = 9  # shifts along the table that are tried of the lattice that separates a heap
SPARE = 1.003  # pitch of the lattice over the smallest that keeps the spacing rule
BEFORE = 0.04  # m from the gate, where parts wait that are not yet at its height


def places(low: np.ndarray, high: np.ndarray, size: np.ndarray, spacing: float, least: int) -> np.ndarray:
    """Return centres (n, 2) m, n >= ``least``, for parts of ``size`` (2,) m at heading 0: ``spacing`` apart if there is room.

    Where there is not, rows or columns are added until they suffice, each where it costs the least distance.
    """
    middle = 0.5 * (low + high)
    low, high = np.minimum(low, middle), np.maximum(high, middle)  # without room, one in the middle
    pitch = SPARE * (size + spacing)
    while True:
        centres = pitch * lattice(low / pitch, high / pitch, 0.0, 1.0)
        if len(centres) >= least:
            return centres
        # The pitch that gains a column, or a row.
        tight = (high - low) / [len(np.unique(column)) for column in centres.T]
        k = int(np.argmax(tight / size))
        pitch[k] = tight[k]


def assign(centre: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return one of the free places (n, 2) m for each centre (n, 2) m, with the least sum of cubed distances."""
    from scipy.optimize import linear_sum_assignment  # of the extra "policies"

    displacement = np.sqrt(((centre[:, None] - free) ** 2).sum(axis=-1))
    return free[linear_sum_assignment(displacement**3)[1]]


class Targets:
    """Assigns targets to all parts of a world.

    Args:
        info: surface, parts, kinds and zones.
        edge: m, distance of targets from the surface's border.
        inset: m, distance from the other borders of a zone.
        slack: m, added to the distance of targets, since parts do not come to rest exactly there.

    Attributes:
        spacing: m, distance that parts keep: the largest dimension of an element, so that none shares one, or the task's.
        room: m, distance of targets, where there is room.
    """

    def __init__(self, info: TaskInfo, edge: float, inset: float, slack: float = 0.0) -> None:
        if not info.has_goal:
            import scipy.optimize  # noqa: F401  -- if missing, raise here rather than in the first episode
        surface, parts = info.surface, info.parts
        self.zones, self.kind = info.zones, np.array(info.kind)
        self.spacing = max(math.sqrt(2.0) * surface.element_size, info.apart or 0.0)
        self.room = self.spacing + slack
        radius = np.array([part.radius for part in parts])
        edge = min(edge, radius.max())  # small surfaces and zones hold parts by their circles, as these rectangles do
        self.low, self.high = np.full(2, edge), np.array([surface.width, surface.depth]) - edge
        # Twice the reach from the centre, on the larger side, so that parts of any shape in neighbouring places are clear.
        self.size = np.array([2.0 * np.abs(part.outline).max(axis=0) for part in parts])
        self.places = []
        for kind, zone in enumerate(() if info.zones is None else info.zones):
            own = self.kind == kind
            border = min(inset, radius[own].max())
            low, high = np.maximum(zone[:2] + border, self.low), np.minimum(zone[2:] - border, self.high)
            self.places.append(places(low, high, self.size[own].max(axis=0), self.room, int(own.sum())))

    def give(self, centre: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Return targets (parts, 2) m of one world's parts at ``centre`` (parts, 2) m; absent parts stay."""
        target = centre.copy()
        if self.zones is None:
            target[present] = self._apart(centre[present])
        for kind, free in enumerate(self.places):
            own = present & (self.kind == kind)
            target[own] = assign(centre[own], free)
        return target

    def leaving(self, centre: np.ndarray) -> np.ndarray:
        """Return targets (batch, parts, 2) m at the far end of each part's gate, each at the part's own height.

        Parts that are not yet at the height of their gate go there first, before the gates (:data:`BEFORE`).
        """
        assert self.zones is not None
        zone = self.zones[self.kind]
        inset = np.minimum(self.size[:, 1], 0.5 * (zone[:, 3] - zone[:, 1]))
        height = np.clip(centre[..., 1], zone[:, 1] + 0.5 * inset, zone[:, 3] - 0.5 * inset)
        there = (centre[..., 1] > zone[:, 1]) & (centre[..., 1] < zone[:, 3])
        return np.stack([np.where(there, zone[:, 2], zone[:, 0] - BEFORE), height], axis=-1)

    def _apart(self, centre: np.ndarray) -> np.ndarray:
        """Return places of the lattice, shifted along the table so that the longest displacement is shortest."""
        free = places(self.low, self.high, self.size.max(axis=0), self.room, len(centre))
        pitch = self.size[:, 0].max() + self.room
        best, least = free, math.inf
        for shift in np.linspace(-0.5, 0.5, SHIFTS) * pitch:
            moved = free + [shift, 0.0]
            moved = moved[(moved[:, 0] >= self.low[0] - 1e-9) & (moved[:, 0] <= self.high[0] + 1e-9)]
            if len(moved) >= len(centre):
                target = assign(centre, moved)
                longest = np.sqrt(((target - centre) ** 2).sum(axis=-1)).max(initial=0.0)
                if longest < least:
                    best, least = target, longest
        return best if least < math.inf else assign(centre, free)


ARRIVED = 0.020  # m from the target
SLOW = 0.050  # m/s
CALMING = 0.5  # s of waiting that are forgotten in a second of motion
ACCELERATION = 0.8  # share of the largest push that parts are expected to gain speed by
BRAKING = 0.6  # share of the largest acceleration at which parts are expected to slow down
SWAP_GAIN = 0.010  # m, minimum gain of a swap, so that two parts do not swap targets repeatedly
NEARING = 0.5  # m that two parts keep beyond the distance of their goals for each m of their displacements
SERVED = 0.036  # m between goals below which some or all episodes fail, which is logged as a warning
MIN_SPACING, MIN_SAFE = 1e-3, 5e-4  # m, lower limits of the spacing rule and the safe distance at goals


class TargetPlan(NamedTuple):
    """The planner's own memory."""

    target: np.ndarray  # (batch, parts, 2) m
    motion: np.ndarray  # (batch, parts) int64, of vibgym.policies.classical.motion_choice
    waited: np.ndarray  # (batch, parts) s
    room: np.ndarray  # (batch, parts, parts) m, distance of two parts at their targets; infinite where it is not used


class PlannerPolicy(Steering):
    """Assigns targets to parts, and keeps them apart on the way.

    Targets are the goals, or else places in the zones of the parts, or places far enough apart.

    Raises:
        ValueError: a task without goals, zones or distances, or a bad setting of the law.
    """

    class Settings(Steering.Settings):
        """How parts keep their distance, and the law's settings."""

        soft: float = Field(default=3.0, ge=0.0)
        """Price of a second in touch for breaking the spacing rule, s; it grows with the square of the distance lacking."""

        hard: float = Field(default=20.0, ge=0.0)
        """Price of a second in touch for coming nearer than ``safe``, s."""

        safe: Length = Field(default=0.010, gt=0.0)
        """Distance that is kept where there is no room for more."""

        yielding: float = Field(default=0.3, ge=0.0, le=1.0)
        """Share of these prices for a part that has right of way over the other."""

        calm: float = Field(default=0.5, gt=0.0)
        """Waiting time after which patience is halved, s."""

        faithful: float = Field(default=0.02, ge=0.0)
        """By which another motion must be better than the last one, s."""

        edge: Length = Field(default=0.026, gt=0.0)
        """Distance of centres from the surface's border."""

        inset: Length = Field(default=0.020, ge=0.0)
        """Distance of targets from the other borders of their zones."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        info.check_places("planner")
        surface, plant, rules = info.surface, info.plant, self.settings
        edge = min(rules.edge, 0.5 * surface.width, 0.5 * surface.depth)
        self.targets = Targets(info, edge, rules.inset, 2.0 * self.slack)
        if type(self) is PlannerPolicy and info.goal_gap is not None and info.goal_gap < SERVED:
            text = "goals of %s are %.3g mm apart: below %g mm the planner jams, since parts that have arrived are in the way"
            LOGGER.warning(f"{text}; policy 'two_phases' does not", info.name, 1e3 * info.goal_gap, 1e3 * SERVED)
        self.tight = info.has_goal and not info.goal_moves and len(info.parts) > 1
        self.hulls, self.threads = hulls_of(info.parts), workers.available_threads()
        # Without zones all parts may swap targets.
        self.kind = self.targets.kind if info.zones is not None else np.zeros(len(info.parts), dtype=np.int64)
        self.inner = np.array([inner_distance(convex_hull(part.outline)) for part in info.parts])
        self.preferences = Preferences(
            width=surface.width,
            depth=surface.depth,
            edge=edge,
            top_speed=self.top,
            acceleration=ACCELERATION * plant.push.min(),
            braking=BRAKING * plant.push.min(),
            approach=1.0 / self.lead,
            soft=rules.soft,
            hard=rules.hard,
            yielding=rules.yielding,
        )

    def initial(self, batch: int) -> SteeringMemory:
        """Return the memory at the start of an episode."""
        shape = (batch, len(self.info.parts))
        room = np.full((*shape, shape[1]), np.inf)
        plan = TargetPlan(np.zeros((*shape, 2)), np.full(shape, STAY), np.zeros(shape), room)
        return super().initial(batch)._replace(own=plan)

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """See :meth:`.steering.Steering.act`."""
        plan = self.aim(measured, memory.own, new)
        velocity, waited = self.choose(measured, plan)
        return self.steer(measured, self.lead * velocity, memory._replace(own=plan._replace(waited=waited)))

    def aim(self, measured: Measured, plan: TargetPlan, new: np.ndarray) -> TargetPlan:
        """Return the plan with the targets of this step; ``new`` (batch,) bool: worlds whose episode has just begun."""
        centre, present, target = measured.centre, measured.present, plan.target
        if self.info.has_goal:
            target = centre + measured.displacement
            if self.tight and new.any():
                plan.room[new] = self.distances(
                    target[new], (measured.heading + measured.heading_error)[new], present[new]
                )
        elif self.info.continuous_feed:
            target = self.targets.leaving(centre)
        else:
            for world in np.flatnonzero(new):
                target[world] = self.targets.give(centre[world], present[world])
            exchange_goals(self.kind, present, np.ascontiguousarray(centre), target, SWAP_GAIN, np.arange(len(target)))
        return plan._replace(target=target)

    def distances(self, target: np.ndarray, heading: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Return distances (n, parts, parts) m between parts at ``target`` (n, parts, 2) m with ``heading`` (n, parts) rad.

        Infinite for absent parts.
        """
        room = np.empty((*heading.shape, heading.shape[1]))
        all_gaps(self.hulls, np.concatenate([target, heading[..., None]], axis=-1), room)
        return np.where(present[:, :, None] & present[:, None], room, np.inf)

    def choose(self, measured: Measured, plan: TargetPlan) -> tuple[np.ndarray, np.ndarray]:
        """Return set velocities (batch, parts, 2), m/s, and how long parts have waited (batch, parts), s.

        ``plan.motion`` is overwritten.
        """
        period, displacement = self.info.step_time, np.sqrt(((plan.target - measured.centre) ** 2).sum(axis=-1))
        stuck = (displacement > ARRIVED) & (np.sqrt((measured.velocity**2).sum(axis=-1)) < SLOW)
        waited = np.where(stuck, plan.waited + period, np.maximum(plan.waited - CALMING * period, 0.0))
        scene, faithful = self.scene(measured, plan.target, plan.room, waited), self.settings.faithful
        velocity = np.empty_like(scene.centre)

        def choose(start: int, stop: int) -> None:
            choose_motions(start, stop, self.preferences, self.hulls, scene, faithful, plan.motion, velocity)

        workers.share(choose, len(velocity), self.threads)
        return velocity, waited

    def scene(self, measured: Measured, target: np.ndarray, room: np.ndarray, waited: np.ndarray) -> Scene:
        """Return the input of the kernels.

        Args:
            target: (batch, parts, 2) m.
            room: (batch, parts, parts) m, distances at the targets.
            waited: (batch, parts) s.
        """
        centre, rules = np.ascontiguousarray(measured.centre), self.settings
        displacement = np.sqrt(((target - centre) ** 2).sum(axis=-1))
        room = room + NEARING * (displacement[:, :, None] + displacement[:, None])
        return Scene(
            present=measured.present,
            centre=centre,
            velocity=np.ascontiguousarray(measured.velocity),
            facing=np.stack([np.cos(measured.heading), np.sin(measured.heading)], axis=-1),
            target=np.ascontiguousarray(target),
            patience=1.0 / (1.0 + (waited / rules.calm) ** 2),
            order=np.argsort(self.right_of_way(displacement), axis=1, kind="stable"),
            spacing=np.clip(room, MIN_SPACING, self.targets.spacing),
            safe=np.clip(0.5 * room, MIN_SAFE, rules.safe),
            inner=self.inner,
        )

    def right_of_way(self, displacement: np.ndarray) -> np.ndarray:
        """Return sort keys (batch, parts) from distances to the targets, m: the smallest key has right of way."""
        return displacement if self.info.continuous_feed else -displacement
