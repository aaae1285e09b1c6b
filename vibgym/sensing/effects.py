"""Effects: what goes wrong on the way from what a sensor sees to what it reads, as stages that every sensor has.

A sensor's mapping names them beside its own settings (``{"kind": "camera", "dropout": 0.1}``), or in ``effects`` where the
sensor has a setting of that name itself (``{"kind": "camera", "effects": {"noise": 1e-4}}``: the camera's own ``noise`` is that
of its pixels). Custom effects apply in the order of registration, not of the mapping; then
bias, noise and dropout. Last of all, velocities are made of what is left: they are differences, the pose less the one read
before over the time between them. Delay and rate are timing, and belong to :class:`vibgym.sensing.Sensor` itself.
"""

from __future__ import annotations

import math
import warnings
import zlib
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from vibgym import checks
from vibgym.config import to_si
from vibgym.kernels.jit import borrowing
from vibgym.physics.core.noise import KEY_DRAWS, keys_from, normals, uniforms
from vibgym.registry import Registry
from vibgym.scene.surface import Surface
from vibgym.sensing.measurement import Reading

if TYPE_CHECKING:
    from vibgym.sensing.base import Sensor

MOST_PLAUSIBLE_TURN = 1.0
"""rad, of a heading's standard deviation. Beyond it there is a warning."""


