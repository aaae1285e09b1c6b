"""What an episode is measured by: the least time that it needs, and collisions on its way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibgym.bounds import FlowBound, PushBound, SeveralBound, TimeBound
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.shared import SharedInterface, Truth
from vibgym.policies.rollout import Ends, Outcomes, Step, Timing
from vibgym.scene import Part
from vibgym.scene.hulls import gaps_between
from vibgym.tasks import Feed
from vibgym.tasks.episode import TOUCHING


@dataclass(frozen=True)
class Measured(Outcomes):
    """How episodes ended, with what each is measured by."""

    bound: np.ndarray  # s, least time to goal from this start, hold included; nan where none is known
    rate_bound: np.ndarray  # most good parts a minute, where parts come and go; nan elsewhere, and where none is known
    collisions: np.ndarray  # pairs newly in touch, see Touches; nan where the task does not count them

    @property
    def time_over_bound(self) -> np.ndarray:
        """Time to goal as a multiple of the least one; nan without success, and where no bound is known."""
        return self.time_to_goal / self.bound

    @property
    def rate_over_bound(self) -> np.ndarray:
        """Good parts a minute as a share of the most; nan where parts stay, and where no bound is known."""
        return self.fact("good_per_minute") / self.rate_bound


class Measures(Ends):
    """Keeps the ends, the least time that each episode needs, and the collisions on its way; one world an episode.

    Args:
        env, info, seeds: as of :class:`vibgym.policies.rollout.Ends`.

    Attributes:
        fields: arrays (episodes, ...), named as in :class:`Measured`.
    """

    def __init__(self, env: VibgymVectorEnv, info: dict[str, Any], seeds: Sequence[int]) -> None:
        super().__init__(env, info, seeds)
        self.touches = Touches(env.parts, len(seeds)) if "touching" in info else None
        self.fields |= {
            "bound": least_times(env),
            "rate_bound": most_rates(env),
            "collisions": np.full(len(seeds), np.nan if self.touches is None else 0.0),
        }
        if self.touches is not None:
            self.touches.new(env.truth, info["touching"] > 0)  # pairs in touch at the start do not count

    def add(self, step: Step) -> None:
        """What a step has brought."""
        super().add(step)
        if self.touches is not None:
            some = step.playing & (step.info["touching"] > 0)
            self.fields["collisions"] += self.touches.new(self.env.truth, some)

    def result(self, task: str, timing: Timing) -> Measured:
        """All of it, when all episodes have ended."""
        return Measured(task, self.seeds, self.env.step_time, **self.fields)


class Touches:
    """Pairs that come into touch, seen once a step.

    A pair is in touch where the parts' outlines are closer than 0.1 mm at the end of a step; it counts whenever it is now and
    was not a step ago. What touches and parts again within a step is not seen. Pairs in touch at the start do not count.

    Args:
        parts: of every world.
        worlds: number of worlds.
    """

    def __init__(self, parts: Sequence[Part], worlds: int) -> None:
        self.parts = parts
        self.one, self.other = np.triu_indices(len(parts), 1)
        self.touching = np.zeros((worlds, len(self.one)), dtype=bool)

    def new(self, truth: Truth, some: np.ndarray) -> np.ndarray:
        """(worlds,) pairs in touch now that were not when last asked.

        Args:
            truth: the state now.
            some: (worlds,) bool, where pairs are in touch at all; none are elsewhere.
        """
        worlds = np.flatnonzero(some & np.isfinite(truth.pose).all(axis=(1, 2)))
        touching = np.zeros_like(self.touching)
        if len(worlds):
            gaps = gaps_between(self.parts, truth.pose[worlds])
            there = truth.present[worlds] & ~truth.fallen[worlds]
            touching[worlds] = gaps[:, self.one, self.other] < TOUCHING
            touching[worlds] &= there[:, self.one] & there[:, self.other]
        found = (touching & ~self.touching).sum(axis=1)
        self.touching = touching
        return found


def least_times(env: SharedInterface) -> np.ndarray:
    """Least time to goal (worlds,) of the episodes that have just begun, s; see :mod:`vibgym.bounds`.

    With several parts it is that of the slowest. Parts that actions do not speak for are pushed by those that they do.

    Args:
        env: with all worlds at the start of an episode.

    Returns:
        nan where no bound is known: for tasks without goal poses or with goals that move, models other than the planar one,
        disturbances, parts that may stick, and where friction or the table's incline are not what part and table say.
    """
    task, truth = env.task, env.truth
    known = task.has_goal and not task.goal_moves and not task.flows and _undisturbed(env)
    slide = all(env.surface.slides_permanently(part.static_friction) and part.friction > 0.0 for part in env.parts)
    steps = None
    if known and slide:
        pushed = task.asked & ~task.driven
        steps = _steps_pushed(env, truth, pushed) if pushed.any() else _steps_driven(env, truth)
    if steps is None:
        return np.full(len(truth.pose), np.nan)
    return np.where(_usual(env, truth.present), env.step_time * steps, np.nan)


def _undisturbed(env: SharedInterface) -> bool:
    """Whether parts lie in the plane, and nothing but the drive moves them."""
    return env.core.simulator.model == "planar" and env.core.disturbances is None


def _usual(env: SharedInterface, present: np.ndarray) -> np.ndarray:
    """(worlds,) bool: friction and the table's incline are what parts and table say."""
    state = env.core.simulator.state
    even = (state.patches == 1.0).all(axis=(1, 2))
    return ((state.friction == 1.0) | ~present).all(axis=1) & (state.incline == 0.0).all(axis=1) & even


