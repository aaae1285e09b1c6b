"""Bounds for several parts: least time to joint success, flow through gates, and pushing of undriven parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.bounds.tables import FREE_END, Hold, displacement_reach, fewest_periods
from vibgym.bounds.time_bound import LARGEST, GoalBound, TimeBound, check_parts
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.plant import drag_of, means


class SeveralBound:
    """Fewest steps, and least time, to the joint success of several parts: all at their goals at once, and held there.

    The bound is the largest of the parts' single-part bounds. It neglects that parts obstruct and push one another and share
    elements, see ``docs/bound.md``.

    Args:
        bounds: of every part, in order; with the same surface, hold and steps.

    Raises:
        ValueError: no bounds, or bounds with different periods, steps or holds.
    """

    def __init__(self, bounds: Sequence[TimeBound]) -> None:
        self.bounds = tuple(checks.instance(f"bounds[{k}]", bound, TimeBound) for k, bound in enumerate(bounds))
        moments = {(bound.surface.period, bound.stride, bound.hold) for bound in self.bounds}
        if len(moments) != 1:
            raise checks.refuse("bounds", sorted(moments), "one of every part, with the same period, steps and hold")

    def each(self, start: Any, goal: Any) -> np.ndarray:
        """Return the fewest steps of every part alone, int64 (n, parts).

        Args:
            start, goal: (n, parts, 3) poses, m and rad.

        Raises:
            ValueError: other shapes, or numbers that are not finite.
        """
        start, goal = self._poses("start", start), self._poses("goal", goal)
        goal = checks.array("goal", goal, start.shape)
        return np.stack([bound.steps(start[:, k], goal[:, k]) for k, bound in enumerate(self.bounds)], axis=1)

    def steps(self, start: Any, goal: Any, counts: np.ndarray | None = None) -> np.ndarray:
        """Return the fewest steps to success, int64 (n,), including the hold, where every part has its own goal.

        Args:
            start, goal: see :meth:`each`.
            counts: (n, parts) bool, present parts with a goal; None: all.
        """
        steps = self.each(start, goal)
        return np.max(steps, axis=1, where=True if counts is None else counts, initial=self.bounds[0].least_steps)

    def free_steps(self, start: Any, goal: Any, group: Any, counts: np.ndarray | None = None) -> np.ndarray:
        """Return the fewest steps where parts may exchange goals within their group: bottleneck assignment.

        Args:
            start, goal, counts: see :meth:`steps`; the goals are those of the parts that count.
            group: (parts,) group number of each part.
        """
        start, goal = self._poses("start", start), self._poses("goal", goal)
        group = checks.array("group", group, (len(self.bounds),), dtype=np.int64)
        there = np.ones(start.shape[:2], dtype=bool) if counts is None else counts
        result = np.full(len(start), self.bounds[0].least_steps)
        for name in np.unique(group):
            members = np.flatnonzero(group == name)
            size = len(members)
            rows, columns = np.repeat(members, size), np.tile(members, size)
            steps = self.bounds[members[0]].steps(start[:, rows].reshape(-1, 3), goal[:, columns].reshape(-1, 3))
            for world, cost in enumerate(steps.reshape(-1, size, size)):
                here = there[world, members]
                if here.any():
                    result[world] = max(result[world], bottleneck(cost[np.ix_(here, here)]))
        return result

    def _poses(self, name: str, value: Any) -> np.ndarray:
        shape = (len(np.atleast_1d(np.asarray(value))), len(self.bounds), 3)
        return checks.array(name, value, shape, least=-LARGEST, most=LARGEST)


def bottleneck(cost: np.ndarray) -> Any:
    """Return the largest entry of the bottleneck assignment of rows to columns; ``cost`` (n, n).

    Bisection of the least threshold with a perfect matching, which augmenting paths find (Burkard, Dell'Amico and Martello,
    "Assignment problems", SIAM 2009, section 6.2).
    """
    levels = np.unique(cost)
    low, high = 0, len(levels) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if _matches(cost <= levels[middle]) else (middle + 1, high)
    return levels[low]


def _matches(allowed: np.ndarray) -> bool:
    """Return whether there is a perfect matching of rows and allowed columns."""
    columns, owner = [np.flatnonzero(row).tolist() for row in allowed], [-1] * len(allowed)

    def finds(row: int, seen: set[int]) -> bool:
        for column in columns[row]:
            if column not in seen:
                seen.add(column)
                if owner[column] < 0 or finds(owner[column], seen):
                    owner[column] = row
                    return True
        return False

    return all(finds(row, set()) for row in range(len(allowed)))


@dataclass(eq=False)
class FlowBound:
    """Largest number of good parts in the counted time of an episode, and per minute.

    Two departures from a slot are separated by a step and the least time from inlet to gate, good parts through a gate by a
    headway. At most ``1 + (n - 1) // d`` events at least ``d`` periods apart fit into ``n`` periods. The bound neglects that
    parts obstruct one another and that the inlet may be occupied.

    Args:
        surface: the table.
        parts: one per slot.
        kind: (parts,) whole numbers, gate of each part.
        displacement: (parts,) m, least distance from the inlet to the gate.
        headway: periods between good parts through the same gate.
        periods: number of counted periods.
        periods_per_step: oscillation periods of a step; parts arrive and leave at its end.
        amplitude: m, largest vertical amplitude of the elements; None: the surface's.

    Raises:
        ValueError: a bad argument.
    """

    surface: Surface
    parts: Sequence[Part]
    kind: Any
    displacement: Any
    headway: int
    periods: int
    periods_per_step: int = 1
    amplitude: float | None = None

    def __post_init__(self) -> None:
        checks.instance("surface", self.surface, Surface)
        check_parts("parts", self.parts)
        number, stride = (
            len(self.parts),
            checks.count("periods_per_step", self.periods_per_step, most=checks.MAX_PERIODS),
        )
        kind = checks.array("kind", self.kind, (number,), dtype=np.int64)
        displacement = checks.array("displacement", self.displacement, (number,), least=0.0)
        gate = _steps(checks.count("headway", self.headway, least=0), stride)
        moments = checks.count("periods", self.periods, least=0) // stride
        full = self.surface.full_scale / self.surface.angular_frequency**2
        amplitude = full if self.amplitude is None else checks.number("amplitude", self.amplitude, least=0.0, most=full)
        transit = np.zeros(number, dtype=np.int64)
        for k, part in enumerate(self.parts):
            reach = displacement_reach(self.surface, part.friction, amplitude, FREE_END, Hold(1, 1))
            transit[k] = _steps(int(fewest_periods(reach, displacement[k : k + 1])[0]), stride)
        passes = np.array([_fitting(moments, steps + 1) for steps in transit.tolist()])
        self.transit = self.surface.period * stride * transit
        """(parts,) s, least time from arrival to leaving."""
        self.most = int(sum(min(passes[kind == one].sum(), _fitting(moments, gate)) for one in np.unique(kind)))
        """Parts in the counted time."""

    @property
    def per_minute(self) -> float:
        """Parts per minute of the counted time; nan without any."""
        return 60.0 * self.most / (self.surface.period * self.periods) if self.periods else math.nan


def _steps(periods: int, stride: int) -> int:
    """Return the number of steps, at least 1."""
    return max(-(-periods // stride), 1)


def _fitting(moments: int, apart: int) -> int:
    """Return the largest number of events at least ``apart`` moments apart."""
    return 1 + (moments - 1) // apart if moments > 0 else 0


MARGIN = 0.15
"""Relative margin of the power, for velocities that change within a period; see docs/bound.md."""


def most_power(surface: Surface, friction: float, amplitude: float) -> float:
    """Return the largest mean power, W/kg, that elements can transfer to a part of this friction, over all constant velocities.

    At a velocity ``v`` along x the mean of friction times velocity over a period is linear in the mean phasor of the elements

        v mu <(g - C cos wt + S sin wt) u_x / |u|>        u = v_table(t) - v

    and is largest with all of them at full ``amplitude`` (m) and the best phase, which pushes along x.
    """
    slip, drag, _, push = means()
    full = amplitude * surface.angular_frequency**2
    return float((surface.table_speed * slip * friction * (full * push - surface.gravity * drag)).max())


@dataclass(eq=False)
class PushBound(GoalBound):
    """Fewest steps, and least time, in which pushers can move an undriven part to a pose.

    Friction dissipates at least ``c m (v^2 + k^2 w^2)``, with ``c = mu g / (2 a_h w)``. Only the pushers transfer energy to
    the part, and the elements transfer at most :func:`most_power` to the pushers. With ``D^2 = x^2 + k^2 a^2`` of displacement
    and turn, and a first touch after a time ``t``, the Cauchy-Schwarz inequality gives

        D^2 <= (T - t) T sum(m_pusher P_pusher) / (c m)

    Args: those of :class:`vibgym.bounds.time_bound.GoalBound`, of the pushed part, and
        pushers: parts that the elements drive, after the part.

    Raises:
        ValueError: a bad argument, no pushers, or a part without friction.
    """

    pushers: Sequence[Part]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_parts("pushers", self.pushers)
        surface, part = self.surface, self.part
        if part.friction == 0.0:
            raise checks.refuse("part", "friction 0", "a part with friction")
        if any(pusher.friction_law is not None for pusher in (part, *self.pushers)):
            raise checks.refuse(
                "part.friction_law", "a law", "None: a constant coefficient of friction, of the pushers too"
            )
        amplitude = surface.full_scale / surface.angular_frequency**2 if self.amplitude is None else self.amplitude
        self.instants = Hold.of(self.hold, self.periods_per_step).instants
        power = sum(pusher.mass * most_power(surface, pusher.friction, amplitude) for pusher in self.pushers)
        drag = float(drag_of(surface, [part])[0])
        self.top_speed = math.sqrt((1.0 + MARGIN) * power / (drag * part.mass))
        """m/s, largest speed that the pushers can sustain."""
        hold = Hold(1, self.periods_per_step)
        self._approach = [
            displacement_reach(surface, pusher.friction, amplitude, FREE_END, hold) for pusher in self.pushers
        ]

    def steps(self, start: Any, goal: Any, gap: Any) -> np.ndarray:
        """Return the fewest steps to success, int64 (n,), including the hold.

        Args:
            start, goal: (n, 3) poses of the part, m and rad.
            gap: (n, pushers) m, from each pusher to the part.

        Raises:
            ValueError: numbers that are not finite, or shapes that do not fit.
        """
        start = checks.array("start", start, (len(start), 3))
        goal = checks.array("goal", goal, start.shape)
        gap = checks.array("gap", gap, (len(start), len(self.pushers)))
        period, heading_error = self.surface.period, np.abs((goal - start)[:, 2])
        if self.heading_period > 0.0:
            heading_error = np.mod(heading_error, self.heading_period)
            heading_error = np.minimum(heading_error, self.heading_period - heading_error)
        heading_error = np.maximum(heading_error - self.heading_tolerance, 0.0)
        displacement = np.maximum(np.hypot(*(goal - start)[:, :2].T) - self.position_tolerance, 0.0)
        far = displacement**2 + self.part.gyration * heading_error**2
        first = np.min(
            [fewest_periods(reach, apart) for reach, apart in zip(self._approach, gap.T, strict=True)], axis=0
        )
        # The last period need not be complete.
        touch = period * (np.maximum(first - 1, 0) + self.latency)
        least = 0.5 * (touch + np.sqrt(touch**2 + 4.0 * far / self.top_speed**2))
        periods = np.where(far > 0.0, np.ceil(least / period - 1e-9), 1.0)
        arrival = np.maximum(np.ceil(periods / self.periods_per_step), 1.0).astype(np.int64)
        return arrival + self.instants - 1