class Effect:
    """Base of all effects: batched, made as ``cls(sensor, where, value)`` for each sensor that has it.

    An effect of your own is a subclass with :meth:`apply`, and ``vibgym.sensing.EFFECTS.register`` gives it a name.

    Args:
        sensor: whose readings it changes.
        where: the setting's name, for errors.
    """

    draws: int = 0
    """Uniform numbers that it needs at the start of each episode, in :meth:`begin`."""

    def __init__(self, sensor: Sensor, where: str) -> None:
        self.sensor, self.where = sensor, where

    @property
    def sigma(self) -> np.ndarray:
        """(3,) or (parts, 3) standard deviation that it adds to readings of a pose, m, m, rad; for estimators."""
        return np.zeros(3)

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Set what holds for the whole episodes of ``worlds``; see :meth:`vibgym.sensing.Sensor.reset`."""

    def apply(self, reading: Reading) -> None:
        """Change what one look has read, in place: poses, which parts are gone, and, by ``seen``, which ones it misses.

        What an effect remembers may change in the worlds ``sensor.looking`` alone.
        """

    def normals(self) -> np.ndarray:
        """Return (worlds, parts, 3) independent standard normal numbers, new ones at each look; a copy.

        They are drawn by counter from the episode's key: the same alone, in a batch, and restored.
        """
        sensor = self.sensor
        drawn = np.zeros((sensor.worlds, len(sensor.parts), 3))
        draw_normals(sensor.looking, sensor.key, sensor.looks, zlib.crc32(type(self).__name__.encode()), drawn)
        return drawn

    def own_state(self) -> dict[str, np.ndarray]:
        """Return live arrays that belong to a snapshot, by name."""
        return {}


class Noise(Effect):
    """White noise, normal, anew at each look; drawn by :func:`read_poses`.

    The value is its standard deviation: [position in m, heading in rad], a number for the position alone, or a mapping with
    ``position`` and ``heading`` (``position_mm``, ``heading_deg``).
    """

    def __init__(self, sensor: Sensor, where: str, value: Any) -> None:
        super().__init__(sensor, where)
        self.deviation = plausible(
            where, deviations(where, value, sensor.surface.width + sensor.surface.depth), sensor.surface
        )

    @property
    def sigma(self) -> np.ndarray:
        return self.deviation[[0, 0, 1]]


class Bias(Effect):
    """An error that stays for the episode: one shift of all positions, and one turn for each part; normal.

    The value is as that of :class:`Noise`. Estimators take ``sigma`` for new at every look, so it is not counted there.
    """

    def __init__(self, sensor: Sensor, where: str, value: Any) -> None:
        super().__init__(sensor, where)
        self.deviation = plausible(
            where, deviations(where, value, sensor.surface.width + sensor.surface.depth), sensor.surface
        )
        self.offset = np.zeros((sensor.worlds, len(sensor.parts), 3))

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        draw_offsets(worlds, self.sensor.key, self.deviation, self.offset)

    def own_state(self) -> dict[str, np.ndarray]:
        return {"offset": self.offset}


class Dropout(Effect):
    """Looks that miss a part, with a probability; the first look of an episode misses none, so with 1 it is the only one."""

    def __init__(self, sensor: Sensor, where: str, value: Any) -> None:
        super().__init__(sensor, where)
        self.share = checks.number(where, value, least=0.0, most=1.0)


EFFECTS: Registry[Callable[[Sensor, str, Any], Effect]] = Registry(
    "effect", {"noise": Noise, "bias": Bias, "dropout": Dropout}
)
"""Effects by name; ``EFFECTS.register(name, cls)`` adds one of your own."""


class Effects:
    """The effects of a sensor, one after the other, and the velocities that follow from what they leave.

    Args:
        sensor: whose readings they change.
        flat: name -> value, of effects given beside the sensor's own settings.
        more: likewise, of those under ``effects``.

    Raises:
        ValueError: an unknown effect, one that is named twice, or a bad value.
    """

    def __init__(self, sensor: Sensor, flat: Mapping[str, Any], more: Any) -> None:
        if not isinstance(more, Mapping):
            raise checks.refuse("sensor.effects", more, f"a mapping with keys among {', '.join(EFFECTS)}")
        more = to_si(more, "sensor.effects")
        for where, given in (("sensor", flat), ("sensor.effects", more)):
            for name in given:
                if name not in EFFECTS:
                    raise checks.unknown(f"{where} effect", name, EFFECTS)
        for name in set(flat) & set(more):
            raise checks.conflict(f"sensor.effects.{name} excludes sensor.{name}: set one of them")
        where = {**{name: f"sensor.{name}" for name in flat}, **{name: f"sensor.effects.{name}" for name in more}}
        given = {**flat, **more}
        self._stages = {name: make(sensor, where[name], given[name]) for name, make in EFFECTS.items() if name in given}
        self._sensor = sensor
        self._splits = np.cumsum([KEY_DRAWS, *(each.draws for each in self._stages.values())]).tolist()
        self.draws = self._splits[-1] if self._stages else 0
        shape = (sensor.worlds, len(sensor.parts))
        self._last, self._elapsed = np.zeros((*shape, 3)), np.zeros(shape, dtype=np.int64)
        self._new = np.zeros(shape, dtype=bool)
        noise, bias, dropout = (self._stages.get(name) for name in ("noise", "bias", "dropout"))
        self._noise = noise.deviation if isinstance(noise, Noise) else np.zeros(2)
        self._offset = bias.offset if isinstance(bias, Bias) else np.zeros((*shape, 3))
        self._dropout = dropout.share if isinstance(dropout, Dropout) else 0.0

    def __len__(self) -> int:
        return len(self._stages)

    @property
    def variance(self) -> np.ndarray:
        """(parts, 3) that they add to readings of a pose."""
        return sum((each.sigma**2 for each in self._stages.values()), np.zeros((len(self._sensor.parts), 3)))

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw what holds for the whole episodes of ``worlds``."""
        self._sensor.key[worlds] = keys_from(uniform[:, :KEY_DRAWS])
        for each, start in zip(self._stages.values(), self._splits):
            each.begin(worlds, uniform[:, start : start + each.draws])

    def apply(self, reading: Reading) -> None:
        """Change what one look has read."""
        for each in self._stages.values():
            each.apply(reading)
        sensor = self._sensor
        read_poses(
            sensor.looking, sensor.key, sensor.looks, self._new, self._noise, self._offset, self._dropout, sensor.step,
            self._last, self._elapsed, reading,
        )  # fmt: skip

    def renew(self, which: np.ndarray, reading: Reading) -> None:
        """Change what has been read of parts that have just come, ``which`` (worlds, parts): no look misses them."""
        others = ~which
        last, elapsed = self._last[others], self._elapsed[others]
        self._new[...] = which
        self.apply(reading)
        self._new[...] = False
        self._last[others], self._elapsed[others] = last, elapsed

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        own = {
            f"{name}_{what}": values for name, each in self._stages.items() for what, values in each.own_state().items()
        }
        return {"effects_key": self._sensor.key, "last": self._last, "elapsed": self._elapsed, **own}


class Stream(IntEnum):
    """Third word of a counter: what a random number is drawn for."""

    NOISE = 0
    DROPOUT = 1
    SHIFT = 2
    TURN = 3


