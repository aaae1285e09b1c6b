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
from vibgym.tasks.scoring import Scoring

HOLD_PERIODS = 10
"""Oscillation periods in a row with all parts done that make success, unless a task is told otherwise: 0.4 s at 25 Hz."""

MOST_HOLD = 10**9

PER_PERIOD = ("time", "within")
"""Reward quantities that every period earns or costs, so that longer steps do not change the task."""


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
        apart: m, distance to the nearest other part above which a part is done; -inf where it does not count.
        lasts: s that an episode takes at least before it can succeed, the hold aside.
        slots: blocks of the state observation.
        features: of a part in it: :attr:`FEATURES`, and what the sensor tells besides.

    Raises:
        ValueError: too many kinds or parts, or a hold that is no number of periods.
    """

    DEFAULT_PARTS: ClassVar[tuple[str, ...]] = ("aluminium_block",)
    MOST_PARTS: ClassVar[int | None] = None

    TERMS: ClassVar[Mapping[str, tuple[str, float]]]
    """Reward terms in order: of what each one is made (:data:`vibgym.tasks.episode.QUANTITIES`), and its weight. Each is
    bounded by its weight in magnitude; those of :data:`PER_PERIOD` count every period of a step."""

    FACTS: ClassVar[tuple[str, ...]]
    """What ``info`` says besides ``reward_terms``, among the names in :meth:`facts`."""

    FEATURES: ClassVar[tuple[str, ...]]
    """Of a part in the state observation, among :data:`vibgym.envs.layout.NAMES`."""

    RANDOMIZED: ClassVar[tuple[str, ...]] = ()
    """Keys of ``randomize=`` that the task draws for itself; it is handed a mapping with those that are given."""

    HAS_WALLS: ClassVar[bool] = True
    """Whether borders may have walls."""

    has_goal: ClassVar[bool] = False
    """Whether every part has a goal pose of its own, drawn for each episode."""

    goal_moves: ClassVar[bool] = False
    """Whether goals move while an episode goes on."""

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
        self.hulls = hulls_of(self.parts)

    @property
    def name(self) -> str:
        """Of the task."""
        return type(self).__name__

    @property
    def has_heading(self) -> bool:
        """Whether headings count."""
        return math.isfinite(self.heading_tolerance)

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
        raise checks.refuse(name, paths, f"nothing for {self.name}, whose goals do not move along paths")

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
            "position": self.position_tolerance,
            "heading": self.heading_tolerance,
            "slow": self.speed_limit,
            "apart": self.apart,
            "far": math.hypot(surface.width, surface.depth),
            "hold": self.hold,
            "periods": periods,
        }
        made_of = [of for of, _ in self.TERMS.values()]
        return Rules(
            zone=zone,
            heading_period=np.array([self.heading_period(part) for part in self.parts]),
            limit=np.array([limits[name] for name in LIMITS]),
            term=np.array([QUANTITIES.index(of) for of in made_of]),
            weight=np.array([w * (periods if of in PER_PERIOD else 1) for of, w in self.TERMS.values()]),
        )

    def facts(self, diverged: np.ndarray, episode: Episode) -> dict[str, np.ndarray]:
        """What ``info`` says besides ``reward_terms``, each (worlds,); live arrays of the true state."""
        known = {
            "is_success": episode.success,
            "position_error": episode.position_error,
            "heading_error": episode.heading_error,
            "clearance": episode.clearance,
            "touching": episode.touching,
            "parts_done": episode.parts_done,
            "fallen": episode.fallen,
            "diverged": diverged,
        }
        return {name: known[name] for name in self.FACTS}

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        """One line for a picture of a world."""
        done, present = episode.parts_done[world], episode.present[world].sum()
        clearance = round(1e3 * float(episode.clearance[world]), 1) + 0.0  # + 0.0: not "-0.0"
        return f"{self.name}   {done} of {present} parts done   smallest distance {clearance} mm"
