"""What policies are and are made from: the protocol, their registry, and the public properties of an environment."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.actuators import DataSheet
from vibgym.allocation.allocator import strongest
from vibgym.envs.features import Layout
from vibgym.registry import Registry
from vibgym.scene.kinds import Kinds
from vibgym.simulation.plant import Sliding, plant_of
from vibgym.tasks.base import kinds_by_name


class Policy(Protocol):
    """A policy, made for an environment with this ``action=`` and ``observation=``; the call is that of SB3's models.

    It gets observations only; public properties of the environment are in :class:`TaskInfo`.
    """

    action: str
    observation: str

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions (n,) or (batch, n) for one observation or a batch, and the state for the next call.

        Args:
            observation: one observation or a batch of them.
            state: returned by the last call; None in the first one.
            episode_start: (batch,) bool, where an episode has just begun; None: nowhere, unless state is None.
            deterministic: False: a stochastic policy samples its actions.
        """
        ...


POLICIES: Registry[Any] = Registry("policy", {})
"""Policies and control laws by name, each made as ``POLICIES[name](info, settings)`` from a :class:`TaskInfo` and the item's
``Settings``; :mod:`vibgym.policies` has the table. ``POLICIES.register(name, cls)`` adds a custom one.

A law (:class:`vibgym.policies.classical.law.Law`) computes wanted accelerations; :func:`vibgym.make_policy` makes the policy
that acts by it."""

SCENE = (
    "task", "surface", "parts", "model", "walls", "start", "zones", "slots", "task_settings", "periods_per_step"
)  # fmt: skip
"""Options of an environment in :attr:`TaskInfo.scene`: without hardware and randomization."""


@dataclass(frozen=True, eq=False)
class TaskInfo:
    """Task, scene and timing of an environment; its state is accessible by observations only."""

    name: str  # the environment's without "vibgym/" and version, such as "SortTwelve"; else the task's
    summary: str  # first paragraph of the task's documentation, in one line
    surface: Surface
    parts: tuple[Part, ...]
    kinds: tuple[str, ...]  # names of the kinds
    kind: tuple[int, ...]  # of each part
    walls: tuple[str, ...]
    zones: np.ndarray | None  # (kinds, 4) m: x_low, y_low, x_high, y_high; None where there are none
    has_goal: bool  # every part has a goal pose
    has_heading: bool  # headings count
    wraps: bool  # headings count modulo the symmetry of the part
    position_tolerance: float  # m
    heading_tolerance: float  # rad; infinite where headings do not count
    apart: float | None  # m, distance between parts that the task requires; None where it does not count
    goal_gap: float | None  # m, least distance between goals in all episodes; None where the task states none
    periods_per_step: int  # oscillation periods
    step_time: float  # s
    layout: Layout  # of the state observation
    parts_layout: tuple[Any, ...]  # columns of the observation by parts
    hardware: DataSheet  # of the actuators
    step_limit: int | None  # steps
    driven: tuple[bool, ...] = ()  # of each part: whether actions drive it
    scored: tuple[bool, ...] = ()  # of each part: whether success depends on it
    continuous_feed: bool = False  # parts arrive and leave during an episode
    goal_moves: bool = False  # during an episode, see vibgym.policies.classical.measured
    flat: bool = True  # parts stay flat on the surface, as in all models but "tilting"
    lead: int = 0  # periods by which measurements are ahead of the present: the estimator's prediction
    scene: Mapping[str, Any] = field(
        default_factory=dict
    )  # keyword arguments of an environment, for policies that simulate
    observation: str = "state"  # the environment's ``observation=``
    observation_space: Any = None  # of one world
    worlds: Kinds | None = None  # parts of the environment's worlds, live, where they differ

    @classmethod
    def of(cls, env: Any, name: str | None = None) -> TaskInfo:
        """Return the properties of an environment, single or vector, wrapped or not.

        Args:
            env: a :class:`vibgym.envs.VibgymEnv` or :class:`vibgym.envs.VibgymVectorEnv`.
            name: instead of the environment's.

        Raises:
            ValueError: another environment.
        """
        base, spec = getattr(env, "unwrapped", env), getattr(env, "spec", None)
        if not hasattr(base, "measurement_lead"):
            raise checks.refuse("env", env, "an environment of vibgym, single or vector, or its TaskInfo")
        task = base.task
        limit = base.max_episode_steps if spec is None else spec.max_episode_steps
        zones = None if task.zones is None else np.array(task.zones)
        if zones is not None:
            zones.setflags(write=False)
        return cls(
            name=name or (task.name if spec is None else spec.name),
            summary=" ".join((type(task).__doc__ or "").strip().split("\n\n")[0].split()),
            surface=base.surface,
            parts=base.parts,
            kinds=tuple(task.kinds),
            kind=tuple(np.asarray(task.kind).tolist()),
            walls=tuple(base.walls),
            zones=zones,
            has_goal=task.has_goal,
            has_heading=task.has_heading,
            wraps=all(task.heading_period(part) > 0.0 for part in base.parts),
            position_tolerance=task.position_tolerance,
            heading_tolerance=task.heading_tolerance,
            apart=task.apart if math.isfinite(task.apart) else None,
            goal_gap=task.goal_gap,
            periods_per_step=base.periods_per_step,
            step_time=base.step_time,
            layout=Layout(base.surface, base.parts, task.features, task.slots),
            parts_layout=base.parts_layout,
            hardware=base.data_sheet,
            step_limit=limit,
            driven=tuple(task.driven.tolist()),
            scored=tuple(task.scored.tolist()),
            continuous_feed=task.continuous_feed,
            goal_moves=task.goal_moves,
            flat=base.core.simulator.flat,
            lead=base.measurement_lead,
            observation=base.core.options.observation,
            observation_space=getattr(env, "single_observation_space", None) or getattr(env, "observation_space", None),
            scene=copy.deepcopy({name: getattr(base.core.options, name) for name in SCENE}),
            worlds=base.core.kinds if base.core.kinds.vary else None,
        )

    def with_parts(self, parts: Sequence[Part]) -> TaskInfo:
        """Return the properties for worlds that all have these parts."""
        layout, scene = self.layout, {**self.scene, "parts": list(parts)}
        layout = Layout(self.surface, parts, layout.features, layout.slots)
        names, _ = kinds_by_name(parts)
        return replace(self, parts=tuple(parts), kinds=names, layout=layout, scene=scene, worlds=None)

    @property
    def plant(self) -> Sliding:
        """Return the parts as plants: accelerations by pushes of this hardware on this surface, and drag by friction."""
        return plant_of(self.surface, self.parts, strongest(self.surface, self.hardware))

    @property
    def hard_dead_zone(self) -> bool:
        """Return whether elements have a hard dead zone: no motion below a minimum commanded amplitude."""
        return self.hardware.dead_zone > 0.0 and self.hardware.dead_zone_form == "hard"

    def check_places(self, policy: str) -> None:
        """Raise ValueError for a task without goals, zones or a distance to keep."""
        if not self.has_goal and self.zones is None and self.apart is None:
            raise self.unsupported(policy, "a task with goals, zones or a distance to keep")

    def unsupported(self, policy: str, required: str) -> ValueError:
        """Return the error of a policy that requires another kind of task."""
        return checks.conflict(f"policy {policy!r} requires {required}, got task {self.name!r}")
