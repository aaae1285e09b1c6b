"""Scoring of episodes on the true state, and rewards that a task computes in NumPy.

A shipped reward is a table of quantities and weights (:attr:`vibgym.tasks.Task.TERMS`), which the kernels of
:mod:`vibgym.tasks.episode` evaluate. A task that overrides :meth:`vibgym.tasks.Task.reward` gets the same quantities as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned, bound
from vibgym.physics.core.records import STATE, State
from vibgym.tasks.episode import (
    CONTEXT,
    QUANTITIES,
    Context,
    Episode,
    Relations,
    Start,
    new_episode,
    new_relations,
    relate_worlds,
    score_worlds,
)

if TYPE_CHECKING:
    from vibgym.tasks.base import Task


Stage = Callable[[np.ndarray], None]


class Scoring:
    """Begins and scores the episodes of all worlds of a task.

    Args:
        task: with its parts.
        state: true state of the worlds; its arrays live as long as this and are changed in place.
        periods: oscillation periods of a step.
        motion: numbers of the motion of every goal, see :class:`vibgym.tasks.episode.Episode`.

    Attributes:
        episode: progress of every world.
        relations: how parts stand to their goals and to one another, by the true state.
        players: (worlds, parts) bool, live: the parts of the episodes, on the table or not.
        rewarded: (worlds, parts) bool, live: the parts whom a step's reward is of.
        changed: (worlds, parts) bool, live: parts that have arrived or left in a step.
    """

    def __init__(self, task: Task, state: State, periods: int, motion: int = 0) -> None:
        worlds, parts = state.pose.shape[:2]
        self._task, self._rules, self._state = task, task.rules(periods), Pinned(STATE, state)
        self.relations = new_relations(worlds, parts)
        self.episode = new_episode(worlds, parts, len(self._rules.term), motion)
        self.players = self.rewarded = self.episode.present
        self.changed = self.episode.arrived
        self._context = self.context(self.relations)
        self._everyone = np.arange(worlds)

    def context(self, relations: Relations) -> Pinned[Context]:
        """What kernels need to bring such relations up to date, in one thread at a time; see :meth:`relating`."""
        hulls = self._task.hulls
        fits = np.zeros(self.episode.done.shape[1], dtype=bool)
        scratch = np.zeros(hulls.corner.shape), np.zeros(4), np.zeros(len(QUANTITIES)), fits
        return Pinned(CONTEXT, Context(relations, self.episode, self._rules, hulls, *scratch))

    def own_state(self) -> dict[str, np.ndarray]:
        """Live arrays that a snapshot has to hold besides the episodes and their relations."""
        return {}

    def facts(self) -> dict[str, np.ndarray]:
        """What ``info`` says besides what the task's facts are, each (worlds,); live arrays."""
        return {}

    def part_facts(self) -> dict[str, np.ndarray]:
        """What ``info["parts"]`` says besides what it says of every task's parts, each (worlds, parts); live arrays."""
        return {}

    def lines(self, world: int) -> list[np.ndarray]:
        """Lines (n, 2), m, along which the goals of a world's parts move, one for each part; none where they stay."""
        return []

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        """Start the episodes of ``worlds`` (index array), whose parts have been put down."""
        self.episode.goal[worlds], self.episode.present[worlds] = start.goal, start.present
        score_worlds(self._state.address, self._context.address, True, worlds)

    def score(self) -> None:
        """Score one step of every world against the one before."""
        for stage in self.stages():
            stage(self._everyone)

    def stages(self) -> list[Stage]:
        """What scores a step of some worlds, one after the other, each called with their index array.

        It has working arrays of its own: those of several calls of this may be at work at the same time, on different worlds.
        """
        return [bound(score_worlds, self._state, self.context(self.relations), False)]

    def relating(self, relations: Relations) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
        """What brings relations to other poses than the true ones up to date; as with :meth:`stages`.

        It is called with an index array of worlds, poses (worlds, parts, 3), and which parts are out of the way.
        """
        return bound(relate_worlds, self.context(relations))


WORST = "fallen"
"""Quantity, and term, of which a world counts its worst part's: one part on the floor is as bad as several."""


