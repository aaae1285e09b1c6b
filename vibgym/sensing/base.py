"""From the true state to readings of it: the door that every sensor goes through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.effects import Effects
from vibgym.sensing.measurement import Reading, new_reading

MOST_DELAY = 10_000
"""Periods: longer than any episode."""

BYTES_OF_READING = 50
"""Of a part, in a step that is kept until it is due."""


class Sensor(ABC):
    """Base of all sensors: batched, with a delay in periods, a rate, and effects.

    A sensor of your own is a subclass with :meth:`measure`, and ``vibgym.sensing.SENSORS.register`` gives it a name. It
    looks at the true state once a step, ``delay`` periods before the step's end or at the end of an earlier step; the base
    class lets effects change what it read, and keeps it until it is due. Just after a reset that is what it read then.

    Args:
        surface: the table.
        parts: the parts of every world.
        worlds: number of worlds.
        periods: oscillation periods of a step.
        delay: periods between an instant and the observation that tells of it.
        rate: Hz, looks in a second; None: one a step. Steps must come at a multiple of it.
        effects: what goes wrong with readings, by name, see :mod:`vibgym.sensing.effects`.
        **more: likewise, effects beside the sensor's own settings.

    Attributes:
        step: s of a step.
        instant: periods after a step's start at which the sensor looks.
        due: the reading that has just come due.
        looking: (n,) index of the worlds that are looked at: all of them, or at a reset those that begin. What is read of
            others is not used.
        looks: (worlds,) int64, looks since the episode's start, the one before its first step being look 0.
        key: (worlds, 2) int64, of the effects' random numbers in this episode.

    Raises:
        ValueError: a bad setting.
    """

    draws: int = 0
    """Uniform numbers that it needs at the start of each episode, in :meth:`begin`."""

    renews: ClassVar[bool] = True
    """Whether parts may come and go while an episode goes on: what :meth:`measure` writes does not depend on earlier looks."""

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        worlds: int,
        periods: int,
        *,
        delay: int = 0,
        rate: float | None = None,
        effects: Any = MappingProxyType({}),
        **more: Any,
    ) -> None:
        self.surface, self.parts, self.worlds = surface, tuple(parts), worlds
        self.periods, self.step = periods, periods * surface.period
        delay = checks.count("sensor.delay", delay, least=0, most=MOST_DELAY)
        self.delay = checks.fitting("sensor.delay", delay, BYTES_OF_READING * worlds * len(self.parts) / periods)
        self.every = _steps_between("sensor.rate", rate, surface.frequency / periods)
        self.instant = periods - self.delay % periods
        # The oldest first.
        self._readings = [new_reading(worlds, len(self.parts)) for _ in range(self.delay // periods + 1)]
        self.looks = np.zeros(worlds, dtype=np.int64)
        self._fresh = new_reading(worlds, len(self.parts))
        self._everyone = np.arange(worlds)
        self.looking = self._everyone
        self.key = np.zeros((worlds, 2), dtype=np.int64)
        self._effects = Effects(self, more, effects)

    @property
    def exact(self) -> bool:
        """Whether what it reads is always the truth of this instant, without delay: then nobody keeps a copy."""
        return False

    @property
    def all_draws(self) -> int:
        """Uniform numbers that it and its effects need at the start of each episode."""
        return self.draws + self._effects.draws

    @property
    def due(self) -> Reading:
        """The reading that has just come due."""
        return self._readings[0]

    @property
    def sigma(self) -> np.ndarray:
        """(parts, 3) standard deviation that what it sees of a pose is thought to have, without effects, m, m, rad."""
        return np.zeros((len(self.parts), 3))

    @property
    def all_sigma(self) -> np.ndarray:
        """(parts, 3) standard deviation that a reading of a pose is thought to have, effects included; for estimators."""
        return np.sqrt(self.sigma**2 + self._effects.variance)

    def facts(self) -> dict[str, np.ndarray]:
        """What ``info`` says of the last look besides, by name: live arrays (worlds, ...)."""
        return {}

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        """Start afresh in ``worlds`` (index array), whose parts have been put down.

        Args:
            uniform: (len(worlds), all_draws) in [0, 1).
        """
        self.begin(worlds, uniform[:, : self.draws])
        if self._effects:
            self._effects.begin(worlds, uniform[:, self.draws :])
        self.looks[worlds] = 0
        fresh = self._fresh
        self.looking = worlds
        self._read(state, fresh)
        self.looking = self._everyone
        for each in self._readings:
            for kept, read in zip(each, fresh, strict=True):
                kept[worlds] = read[worlds]
        for each in self._readings[1:]:  # until the first look of a step is due there is nothing new
            each.seen[worlds] = False

    def renew(self, which: np.ndarray, state: State) -> None:
        """Start afresh with single parts in the middle of an episode: ``which`` (worlds, parts) have just come or gone.

        What is to be read of them until a look of theirs is due is what is read now.
        """
        fresh = self._fresh
        self.looking = np.flatnonzero(which.any(axis=1))
        fresh.seen[...] = True
        self.measure(state, fresh)
        if self._effects:
            self._effects.renew(which, fresh)
        self.looking = self._everyone
        for each in self._readings:
            for kept, read in zip(each, fresh, strict=True):
                kept[which] = read[which]
        for each in self._readings[1:]:
            each.seen[which] = False

    def look(self, state: State) -> None:
        """Take in the true state of this instant; called once a step, at :attr:`instant`."""
        self.looks += 1
        oldest = self._readings.pop(0)
        self._read(state, oldest)
        self._readings.append(oldest)

    def _read(self, state: State, reading: Reading) -> None:
        """Overwrite a reading with what is seen of ``state`` and what effects make of it."""
        reading.seen[...] = True
        self.measure(state, reading)
        if self.every > 1:
            reading.seen[self.looks % self.every != 0] = False
        if self._effects:
            self._effects.apply(reading)

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:  # noqa: B027 - most have nothing to do
        """Set what holds for the whole episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def measure(self, state: State, reading: Reading) -> None:
        """Write what is seen of ``state`` (not to be changed or kept) into ``reading``, for all worlds.

        ``reading.seen`` is True on entry: set it False for parts that this look does not see.
        """

    def own_state(self) -> dict[str, np.ndarray]:
        """Live arrays that belong to a snapshot, by name, besides what the base class keeps."""
        return {}

    def live(self) -> dict[str, np.ndarray]:
        """All live arrays of a snapshot."""
        kept: dict[str, Any] = {"looks": self.looks}
        for k, each in enumerate(self._readings):
            kept |= {f"{name}{k}": values for name, values in each._asdict().items()}
        return {**kept, **self.own_state(), **(self._effects.live() if self._effects else {})}


def _steps_between(name: str, rate: Any, steps_per_second: float) -> int:
    """Steps from look to look."""
    if rate is None:
        return 1
    value = checks.number(name, rate, above=0.0)
    steps = round(steps_per_second / value)
    if steps < 1 or abs(steps * value - steps_per_second) > 1e-6 * steps_per_second:
        allowed = f"{steps_per_second:g} Hz, the rate of steps, over a whole number; or None for that rate"
        raise checks.refuse(name, rate, allowed)
    return steps
