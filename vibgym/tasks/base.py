"""Task: starts, goals, reward terms and success criteria, all on the true state."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings
from vibgym.tasks.assignment import give_out
from vibgym.tasks.episode import QUANTITIES, Episode, Relations, Rules, Start
from vibgym.tasks.scoring import Scoring, Step

HOLD_PERIODS = 10
"""Default number of consecutive oscillation periods with all parts done that count as success: 0.4 s at 25 Hz."""

MAX_HOLD, MAX_SLOTS = 10**9, 10_000

MAX_KINDS = 3
"""Largest number of kinds of parts that observations have room for."""

PER_PERIOD = ("time", "within")
"""Reward quantities counted once per period, so that longer steps do not change the task."""

ANYWHERE = (-math.inf, -math.inf, math.inf, math.inf)
"""Zone of a part without a goal."""


class Task(ABC):
    """Draws starts from uniform numbers and defines goals, tolerances and reward; :mod:`vibgym.tasks.episode` scores it.

    A custom task is a subclass with a ``start`` and the class attributes below; ``vibgym.tasks.TASKS.register`` names it. Its
    settings are the fields of a nested ``Settings``; it reads them from :attr:`settings`.

    Args:
        surface: the table.
        parts: the parts of every world; those with the same name are of one kind.
        settings: of the task; None: the defaults.

    Attributes:
        kinds: names of the parts' kinds.  kind: (parts,) index of each part's.
        driven: (parts,) bool, parts that actions control; no element is allocated to the others.
        scored: (parts,) bool, parts with a goal; others have no errors and are done unless they have fallen.
        features: features of a part in the state observation: :attr:`FEATURES`, and those of the sensor.
        made_of: quantity of each reward term that has one.  weights: of all terms.
        worst: terms of which a world counts its worst part: falls, where they end the episode.

    Raises:
        ValueError: too many kinds or parts, too few slots, or reward terms without a quantity.
    """

    class Settings(BaseSettings):
        """Settings of every task. A task that does not take one of them declares it as a class variable with its value."""

        hold: int = Field(default=HOLD_PERIODS, ge=1, le=MAX_HOLD)
        """Consecutive oscillation periods with all parts done that count as success."""

        slots: int | None = Field(default=None, ge=1, le=MAX_SLOTS)
        """Blocks of the state observation, at least the number of parts, which is the default."""

        weights: dict[str, float] = {}
        """Weights of reward terms, in place of those in ``TERMS``; with an overridden ``reward`` also of other terms."""

    settings: Settings

    DEFAULT_PARTS: ClassVar[tuple[str, ...]] = ("aluminium_block",)
    MAX_PARTS: ClassVar[int | None] = None

    TERMS: ClassVar[Mapping[str, tuple[str, float] | float]]
    """Reward terms in order: quantity (:data:`vibgym.tasks.episode.QUANTITIES`) and weight of each. A term that only an
    overridden :meth:`reward` computes has a weight alone."""

    FEATURES: ClassVar[tuple[str, ...]]
    """Features of a part in the state observation, among :data:`vibgym.envs.features.FEATURES`."""

    RANDOMIZED: ClassVar[tuple[str, ...]] = ()
    """Keys of ``randomize=`` that the task draws itself; its setting ``randomize`` is a model with these fields."""

    HAS_WALLS: ClassVar[bool] = True
    """Whether borders may have walls."""

    has_goal: ClassVar[bool] = False
    """Whether every part has its own goal pose, drawn for each episode."""

    goal_moves: ClassVar[bool] = False
    """Whether goals move during an episode."""

    continuous_feed: ClassVar[bool] = False
    """Whether parts arrive and leave during an episode."""

    exchanges: bool = False
    """Whether parts of a kind may exchange goals during an episode."""

    modulo_symmetry: ClassVar[bool] = False
    """Whether goal headings count modulo the part's symmetry (180 degrees for a rectangle) instead of a full turn."""

    position_tolerance: ClassVar[float] = 0.0  # m, from the goal or the zone
    heading_tolerance: ClassVar[float] = math.inf  # rad; infinite where headings do not count
    speed_limit: ClassVar[float] = math.inf  # m/s, mean over the last period, below which a part is done

    draws: int
    """Uniform numbers per episode."""

    zones: np.ndarray | None = None
    """(kinds, 4) m, goal zone of each kind: x_low, y_low, x_high, y_high."""

    apart: float = -math.inf
    """m, distance to the nearest other part above which a part is done; -inf where it does not count."""

    goal_gap: float | None = None
    """m, least distance between goals of all episodes, where the task defines one."""

    lasts: float = 0.0
    """s, least duration of an episode before it can succeed, excluding the hold."""

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings
        if self.MAX_PARTS is not None and len(parts) > self.MAX_PARTS:
            raise checks.refuse("parts", f"{len(parts)} parts", f"at most {self.MAX_PARTS} for {self.name}")
        self.hold = self.settings.hold
        self.surface, self.parts, self.features = surface, tuple(parts), tuple(self.FEATURES)
        self.part_kinds = Kinds.of(parts)
        self.kinds, self.kind = kinds_by_name(self.parts)
        self.slots = len(parts) if self.settings.slots is None else self.settings.slots
        if self.slots < len(parts):
            raise checks.refuse("slots", self.slots, f"a whole number >= {len(parts)}, the number of parts")
        self.driven = np.array([part.coupling > 0.0 for part in self.parts])
        self.scored = np.ones(len(self.parts), dtype=bool)
        self.made_of, weights = terms_of(self.name, self.TERMS, self.has_custom_reward)
        self.weights = weights | self.settings.weights
        falls = [term for term in self.weights if self.made_of.get(term, term) == "fallen"]
        self.worst = () if self.continuous_feed else tuple(falls)

    @property
    def name(self) -> str:
        """Name of the task."""
        return type(self).__name__

    @property
    def has_heading(self) -> bool:
        """Whether headings count."""
        return math.isfinite(self.heading_tolerance)

    @property
    def info_fields(self) -> tuple[str, ...]:
        """Fields of ``info``, among the names in :data:`vibgym.envs.info.ROWS`."""
        counted = {
            "is_success": True, "position_error": not self.continuous_feed,
            "heading_error": self.has_heading and not self.continuous_feed,
            "clearance": self.MAX_PARTS != 1, "touching": self.MAX_PARTS != 1, "parts_done": self.MAX_PARTS != 1,
            "fallen": not self.continuous_feed, "diverged": True,
        }  # fmt: skip
        return tuple(name for name, counts in counted.items() if counts)

    def tolerances(self) -> np.ndarray:
        """Return position and heading tolerance of each part, (parts, 2) m and rad."""
        return np.tile([self.position_tolerance, self.heading_tolerance], (len(self.parts), 1))

    def heading_period(self, part: Part) -> float:
        """Return the turn after which a part's goal is the same, rad; 0 where headings are not wrapped."""
        if not self.modulo_symmetry:
            return 2.0 * math.pi
        return 2.0 * math.pi / part.symmetry if part.symmetry else 1e-9  # disc: tiny, so that every heading is the same

    @abstractmethod
    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        """Return starts computed from ``uniform`` (n, draws) in [0, 1).

        Args:
            present: (n, parts) bool, the parts of each episode; None: chosen by the task.
        """

    def goal_from(self, start: Start, pose: np.ndarray) -> np.ndarray:
        """Return the goals (n, parts, 3) of a drawn start whose parts are placed at ``pose`` (n, parts, 3) instead."""
        return give_out(self.kind, start.present, pose, start.goal) if self.exchanges else start.goal

    def place(self, start: Start, pose: np.ndarray) -> Start:
        """Return a drawn start whose parts are placed at ``pose`` (n, parts, 3) instead.

        Raises:
            ValueError: the task cannot start there.
        """
        return start._replace(pose=pose, goal=self.goal_from(start, pose))

    def scoring(self, state: State, periods: int) -> Scoring:
        """Return the scoring of the worlds of ``state``, with ``periods`` oscillation periods per step."""
        return Scoring(self.rules(periods), self.part_kinds, state, self.kind if self.exchanges else None)

    def rules(self, periods: int) -> Rules:
        """Return the task's parameters for the kernels, with ``periods`` oscillation periods per step."""
        zone = np.tile(ANYWHERE, (len(self.parts), 1))
        if self.zones is not None:
            zone = self.zones[self.kind]
        elif self.has_goal:
            zone = np.zeros((len(self.parts), 4))
        counted = [(name, of, self.weights[name]) for name, of in self.made_of.items()]
        if self.has_custom_reward:  # takes all quantities without weights
            counted = [(of, of, 1.0) for of in QUANTITIES]
        return Rules(
            zone=np.where(self.scored[:, None], zone, ANYWHERE),
            tolerance=np.ascontiguousarray(np.where(self.scored[:, None], self.tolerances(), math.inf)),
            has_goal=self.scored,
            heading_period=self.part_kinds.values(self.heading_period),
            slow=float(self.speed_limit),
            apart=float(self.apart),
            far=math.hypot(self.surface.width, self.surface.depth),
            hold=max(self.hold, periods + 1) if self.hold > 1 else 1,  # a hold has a first and a last end of a step
            periods=periods,
            term=np.array([list(QUANTITIES).index(of) for _, of, _ in counted], dtype=np.int64),
            weight=np.array([w * (periods if of in PER_PERIOD else 1) for _, of, w in counted], dtype=np.float64),
            worst=np.array([name in self.worst for name, *_ in counted], dtype=bool),
        )

    def reward(self, step: Step) -> Mapping[str, np.ndarray]:
        """Return the reward terms of a step, each (worlds, parts), before they are weighted.

        Override it for a custom reward, with ``super().reward(step)`` for the terms of :attr:`TERMS`; without an override
        kernels compute these. ``docs/extending.md`` defines how terms become rewards. A reward must depend on the step alone
        and store nothing: worlds, copies and snapshots then continue bit for bit.
        """
        return {name: step.quantities[quantity] for name, quantity in self.made_of.items()}

    @property
    def has_custom_reward(self) -> bool:
        """Whether :meth:`reward` is overridden."""
        return getattr(self.reward, "__func__", None) is not Task.reward

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        """Return one line of text for a picture of a world: the errors of the only part with a goal, or the progress of all."""
        away, scored = f"{1e3 * episode.position_error[world]:.1f} mm", np.flatnonzero(self.scored & self.has_goal)
        if len(scored) == 1:
            heading_error = rounded(float(np.degrees(relations.error[world, scored[0], 2])))
            heading = f"   heading {heading_error:+.1f} deg to go" if self.has_heading else ""
            return f"{self.name}   distance {away}{heading}"
        done, present = episode.parts_done[world], episode.present[world].sum()
        clearance = rounded(1e3 * float(episode.clearance[world]))
        text = f"{self.name}   {done} of {present} parts done   smallest distance {clearance} mm"
        return f"{text}   error {away}" if self.has_goal else text


