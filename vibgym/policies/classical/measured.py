"""Decode state observations of all tasks into SI units, follow moving goals, and keep the memory of controllers.

Observations contain the velocity of a moving goal and its pose up to four periods ahead. Its acceleration is taken to be
constant in each period, so that from the first velocity on

    v_{k+1} = 2 (p_{k+1} - p_k) / T - v_k

and after them to be that of the last period. A law gets parts in the frame of their goals, which does not rotate: there a goal
is at rest at the origin, velocities are differences, and the goal's own acceleration is added to the law's output. So all laws
follow paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from vibgym import checks
from vibgym.envs.features import Layout
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.episode import PREVIEW

Memory = TypeVar("Memory", bound=tuple)


@dataclass(frozen=True, eq=False)
class Measured:
    """A batch of decoded observations: arrays (batch, parts) or (batch, parts, 2). Values of absent parts are undefined.

    Values of moving goals, and the last two, are zeros that broadcast to their shapes where they do not apply.
    """

    present: np.ndarray  # bool
    centre: np.ndarray  # m
    heading: np.ndarray  # rad, modulo the part's symmetry; 0 for a disc
    displacement: np.ndarray  # m, displacement to the goal, or to the nearest point of the zone; 0 without
    heading_error: np.ndarray  # rad, goal heading minus heading; 0 where headings do not count
    velocity: np.ndarray  # mean over the last period, m/s
    spin: np.ndarray  # the same, rad/s
    gap: np.ndarray  # distance to the nearest other part, m, at most about eight elements; infinite for one part
    single: bool  # whether one observation without batch axis was given
    # Of moving goals: (batch, parts, 3) velocity, m/s, m/s, rad/s; (batch, parts, PREVIEW, 3) pose 1, 2, ... periods ahead
    # minus the present one, m, m, rad; (batch, parts, 3) mean acceleration over a step, computed by Preview.
    goal_velocity: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))
    goal_ahead: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, PREVIEW, 3)))
    goal_acceleration: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))
    # (batch, parts) bool: parts that have arrived in this step, where parts arrive and leave.
    arrived: np.ndarray = field(default_factory=lambda: np.zeros((1, 1), dtype=bool))
    # (batch, parts, 3) m, m, rad: standard deviation of the place of rest, from pulses that are not measured yet.
    doubt: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))

    @property
    def pose(self) -> np.ndarray:
        """(batch, parts, 3) m, m, rad."""
        return np.concatenate([self.centre, self.heading[..., None]], axis=-1)

    @property
    def rate(self) -> np.ndarray:
        """(batch, parts, 3) mean velocity and spin over the last period, m/s, m/s, rad/s."""
        return np.concatenate([self.velocity, self.spin[..., None]], axis=-1)

    @classmethod
    def of(cls, observation: Any, info: TaskInfo) -> Measured:
        """Decode one state observation (size,) or a batch (batch, size).

        Raises:
            ValueError: another shape.
        """
        layout, values = info.layout, check_state(observation, info.layout)
        rows = np.atleast_2d(values)
        none = np.zeros((len(rows), len(info.parts), 1))

        def quantity(name: str, default: np.ndarray = none) -> np.ndarray:
            return layout.quantity(rows, name) if name in layout else default

        return cls(
            present=quantity("present", none + 1.0)[..., 0] > 0.5,
            centre=quantity("position"),
            heading=quantity("heading")[..., 0],
            displacement=quantity("way", np.repeat(none, 2, axis=-1)),
            heading_error=quantity("turn")[..., 0],
            velocity=quantity("velocity"),
            spin=quantity("spin")[..., 0],
            gap=quantity("gap", none + math.inf)[..., 0],
            single=values.ndim == 1,
            arrived=quantity("arrived")[..., 0] > 0.5,
            **_moving_goals(rows, layout),
        )


def _moving_goals(rows: np.ndarray, layout: Layout) -> dict[str, np.ndarray]:
    """Return velocity and preview of the goals in observations (batch, size); nothing where goals are fixed."""
    if "way_ahead" not in layout:
        return {}
    shape = (len(rows), len(layout.parts), PREVIEW)
    displacement = layout.quantity(rows, "way_ahead").reshape(*shape, 2) - layout.quantity(rows, "way")[..., None, :]
    heading_error = layout.quantity(rows, "turn_ahead") - layout.quantity(rows, "turn")
    velocity = [layout.quantity(rows, name) for name in ("goal_velocity", "goal_spin")]
    return {
        "goal_velocity": np.concatenate(velocity, axis=-1),
        "goal_ahead": np.concatenate([displacement, heading_error[..., None]], axis=-1),
    }


def check_state(observation: Any, layout: Layout) -> np.ndarray:
    """Return one state observation (size,) or a batch (batch, size) as float64.

    Raises:
        ValueError: another shape.
    """
    try:
        values = np.asarray(observation, dtype=np.float64)
    except (TypeError, ValueError):
        raise checks.refuse("observation", observation, f"real numbers of shape (..., {layout.size})") from None
    if values.ndim not in (1, 2) or values.shape[-1] != layout.size:
        raise checks.refuse("observation", f"array of shape {values.shape}", f"shape (..., {layout.size})")
    return values


def wrap(angle: np.ndarray, symmetry: np.ndarray | int = 1) -> np.ndarray:
    """Wrap angles (rad) of parts with this symmetry to +-pi / symmetry."""
    period = 2.0 * math.pi / np.maximum(symmetry, 1)
    return angle - period * np.round(angle / period)


def recall(
    state: Any, episode_start: Any, initial: Memory, batch: int, arrived: np.ndarray | None = None
) -> tuple[Memory, np.ndarray]:
    """Return a copy of a controller's memory at the beginning of a step, and (batch,) bool, where an episode has begun.

    Args:
        state: what the controller returned last; None at the very start.
        episode_start: (batch,) bool, see :meth:`vibgym.policies.task_info.Policy.predict`.
        initial: memory at an episode's start, per world or of one world for all: a NamedTuple of arrays (batch, ...) or
            (1, ...) and of such NamedTuples.
        batch: number of worlds.
        arrived: (batch, parts) bool, parts that have arrived in this step, whose memory is reset. Where there are any, a
            memory's arrays are all (batch, parts, ...). None: parts stay.

    Raises:
        ValueError: a memory of another controller or batch.
    """
    fresh = mapped(lambda array: np.broadcast_to(array, (batch, *array.shape[1:])), initial)
    if state is None:
        # In C order, unlike np.copy: another layout would compile every kernel that reads the memory twice.
        return mapped(np.ndarray.copy, fresh), np.ones(batch, dtype=bool)
    new = np.broadcast_to(np.asarray(False if episode_start is None else episode_start, dtype=bool), (batch,))
    if not _alike(state, fresh):
        got = type(state).__name__
        if isinstance(state, tuple) and state and isinstance(state[0], np.ndarray):
            got += f" of {len(state[0])}"
        raise checks.refuse("state", got, f"None, or what predict() returned for {batch}: {type(initial).__name__}")
    reset = new if arrived is None or not arrived.any() else new[:, None] | arrived

    def kept(array: np.ndarray, start: np.ndarray) -> np.ndarray:
        result = array.copy()
        result[reset] = start[reset]
        return result

    return mapped(kept, state, fresh), new


def mapped(function: Callable[..., np.ndarray], *memories: Any) -> Any:
    """Return a memory of the results of a function of the arrays of memories, which are arrays and tuples of them, or None."""
    first = memories[0]
    if isinstance(first, np.ndarray):
        return function(*memories)
    if not isinstance(first, tuple):
        return first
    rows = [mapped(function, *entries) for entries in zip(*memories, strict=True)]
    return type(first)(*rows) if hasattr(first, "_fields") else tuple(rows)


def _alike(state: Any, fresh: Any) -> bool:
    """Return whether two memories have the same structure and shapes."""
    if isinstance(fresh, np.ndarray):
        return isinstance(state, np.ndarray) and state.shape == fresh.shape
    return type(state) is type(fresh) and all(_alike(a, b) for a, b in zip(state, fresh, strict=True))


class Preview:
    """Extrapolation of moving goals to the instant at which a step's command begins to act.

    Args:
        info: task, scene and step time.
    """

    def __init__(self, info: TaskInfo) -> None:
        self.period, self.lead, self.periods = info.surface.period, info.lead, info.periods_per_step
        turns = [info.has_heading and part.symmetry > 0 for part in info.parts]
        self._counts = np.array([[1.0, 1.0, float(heading_error)] for heading_error in turns])

    def __call__(self, measured: Measured) -> Measured:
        """Return displacements to these goals, their velocity, and their mean acceleration over the step."""
        period, ahead = self.period, measured.goal_ahead * self._counts[:, None]
        places = np.concatenate([np.zeros_like(ahead[..., :1, :]), ahead], axis=-2)
        velocity = np.empty_like(places)
        velocity[..., 0, :] = measured.goal_velocity * self._counts
        for k in range(PREVIEW):
            mean = (places[..., k + 1, :] - places[..., k, :]) / period
            velocity[..., k + 1, :] = 2.0 * mean - velocity[..., k, :]
        begin, speed = self._at(places, velocity, self.lead)
        end, _ = self._at(places, velocity, self.lead + self.periods)
        time = self.periods * period
        return replace(
            measured,
            displacement=measured.displacement + begin[..., :2],
            heading_error=measured.heading_error + begin[..., 2],
            goal_velocity=speed,
            goal_acceleration=2.0 * (end - begin - time * speed) / time**2,
        )

    def _at(self, places: np.ndarray, velocity: np.ndarray, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Return poses and velocities so many periods from now."""
        if periods <= PREVIEW:
            return places[..., periods, :], velocity[..., periods, :]
        last, beyond = velocity[..., PREVIEW, :], (periods - PREVIEW) * self.period
        rate = (last - velocity[..., PREVIEW - 1, :]) / self.period
        return places[..., PREVIEW, :] + beyond * last + 0.5 * beyond**2 * rate, last + beyond * rate


def from_goals(measured: Measured) -> Measured:
    """Return the parts in the frames of their moving goals, see the module."""
    velocity = measured.goal_velocity
    return replace(
        measured,
        centre=-measured.displacement,
        heading=-measured.heading_error,
        velocity=measured.velocity - velocity[..., :2],
        spin=measured.spin - velocity[..., 2],
    )
