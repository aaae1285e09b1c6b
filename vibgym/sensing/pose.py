"""A sensor that reads poses with noise, bias and gaps: what a camera says, without the camera."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym._numba.jit import borrowing
from vibgym.config import to_si
from vibgym.physics.core.noise import KEY_DRAWS, keys_from, normals, uniforms
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Reading

POSITION_NOISE, HEADING_NOISE = 1e-4, math.radians(0.2)

_NOISE, _DROPOUT, _SHIFT, _TURN = range(4)  # third word of the counter: what a number is drawn for


@borrowing
def draw_offsets(worlds, key, bias, offset):
    """Errors of whole episodes: a shift of the image, and a turn of each part's axis, into ``offset`` (worlds, parts, 3)."""
    for w in worlds:
        dx, dy, _, _ = normals(key[w], 0, 0, _SHIFT, 0)
        for p in range(offset.shape[1]):
            turn, _, _, _ = normals(key[w], 0, p, _TURN, 0)
            offset[w, p, 0], offset[w, p, 1], offset[w, p, 2] = bias[0] * dx, bias[0] * dy, bias[1] * turn


@borrowing
def read_poses(worlds, state_pose, gone, key, looks, every, noise, offset, dropout, step, last, elapsed, reading):
    """Write noisy poses, and mean velocities as their differences.

    Args:
        worlds: (n,) index of those that are looked at.
        state_pose: (worlds, parts, 3) true poses.  gone: (worlds, parts).
        key: (worlds, 2).  looks: (worlds,) number of this look, of which every ``every``-th really is one.
        noise: (2,) standard deviations of position (m) and heading (rad), anew at each look.
        offset: (worlds, parts, 3) error of the whole episode.
        dropout: probability that a look misses a part; the first look of an episode misses none.
        step: s of a step.
        last: (worlds, parts, 3) pose that was read last; overwritten.
        elapsed: (worlds, parts) int64, steps since then; overwritten.
        reading: overwritten.
    """
    for w in worlds:
        first = looks[w] == 0
        for p in range(state_pose.shape[1]):
            elapsed[w, p] += 1
            reading.gone[w, p] = gone[w, p]
            lost = looks[w] % every != 0
            if dropout > 0.0 and not first:
                chance, _, _, _ = uniforms(key[w], looks[w], p, _DROPOUT, 0)
                lost = lost or chance < dropout
            if lost:
                reading.seen[w, p] = False
                for k in range(3):
                    reading.pose[w, p, k], reading.mean_velocity[w, p, k] = last[w, p, k], 0.0
                continue
            ex, ey, et, _ = normals(key[w], looks[w], p, _NOISE, 0)
            error = noise[0] * ex, noise[0] * ey, noise[1] * et
            for k in range(3):
                pose = state_pose[w, p, k] + (offset[w, p, k] + error[k])
                reading.mean_velocity[w, p, k] = 0.0 if first else (pose - last[w, p, k]) / (elapsed[w, p] * step)
                reading.pose[w, p, k], last[w, p, k] = pose, pose
            elapsed[w, p] = 0


class PoseSensor(Sensor):
    """Reads every part's pose with noise; its velocity is the difference to the pose read before.

    Noise is drawn by counter from a key that each episode draws: it is the same alone, in a batch, and restored.

    Args:
        surface, parts, worlds, periods: see :class:`Sensor`.
        noise: standard deviation anew at each look, normal: [position in m, heading in rad], a number for the position alone,
            or a mapping with ``position`` and ``heading`` (``position_mm``, ``heading_deg``).
        bias: likewise, of an error that stays for the episode: one shift of all positions, and one turn for each part.
        dropout: probability that a look misses a part. The first look of an episode misses none, so with 1 it is the only one.
        **base: ``delay``, ``rate``.

    Raises:
        ValueError: a bad setting.
    """

    draws = KEY_DRAWS

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        worlds: int,
        periods: int,
        *,
        noise: Any = (POSITION_NOISE, HEADING_NOISE),
        bias: Any = 0.0,
        dropout: float = 0.0,
        **base: Any,
    ) -> None:
        super().__init__(surface, parts, worlds, periods, **base)
        largest = surface.width + surface.depth
        self.noise = deviations("sensor.noise", noise, largest)
        self.bias = deviations("sensor.bias", bias, largest)
        self.dropout = checks.number("sensor.dropout", dropout, least=0.0, most=1.0)
        shape = (worlds, len(self.parts))
        self._key = np.zeros((worlds, 2), dtype=np.int64)
        self._offset = np.zeros((*shape, 3))
        self._last, self._elapsed = np.zeros((*shape, 3)), np.zeros(shape, dtype=np.int64)

    @property
    def sigma(self) -> np.ndarray:
        position, heading = self.noise
        return np.tile([position, position, heading], (len(self.parts), 1))

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        self._key[worlds] = keys_from(uniform)
        draw_offsets(worlds, self._key, self.bias, self._offset)

    def measure(self, state: State, reading: Reading) -> None:
        step = self.periods * self.surface.period
        read_poses(
            self.looking, state.pose, state.fallen, self._key, self.looks, self.every, self.noise, self._offset, self.dropout,
            step, self._last, self._elapsed, reading,
        )  # fmt: skip

    def own_state(self) -> dict[str, np.ndarray]:
        return {"key": self._key, "offset": self._offset, "last": self._last, "elapsed": self._elapsed}


def deviations(name: str, value: Any, largest: float) -> np.ndarray:
    """Standard deviations (2,) of position (m) and heading (rad).

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