def rounded(value: float) -> float:
    """Return a number with one decimal for a caption, 0.0 instead of -0.0."""
    return round(value, 1) + 0.0


def kinds_by_name(parts: Sequence[Part]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the kinds in order of appearance, and each part's kind (parts,).

    Parts with the same name are of one kind, irrespective of their shape.

    Raises:
        ValueError: there are more than :data:`MAX_KINDS` kinds.
    """
    names = tuple(dict.fromkeys(part.name for part in parts))
    if len(names) > MAX_KINDS:
        raise checks.refuse("parts", f"{len(names)} kinds: {', '.join(names)}", f"at most {MAX_KINDS} kinds (names)")
    return names, np.array([names.index(part.name) for part in parts])


def terms_of(owner: str, terms: Mapping[str, Any], custom: bool) -> tuple[dict[str, str], dict[str, float]]:
    """Return the quantities and the weights of a table of terms, see :attr:`Task.TERMS`.

    Args:
        owner: the task's name, for errors.
        custom: whether the task overrides ``reward``.

    Raises:
        ValueError: if a quantity is unknown, a weight is not finite, or a term is not computed by any quantity or override.
    """
    made_of, weights = {}, {}
    for name, entry in terms.items():
        where, weight = f"{owner}.TERMS[{name!r}]", entry
        if isinstance(entry, tuple) and len(entry) == 2:
            made_of[name] = checks.choice(f"{where}[0]", entry[0], QUANTITIES)
            weight = entry[1]
        elif not custom:
            known = f"(quantity, weight) with a quantity among {', '.join(QUANTITIES)}"
            raise checks.refuse(where, entry, f"{known}, or a reward that returns the term")
        weights[name] = checks.number(where, weight)
    return made_of, weights