def most_rates(env: SharedInterface) -> np.ndarray:
    """Most good parts a minute (worlds,) of the episodes that have just begun; see :class:`vibgym.bounds.FlowBound`.

    Args:
        env: with all worlds at the start of an episode, and a limit.

    Returns:
        nan for tasks whose parts stay, and where no bound is known, as for :func:`least_times`.
    """
    task, surface, worlds = env.task, env.surface, len(env.truth.pose)
    limit = getattr(env, "max_episode_steps", None)
    slide = all(surface.slides_permanently(part.static_friction) and part.friction > 0.0 for part in env.parts)
    if not isinstance(task, Feed) or limit is None or not _undisturbed(env) or not slide:
        return np.full(worlds, np.nan)
    assert task.zones is not None  # its gates
    inlet = task.inlet
    # Heaps lie wholly in the room that they have, one part alone with its centre in a strip.
    inner = np.array([part.inner_radius for part in env.parts])
    begin = np.full(len(env.parts), inlet.high) if inlet.heap == 1 else inlet.room.width - inner
    bound = FlowBound(
        surface, _pushed_together(env.parts), task.kind, np.maximum(task.zones[task.kind, 0] - begin, 0.0), task.headway,
        max(limit * env.periods_per_step - task.warm_up, 0), env.periods_per_step, env.core.actuators.most_amplitude,
    )  # fmt: skip
    return np.where(_usual(env, np.ones((worlds, len(env.parts)), dtype=bool)), bound.per_minute, np.nan)


def _asks(env: SharedInterface, part: Any) -> dict[str, Any]:
    """What a bound has to know of one part's goal and of the machine."""
    away, turned = env.task.tolerances()[part].tolist()
    return {
        "position_tolerance": away,
        "heading_tolerance": turned,
        "heading_period": env.task.heading_period(env.parts[part]),
        "hold": env.task.hold,
        "periods_per_step": env.periods_per_step,
        "amplitude": env.core.actuators.most_amplitude,
        "latency": env.core.actuators.least_latency,
    }


def _steps_driven(env: SharedInterface, truth: Truth) -> np.ndarray:
    """Fewest steps where the elements drive all parts of which something is asked."""
    asked, parts = np.flatnonzero(env.task.asked), _pushed_together(env.parts)
    stopped = len(parts) > 1 or bool(env.walls)
    bound = SeveralBound([TimeBound(env.surface, parts[k], stopped=stopped, **_asks(env, k)) for k in asked])
    start, goal, there = truth.pose[:, asked], truth.goal[:, asked], truth.present[:, asked]
    if env.task.exchanges:
        return bound.free_steps(start, goal, np.asarray(env.task.kind)[asked], there)
    return bound.steps(start, goal, there)


def _pushed_together(parts: Sequence[Part]) -> list[Part]:
    """The parts with the friction of the one that has most: who is pushed by that one may gain speed as fast as it."""
    most, sticks = (max(getattr(part, name) for part in parts) for name in ("friction", "static_friction"))
    return [replace(part, friction=most, static_friction=sticks) for part in parts]


def _steps_pushed(env: SharedInterface, truth: Truth, pushed: np.ndarray) -> np.ndarray | None:
    """Fewest steps where one part is to be pushed by those that the elements drive; None: no bound is known."""
    driven, (part, *others) = np.flatnonzero(env.task.driven), np.flatnonzero(pushed)
    if others or not truth.present.all():
        return None
    bound = PushBound(env.surface, env.parts[part], [env.parts[each] for each in driven], **_asks(env, part))
    gap = gaps_between(env.parts, truth.pose)[:, part, driven]
    return bound.steps(truth.pose[:, part], truth.goal[:, part], np.maximum(gap, 0.0))
