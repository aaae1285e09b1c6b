"""Decode state observations of all tasks into SI units, and keep the state of controllers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from vibgym import checks
from vibgym.envs.features import Layout
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.episode import PREVIEW

Memory = TypeVar("Memory", bound=tuple)


@dataclass(frozen=True, eq=False)
class Measured:
    """A batch of observations: arrays of (batch, parts) or (batch, parts, 2). Those of absent parts are meaningless."""

    present: np.ndarray  # bool
    centre: np.ndarray  # m
    heading: np.ndarray  # rad, modulo the part's symmetry; 0 for a disc
    way: np.ndarray  # goal, or nearest point of the zone, minus centre, m; 0 without
    turn: np.ndarray  # goal minus heading, rad; 0 where headings do not count
    velocity: np.ndarray  # mean over the last period, m/s
    spin: np.ndarray  # the same, rad/s
    gap: np.ndarray  # distance to the nearest other part, m, capped at about eight elements; infinite for one part
    single: bool  # whether one observation without batch axis was given
    # Of goals that move: (batch, parts, 3) velocity, m/s, m/s, rad/s; (batch, parts, PREVIEW, 3) pose 1, 2, ... periods
    # ahead minus the present one, m, m, rad; (batch, parts, 3) mean acceleration over a step, which no observation tells,
    # see vibgym.policies.classical.goal_motion. Zeros that broadcast to these shapes where goals stay.
    goal_velocity: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))
    goal_ahead: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, PREVIEW, 3)))
    goal_acceleration: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))
    # (batch, parts) bool: parts that have arrived in this step, where parts come and go.
    arrived: np.ndarray = field(default_factory=lambda: np.zeros((1, 1), dtype=bool))
    # (batch, parts, 3) m, m, rad: standard deviation of the place where a part comes to rest, of what is not yet read.
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
        """Decode one state observation or a batch of them.

        Raises:
            ValueError: the array is not (size,) or (batch, size).
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
            way=quantity("way", np.repeat(none, 2, axis=-1)),
            turn=quantity("turn")[..., 0],
            velocity=quantity("velocity"),
            spin=quantity("spin")[..., 0],
            gap=quantity("gap", none + math.inf)[..., 0],
            single=values.ndim == 1,
            arrived=quantity("arrived")[..., 0] > 0.5,
            **moving_goals(rows, layout),
        )


def moving_goals(rows: np.ndarray, layout: Layout) -> dict[str, np.ndarray]:
    """Velocity and preview of the goals in observations (batch, size); nothing where goals stay."""
    if "way_ahead" not in layout:
        return {}
    shape = (len(rows), len(layout.parts), PREVIEW)
    way = layout.quantity(rows, "way_ahead").reshape(*shape, 2) - layout.quantity(rows, "way")[..., None, :]
    turn = layout.quantity(rows, "turn_ahead") - layout.quantity(rows, "turn")
    velocity = [layout.quantity(rows, name) for name in ("goal_velocity", "goal_spin")]
    return {
        "goal_velocity": np.concatenate(velocity, axis=-1),
        "goal_ahead": np.concatenate([way, turn[..., None]], axis=-1),
    }


def check_state(observation: Any, layout: Layout) -> np.ndarray:
    """One state observation (size,) or a batch (batch, size) as float64.

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


def wrap(angle: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
    """Angles to the nearest equivalent one of parts with this symmetry, within +-pi / symmetry, rad."""
    period = 2.0 * math.pi / np.maximum(symmetry, 1)
    return angle - period * np.round(angle / period)


def started(state: Any, episode_start: Any, batch: int) -> np.ndarray:
    """(batch,) bool: whose episode has just begun."""
    if state is None:
        return np.ones(batch, dtype=bool)
    if episode_start is None:
        return np.zeros(batch, dtype=bool)
    return np.broadcast_to(np.asarray(episode_start, dtype=bool), (batch,))


def recall(
    state: Any, episode_start: Any, initial: Memory, batch: int, arrived: np.ndarray | None = None
) -> tuple[Memory, np.ndarray]:
    """A controller's memory at the beginning of a step, a copy of its own, and (batch,) whose episode has just begun.

    Args:
        state: what the controller returned last; None at the very start.
        episode_start: (batch,) bool, see :meth:`vibgym.policies.protocol.Policy.predict`.
        initial: memory at an episode's start, of each world, or of one that stands for all: a NamedTuple of arrays (batch, ...)
            or (1, ...) and of such NamedTuples.
        batch: number of worlds.
        arrived: (batch, parts) bool, parts that have arrived in this step: nothing is known of them. Where there are any, a
            memory's arrays are all (batch, parts, ...). None: parts stay.

    Raises:
        ValueError: a memory of another controller or batch.
    """
    new = started(state, episode_start, batch)
    if state is None:
        return _kept(None, initial, new), new
    if not _alike(state, initial, batch):
        got = type(state).__name__
        if isinstance(state, tuple) and state and isinstance(state[0], np.ndarray):
            got += f" of {len(state[0])}"
        raise checks.refuse("state", got, f"None, or what predict() returned for {batch}: {type(initial).__name__}")
    kept = _kept(state, initial, new)
    return kept if arrived is None or not arrived.any() else _kept(kept, initial, arrived), new


def _alike(state: Any, initial: Any, batch: int) -> bool:
    """Whether two memories are of the same controller, and the first of so many worlds."""
    if isinstance(initial, np.ndarray):
        return isinstance(state, np.ndarray) and state.shape == (batch, *initial.shape[1:])
    return type(state) is type(initial) and all(_alike(a, b, batch) for a, b in zip(state, initial, strict=True))


def _kept(state: Any, initial: Any, new: np.ndarray) -> Any:
    """A copy of a memory, fresh where ``new`` (batch,) or (batch, parts); of one that is None, all fresh."""
    if isinstance(initial, np.ndarray):
        fresh = np.broadcast_to(initial, (len(new), *initial.shape[1:]))
        kept = fresh.copy() if state is None else state.copy()
        if state is not None and new.any():
            kept[new] = fresh[new]
        return kept
    rows = [None] * len(initial) if state is None else state
    kept = [_kept(a, b, new) for a, b in zip(rows, initial, strict=True)]
    return type(initial)(*kept) if kept else initial
