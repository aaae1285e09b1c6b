"""Sensors: the base class, the ideal sensor, and the pose sensor with white noise."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.effects import EFFECTS, Effects
from vibgym.sensing.measurement import Reading, Sampling, new_reading
from vibgym.settings import BaseSettings, with_unit

MAX_DELAY = 10_000
"""Largest delay, periods: longer than any episode."""

BYTES_OF_READING = 50
"""Memory of a part in a delayed reading."""

POSITION_NOISE, HEADING_NOISE = 1e-4, math.radians(0.2)
"""m and rad, standard deviations of the pose sensor by default."""


class Sensor(Sampling, ABC):
    """Base of all sensors: batched, with a delay in periods, a rate, and effects.

    A custom sensor is a subclass with :meth:`measure`, registered by ``vibgym.sensing.SENSORS.register``. It samples the true
    state once a step, ``delay`` periods before the end of this or a later step; the base class applies effects and delays the
    reading. After a reset, the first reading is repeated until a later one is due.

    Args:
        surface, parts, worlds, periods: see :class:`vibgym.sensing.measurement.Sampling`, also for attributes.
        settings: None: the defaults.

    Attributes:
        instant: periods after a step's start at which the sensor samples.

    Raises:
        ValueError: a delay that does not fit into memory, a rate that does not divide that of steps, or a bad effect.
    """

    class Settings(BaseSettings):
        """Settings of all sensors. Further keys are effects: ``{"kind": "pose", "dropout": 0.1}``."""

        delay: int = Field(default=0, ge=0, le=MAX_DELAY)
        """Periods between a sample and the observation that contains it."""

        rate: float | None = Field(default=None, gt=0.0)
        """Hz of samples; None: one a step. The rate of steps is a multiple of it."""

        effects: Mapping[str, Any] = {}
        """Effects by name, see :mod:`vibgym.sensing.effects`; in addition to the default ones."""

        @model_validator(mode="before")
        @classmethod
        def _gather_effects(cls, values: Any) -> Any:
            """Move effects that are given beside the settings to ``effects``, and add the default ones."""
            if not isinstance(values, Mapping) or not isinstance(values.get("effects", {}), Mapping):
                return values
            own = {*cls.model_fields, *with_unit(cls)}
            extra = {name: value for name, value in values.items() if name not in own}
            for name in extra:
                if name not in EFFECTS:
                    raise checks.unknown("setting", name, (*cls.model_fields, *EFFECTS))
                if name in values.get("effects", {}):
                    raise checks.conflict(f"effects.{name} excludes {name}: set one of them")
            effects = {**cls.model_fields["effects"].default, **values.get("effects", {}), **extra}
            return {**{name: value for name, value in values.items() if name in own}, "effects": effects}

    settings: Settings

    draws: int = 0
    """Number of uniform random numbers for :meth:`begin` at the start of each episode."""

    resets_parts: ClassVar[bool] = True
    """Whether parts may be replaced during an episode: readings do not depend on earlier samples."""

    def __init__(
        self, surface: Surface, parts: Sequence[Part], worlds: int, periods: int, settings: Settings | None = None
    ) -> None:
        super().__init__(surface, parts, worlds, periods)
        self.settings = chosen = type(self).Settings() if settings is None else settings
        self.delay = checks.fitting("sensor.delay", chosen.delay, BYTES_OF_READING * worlds * len(self.parts) / periods)
        self.every = 1 if chosen.rate is None else _steps_between(chosen.rate, surface.frequency / periods)
        self.instant = periods - self.delay % periods
        # The oldest first.
        self._readings = [new_reading(worlds, len(self.parts)) for _ in range(self.delay // periods + 1)]
        self._fresh = new_reading(worlds, len(self.parts))
        self._effects = Effects(self, chosen.effects, type(chosen).model_fields)

    @property
    def exact(self) -> bool:
        """Whether readings equal the true state without delay; then they are not copied."""
        return False

    @property
    def all_draws(self) -> int:
        """Number of uniform random numbers for the sensor and its effects at the start of each episode."""
        return self.draws + self._effects.draws

    @property
    def due(self) -> Reading:
        """The latest delayed reading."""
        return self._readings[0]

    @property
    def sigma(self) -> np.ndarray:
        """(parts, 3) or (worlds, parts, 3) nominal standard deviation of a measured pose without effects, m, m, rad."""
        return np.zeros((len(self.parts), 3))

    @property
    def all_sigma(self) -> np.ndarray:
        """The same with effects; for estimators."""
        return np.sqrt(self.sigma**2 + self._effects.variance)

    def info(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) of the last sample that ``info`` reports, by name."""
        return {}

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        """Restart in ``worlds`` (index array), whose parts have been placed.

        Args:
            uniform: (len(worlds), all_draws) in [0, 1).
        """
        self.begin(worlds, uniform[:, : self.draws])
        if self._effects:
            self._effects.begin(worlds, uniform[:, self.draws :])
        self.samples[worlds] = 0
        fresh = self._fresh
        self.sampled = worlds
        self._read(state, fresh)
        self.sampled = self._everyone
        self._repeat(worlds)

    def reset_parts(self, which: np.ndarray, state: State) -> None:
        """Restart single parts during an episode: ``which`` (worlds, parts) have been added or removed.

        The present reading is repeated until a later one is due.
        """
        fresh = self._fresh
        self.sampled = np.flatnonzero(which.any(axis=1))
        fresh.seen[...] = True
        self.measure(state, fresh)
        if self._effects:
            self._effects.reset_parts(which, fresh)
        self.sampled = self._everyone
        self._repeat(which)

    def _repeat(self, where: np.ndarray) -> None:
        """Make the new reading the current one, in worlds or of parts, until the first sample of a step is due."""
        for reading in self._readings:
            for kept, read in zip(reading, self._fresh, strict=True):
                kept[where] = read[where]
        for reading in self._readings[1:]:
            reading.seen[where] = False

    def sample(self, state: State) -> None:
        """Sample the true state; called once a step, at :attr:`instant`."""
        self.samples += 1
        oldest = self._readings.pop(0)
        self._read(state, oldest)
        self._readings.append(oldest)

    def _read(self, state: State, reading: Reading) -> None:
        """Write the measured state with effects into a reading."""
        reading.seen[...] = True
        self.measure(state, reading)
        if self.every > 1:
            reading.seen[self.samples % self.every != 0] = False
        if self._effects:
            self._effects.apply(reading)

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw what is constant during the episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def measure(self, state: State, reading: Reading) -> None:
        """Write a measurement of ``state`` (read-only, do not keep it) into ``reading``, for all worlds.

        ``reading.seen`` is True on entry: set it False for parts that are not measured.
        """

    def custom_state(self) -> dict[str, np.ndarray]:
        """Return further live arrays of a snapshot, by name."""
        return {}

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        kept: dict[str, Any] = {"samples": self.samples}
        for k, reading in enumerate(self._readings):
            kept |= {f"{name}{k}": values for name, values in reading._asdict().items()}
        return {**kept, **self.custom_state(), **(self._effects.live() if self._effects else {})}


