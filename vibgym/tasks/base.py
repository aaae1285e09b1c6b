"""What environments know of a task, whether it asks for the pose of one part or sorts a crowd."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface


class Start(NamedTuple):
    """Where the episodes of n worlds begin."""

    pose: np.ndarray  # (n, parts, 3) m, m, rad; of absent parts beside the surface
    present: np.ndarray  # (n, parts) bool
    goal: np.ndarray  # (n, 3) goal pose of part 0; zeros for tasks without one


class Task(ABC):
    """Draws starts from uniform numbers and scores every step in one compiled pass over the worlds.

    Scores are named tuples of arrays that the task changes in place; all have ``distance`` (m), ``success``, ``ended`` (bool),
    ``terms`` and ``reward``.
    """

    MANY: ClassVar[bool] = False
    """Whether the task is one for several parts."""

    DEFAULT_PARTS: ClassVar[tuple[str, ...]] = ("aluminium_block",)
    SETTINGS: ClassVar[tuple[str, ...]] = ()
    """Keyword arguments besides surface and parts."""

    TERMS: ClassVar[tuple[str, ...]]
    """Reward terms in order."""

    surface: Surface
    parts: tuple[Part, ...]
    draws: Any
    """Uniform numbers per episode."""

    @classmethod
    @abstractmethod
    def build(cls, surface: Surface, parts: Sequence[Part], settings: Mapping[str, Any]) -> Task:
        """The task for these parts; ``settings`` has keys among :attr:`SETTINGS`."""

    @abstractmethod
    def start(self, uniform: np.ndarray) -> Start:
        """Starts from ``uniform`` (n, draws) in [0, 1)."""

    @abstractmethod
    def new_score(self, worlds: int) -> Any:
        """A score for ``worlds`` worlds."""

    @abstractmethod
    def begin(self, state: State, start: Start, goal: np.ndarray, worlds: np.ndarray, result: Any) -> None:
        """Start the episodes of ``worlds`` (index array), which have been put down at ``start``.

        Args:
            goal: (all worlds, 3).
        """

    @abstractmethod
    def score(self, state: State, goal: np.ndarray, result: Any) -> None:
        """Score one step of every world against the one before."""

    @abstractmethod
    def facts(self, state: State, result: Any) -> dict[str, np.ndarray]:
        """What ``info`` says besides ``reward_terms``, each (worlds,); live arrays."""

    @abstractmethod
    def caption(self, result: Any, world: int) -> str:
        """One line for a picture of a world."""
