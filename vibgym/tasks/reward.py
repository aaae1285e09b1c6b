"""Rewards that replace the kernels': computed in NumPy after every step, and averaged as the kernels' are.

How terms of parts become the reward of a world is defined in ``docs/extending.md``, section Reward, for all rewards.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Iterable, Mapping
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.tasks.base import Task
from vibgym.tasks.episode import QUANTITIES
from vibgym.tasks.scoring import Instant, Scoring, Step, read_only


class Reward(ABC):
    """Base class of rewards that replace the kernels'.

    Args:
        scoring: of the worlds.
        names: of the terms.
        worst: terms of which a world counts its worst part.

    Attributes:
        terms: (worlds, terms) weighted.  part_terms: (worlds, parts, terms) likewise.
    """

    def __init__(self, scoring: Scoring, names: Iterable[str], worst: Container[str] = ()) -> None:
        self.scoring, self.names = scoring, tuple(names)
        worlds, parts = scoring.episode.present.shape
        self.terms, self.part_terms = np.zeros((worlds, len(self.names))), np.zeros((worlds, parts, len(self.names)))
        self._worst = np.array([term in worst for term in self.names], dtype=bool)

    def begin_step(self) -> None:  # noqa: B027 - optional
        """Store what a reward needs of the state before a step."""

    @abstractmethod
    def evaluate(self) -> None:
        """Write the terms of the step that has just been scored to ``part_terms``: 0 of parts that are not rewarded."""

    def score(self) -> None:
        """Compute the reward of the step that has just been scored."""
        self.evaluate()
        self.scoring.average(self.part_terms, self._worst, self.terms)


class CustomReward(Reward):
    """The reward of a task that overrides :meth:`vibgym.tasks.Task.reward`.

    The method is called once at construction, with a step in which nothing happens.

    Args:
        task: with this reward.
        scoring: of the worlds.
        elements: computes :attr:`vibgym.tasks.Step.phasors`.

    Raises:
        ValueError: the task returns no mapping, a term of a wrong shape or one without a weight.
    """

    def __init__(self, task: Task, scoring: Scoring, elements: Callable[[], np.ndarray]) -> None:
        self.scoring, self._task, self._elements = scoring, task, elements
        self._name = f"reward of {task.name}"
        self.begin_step()
        with np.errstate(all="ignore"):
            first = self._terms(np.ones(scoring.episode.present.shape, dtype=bool))
        for term, values in first.items():
            if not isinstance(term, str) or term not in task.weights:
                allowed = f"those with a weight, in TERMS or task_settings.weights: {', '.join(task.weights) or 'none'}"
                raise checks.refuse(f"terms of the {self._name}", term, allowed)
            self._checked(term, values)
        super().__init__(scoring, first, task.worst)

    def begin_step(self) -> None:
        self._before = Instant(*(view.copy() for view in self._now()))

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
    def evaluate(self) -> None:
        """Write the terms of the step that has just been scored.

        Raises:
            ValueError: the task returns no mapping, other terms than at construction, or one of a wrong shape or with numbers
                that are not finite.
        """
        rewarded = self.scoring.rewarded
        terms = self._terms(rewarded)
        if set(terms) != set(self.names):
            raise checks.refuse(self._name, list(terms), f"the terms of its first step: {', '.join(self.names)}")
        for k, term in enumerate(self.names):
            values, part_terms = self._checked(term, terms[term]), self.part_terms[..., k]
            part_terms[:] = self._task.weights[term] * np.where(rewarded, values, 0.0)
            if not np.isfinite(part_terms).all():
                world, part = np.argwhere(~np.isfinite(part_terms))[0].tolist()
                what = f"{self._name}, term {term!r}, part {part} of world {world}"
                raise checks.refuse(what, float(values[world, part]), "a finite number, weighed too")

    def _now(self) -> Instant:
        return Instant.of(self.scoring.state, self.scoring.episode, self.scoring.relations)

    def _terms(self, present: np.ndarray) -> Mapping[str, Any]:
        """Return the task's terms of the step."""
        episode, periods = self.scoring.episode, self.scoring.rules.periods
        quantities = {name: read_only(episode.part_terms[..., k]) for k, name in enumerate(QUANTITIES)}
        here, success = read_only(present), read_only(episode.success)
        terms = self._task.reward(Step(self._before, self._now(), quantities, here, success, periods, self._elements))
        if not isinstance(terms, Mapping):
            raise checks.refuse(self._name, terms, "a mapping from terms to (worlds, parts) arrays")
        return terms

    def _checked(self, term: str, values: Any) -> np.ndarray:
        """Return a term as an array of numbers."""
        where, shape, meaning = f"{self._name}, term {term!r}", self.scoring.episode.present.shape, ": (worlds, parts)"
        return checks.shaped(where, values, (shape,), "an array of numbers", meaning, "bfiu").astype(np.float64)


class GoalReward(Reward):
    """Reward of a goal observation: ``compute_reward`` of its task, for the true poses as they would be observed."""

    def __init__(self, observation: Any, scoring: Scoring) -> None:
        super().__init__(scoring, ("goal",))
        self._observation = observation

    def evaluate(self) -> None:
        observation, scoring = self._observation, self.scoring
        achieved, desired = observation.reached(scoring.state.pose), observation.reached(scoring.episode.goal)
        reward = observation.task.compute_reward(achieved, desired, {"fallen": scoring.episode.fallen})
        self.part_terms[..., 0] = np.where(scoring.rewarded, reward[:, None], 0.0)
