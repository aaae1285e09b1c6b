"""Scoring of the episodes of all worlds on the true state, by the kernels of :mod:`.episode`; the step that a reward is of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Pinned, bound
from vibgym.physics.core.records import STATE, State
from vibgym.scene.hulls import hulls_of
from vibgym.scene.kinds import Kinds
from vibgym.tasks.assignment import EXCHANGE, exchange_goals
from vibgym.tasks.episode import (
    CONTEXT,
    QUANTITIES,
    Context,
    Episode,
    Relations,
    Rules,
    Start,
    average_terms,
    relate_worlds,
    score_worlds,
)

Stage = Callable[[np.ndarray], None]


class Scoring:
    """Starts and scores the episodes of all worlds.

    A subclass adds what a task measures beyond :class:`vibgym.tasks.episode.Episode`: arrays in :meth:`custom_state` and
    :meth:`info`, and kernels in :meth:`stages`. One value per world needs :attr:`MEASURED` and :meth:`measure` only.

    Args:
        rules: of the task.
        parts: of the worlds.
        state: true state of the worlds; its arrays are changed in place.
        exchanged: (parts,) kinds; parts of a kind exchange goals where that shortens their distances. None: goals stay.
        motion: numbers of the motion of every goal, see :class:`vibgym.tasks.episode.Episode`.

    Attributes (live arrays):
        episode: progress of every world.
        relations: errors to the goals and distances between parts, by the true state.
        players: (worlds, parts) bool, parts of the episodes, on the table or not.
        rewarded: (worlds, parts) bool, parts that the reward of a step includes.
        changed: (worlds, parts) bool, parts that have arrived or left in a step.
        measured: entries of ``info`` by their names, :attr:`MEASURED`, each (worlds,).
    """

    MEASURED: ClassVar[tuple[str, ...]] = ()
    """Entries of ``info`` that :meth:`measure` computes."""

    def __init__(
        self, rules: Rules, parts: Kinds, state: State, exchanged: np.ndarray | None = None, motion: int = 0
    ) -> None:
        worlds, count = state.pose.shape[:2]
        self.rules, self._parts, self._state = rules, parts, Pinned(STATE, state)
        self._exchanged = None if exchanged is None else np.ascontiguousarray(exchanged)
        self.relations = new_relations(worlds, count, rules.far)
        self.episode = new_episode(worlds, count, len(rules.term), motion)
        self.players = self.rewarded = self.episode.present
        self.changed = self.episode.arrived
        self.measured = {name: np.zeros(worlds) for name in self.MEASURED}
        self._context = self.context(self.relations)

    @property
    def state(self) -> State:
        """True state of the worlds, live."""
        return self._state.record

    def context(self, relations: Relations) -> Pinned[Context]:
        """Return the kernels' arguments for such relations, with scratch memory for one thread."""
        hulls = hulls_of(self._parts)
        fits = np.zeros(self.episode.done.shape[1], dtype=bool)
        scratch = np.zeros(hulls.corner.shape), np.ones(2), np.zeros(len(QUANTITIES)), fits
        return Pinned(CONTEXT, Context(relations, self.episode, self.rules, hulls, *scratch))

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

    def custom_state(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) that a snapshot contains in addition to episodes and relations."""
        return dict(self.measured)

    def info(self) -> dict[str, np.ndarray]:
        """Return further entries of ``info``, each (worlds,); live arrays."""
        return dict(self.measured)

    def part_info(self) -> dict[str, np.ndarray]:
        """Return further entries of ``info["parts"]``, each (worlds, parts); live arrays."""
        return {}

    def lines(self, world: int) -> list[np.ndarray]:
        """Return lines (n, 2), m, along which the goals of a world's parts move, one per part; none where they stay."""
        return []

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        """Start the episodes of ``worlds`` (index array), whose parts have been placed."""
        self.episode.goal[worlds], self.episode.present[worlds] = start.goal, start.present
        score_worlds(self._state.address, self._context.address, True, worlds)
        for stage in self.measure():
            stage(worlds)

    def stages(self) -> list[Stage]:
        """Return the functions that score a step of some worlds, called in order with their index array.

        Each call allocates scratch memory: stages of several calls can run at the same time, on different worlds.
        """
        stages = [bound(score_worlds, self._state, self.context(self.relations), False), *self.measure()]
        if self._exchanged is None:
            return stages
        present, pose, goal = self.episode.present, self.state.pose, self.episode.goal
        return [bound(exchange_goals, self._exchanged, present, pose, goal, EXCHANGE), *stages]

    def measure(self) -> list[Stage]:
        """Return stages that compute :attr:`measured` at the start of an episode and after every step; as :meth:`stages`."""
        return []

    def relating(self, relations: Relations) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
        """Return a function that updates relations by other poses than the true ones; scratch memory as for :meth:`stages`.

        Its arguments: index array of worlds, poses (worlds, parts, 3), and which parts to ignore (worlds, parts) bool.
        """
        return bound(relate_worlds, self.context(relations))


@jit
def average_worlds(part_terms, counted, share, worst, terms, reward):
    """Compute terms (worlds, terms) and rewards (worlds,) of all worlds; see :func:`average_terms`."""
    for world in range(terms.shape[0]):
        reward[world] = average_terms(part_terms[world], counted[world], share[world], worst, terms[world])


def new_relations(worlds: int, parts: int, far: float) -> Relations:
    """Allocate relations of parts at the goals and ``far`` m apart."""
    return Relations(
        error=np.zeros((worlds, parts, 3)),
        gap=np.full((worlds, parts), far),
        neighbour=np.full((worlds, parts), -1, dtype=np.int64),
        reach=np.zeros((worlds, parts)),
    )


def new_episode(worlds: int, parts: int, terms: int, motion: int = 0) -> Episode:
    """Allocate an episode with ``terms`` reward terms and ``motion`` numbers for the motion of every goal."""
    return Episode(
        goal=np.zeros((worlds, parts, 3)),
        motion=np.zeros((worlds, parts, motion)),
        present=np.zeros((worlds, parts), dtype=bool),
        arrived=np.zeros((worlds, parts), dtype=bool),
        event=np.zeros((worlds, parts), dtype=np.int64),
        done=np.zeros((worlds, parts), dtype=bool),
        number=np.zeros((worlds, 4)),
        count=np.zeros((worlds, 3), dtype=np.int64),
        flag=np.zeros((worlds, 4), dtype=bool),
        terms=np.zeros((worlds, terms)),
        part_fallen=np.zeros((worlds, parts), dtype=bool),
        part_number=np.zeros((worlds, parts, 6)),
        part_terms=np.zeros((worlds, parts, terms)),
        part_reward=np.zeros((worlds, parts)),
    )


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
        return cls(*map(read_only, live))


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


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view