@borrowing
def draw_normals(worlds, key, looks, stream, drawn):
    """Fill ``drawn`` (worlds, parts, 3) with standard normal numbers."""
    for w in worlds:
        for p in range(drawn.shape[1]):
            drawn[w, p, 0], drawn[w, p, 1], drawn[w, p, 2], _ = normals(key[w], looks[w], p, stream, 0)


@borrowing
def draw_offsets(worlds, key, bias, offset):
    """Write the errors of episodes, an image shift and a rotation of each part's axis, into ``offset`` (worlds, parts, 3)."""
    for w in worlds:
        dx, dy, _, _ = normals(key[w], 0, 0, Stream.SHIFT, 0)
        for p in range(offset.shape[1]):
            turn, _, _, _ = normals(key[w], 0, p, Stream.TURN, 0)
            offset[w, p, 0], offset[w, p, 1], offset[w, p, 2] = bias[0] * dx, bias[0] * dy, bias[1] * turn


@borrowing
def read_poses(worlds, key, looks, new, noise, offset, dropout, step, last, elapsed, reading):
    """Add noise and bias to the poses of a reading, miss parts, and make mean velocities of the poses' differences.

    Args:
        worlds: (n,) indices of the sampled worlds.
        key: (worlds, 2).  looks: (worlds,) number of this look.
        new: (worlds, parts) bool, parts that have come since the one before; at the first look of an episode all have.
        noise: (2,) standard deviations of position (m) and heading (rad), anew at each look.
        offset: (worlds, parts, 3) error of the whole episode.
        dropout: probability that a look misses a part; the first look at a part does not.
        step: s of a step.
        last: (worlds, parts, 3) pose that was read last; overwritten.
        elapsed: (worlds, parts) int64, steps since then; overwritten.
        reading: overwritten.
    """
    for w in worlds:
        for p in range(last.shape[1]):
            first = looks[w] == 0 or new[w, p]
            elapsed[w, p] += 1
            lost = not reading.seen[w, p]
            if dropout > 0.0 and not first:
                chance, _, _, _ = uniforms(key[w], looks[w], p, Stream.DROPOUT, 0)
                lost = lost or chance < dropout
            if lost:
                reading.seen[w, p] = False
                for k in range(3):
                    reading.pose[w, p, k], reading.mean_velocity[w, p, k] = last[w, p, k], 0.0
                continue
            ex, ey, et, _ = normals(key[w], looks[w], p, Stream.NOISE, 0)
            error = noise[0] * ex, noise[0] * ey, noise[1] * et
            for k in range(3):
                pose = reading.pose[w, p, k] + (offset[w, p, k] + error[k])
                reading.mean_velocity[w, p, k] = 0.0 if first else (pose - last[w, p, k]) / (elapsed[w, p] * step)
                reading.pose[w, p, k], last[w, p, k] = pose, pose
            elapsed[w, p] = 0


def deviations(name: str, value: Any, largest: float) -> np.ndarray:
    """Return standard deviations (2,) of position (m, at most ``largest``) and heading (rad).

    Raises:
        ValueError: not a number, a pair or a mapping, or a value out of range.
    """
    allowed = "[position in m, heading in rad], a number in m, or a mapping with 'position' and 'heading'"
    if isinstance(value, Mapping):
        given = to_si(value, name)
        if not set(given) <= {"position", "heading"}:
            raise checks.refuse(name, dict(value), allowed)
        value = [given.get("position", 0.0), given.get("heading", 0.0)]
    elif checks.listed(value):
        if len(value) != 2:
            raise checks.refuse(name, value, allowed)
    else:
        value = [value, 0.0]
    bounds = (("position", largest), ("heading", 2.0 * math.pi))
    return np.array(
        [checks.number(f"{name} ({what})", each, least=0.0, most=most) for (what, most), each in zip(bounds, value)]
    )


def plausible(name: str, deviation: np.ndarray, surface: Surface) -> np.ndarray:
    """Return standard deviations (2,) of position (m) and heading (rad); warn if they look like mm or degrees."""
    position, heading = deviation.tolist()
    if position > surface.element_size:
        warnings.warn(
            f"{name}: {position:g} m is more than an element of {surface.element_size:g} m; positions are in m",
            stacklevel=2,
        )
    if heading > MOST_PLAUSIBLE_TURN:
        warnings.warn(f"{name}: {heading:g} rad is {math.degrees(heading):.0f} deg; headings are in rad", stacklevel=2)
    return deviation
