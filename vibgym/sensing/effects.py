"""Effects: measurement errors, shared by all sensors.

A sensor's mapping has effects next to its settings (``{"kind": "camera", "dropout": 0.1}``), or under ``effects`` where the
sensor has a setting of the same name (``{"kind": "camera", "effects": {"noise": 1e-4}}``: ``noise`` is that of the camera's
pixels). The value is a mapping of the effect's settings, the first of them alone, or a list of all: ``"noise": 1e-4`` and
``"noise": [1e-4, 0.0]`` are ``"noise": {"position": 1e-4}``.

Custom effects apply in the order of registration; bias, noise and dropout follow. Finally velocities are computed from the
resulting poses: the difference to the previous reading over the time between them. Delay and rate belong to
:class:`vibgym.sensing.Sensor`.
"""

from __future__ import annotations

import math
import warnings
import zlib
from collections.abc import Container, Mapping
from enum import IntEnum
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.physics.core.noise import KEY_DRAWS, keys_from, normals, uniforms
from vibgym.registry import Registry
from vibgym.sensing.measurement import Reading, Sampling
from vibgym.settings import Angle, BaseSettings, Length, read

MAX_PLAUSIBLE_TURN = 1.0
"""rad, largest standard deviation of a heading without a warning."""


class Effect:
    """Base class of effects: batched, constructed for each sensor.

    A custom effect is a subclass with :meth:`apply`, registered by ``vibgym.sensing.EFFECTS.register``.

    Args:
        sensor: whose readings it changes.
        settings: None: the defaults.
    """

    class Settings(BaseSettings):
        """Settings of an effect."""

    settings: Settings

    draws: int = 0
    """Number of uniform random numbers for :meth:`begin` at the start of each episode."""

    def __init__(self, sensor: Sampling, settings: Settings | None = None) -> None:
        self.sensor = sensor
        self.settings = type(self).Settings() if settings is None else settings

    @property
    def sigma(self) -> np.ndarray:
        """(3,) or (parts, 3) standard deviation that it adds to readings of a pose, m, m, rad; for estimators."""
        return np.zeros(3)

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw what is constant during the episodes of ``worlds``; see :meth:`vibgym.sensing.Sensor.reset`."""

    def apply(self, reading: Reading) -> None:
        """Change a reading in place: poses, ``gone``, and ``seen`` (False for missed parts).

        Stored state may change only in the worlds ``sensor.sampled``.
        """

    def normals(self) -> np.ndarray:
        """Return (worlds, parts, 3) independent standard normal numbers, new at each sample; a copy.

        They are drawn by counter from the key of the episode: the same alone, in a batch, and after a restored snapshot.
        """
        sensor = self.sensor
        drawn = np.zeros((sensor.worlds, len(sensor.parts), 3))
        draw_normals(sensor.sampled, sensor.key, sensor.samples, zlib.crc32(type(self).__name__.encode()), drawn)
        return drawn

    def custom_state(self) -> dict[str, np.ndarray]:
        """Return live arrays of a snapshot, by name."""
        return {}


class PoseError(Effect):
    """Base of normal errors of poses; it warns if they look like mm or degrees."""

    class Settings(Effect.Settings):
        """Standard deviations."""

        position: Length = Field(default=0.0, ge=0.0)
        """Of x and y."""

        heading: Angle = Field(default=0.0, ge=0.0, le=2.0 * math.pi)
        """Of the heading."""

    settings: Settings

    def __init__(self, sensor: Sampling, settings: Settings | None = None) -> None:
        super().__init__(sensor, settings)
        position, heading, surface = self.settings.position, self.settings.heading, sensor.surface
        checks.number("position", position, most=surface.width + surface.depth)
        self.deviation = np.array([position, heading])
        name = type(self).__name__.lower()
        if position > surface.element_size:
            warnings.warn(
                f"{name}: {position:g} m is more than an element of {surface.element_size:g} m; positions are in m",
                stacklevel=2,
            )
        if heading > MAX_PLAUSIBLE_TURN:
            warnings.warn(
                f"{name}: {heading:g} rad is {math.degrees(heading):.0f} deg; headings are in rad", stacklevel=2
            )


class Noise(PoseError):
    """White normal noise, new at each sample; drawn by :func:`read_poses`."""

    @property
    def sigma(self) -> np.ndarray:
        return self.deviation[[0, 0, 1]]


class Bias(PoseError):
    """Constant error of an episode: one shift of all positions, one turn for each part; normal.

    It does not add to ``sigma``, the deviation of independent noise.
    """

    def __init__(self, sensor: Sampling, settings: PoseError.Settings | None = None) -> None:
        super().__init__(sensor, settings)
        self.offset = np.zeros((sensor.worlds, len(sensor.parts), 3))

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        draw_offsets(worlds, self.sensor.key, self.deviation, self.offset)

    def custom_state(self) -> dict[str, np.ndarray]:
        return {"offset": self.offset}


class Dropout(Effect):
    """Samples miss parts. The first sample of an episode misses none."""

    class Settings(Effect.Settings):
        """Settings of dropout."""

        share: float = Field(default=0.0, ge=0.0, le=1.0)
        """Probability that a sample misses a part."""

    settings: Settings


EFFECTS: Registry[type[Effect]] = Registry("effect", {"noise": Noise, "bias": Bias, "dropout": Dropout})
"""Effects by name; ``EFFECTS.register(name, cls)`` adds a custom one."""


def settings_of(effect: type[Effect], value: Any, where: str) -> Effect.Settings:
    """Return the settings of an effect from a mapping, the value of the first of them, or a list of the values of all.

    Raises:
        ValueError: a bad value of the argument ``where``.
    """
    names = tuple(effect.Settings.model_fields)
    if checks.listed(value) and len(value) == len(names) > 1:
        value = dict(zip(names, value, strict=True))
    elif names and not isinstance(value, Mapping | BaseSettings):
        value = {names[0]: value}
    return read(effect.Settings, value, where)


class Effects:
    """The effects of a sensor in order, and the velocities computed from their result.

    Args:
        sensor: whose readings they change.
        chosen: effects by name, see :func:`settings_of`.
        reserved: names of the sensor's settings; effects of such names are given under ``effects``, for errors.

    Raises:
        ValueError: an unknown effect, or a bad value.
    """

    def __init__(self, sensor: Sampling, chosen: Mapping[str, Any], reserved: Container[str]) -> None:
        self._stages: dict[str, Effect] = {}
        for name in chosen:
            checks.choice("sensor.effects", name, EFFECTS)
        for name in (known for known in EFFECTS if known in chosen):
            where = f"sensor.effects.{name}" if name in reserved else f"sensor.{name}"
            settings = settings_of(EFFECTS[name], chosen[name], where)
            with checks.within(where):
                self._stages[name] = EFFECTS[name](sensor, settings=settings)
        self._sensor = sensor
        self._splits = np.cumsum([KEY_DRAWS, *(stage.draws for stage in self._stages.values())]).tolist()
        self.draws = self._splits[-1] if self._stages else 0
        shape = (sensor.worlds, len(sensor.parts))
        self._last, self._elapsed = np.zeros((*shape, 3)), np.zeros(shape, dtype=np.int64)
        self._new = np.zeros(shape, dtype=bool)
        noise, bias, dropout = (self._stages.get(name) for name in ("noise", "bias", "dropout"))
        self._noise = noise.deviation if isinstance(noise, Noise) else np.zeros(2)
        self._offset = bias.offset if isinstance(bias, Bias) else np.zeros((*shape, 3))
        self._dropout = dropout.settings.share if isinstance(dropout, Dropout) else 0.0

    def __len__(self) -> int:
        return len(self._stages)

    @property
    def variance(self) -> np.ndarray:
        """(parts, 3) variance that the effects add to a measured pose."""
        return sum((stage.sigma**2 for stage in self._stages.values()), np.zeros((len(self._sensor.parts), 3)))

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw what is constant during the episodes of ``worlds``."""
        self._sensor.key[worlds] = keys_from(uniform[:, :KEY_DRAWS])
        for stage, start in zip(self._stages.values(), self._splits):
            stage.begin(worlds, uniform[:, start : start + stage.draws])

    def apply(self, reading: Reading) -> None:
        """Apply all effects to a reading, in place."""
        for stage in self._stages.values():
            stage.apply(reading)
        sensor = self._sensor
        read_poses(
            sensor.sampled, sensor.key, sensor.samples, self._new, self._noise, self._offset, self._dropout, sensor.step,
            self._last, self._elapsed, reading,
        )  # fmt: skip

    def reset_parts(self, which: np.ndarray, reading: Reading) -> None:
        """Apply all effects except dropout to the reading of parts that have just arrived, ``which`` (worlds, parts)."""
        others = ~which
        last, elapsed = self._last[others], self._elapsed[others]
        self._new[...] = which
        self.apply(reading)
        self._new[...] = False
        self._last[others], self._elapsed[others] = last, elapsed

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        own = {
            f"{name}_{what}": values
            for name, stage in self._stages.items()
            for what, values in stage.custom_state().items()
        }
        return {"effects_key": self._sensor.key, "last": self._last, "elapsed": self._elapsed, **own}


