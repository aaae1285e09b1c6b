"""Scoring of episodes on the true state, and rewards that a task computes in NumPy.

A shipped reward is a table of quantities and weights (:attr:`vibgym.tasks.Task.TERMS`), which the kernels of
:mod:`vibgym.tasks.episode` evaluate. A task that overrides :meth:`vibgym.tasks.Task.reward` gets the same quantities as arrays.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned, bound
from vibgym.physics.core.records import STATE, State
from vibgym.scene.hulls import hulls_of
from vibgym.tasks.assignment import EXCHANGE, exchange_goals
from vibgym.tasks.episode import (
    CONTEXT,
    QUANTITIES,
    Context,
    Episode,
    Relations,
    Start,
    average_worlds,
    new_episode,
    new_relations,
    relate_parts,
    relate_worlds,
    score_worlds,
)

if TYPE_CHECKING:
    from vibgym.tasks.base import Task


Stage = Callable[[np.ndarray], None]


class Scoring:
    """Starts and scores the episodes of all worlds of a task.

    Args:
        task: with its parts.
        state: true state of the worlds; its arrays are changed in place.
        periods: oscillation periods of a step.
        motion: numbers of the motion of every goal, see :class:`vibgym.tasks.episode.Episode`.

    Attributes (live arrays):
        episode: progress of every world.
        relations: errors to the goals and distances between parts, by the true state.
        players: (worlds, parts) bool, parts of the episodes, on the table or not.
        rewarded: (worlds, parts) bool, parts that the reward of a step includes.
        changed: (worlds, parts) bool, parts that have arrived or left in a step.
    """

    def __init__(self, task: Task, state: State, periods: int, motion: int = 0) -> None:
        worlds, parts = state.pose.shape[:2]
        self._task, self._rules, self._state = task, task.rules(periods), Pinned(STATE, state)
        self.relations = new_relations(worlds, parts, self._rules.far)
        self.episode = new_episode(worlds, parts, len(self._rules.term), motion)
        self.players = self.rewarded = self.episode.present
        self.changed = self.episode.arrived
        self._context = self.context(self.relations)
        self._everyone = np.arange(worlds)
        self._several = parts > 1  # the gap and neighbour of a single part never change

    def context(self, relations: Relations) -> Pinned[Context]:
        """Return the kernels' arguments for such relations, with scratch memory for one thread."""
        hulls = hulls_of(self._task.part_kinds)
        fits = np.zeros(self.episode.done.shape[1], dtype=bool)
        scratch = np.zeros(hulls.corner.shape), np.ones(2), np.zeros(len(QUANTITIES)), fits
        return Pinned(CONTEXT, Context(relations, self.episode, self._rules, hulls, *scratch))

    def shares(self) -> np.ndarray:
        """Return the number of parts (worlds,) that the mean of a reward is over."""
        return self.rewarded.sum(axis=1)

    def average(self, part_terms: np.ndarray, worst: np.ndarray, terms: np.ndarray) -> None:
        """Set reward and terms of all worlds, and the rewards of their parts, from weighted terms of the parts.

        Args:
            part_terms: (worlds, parts, terms), 0 of parts that are not :attr:`rewarded`.
            worst: (terms,) bool, terms of which the worst part counts.
            terms: (worlds, terms), overwritten.
        """
        part_reward = self.episode.part_reward
        part_reward[:] = 0.0
        for k in range(len(worst)):  # one by one, so that the sum does not depend on the number of worlds
            part_reward += part_terms[..., k]
        average_worlds(part_terms, self.rewarded, self.shares(), worst, terms, self.episode.reward)

    def own_state(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) that a snapshot contains in addition to episodes and relations."""
        return {}

    def facts(self) -> dict[str, np.ndarray]:
        """Return further entries of ``info``, each (worlds,); live arrays."""
        return {}

    def part_facts(self) -> dict[str, np.ndarray]:
        """Return further entries of ``info["parts"]``, each (worlds, parts); live arrays."""
        return {}

    def lines(self, world: int) -> list[np.ndarray]:
        """Return lines (n, 2), m, along which the goals of a world's parts move, one per part; none where they stay."""
        return []

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        """Start the episodes of ``worlds`` (index array), whose parts have been placed."""
        self.episode.goal[worlds], self.episode.present[worlds] = start.goal, start.present
        state, context = self._state, self._context.address
        if self._several:
            relate_parts(context, True, state.record.pose, state.record.fallen, worlds)
        score_worlds(state.address, context, True, worlds)

    def score(self) -> None:
        """Score one step of every world relative to the previous one."""
        for stage in self.stages():
            stage(self._everyone)

    def stages(self) -> list[Stage]:
        """Return the functions that score a step of some worlds, called in order with their index array.

        Each call allocates scratch memory: stages of several calls can run at the same time, on different worlds.
        """
        context, true, episode = self.context(self.relations), self._state.record, self.episode
        stages = [bound(score_worlds, self._state, context, False)]
        if self._several:
            stages.insert(0, bound(relate_parts, context, True, true.pose, true.fallen))
        if self._task.exchanges:
            kind = np.ascontiguousarray(self._task.kind)
            stages.insert(0, bound(exchange_goals, kind, episode.present, true.pose, episode.goal, EXCHANGE))
        return stages

    def relating(self, relations: Relations) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
        """Return a function that updates relations by other poses than the true ones; scratch memory as for :meth:`stages`.

        Its arguments: index array of worlds, poses (worlds, parts, 3), and which parts to ignore (worlds, parts) bool.
        """
        context = self.context(relations)
        to_goals, to_parts = bound(relate_worlds, context), bound(relate_parts, context, False)
        if not self._several:
            return lambda worlds, pose, gone: to_goals(worlds, pose)

        def relate(worlds: np.ndarray, pose: np.ndarray, gone: np.ndarray) -> None:
            to_parts(pose, gone, worlds)
            to_goals(worlds, pose)

        return relate


