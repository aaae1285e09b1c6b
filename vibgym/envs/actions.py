"""Actions: flat float32 boxes in [-1, 1], and the commands that they are decoded to."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.actuators import DataSheet
from vibgym.kernels.jit import jit
from vibgym.physics.core.drive import (
    Drive,
    element_drive,
    phasor_drive,
)
from vibgym.registry import Registry
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement
from vibgym.settings import BaseSettings
from vibgym.simulation.threads import Blocks
from vibgym.snapshots import Live

FLOAT32 = np.dtype(np.float32)


@jit
def all_finite(values):
    """Return whether all of ``values`` (worlds, size) are finite."""
    bad = 0
    for w in range(values.shape[0]):
        for k in range(values.shape[1]):
            bad |= not (abs(values[w, k]) < math.inf)  # without an early exit the loop is vectorised
    return bad == 0


@jit
def copy_finite(values, kept):
    """Copy ``values`` (worlds, size) into ``kept`` if all are finite; returns whether they are."""
    if not all_finite(values):
        return False
    for w in range(values.shape[0]):
        for k in range(values.shape[1]):
            kept[w, k] = values[w, k]
    return True


WORTH_SHARING = 2**20
"""Bytes of a batch of actions above which several threads check it; the check is limited by memory bandwidth."""


def all_finite_in_blocks(values: np.ndarray, blocks: Blocks) -> bool:
    """Return whether all of ``values`` (worlds, size) are finite; large batches are checked on all threads."""
    if values.nbytes < WORTH_SHARING:
        return all_finite(values)
    finite = [False] * len(blocks.edges)

    def check(k: int) -> None:
        start, stop = blocks.edges[k]
        finite[k] = all_finite(values[start:stop])

    blocks.run(check)
    return all(finite)


class Action(Live, ABC):
    """Base class of actions: shape, flat space, validation, and command.

    A custom action is a subclass with ``shape`` and :meth:`command`; ``vibgym.envs.ACTIONS.register`` gives it a name.
    State between steps is in :meth:`live`: arrays (worlds, ...), which are reset to zero when an episode begins.

    Args:
        surface: the table.
        parts: the parts of a world.

    Attributes:
        shape: of an action; the space is flat, in C order.
        size: numbers of an action.
        step_time: s, of a step; set by the environment, before that a period.
    """

    SNAPSHOT = "action"

    shape: tuple[int, ...]
    by_part: ClassVar[bool] = False
    """Whether the first axis of ``shape`` is that of the parts."""

    class Settings(BaseSettings):
        """Settings of an action."""

    settings: Settings

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings
        self.surface = surface
        self.parts = Kinds.of(parts)
        self.full_scale = surface.full_scale
        self.step_time = surface.period
        self._shapes: dict[int | None, tuple[tuple[int, ...], ...]] = {}  # accepted shapes, by number of worlds
        self._size = 0  # once shapes are known
        self._drive: Drive | None = None  # the last command

    @property
    def size(self) -> int:
        """Numbers of an action."""
        return math.prod(self.shape)

    @property
    def space(self) -> spaces.Box:
        """Flat box of one world; most learners require one."""
        return spaces.Box(-1.0, 1.0, (self.size,), np.float32)

    def check(self, action: Any, worlds: int | None) -> np.ndarray:
        """Return a batch as contiguous float32 (worlds, size).

        Args:
            action: (worlds, size) or (worlds, ...) with :attr:`shape` for the rest.
            worlds: None: one action without that axis, as a batch of 1.

        Raises:
            ValueError: wrong shape, not numbers, NaN or infinity.
        """
        values = self.shaped(action, worlds)
        if not all_finite(values):
            raise self.not_finite(action)
        return values

    def shaped(self, action: Any, worlds: int | None) -> np.ndarray:
        """Return a batch like :meth:`check`, without the check of float32 values for NaN and infinity.

        Raises:
            ValueError: wrong shape, not numbers; of other types than float32 also NaN or infinity.
        """
        shapes = self._shapes.get(worlds)
        if shapes is None:
            lead = () if worlds is None else (worlds,)
            self._size = self.size
            shapes = self._shapes[worlds] = ((*lead, self._size), (*lead, *self.shape))
        if type(action) is np.ndarray and action.dtype is FLOAT32 and action.shape in shapes and action.flags.carray:
            # The usual case, without further checks. An array that is the same as in the last step need not be pinned again.
            return action if action.ndim == 2 and worlds is not None else action.reshape(-1, self._size)
        values = checks.shaped("action", action, shapes, "real numbers")
        if values.dtype != np.float32:
            if not np.isfinite(values).all():
                raise self.not_finite(action)
            # Clip in the given type: a float64 beyond float32's range would turn into infinity.
            values = np.clip(values, -1.0, 1.0)
        return np.array(values, dtype=np.float32, order="C").reshape(-1, self._size)

    def not_finite(self, action: Any) -> checks.Refused:
        """Return the error for an action with values that are not finite."""
        values = np.asarray(action)
        bad = np.argwhere(~np.isfinite(values))[0].tolist()
        return checks.refuse("action", f"{float(values[tuple(bad)])} at {bad}", "finite numbers")

    def resolve_limits(self, sheet: DataSheet, worlds: int) -> dict[str, np.ndarray]:
        """Apply the limits of the elements; called once, before the first command.

        Args:
            sheet: nominal properties of the elements.
            worlds: number of worlds.

        Returns:
            Live arrays (worlds, ...) for ``info["commanded"]``, by name.
        """
        return {}

    @abstractmethod
    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        """Return the drive that a batch of actions commands.

        Args:
            values: (worlds, size) float32, finite.
            measurement: of the parts; parts that are gone or not driven get no command.
        """


class _ElementWise(Action):
    """Base class of actions with two numbers per element."""

    make_drive: Callable[[np.ndarray, int, float], Drive]

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (surface.rows, surface.columns, 2)

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        if self._drive is None or self._drive.values is not values:
            self._drive = self.make_drive(values, self.surface.columns, self.full_scale)
        return self._drive


class Element(_ElementWise):
    """(rows, columns, 2): amplitude [-1, 1] -> [0, max_amplitude] and phase [-1, 1] -> [-pi, pi] of every element."""

    make_drive = staticmethod(element_drive)


class Phasor(_ElementWise):
    """(rows, columns, 2): amplitude x (cos, sin) phase of every element; longer vectors are shortened to length 1."""

    make_drive = staticmethod(phasor_drive)


ACTIONS: Registry[type[Action]] = Registry("action", {"element": Element, "phasor": Phasor})
"""Actions by name; ``ACTIONS.register(name, cls)`` adds a custom one. :mod:`vibgym.envs.local_actions` and
:mod:`vibgym.envs.motions` add those with values per part."""


def new_action(name: Any, surface: Surface, parts: Sequence[Part]) -> Action:
    """Return the action of this name for a scene.

    Raises:
        ValueError: an unknown name, or a custom action that is no :class:`Action` or has no valid shape.
    """
    action = ACTIONS.make("action", name, surface, parts)
    if not isinstance(action, Action):
        raise checks.refuse(f"action {name!r}", type(action), "a subclass of vibgym.envs.Action")
    shape = getattr(action, "shape", None)
    if not isinstance(shape, tuple) or not shape or not all(isinstance(n, int | np.integer) and n > 0 for n in shape):
        raise checks.refuse(
            f"shape of action {name!r}", shape, "a tuple of whole numbers >= 1, such as (len(parts), 3)"
        )
    return action


def actions_by_part() -> tuple[str, ...]:
    """Return the names of actions with values per part, custom ones included."""
    return tuple(name for name, action in ACTIONS.items() if action.by_part)