class Stream(IntEnum):
    """Third word of a counter: the purpose of a random number."""

    NOISE = 0
    DROPOUT = 1
    SHIFT = 2
    TURN = 3


@jit
def draw_normals(worlds, key, samples, stream, drawn):
    """Fill ``drawn`` (worlds, parts, 3) with standard normal numbers."""
    for w in worlds:
        for p in range(drawn.shape[1]):
            drawn[w, p, 0], drawn[w, p, 1], drawn[w, p, 2], _ = normals(key[w], samples[w], p, stream, 0)


@jit
def draw_offsets(worlds, key, bias, offset):
    """Write the constant errors of episodes, a shift and a turn of each part, into ``offset`` (worlds, parts, 3)."""
    for w in worlds:
        dx, dy, _, _ = normals(key[w], 0, 0, Stream.SHIFT, 0)
        for p in range(offset.shape[1]):
            turn, _, _, _ = normals(key[w], 0, p, Stream.TURN, 0)
            offset[w, p, 0], offset[w, p, 1], offset[w, p, 2] = bias[0] * dx, bias[0] * dy, bias[1] * turn


@jit
def read_poses(worlds, key, samples, new, noise, offset, dropout, step, last, elapsed, reading):
    """Add noise and bias to the poses of a reading, drop parts, and compute mean velocities from pose differences.

    Args:
        worlds: (n,) indices of the sampled worlds.
        key: (worlds, 2).  samples: (worlds,) number of this sample.
        new: (worlds, parts) bool, parts that have arrived since the last sample; at the first sample of an episode, all.
        noise: (2,) standard deviations of position (m) and heading (rad).
        offset: (worlds, parts, 3) constant error of the episode.
        dropout: probability that a sample misses a part, except the first sample of the part.
        step: s of a step.
        last: (worlds, parts, 3) last measured pose; overwritten.
        elapsed: (worlds, parts) int64, steps since then; overwritten.
        reading: overwritten.
    """
    for w in worlds:
        for p in range(last.shape[1]):
            first = samples[w] == 0 or new[w, p]
            elapsed[w, p] += 1
            lost = not reading.seen[w, p]
            if dropout > 0.0 and not first:
                chance, _, _, _ = uniforms(key[w], samples[w], p, Stream.DROPOUT, 0)
                lost = lost or chance < dropout
            if lost:
                reading.seen[w, p] = False
                for k in range(3):
                    reading.pose[w, p, k], reading.mean_velocity[w, p, k] = last[w, p, k], 0.0
                continue
            ex, ey, et, _ = normals(key[w], samples[w], p, Stream.NOISE, 0)
            error = noise[0] * ex, noise[0] * ey, noise[1] * et
            for k in range(3):
                pose = reading.pose[w, p, k] + (offset[w, p, k] + error[k])
                reading.mean_velocity[w, p, k] = 0.0 if first else (pose - last[w, p, k]) / (elapsed[w, p] * step)
                reading.pose[w, p, k], last[w, p, k] = pose, pose
            elapsed[w, p] = 0
