"""``randomize={"disturbance": ...}``: impulse disturbances at random times of an episode.

With ``model="tilting"`` a struck part is let go from a tilt; with the others it gets a kick that has the statistics of what
that leads to (:mod:`vibgym.physics.planar.kick`). ``info`` says which parts were struck in a step, and by what tilt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.config import to_si
from vibgym.physics.core.noise import KEY_DRAWS, keys_from
from vibgym.physics.planar.kick import begin_waiting, strike_parts
from vibgym.scene.parts import Part
from vibgym.simulation.simulator import Simulator
from vibgym.snapshots import Live

MOST_RATE = 100.0
"""1/s."""

MOST_TILT = math.radians(45.0)


class Setting(NamedTuple):
    """What a disturbance is."""

    rate: float  # 1/s, for each part
    low: float  # rad, range of the tilt
    high: float


def setting_from(value: Any, parts: Sequence[Part]) -> Setting:
    """The setting ``{"rate": 1/s, "tilt_deg": [low, high]}``, checked for these parts; one number is both ends of the range.

    Raises:
        ValueError: a bad setting, or a tilt that topples a part.
    """
    where = "randomize['disturbance']"
    allowed = "a mapping with exactly the keys rate (1/s) and tilt (rad, or tilt_deg): a number, or [low, high]"
    if not isinstance(value, Mapping):
        raise checks.refuse(where, value, allowed)
    given = to_si(value, where)
    if set(given) != {"rate", "tilt"}:
        raise checks.refuse(where, sorted(map(str, value)), allowed)
    rate = checks.number(f"{where}['rate']", given["rate"], least=0.0, most=MOST_RATE)
    tilt = given["tilt"] if checks.listed(given["tilt"]) else [given["tilt"], given["tilt"]]
    low, high = checks.interval(f"{where}['tilt']", tilt, 0.0, MOST_TILT)
    for part in parts:
        steepest = math.atan(1.0 / part.slenderness) if part.slenderness > 0.0 else math.inf
        if high >= steepest:
            most = f"less than {math.degrees(steepest):.3g} deg, which topples {part.name!r}"
            raise checks.refuse(f"{where}['tilt']", f"{math.degrees(high):.3g} deg", most)
    return Setting(rate, low, high)


class Disturbances(Live):
    """Strikes parts of a batch of worlds.

    Args:
        setting: what a disturbance is.
        simulator: whose parts they are.
        span: s, of a step.

    Attributes:
        struck: (worlds, parts) rad, tilt by which a part was struck in the last step, or 0; live.
    """

    SNAPSHOT = "disturbances"
    draws = KEY_DRAWS

    def __init__(self, setting: Setting, simulator: Simulator, span: float) -> None:
        self._setting, self._simulator, self._span = setting, simulator, span
        shape = simulator.worlds, len(simulator.parts)
        self._key = np.zeros((shape[0], KEY_DRAWS), dtype=np.int64)
        self._count = np.zeros(shape, dtype=np.int64)
        self._wait = np.zeros(shape)
        self.struck = np.zeros(shape)
        self._lean, self._kick = np.zeros((*shape, 2)), np.zeros((*shape, 3))

    def live(self) -> dict[str, np.ndarray]:
        """See :class:`vibgym.snapshots.Live`."""
        live = {"key": self._key, "count": self._count, "wait": self._wait, "struck": self.struck}
        return {f"disturbance_{name}": values for name, values in live.items()}

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Begin episodes in ``worlds`` (index array), with numbers (n, draws) in [0, 1) of their generators."""
        self._key[worlds], self.struck[worlds] = keys_from(uniform), 0.0
        begin_waiting(worlds, self._key, self._setting.rate, self._wait, self._count)

    def strike(self, present: np.ndarray) -> None:
        """Strike those parts whose time comes in a step; ``present``: (worlds, parts) bool."""
        state, setting = self._simulator.state, self._setting
        away = state.fallen | state.diverged[:, None] | ~present
        if strike_parts(
            self._key, setting.rate, setting.low, setting.high, self._span, away, self._wait, self._count, self._lean,
            self._kick,
        ):  # fmt: skip
            self._simulator.disturb(self._lean, self._kick)
        np.hypot(self._lean[..., 0], self._lean[..., 1], out=self.struck)