class Instant(NamedTuple):
    """The true state of all parts at the beginning or at the end of a step; of absent parts it means nothing."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    velocity: np.ndarray  # (worlds, parts, 3) m/s, m/s, rad/s
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period
    sticking: np.ndarray  # (worlds, parts) bool
    goal: np.ndarray  # (worlds, parts, 3) m, m, rad; zeros for tasks with zones or without goals
    error: np.ndarray  # (worlds, parts, 3) goal, or nearest point of the zone, minus pose: m, m, rad
    gap: np.ndarray  # (worlds, parts) m, to the nearest other part
    done: np.ndarray  # (worlds, parts) bool
    fallen: np.ndarray  # (worlds, parts) bool

    @property
    def position_error(self) -> np.ndarray:
        """(worlds, parts) m, distance to the goal or zone."""
        return np.hypot(self.error[..., 0], self.error[..., 1])

    @property
    def heading_error(self) -> np.ndarray:
        """(worlds, parts) rad, magnitude; 0 where headings do not count."""
        return np.abs(self.error[..., 2])

    @classmethod
    def of(cls, state: State, episode: Episode, relations: Relations) -> Instant:
        """The present one, as views that cannot be written to."""
        live = (
            state.pose, state.velocity, state.mean_velocity, state.sticking, episode.goal, relations.error, relations.gap,
            episode.done, episode.part_fallen,
        )  # fmt: skip
        return cls(*map(_readable, live))


@dataclass(frozen=True)
class Step:
    """What a step has done to the parts of all worlds. Arrays are those of the environment: copy what is to be kept.

    Attributes:
        before, now: how the parts stood at the step's beginning, and stand at its end.
        quantities: by the names of :data:`vibgym.tasks.episode.QUANTITIES`, (worlds, parts) of each part alone: what the
            terms of shipped tasks count. ``time`` and ``within`` count every period of the step.
        present: (worlds, parts) bool, the parts of this episode.
        success: (worlds,) bool, whether the step has ended the episode with success.
        periods: oscillation periods of the step.
    """

    before: Instant
    now: Instant
    quantities: Mapping[str, np.ndarray]
    present: np.ndarray
    success: np.ndarray
    periods: int
    _elements: Callable[[], np.ndarray]

    @cached_property
    def phasors(self) -> np.ndarray:
        """(worlds, rows, columns, 2) what every element did last: amplitude x (cos, sin) of its phase, 1 at full scale."""
        return self._elements()


class OwnReward:
    """Asks a task for its terms at every step, weighs them, and writes them where the kernels' own would stand.

    The reward of a part is the sum of its weighted terms; those of absent parts are 0. A world's term is the mean over its
    present parts, but for ``fallen`` (:data:`WORST`), and its reward is the sum of these. The kernels form a world's shipped
    terms of the parts' mean errors instead: to rounding that is the same, unless a part is at a term's bound, and but for
    ``approach``, ``alignment`` and ``within`` of several parts.

    Args:
        task: whose terms; it is asked once at construction, about a step in which nothing has happened.
        scoring: of its episodes; of a task with a reward of its own it delivers the quantities.
        state: true state of the worlds.
        periods: oscillation periods of a step.
        elements: what makes :attr:`Step.phasors`.
        weights: those that were set, beside the task's own.

    Attributes:
        names: of the terms.
        terms: (worlds, terms) weighted.  part_terms: (worlds, parts, terms) likewise.

    Raises:
        ValueError: the task returns no mapping, a term of a wrong shape or one without a weight; a weight of no term.
    """

    def __init__(
        self,
        task: Task,
        scoring: Scoring,
        state: State,
        periods: int,
        elements: Callable[[], np.ndarray],
        weights: Mapping[str, float],
    ) -> None:
        self._task, self._scoring, self._state, self._periods = task, scoring, state, periods
        self._elements = elements
        worlds, parts = state.pose.shape[:2]
        self._everyone = np.ones((worlds, parts), dtype=bool)
        self.names: tuple[str, ...] = ()
        self.begin_step()
        with np.errstate(all="ignore"):
            first = self._asked(self._everyone)
        self.names = tuple(first)
        for name in weights:
            if name not in self.names:
                allowed = f"weights of what the reward of {task.name} returns: {', '.join(self.names) or 'nothing'}"
                raise checks.refuse(f"task_settings['weights'][{name!r}]", weights[name], allowed)
        self.terms, self.part_terms = np.zeros((worlds, len(first))), np.zeros((worlds, parts, len(first)))

    def begin_step(self) -> None:
        """Remember how the parts stand before a step."""
        self._before = Instant(*(view.copy() for view in self._now()))

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
    def score(self) -> None:
        """Reward the step that has just been scored.

        Raises:
            ValueError: the task returns no mapping, other terms than before, or one of a wrong shape, without a weight or
                with numbers that are not finite.
        """
        episode = self._scoring.episode
        present, terms, part_terms = self._scoring.rewarded, self.terms, self.part_terms
        parts, reward, part_reward = present.shape[1], episode.reward, episode.part_reward
        reward[:], part_reward[:] = 0.0, 0.0
        share, made_of = np.maximum(present.sum(axis=1), 1), self._task.made_of
        for k, (name, values) in enumerate(self._asked(present).items()):
            weight, here = self._task.weights[name], np.where(present, values, 0.0)
            if made_of.get(name, name) == WORST:
                of_world = np.take_along_axis(here, np.abs(here).argmax(axis=1)[:, None], axis=1)[:, 0]
            else:  # part by part: the sum of a world shall not depend on how many there are
                of_world = sum(here[:, part] for part in range(parts)) / share
            terms[:, k], part_terms[..., k] = weight * of_world, weight * here
            if not np.isfinite(part_terms[..., k]).all():
                world, part = np.argwhere(~np.isfinite(part_terms[..., k]))[0].tolist()
                what = f"reward of {self._task.name}, term {name!r}, part {part} of world {world}"
                raise checks.refuse(what, float(here[world, part]), "a finite number, weighed too")
            reward += terms[:, k]
            part_reward += part_terms[..., k]

    def _now(self) -> Instant:
        return Instant.of(self._state, self._scoring.episode, self._scoring.relations)

    def _asked(self, present: np.ndarray) -> dict[str, np.ndarray]:
        """The task's terms, checked but for their numbers."""
        episode = self._scoring.episode
        quantities = {name: _readable(episode.part_terms[..., k]) for k, name in enumerate(QUANTITIES)}
        who, success = _readable(present), _readable(episode.success)
        step = Step(self._before, self._now(), quantities, who, success, self._periods, self._elements)
        found = self._task.reward(step)
        if not isinstance(found, Mapping):
            raise checks.refuse(f"reward of {self._task.name}", found, "a mapping from terms to (worlds, parts) arrays")
        terms = {name: self._checked(name, values) for name, values in found.items()}
        if self.names and tuple(terms) != self.names:
            if set(terms) != set(self.names):
                allowed = f"the terms of its first step: {', '.join(self.names)}"
                raise checks.refuse(f"reward of {self._task.name}", list(terms), allowed)
            terms = {name: terms[name] for name in self.names}
        return terms

    def _checked(self, name: Any, values: Any) -> np.ndarray:
        """A term as an array of numbers, of which there is a weight."""
        known = self._task.weights
        if not isinstance(name, str) or name not in known:
            allowed = f"those with a weight, in TERMS or task_settings['weights']: {', '.join(known) or 'none'}"
            raise checks.refuse(f"terms of the reward of {self._task.name}", name, allowed)
        shape = self._everyone.shape
        where, meaning = f"reward of {self._task.name}, term {name!r}", ": (worlds, parts)"
        return checks.shaped(where, values, (shape,), "an array of numbers", meaning, "bfiu").astype(np.float64)


def _readable(array: np.ndarray) -> np.ndarray:
    """A view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def terms_of(owner: str, terms: Mapping[str, Any], own: bool) -> tuple[dict[str, str], dict[str, float]]:
    """What a task's table of terms says: of which quantities they are made, and their weights.

    Args:
        owner: the task's name, for errors.
        terms: see :attr:`vibgym.tasks.Task.TERMS`.
        own: whether the task has a reward of its own.

    Raises:
        ValueError: if a quantity is unknown, a weight is not finite, or a term is not computed by any quantity or override.
    """
    made_of, weights = {}, {}
    for name, entry in terms.items():
        where, weight = f"{owner}.TERMS[{name!r}]", entry
        if isinstance(entry, tuple) and len(entry) == 2:
            made_of[name] = checks.choice(f"{where}[0]", entry[0], QUANTITIES)
            weight = entry[1]
        elif not own:
            known = (
                f"(quantity, weight) with a quantity among {', '.join(QUANTITIES)}, or a reward that returns the term"
            )
            raise checks.refuse(where, entry, known)
        weights[name] = checks.number(where, weight)
    return made_of, weights