def _steps_between(rate: float, steps_per_second: float) -> int:
    """Return the number of steps between samples."""
    steps = round(steps_per_second / rate)
    if steps < 1 or abs(steps * rate - steps_per_second) > 1e-6 * steps_per_second:
        allowed = f"{steps_per_second:g} Hz, the rate of steps, over a whole number; or None for that rate"
        raise checks.refuse("sensor.rate", rate, allowed)
    return steps


class IdealSensor(Sensor):
    """Sensor of true poses and mean velocities, by default without delay; arrays are not copied unless needed.

    With effects, velocities are differences of readings, as for :class:`vibgym.sensing.PoseSensor`.
    """

    @property
    def exact(self) -> bool:
        return self.delay == 0 and self.every == 1 and not self._effects

    def measure(self, state: State, reading: Reading) -> None:
        for read, true in zip(reading, (state.pose, state.mean_velocity, state.fallen), strict=False):
            read[...] = true


class PoseSensor(IdealSensor):
    """Sensor of every part's pose with noise; velocities are differences of successive poses.

    The ideal sensor with a permanent effect.
    """

    class Settings(IdealSensor.Settings):
        """Settings of the pose sensor: those of every sensor, with noise by default."""

        effects: Mapping[str, Any] = {"noise": (POSITION_NOISE, HEADING_NOISE)}

    settings: Settings
