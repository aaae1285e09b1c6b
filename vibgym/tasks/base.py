"""What a task is: starts, goals, reward terms and success, all on the true state. One file a task."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.episode import LIMITS, QUANTITIES, Episode, Relations, Rules, Start
from vibgym.tasks.kinds import kinds_by_name
from vibgym.tasks.reward import Step, terms_of
from vibgym.tasks.scoring import Scoring

HOLD_PERIODS = 10
"""Default number of consecutive oscillation periods with all parts done that count as success: 0.4 s at 25 Hz."""

MOST_HOLD = 10**9

PER_PERIOD = ("time", "within")
"""Reward quantities that every period earns or costs, so that longer steps do not change the task."""


def looks_same_after(part: Part) -> float:
    """Turn after which a part looks the same, rad. A disc's heading shows nowhere: a tiny one makes every heading the same."""
    return 2.0 * math.pi / part.symmetry if part.symmetry else 1e-9


class Task(ABC):
    """Draws starts from uniform numbers, and says what is asked of the parts; :mod:`vibgym.tasks.episode` scores it.

    A task of your own is a subclass with a ``start`` and the numbers below; ``vibgym.tasks.TASKS.register`` gives it a name.

    Args:
        surface: the table.
        parts: the parts of every world.
        hold: oscillation periods in a row with all parts done that make success.

    Attributes:
        kinds: names of the parts' kinds.  kind: (parts,) of each part.
        zones: (kinds, 4) m, where each kind shall end: x_low, y_low, x_high, y_high; None for tasks without zones.
        driven: (parts,) bool, parts that actions control; no element is allocated to the others.
        asked: (parts,) bool, parts of which something is asked; others have no errors, and are done unless they have fallen.
        apart: m, distance to the nearest other part above which a part is done; -inf where it does not count.
        goal_gap: m, least distance between goals of all episodes; None where the task states none.
        lasts: s that an episode takes at least before it can succeed, the hold aside.
        slots: blocks of the state observation.
        features: of a part in it: :attr:`FEATURES`, and what the sensor tells besides.
        made_of: quantity of each reward term that has one.  weights: of all terms.

    Raises:
        ValueError: too many kinds or parts, a hold that is no number of periods, or reward terms of which there is no quantity.
    """

    DEFAULT_PARTS: ClassVar[tuple[str, ...]] = ("aluminium_block",)
    MOST_PARTS: ClassVar[int | None] = None

    TERMS: ClassVar[Mapping[str, tuple[str, float] | float]]
    """Reward terms in order: of what each one is made (:data:`vibgym.tasks.episode.QUANTITIES`), and its weight. Each is
    bounded by its weight in magnitude; those of :data:`PER_PERIOD` count every period of a step. A term that a
    :meth:`reward` of the task's own makes has a weight alone."""

    FACTS: ClassVar[tuple[str, ...]] = (
        "is_success", "position_error", "heading_error", "clearance", "touching", "parts_done", "fallen", "diverged",
    )  # fmt: skip
    """Fields of ``info``, among the names in :data:`vibgym.envs.info.ROWS`."""

    FEATURES: ClassVar[tuple[str, ...]]
    """Of a part in the state observation, among :data:`vibgym.envs.features.FEATURES`."""

    RANDOMIZED: ClassVar[tuple[str, ...]] = ()
    """Keys of ``randomize=`` that the task draws for itself; it is handed a mapping with those that are given."""

    HAS_WALLS: ClassVar[bool] = True
    """Whether borders may have walls."""

    has_goal: ClassVar[bool] = False
    """Whether every part has a goal pose of its own, drawn for each episode."""

    goal_moves: ClassVar[bool] = False
    """Whether goals move while an episode goes on."""

    flows: ClassVar[bool] = False
    """Whether parts arrive and leave while an episode goes on."""

    exchanges: bool = False
    """Whether parts of a kind may exchange goals while an episode goes on."""

    position_tolerance: ClassVar[float] = 0.0  # m, from the goal or the zone
    heading_tolerance: ClassVar[float] = math.inf  # rad; infinite where headings do not count
    speed_limit: ClassVar[float] = math.inf  # m/s, mean over the last period, below which a part is done

    draws: int
    """Uniform numbers per episode."""

    def __init__(self, surface: Surface, parts: Sequence[Part], *, hold: int = HOLD_PERIODS) -> None:
        if self.MOST_PARTS is not None and len(parts) > self.MOST_PARTS:
            raise checks.refuse("parts", f"{len(parts)} parts", f"at most {self.MOST_PARTS} for {self.name}")
        self.hold = checks.count("task_settings['hold']", hold, most=MOST_HOLD)
        self.surface, self.parts = surface, tuple(parts)
        self.kinds, self.kind = kinds_by_name(self.parts)
        self.zones: np.ndarray | None = None
        self.apart, self.lasts = -math.inf, 0.0
        self.slots, self.features = len(self.parts), tuple(self.FEATURES)
        self.goal_gap: float | None = None
        self.driven = np.array([part.coupling > 0.0 for part in self.parts])  # else no element moves it
        self.asked = np.ones(len(self.parts), dtype=bool)
        self.hulls = hulls_of(self.parts)
        self.made_of, self.weights = terms_of(self.name, self.TERMS, self.has_own_reward)

    @property
    def name(self) -> str:
        """Of the task."""
        return type(self).__name__

    @property
    def has_heading(self) -> bool:
        """Whether headings count."""
        return math.isfinite(self.heading_tolerance)

    def tolerances(self) -> np.ndarray:
        """(parts, 2) m and rad, of each part; the same for all, unless a task has it otherwise."""
        return np.tile([self.position_tolerance, self.heading_tolerance], (len(self.parts), 1))

    def heading_period(self, part: Part) -> float:
        """Turn that leaves a part's goal the same, rad; 0 where headings are not wrapped."""
        return 2.0 * math.pi

    @abstractmethod
    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        """Starts from ``uniform`` (n, draws) in [0, 1).

        Args:
            present: (n, parts) bool, which parts there are; None: as the task has it.
        """

    def starts_along(self, name: str, paths: Any, longest: float) -> Callable[[np.ndarray, np.ndarray | None], Start]:
        """What to call instead of :meth:`start` for goals that move along other paths than the task's.

        Args:
            name: what errors call these.
            longest: s that they may last.

        Raises:
            ValueError: bad paths, or a task whose goals do not move along paths.
        """
        raise checks.conflict(f"{name} cannot be set for task {self.name!r}: its goals do not follow paths")

    def goal_from(self, start: Start, pose: np.ndarray) -> np.ndarray:
        """Goals (n, parts, 3) of a drawn start whose parts were put down at ``pose`` (n, parts, 3) instead."""
        return start.goal

    def put_down(self, start: Start, pose: np.ndarray) -> Start:
        """A drawn start whose parts are put down at ``pose`` (n, parts, 3) instead.

        Raises:
            ValueError: the task does not begin there.
        """
        return start._replace(pose=pose, goal=self.goal_from(start, pose))

    def scoring(self, state: State, periods: int) -> Scoring:
        """What scores the episodes of the worlds of ``state``, with ``periods`` oscillation periods a step."""
        return Scoring(self, state, periods)

    def rules(self, periods: int) -> Rules:
        """The task's numbers for the kernels, with ``periods`` oscillation periods a step."""
        parts, surface = len(self.parts), self.surface
        zone = np.tile([-math.inf, -math.inf, math.inf, math.inf], (parts, 1))
        if self.zones is not None:
            zone = self.zones[self.kind]
        elif self.has_goal:
            zone = np.zeros((parts, 4))
        limits = {
            "slow": self.speed_limit,
            "apart": self.apart,
            "far": math.hypot(surface.width, surface.depth),
            "hold": self.hold,
            "periods": periods,
        }
        counted = [(of, self.weights[name]) for name, of in self.made_of.items()]
        if self.has_own_reward:  # which is made of all quantities as they are
            counted = [(of, 1.0) for of in QUANTITIES]
        return Rules(
            zone=np.where(self.asked[:, None], zone, [-math.inf, -math.inf, math.inf, math.inf]),
            tolerance=np.ascontiguousarray(np.where(self.asked[:, None], self.tolerances(), math.inf)),
            asked=self.asked,
            heading_period=np.array([self.heading_period(part) for part in self.parts]),
            limit=np.array([limits[name] for name in LIMITS]),
            term=np.array([QUANTITIES.index(of) for of, _ in counted], dtype=np.int64),
            weight=np.array([w * (periods if of in PER_PERIOD else 1) for of, w in counted], dtype=np.float64),
        )

    def reward(self, step: Step) -> Mapping[str, np.ndarray]:
        """Terms of the reward of a step, each (worlds, parts), before they are weighed.

        What ``env.step`` returns is their sum, each times its weight in :attr:`weights`: the mean over the present parts, but
        for ``fallen``, of which the worst part counts; see :class:`vibgym.tasks.reward.OwnReward`. Override it for a
        custom reward, with ``super().reward(step)`` for the terms of :attr:`TERMS`; without an override kernels compute these.
        A reward must depend on the step alone and store nothing: worlds, copies and snapshots then continue bit for bit.
        """
        return {name: step.quantities[quantity] for name, quantity in self.made_of.items()}

    @property
    def has_own_reward(self) -> bool:
        """Whether :meth:`reward` is overridden, so that it is asked at every step."""
        return getattr(self.reward, "__func__", None) is not Task.reward

    def weigh(self, weights: Any) -> None:
        """Let some terms of the reward count with other weights than in :attr:`TERMS`.

        Args:
            weights: a mapping from terms to finite numbers. Of a reward of the task's own it may name terms that are not in
                the table.

        Raises:
            ValueError: another value, or an unknown term; nothing has changed.
        """
        name = "task_settings['weights']"
        known = ", ".join(self.weights)
        if not isinstance(weights, Mapping):
            raise checks.refuse(name, weights, f"a mapping from terms to numbers; terms: {known}")
        for term in weights:
            if not isinstance(term, str) or not (term in self.weights or self.has_own_reward):
                raise checks.refuse(f"{name}[{checks.shown(term)}]", weights[term], f"weights of the terms {known}")
        self.weights |= {term: checks.number(f"{name}[{term!r}]", weight) for term, weight in weights.items()}

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        """One line for a picture of a world."""
        done, present = episode.parts_done[world], episode.present[world].sum()
        clearance = round(1e3 * float(episode.clearance[world]), 1) + 0.0  # + 0.0: not "-0.0"
        return f"{self.name}   {done} of {present} parts done   smallest distance {clearance} mm"
