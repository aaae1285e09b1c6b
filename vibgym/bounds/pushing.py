"""Least time in which parts that the table drives can push one that it does not drive to a pose: by energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds.tables import FREE_END, Hold, fewest_periods, way_reach
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

MARGIN = 0.15
"""Added to the power of the elements, as a share: of velocities that change within a period, see docs/bound.md."""

SPEEDS, INSTANTS = 400, 720  # of the table's speed up to which power is looked for, and of a period


def most_power(surface: Surface, friction: float, amplitude: float) -> float:
    """Largest mean power, W/kg, that the elements can give a part of this friction, at whatever velocity it is held.

    At a velocity ``v`` along x the mean of friction times velocity over a period is linear in the mean phasor of the elements

        v mu <(g - C cos wt + S sin wt) u_x / |u|>        u = v_table(t) - v

    and largest with all of them at full ``amplitude`` (m) and the best phase.
    """
    at = 2.0 * math.pi * (np.arange(INSTANTS) + 0.5) / INSTANTS
    speed = surface.table_speed * np.arange(1, SPEEDS + 1)[:, None] / SPEEDS
    along, across = -surface.table_speed * np.sin(at) - speed, surface.table_speed * np.cos(at)
    share = along / np.hypot(along, across)
    best = np.hypot((share * np.cos(at)).mean(axis=1), (share * np.sin(at)).mean(axis=1))
    full = amplitude * surface.angular_frequency**2
    return float((speed[:, 0] * friction * (surface.gravity * share.mean(axis=1) + full * best)).max())


@dataclass(eq=False)
class PushBound:
    """Fewest steps, and least time, in which pushers can bring a part to a pose whose pressure the elements do not change.

    The part's friction takes at least ``c m (v^2 + k^2 w^2)``, with ``c = mu g / (2 a_h w)``. Nobody but the pushers gives it
    energy, and the elements give these no more than :func:`most_power`. With ``D^2 = way^2 + k^2 turn^2`` and a first touch
    after a time ``t``, Cauchy and Schwarz leave

        D^2 <= (T - t) T sum(m_pusher P_pusher) / (c m)

    However the pushers do it: levers and throws gain speed, not energy.

    Args:
        surface: the table.
        part: that is pushed.
        pushers: that the elements drive.
        position_tolerance, heading_tolerance, heading_period, hold, periods_per_step, amplitude, latency: as for
            :class:`vibgym.bounds.TimeBound`.

    Raises:
        ValueError: nobody who pushes, or a part without friction.
    """

    surface: Surface
    part: Part
    pushers: Sequence[Part]
    _: KW_ONLY
    position_tolerance: float
    heading_tolerance: float = math.inf
    heading_period: float = 0.0
    hold: int = 10
    periods_per_step: int = 1
    amplitude: float | None = None
    latency: int = 0

    def __post_init__(self) -> None:
        surface, part = self.surface, checks.instance("part", self.part, Part)
        if not self.pushers:
            raise checks.refuse("pushers", list(self.pushers), "one part at least that the elements drive")
        if part.friction == 0.0:
            raise checks.refuse("part", "friction 0", "parts that friction brakes")
        self.position_tolerance = checks.number("position_tolerance", self.position_tolerance, above=0.0)
        amplitude = surface.full_scale / surface.angular_frequency**2 if self.amplitude is None else self.amplitude
        self.instants = -(-self.hold // self.periods_per_step)
        power = sum(each.mass * most_power(surface, each.friction, amplitude) for each in self.pushers)
        drag = part.friction * surface.gravity / (2.0 * surface.table_speed)
        self.top_speed = math.sqrt((1.0 + MARGIN) * power / (drag * part.mass))
        """m/s, that the part could be kept at."""
        hold = Hold(1, self.periods_per_step)
        self._approach = [way_reach(surface, each.friction, amplitude, FREE_END, hold) for each in self.pushers]

    def steps(self, start: Any, goal: Any, gap: Any) -> np.ndarray:
        """Fewest steps to success, int64 (n,), the hold's own included.

        Args:
            start, goal: (n, 3) poses of the part, m and rad.
            gap: (n, pushers) m, from each pusher to the part.

        Raises:
            ValueError: numbers that are not finite, or shapes that do not fit.
        """
        start = checks.array("start", start, (len(start), 3))
        goal = checks.array("goal", goal, start.shape)
        gap = checks.array("gap", gap, (len(start), len(self.pushers)))
        period, turn = self.surface.period, np.abs((goal - start)[:, 2])
        if self.heading_period > 0.0:
            turn = np.mod(turn, self.heading_period)
            turn = np.minimum(turn, self.heading_period - turn)
        turn = np.maximum(turn - self.heading_tolerance, 0.0)
        way = np.maximum(np.hypot(*(goal - start)[:, :2].T) - self.position_tolerance, 0.0)
        far = way**2 + self.part.gyration * turn**2
        first = np.min([fewest_periods(each, apart) for each, apart in zip(self._approach, gap.T, strict=True)], axis=0)
        # Part of the last period may do.
        touch = period * (np.maximum(first - 1, 0) + self.latency)
        least = 0.5 * (touch + np.sqrt(touch**2 + 4.0 * far / self.top_speed**2))
        periods = np.where(far > 0.0, np.ceil(least / period - 1e-9), 1.0)
        arrival = np.maximum(np.ceil(periods / self.periods_per_step), 1.0).astype(np.int64)
        return arrival + self.instants - 1

    def seconds(self, start: Any, goal: Any, gap: Any) -> np.ndarray:
        """Least time to success, s (n,); see :meth:`steps`."""
        return self.periods_per_step * self.surface.period * self.steps(start, goal, gap)