class FactScoring(Scoring):
    """Scoring with one more entry of ``info``, which a kernel computes at the start of an episode and after every step.

    Attributes:
        FACT: its name.
        fact: (worlds,) live array.
    """

    FACT: ClassVar[str]

    def __init__(self, task: Task, state: State, periods: int) -> None:
        super().__init__(task, state, periods)
        self.fact = np.zeros(len(state.pose))

    @abstractmethod
    def measure(self) -> Stage:
        """Return the stage that computes :attr:`fact` of some worlds."""

    def own_state(self) -> dict[str, np.ndarray]:
        return {self.FACT: self.fact}

    def facts(self) -> dict[str, np.ndarray]:
        return {self.FACT: self.fact}

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        super().begin(worlds, start)
        self.measure()(worlds)

    def stages(self) -> list[Stage]:
        return [*super().stages(), self.measure()]


class Instant(NamedTuple):
    """True state of all parts at the beginning or end of a step; values of absent parts have no meaning."""

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
        """Return read-only views of the present state."""
        live = (
            state.pose, state.velocity, state.mean_velocity, state.sticking, episode.goal, relations.error, relations.gap,
            episode.done, episode.part_fallen,
        )  # fmt: skip
        return cls(*map(_readable, live))


@dataclass(frozen=True)
class Step:
    """A step of all worlds, for rewards. Arrays are those of the environment: copy what you keep.

    Attributes:
        before, now: states at the step's beginning and end.
        quantities: (worlds, parts) by the names of :data:`vibgym.tasks.episode.QUANTITIES`, of each part alone. ``time`` and
            ``within`` count every period of the step.
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
        """(worlds, rows, columns, 2) last phasors of the elements: amplitude x (cos, sin) of the phase, 1 at full scale."""
        return self._elements()


class CustomReward:
    """Calls a task's :meth:`~vibgym.tasks.Task.reward` after every step and weighs its terms; see :meth:`Scoring.average`.

    Args:
        scoring: of a task with a custom reward, called once at construction with a step in which nothing happens.
        elements: computes :attr:`Step.phasors`.

    Attributes:
        names: of the terms.
        terms: (worlds, terms) weighted.  part_terms: (worlds, parts, terms) likewise.

    Raises:
        ValueError: the task returns no mapping, a term of a wrong shape or one without a weight; a weight of no term.
    """

    def __init__(self, scoring: Scoring, elements: Callable[[], np.ndarray]) -> None:
        self._scoring, self._elements, self._task = scoring, elements, scoring._task
        worlds, parts = self._shape = scoring.episode.present.shape
        self.names: tuple[str, ...] = ()
        self.begin_step()
        with np.errstate(all="ignore"):
            first = self._asked(np.ones(self._shape, dtype=bool))
        self.names = tuple(first)
        for name in self._task.settings.weights:
            if name not in self.names:
                raise checks.unknown("term", name, self.names, of="task_settings.weights")
        self.terms, self.part_terms = np.zeros((worlds, len(first))), np.zeros((worlds, parts, len(first)))

    def begin_step(self) -> None:
        """Store the state before a step."""
        self._before = Instant(*(view.copy() for view in self._now()))

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
    def score(self) -> None:
        """Compute the reward of the step that has just been scored.

        Raises:
            ValueError: the task returns no mapping, other terms than before, or one of a wrong shape, without a weight or
                with numbers that are not finite.
        """
        scoring, task = self._scoring, self._task
        for k, (name, values) in enumerate(self._asked(scoring.rewarded).items()):
            part_terms = self.part_terms[..., k]
            part_terms[:] = task.weights[name] * np.where(scoring.rewarded, values, 0.0)
            if not np.isfinite(part_terms).all():
                world, part = np.argwhere(~np.isfinite(part_terms))[0].tolist()
                what = f"reward of {task.name}, term {name!r}, part {part} of world {world}"
                raise checks.refuse(what, float(values[world, part]), "a finite number, weighed too")
        worst = np.array([task.counts_worst(task.made_of.get(name, name)) for name in self.names])
        scoring.average(self.part_terms, worst, self.terms)

    def _now(self) -> Instant:
        return Instant.of(self._scoring._state.record, self._scoring.episode, self._scoring.relations)

    def _asked(self, present: np.ndarray) -> dict[str, np.ndarray]:
        """Return the task's terms, checked except for their numbers."""
        episode, periods = self._scoring.episode, self._scoring._rules.periods
        quantities = {name: _readable(episode.part_terms[..., k]) for k, name in enumerate(QUANTITIES)}
        here, success = _readable(present), _readable(episode.success)
        step = Step(self._before, self._now(), quantities, here, success, periods, self._elements)
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
        """Return a term as an array of numbers, if it has a weight."""
        known = self._task.weights
        if not isinstance(name, str) or name not in known:
            allowed = f"those with a weight, in TERMS or task_settings.weights: {', '.join(known) or 'none'}"
            raise checks.refuse(f"terms of the reward of {self._task.name}", name, allowed)
        where, meaning = f"reward of {self._task.name}, term {name!r}", ": (worlds, parts)"
        return checks.shaped(where, values, (self._shape,), "an array of numbers", meaning, "bfiu").astype(np.float64)


def _readable(array: np.ndarray) -> np.ndarray:
    """Return a read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view


def terms_of(owner: str, terms: Mapping[str, Any], own: bool) -> tuple[dict[str, str], dict[str, float]]:
    """Return the quantities and the weights of a task's table of terms.

    Args:
        owner: the task's name, for errors.
        terms: see :attr:`vibgym.tasks.Task.TERMS`.
        own: whether the task overrides ``reward``.

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
            known = f"(quantity, weight) with a quantity among {', '.join(QUANTITIES)}"
            raise checks.refuse(where, entry, f"{known}, or a reward that returns the term")
        weights[name] = checks.number(where, weight)
    return made_of, weights
