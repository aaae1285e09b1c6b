"""Metrics of episodes: lower bounds of the time to the goal, collisions, smoothness and corrective movements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds import FlowBound, PushBound, SeveralBound, TimeBound
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.shared import SharedInterface, Truth
from vibgym.policies.rollout import Ends, Outcomes, RolloutStep, Timing, rollout
from vibgym.scene import Part
from vibgym.scene.hulls import gaps_between
from vibgym.scene.kinds import groups_of
from vibgym.tasks import Feed
from vibgym.tasks.episode import TOUCHING


@dataclass(frozen=True)
class MeasuredOutcomes(Outcomes):
    """Outcomes of episodes, with bounds, collisions, and measures of how smoothly and directly parts were moved.

    Corrective movements are those of MagBotSim (Bergmann et al. 2025): *overshoots* and *distance corrections*. Changes of the
    distance below :data:`STILL` do not count. With several parts they are summed. Bounds are nan where none is known.
    """

    bound: np.ndarray  # s, lower bound of the time to goal from this start, hold included
    rate_bound: np.ndarray  # upper bound of good parts a minute, where parts come and go; nan elsewhere
    collisions: np.ndarray  # pairs newly in contact, see Measures; nan where the task does not count them
    action_change: np.ndarray  # mean absolute change of a number of the action from step to step
    overshoots: np.ndarray  # times that a part has left the position tolerance of its goal; nan without goal poses
    corrections: np.ndarray  # times that a part has come nearer to its goal again after it had moved away; nan likewise

    @property
    def time_over_bound(self) -> np.ndarray:
        """Time to goal over its lower bound; nan without success."""
        return self.time_to_goal / self.bound

    @property
    def rate_over_bound(self) -> np.ndarray:
        """Good parts a minute over their upper bound."""
        return self.reported("good_per_minute") / self.rate_bound


STILL = 2e-5
"""Change of a distance to a goal that does not count as a movement, m."""


class Measures(Ends):
    """Collector of outcomes, bounds, collisions, smoothness and corrective movements; one world per episode.

    A pair of parts is in contact where their outlines are closer than 0.1 mm at the end of a step. It counts whenever it is
    in contact and was not a step before, or at the start. Contacts that begin and end within a step are not seen.

    Args:
        env, info, seeds: as of :class:`vibgym.policies.rollout.Ends`.

    Attributes:
        fields: arrays (episodes, ...), named as in :class:`MeasuredOutcomes`.
    """

    def __init__(self, env: VibgymVectorEnv, info: dict[str, Any], seeds: Sequence[int]) -> None:
        super().__init__(env, info, seeds)
        count, self._goals = len(seeds), env.task.has_goal and not env.task.continuous_feed
        self._pairs = np.triu_indices(len(env.core.kinds), 1)
        self._touching = np.zeros((count, len(self._pairs[0])), dtype=bool)
        self.fields |= {
            "bound": least_times(env),
            "rate_bound": most_rates(env),
            "collisions": np.full(count, 0.0 if "touching" in info else np.nan),
            "action_change": np.zeros(count),
            **{name: np.full(count, 0.0 if self._goals else np.nan) for name in ("overshoots", "corrections")},
        }
        if "touching" in info:
            self._new_contacts(info["touching"] > 0)
        self._action: np.ndarray | None = None
        if self._goals:
            self._reached, self._away = env.task.tolerances()[:, 0], self._distance()
            self._inside, self._grew = self._away < self._reached, np.zeros(self._away.shape, dtype=bool)

    def add(self, step: RolloutStep) -> None:
        """Add a step."""
        super().add(step)
        which, ended = step.episode[step.playing], step.episode[step.ended]
        if "touching" in step.info:
            self.fields["collisions"] += self._new_contacts(step.playing & (step.info["touching"] > 0))
        action = np.asarray(step.action, dtype=np.float64).reshape(len(step.age), -1)
        if self._action is not None:
            change = np.abs(action - self._action).mean(axis=1)[step.playing]
            self.fields["action_change"][which] += change
        self._action = action
        self.fields["action_change"][ended] /= np.maximum(step.age[step.ended] - 1, 1)
        if self._goals:
            self._correct(which, step.playing)

    def result(self, task: str, timing: Timing) -> MeasuredOutcomes:
        """Return the result, when all episodes have ended."""
        return MeasuredOutcomes(task, self.seeds, self.env.step_time, timing, **self.fields)

    def _new_contacts(self, some: np.ndarray) -> np.ndarray:
        """Return the number (worlds,) of pairs in contact that were not at the last call; (worlds,) bool: where any are."""
        truth, (one, other) = self.env.truth, self._pairs
        worlds = np.flatnonzero(some & np.isfinite(truth.pose).all(axis=(1, 2)))
        touching = np.zeros_like(self._touching)
        if len(worlds):
            gaps = gaps_between(self.env.core.kinds.some(worlds), truth.pose[worlds])
            there = truth.present[worlds] & ~truth.fallen[worlds]
            touching[worlds] = (gaps[:, one, other] < TOUCHING) & there[:, one] & there[:, other]
        begun = (touching & ~self._touching).sum(axis=1)
        self._touching = touching
        return begun

    def _correct(self, which: np.ndarray, playing: np.ndarray) -> None:
        """Count the corrective movements of a step."""
        away, before = self._distance(), self._away
        inside = away < self._reached
        left = self._inside & ~inside & (np.abs(away - self._reached) > STILL)
        nearer = away < before - STILL
        corrected = self._grew & nearer
        self._grew = (self._grew & ~nearer) | (away > before + STILL)
        self._away, self._inside = away, inside
        for name, events in (("overshoots", left), ("corrections", corrected)):
            self.fields[name][which] += events.sum(axis=1)[playing]

    def _distance(self) -> np.ndarray:
        """Return the distances (worlds, parts) of parts to their goals, m; 0 without."""
        truth = self.env.truth
        return np.where(truth.present & self.env.task.scored, np.hypot(truth.error[..., 0], truth.error[..., 1]), 0.0)


def least_times(env: SharedInterface) -> np.ndarray:
    """Return lower bounds of the time to goal (worlds,), s, of episodes that have just begun; see :mod:`vibgym.bounds`.

    With several parts it is that of the slowest. Parts that are not driven are pushed by driven ones.

    Args:
        env: with all worlds at the start of an episode.

    Returns:
        nan where no bound is known: for tasks without goal poses or with goals that move, models other than the planar one,
        disturbances, parts that may stick, and where friction or incline differ from those of part and table.
    """
    task, truth = env.task, env.truth
    steps = np.full(len(truth.pose), np.nan)
    if task.has_goal and not task.goal_moves and not task.continuous_feed and _slides_undisturbed(env):
        pushed, kinds = task.scored & ~task.driven, env.core.kinds
        of_world = kinds.kind if kinds.vary else np.zeros((len(truth.pose), 1), dtype=np.int64)
        for _, worlds in groups_of(of_world):
            parts, own = kinds.parts(int(worlds[0])), Truth(*(values[worlds] for values in truth))
            least = _steps_pushed(env, parts, own, pushed) if pushed.any() else _steps_driven(env, parts, own)
            steps[worlds] = np.nan if least is None else least
    return np.where(_usual(env, truth.present), env.step_time * steps, np.nan)


def _slides_undisturbed(env: SharedInterface) -> bool:
    """Return whether parts slide permanently in the plane with constant coefficients, and only the drive moves them."""
    slide = all(
        env.surface.slides_permanently(part.static_friction) and part.friction > 0.0 and part.friction_law is None
        for part in env.core.kinds.every
    )
    return slide and env.core.simulator.model == "planar" and env.core.disturbances is None


def _usual(env: SharedInterface, present: np.ndarray) -> np.ndarray:
    """Return (worlds,) bool, whether friction and incline are those of part and table."""
    state = env.core.simulator.state
    even = (state.patches == 1.0).all(axis=(1, 2))
    return ((state.friction == 1.0) | ~present).all(axis=1) & (state.incline == 0.0).all(axis=1) & even


def most_rates(env: SharedInterface) -> np.ndarray:
    """Return upper bounds of good parts a minute (worlds,) of episodes just begun; see :class:`vibgym.bounds.FlowBound`.

    Args:
        env: with all worlds at the start of an episode, and a limit.

    Returns:
        nan for tasks whose parts stay, and where no bound is known, as for :func:`least_times`.
    """
    task, surface, worlds = env.task, env.surface, len(env.truth.pose)
    limit = getattr(env, "max_episode_steps", None)
    if not isinstance(task, Feed) or limit is None or not _slides_undisturbed(env):
        return np.full(worlds, np.nan)
    assert task.zones is not None  # its gates
    inlet = task.inlet
    # Heaps lie entirely within the inlet's room, single parts with their centres in a strip.
    inner = np.array([part.inner_radius for part in env.parts])
    begin = np.full(len(env.parts), inlet.high) if inlet.heap == 1 else inlet.room.width - inner
    bound = FlowBound(
        surface, _pushed_together(env.parts), task.kind, np.maximum(task.zones[task.kind, 0] - begin, 0.0), task.headway,
        max(limit * env.periods_per_step - task.warm_up, 0), env.periods_per_step, env.core.actuators.most_amplitude,
    )  # fmt: skip
    return np.where(_usual(env, np.ones((worlds, len(env.parts)), dtype=bool)), bound.per_minute, np.nan)


def _asks(env: SharedInterface, parts: Sequence[Part], part: Any) -> dict[str, Any]:
    """Return a bound's arguments about one part's goal and the hardware."""
    away, turned = env.task.tolerances()[part].tolist()
    return {
        "position_tolerance": away,
        "heading_tolerance": turned,
        "heading_period": env.task.heading_period(parts[part]),
        "hold": env.task.hold,
        "periods_per_step": env.periods_per_step,
        "amplitude": env.core.actuators.most_amplitude,
        "latency": env.core.actuators.least_latency,
    }


def _steps_driven(env: SharedInterface, parts: Sequence[Part], truth: Truth) -> np.ndarray:
    """Return the least number of steps (worlds,) where the elements drive all parts with goals."""
    scored, own = np.flatnonzero(env.task.scored), _pushed_together(parts)
    stopped = len(own) > 1 or bool(env.walls)
    bound = SeveralBound([TimeBound(env.surface, own[k], stopped=stopped, **_asks(env, parts, k)) for k in scored])
    start, goal, there = truth.pose[:, scored], truth.goal[:, scored], truth.present[:, scored]
    if env.task.exchanges:
        return bound.free_steps(start, goal, np.asarray(env.task.kind)[scored], there)
    return bound.steps(start, goal, there)


def _pushed_together(parts: Sequence[Part]) -> list[Part]:
    """Return the parts with the largest friction of all: a part that another one pushes may gain speed as fast as that one."""
    most, sticks = (max(getattr(part, name) for part in parts) for name in ("friction", "static_friction"))
    return [replace(part, friction=most, static_friction=sticks) for part in parts]


def _steps_pushed(env: SharedInterface, parts: Sequence[Part], truth: Truth, pushed: np.ndarray) -> np.ndarray | None:
    """Return the least number of steps (worlds,) where driven parts push one part; None: no bound is known."""
    driven, (part, *others) = np.flatnonzero(env.task.driven).tolist(), np.flatnonzero(pushed).tolist()
    if others or not truth.present.all():
        return None
    bound = PushBound(env.surface, parts[part], [parts[pusher] for pusher in driven], **_asks(env, parts, part))
    gap = gaps_between(parts, truth.pose)[:, part, driven]
    return bound.steps(truth.pose[:, part], truth.goal[:, part], np.maximum(gap, 0.0))


IDLE = 16
"""Episodes in which all elements rest, see :func:`check_cost_limit`."""


def check_cost_limit(name: str, limit: float, task: str, environment: Mapping[str, Any], first_seed: int = 0) -> None:
    """Raise for a limit below the mean cost of episodes in which all elements rest.

    Args:
        name: of the setting, for errors.
        limit: largest cost of an episode.
        task, environment: as of :func:`vibgym.policies.rollout`.
        first_seed: of :data:`IDLE` episodes.

    Raises:
        ValueError: such a limit, or an environment without costs.
    """
    cost = rollout("zero", task, seeds=range(first_seed, first_seed + IDLE), **environment).cost
    if np.isnan(cost).any():
        raise checks.conflict(f"{name} requires environment.costs")
    if limit < cost.mean():
        allowed = f"at least {cost.mean():.4g}, the mean cost of an episode of {task} in which all elements rest"
        raise checks.refuse(name, limit, allowed)
