"""Least time from rest at one pose to success at another."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds.tables import FREE_END, Hold, Reach, displacement_reach, turn_reach
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

MAX_HOLD = MAX_LATENCY = 10_000

LARGEST = 1e9
"""Largest coordinates of poses, m and rad."""


@dataclass(eq=False)
class GoalBound:
    """What bounds of a part with a goal have in common.

    Args:
        surface, part: the pair.
        position_tolerance: m, from the goal's centre.
        heading_tolerance: rad; infinite where headings do not count.
        heading_period: rad, turn after which the goal is the same; 0 where headings are not wrapped.
        hold: consecutive oscillation periods that must end within the tolerances.
        periods_per_step: oscillation periods of a step; the part is observed at the end of a step.
        amplitude: m, largest vertical amplitude of the elements; None: the surface's.
        latency: periods before the first command acts; until then the elements rest.

    Raises:
        ValueError: a bad argument.
    """

    surface: Surface
    part: Part
    _: KW_ONLY
    position_tolerance: float
    heading_tolerance: float = math.inf
    heading_period: float = 0.0
    hold: int = 10
    periods_per_step: int = 1
    amplitude: float | None = None
    latency: int = 0

    def __post_init__(self) -> None:
        surface = checks.instance("surface", self.surface, Surface)
        checks.instance("part", self.part, Part)
        self.position_tolerance = checks.number("position_tolerance", self.position_tolerance, above=0.0)
        if not isinstance(self.heading_tolerance, float) or self.heading_tolerance != math.inf:
            self.heading_tolerance = checks.number("heading_tolerance", self.heading_tolerance, above=0.0)
        self.heading_period = checks.number("heading_period", self.heading_period, least=0.0)
        self.hold = checks.count("hold", self.hold, most=MAX_HOLD)
        self.periods_per_step = checks.count("periods_per_step", self.periods_per_step, most=checks.MAX_PERIODS)
        if self.amplitude is not None:
            self.amplitude = checks.number("amplitude", self.amplitude, least=0.0, most=surface.max_amplitude)
        self.latency = checks.count("latency", self.latency, least=0, most=MAX_LATENCY)


@dataclass(eq=False)
class TimeBound(GoalBound):
    """Fewest steps, and least time, in which one part alone can succeed: from rest into tolerance, and held there.

    It holds for every policy on the planar model and a level table, for all phasors within ``amplitude``. Displacement and turn
    are bounded separately; the larger bound counts. The first instance for a scene and its tolerances computes tables, which
    takes some seconds.

    Args: those of :class:`GoalBound`, and
        stopped: whether other parts or walls may stop the part at its goal, so that it need not brake.

    Raises:
        ValueError: a bad argument, or a part that might stick.
    """

    _: KW_ONLY
    stopped: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        surface, part, heading_tolerance = self.surface, self.part, self.heading_tolerance
        self.stride = self.periods_per_step
        amplitude: Any = surface.max_amplitude if self.amplitude is None else self.amplitude
        if part.coupling == 0.0:
            raise checks.refuse("part.coupling", part.coupling, "> 0: parts that the elements move")
        if part.friction_law is not None:
            raise checks.refuse(
                "part.friction_law", dict(part.friction_law), "None: a constant coefficient of friction"
            )
        amplitude *= part.coupling  # as it reaches the part
        strongest = part.static_friction * (surface.gravity + amplitude * surface.angular_frequency**2)
        if part.friction == 0.0 or surface.horizontal_amplitude * surface.angular_frequency**2 <= strongest:
            allowed = "parts that slide all the time: mu > 0 and a_h w^2 > mu_0 (g + a_v w^2)"
            raise checks.refuse("part", f"friction {part.friction:g} (static: {part.static_friction:g})", allowed)
        self._hold = Hold.of(self.hold, self.stride)
        end = FREE_END if checks.flag("stopped", self.stopped) else self.position_tolerance
        self._displacements = displacement_reach(surface, part.friction, amplitude, end, self._hold)
        self._rotations: tuple[Reach, Reach] | None = None
        if 0.0 < self.heading_period <= 2.0 * heading_tolerance:
            heading_tolerance = math.inf  # no heading is ever off
        if heading_tolerance < math.inf:
            end = FREE_END if self.stopped else heading_tolerance
            self._rotations = turn_reach(surface, part, amplitude, end, self._hold)

    @property
    def step_time(self) -> float:
        """s."""
        return self.stride * self.surface.period

    @property
    def least_steps(self) -> int:
        """Steps of the hold: the bound of an episode in which nothing has to move."""
        return self._hold.instants

    def steps(self, start: Any, goal: Any) -> np.ndarray:
        """Return the fewest steps to success, int64 (n,), including the hold.

        Args:
            start, goal: (n, 3) poses, m and rad; a single row is broadcast.

        Raises:
            ValueError: numbers that are not finite, or shapes that do not fit.
        """
        start, goal = _rows("start", start), _rows("goal", goal)
        shape = (max(len(start), len(goal)), 3)
        start, goal = checks.array("start", start, shape), checks.array("goal", goal, shape)
        x, y = (goal - start)[:, :2].T
        periods = self._displacements.periods(np.arctan2(y, x), np.hypot(x, y) - self.position_tolerance)
        if self._rotations is not None:
            periods = np.maximum(periods, self._turning(start[:, 2], goal[:, 2] - start[:, 2]))
        arrival = np.maximum(-(-(periods + np.where(periods > 0, self.latency, 0)) // self.stride), 1)
        return arrival + self._hold.instants - 1

    def seconds(self, start: Any, goal: Any) -> np.ndarray:
        """Return the least time to success, s (n,); see :meth:`steps`."""
        return self.step_time * self.steps(start, goal)

    def _turning(self, heading: np.ndarray, heading_error: np.ndarray) -> np.ndarray:
        """Return the fewest periods to within the heading's tolerance, in the faster direction."""
        assert self._rotations is not None
        period = self.heading_period
        errors = (heading_error,)
        if period > 0.0:
            heading_error = np.mod(heading_error, period)
            errors = (heading_error, heading_error - period)
        periods = []
        for angle in errors:
            left = np.abs(angle) - self.heading_tolerance
            counter, clockwise = self._rotations[0].periods(heading, left), self._rotations[1].periods(-heading, left)
            periods.append(np.where(angle >= 0.0, counter, clockwise))
        return np.min(periods, axis=0)


def check_parts(name: str, parts: Any) -> None:
    """Raise ValueError unless ``parts`` is a list of at least one :class:`vibgym.Part`."""
    if not checks.listed(parts) or not len(parts):
        raise checks.refuse(name, parts, "a list of at least one vibgym.Part")
    for k, part in enumerate(parts):
        checks.instance(f"{name}[{k}]", part, Part)


def _rows(name: str, value: Any) -> np.ndarray:
    """Return poses (n, 3)."""
    try:
        rows = np.atleast_2d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise checks.refuse(name, value, "real numbers of shape (n, 3)") from None
    return checks.array(name, rows, (len(rows), 3), least=-LARGEST, most=LARGEST)
