"""``randomize=``: conditions drawn for every episode from the world's generator; ``info["drawn"]`` reports them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.config import to_si
from vibgym.envs.disturbances import Setting, setting_from
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.model import LEAST_FACTOR, MOST_FACTOR

STEEPEST = 0.2
"""rad, largest incline; the normal load, which is not changed, would be 2 % smaller."""


@dataclass(frozen=True)
class Effect:
    """A condition that can be drawn for every episode.

    Attributes:
        range: ``range(name, setting)`` returns lowest and highest value, or raises ValueError.
        draws: ``draws(surface, parts)`` returns the number of uniform numbers.
        values: ``values(range, uniform, surface)`` returns values from uniform numbers (n, draws).
    """

    range: Callable[[str, Any], tuple[float, float]]
    draws: Callable[[Surface, int], int]
    values: Callable[[tuple[float, float], np.ndarray, Surface], np.ndarray]


def factor_range(name: str, value: Any) -> tuple[float, float]:
    """Return a range of factors."""
    return checks.interval(name, value, LEAST_FACTOR, MOST_FACTOR)


def angle_range(name: str, value: Any) -> tuple[float, float]:
    """Return a range of angles from the horizontal, rad; a single number is the upper end of [0, number]."""
    if checks.listed(value):
        return checks.interval(name, value, 0.0, STEEPEST)
    return 0.0, checks.number(name, value, least=0.0, most=STEEPEST)


def within(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """Return uniformly distributed values."""
    return bounds[0] + (bounds[1] - bounds[0]) * uniform


def inclines(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """Return accelerations (n, 2), m/s^2, of tables inclined by a uniform angle in a uniform direction."""
    size = surface.gravity * np.sin(within(bounds, uniform[:, 0], surface))
    turn = 2.0 * math.pi * uniform[:, 1]
    return size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def patches(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """Return uniformly distributed values (n, rows, columns), one per element."""
    return within(bounds, uniform, surface).reshape(-1, surface.rows, surface.columns)


def per_part(surface: Surface, parts: int) -> int:
    """Return the number of parts."""
    return parts


def per_element(surface: Surface, parts: int) -> int:
    """Return the number of elements."""
    return surface.rows * surface.columns


def two(surface: Surface, parts: int) -> int:
    """Return 2, for a vector."""
    return 2


EFFECTS: dict[str, Effect] = {
    "friction": Effect(factor_range, per_part, within),
    "mass": Effect(factor_range, per_part, within),
    "incline": Effect(angle_range, two, inclines),
    "patches": Effect(factor_range, per_element, patches),
}
"""By the name in ``randomize=``, which :meth:`vibgym.Simulator.set_conditions` has for them, too."""


DISTURBANCE = "disturbance"
"""Key of impulse disturbances during an episode, see :mod:`vibgym.envs.disturbances`."""


class Randomization:
    """Conditions that an environment draws for every episode.

    Args:
        setting: the keyword argument: None, or a mapping from names to ranges.
        of_task, of_actuators: further keys, drawn by the task and the actuators.
        surface: the table.
        parts: of a world.

    Attributes:
        task, actuators: settings of these keys.
        disturbance: setting of impulse disturbances, or None.
        ranges: lowest and highest value of every effect, in the order of :data:`EFFECTS`.
        draws: uniform numbers per episode.

    Raises:
        ValueError: an unknown key, or an invalid range.
    """

    def __init__(
        self, setting: Any, of_task: Sequence[str], of_actuators: Sequence[str], surface: Surface, parts: Sequence[Part]
    ) -> None:
        known = (*EFFECTS, DISTURBANCE, *of_actuators, *of_task)
        setting = {} if setting is None else setting
        if not isinstance(setting, Mapping):
            raise checks.refuse("randomize", setting, f"None, or a mapping with keys among {', '.join(known)}")
        setting = to_si(setting, "randomize")
        for name in setting:
            if name not in known:
                raise checks.unknown("key of randomize", name, known)
        self.task = {name: setting[name] for name in of_task if name in setting}
        self.actuators = {name: setting[name] for name in of_actuators if name in setting}
        self.ranges = {
            name: effect.range(f"randomize[{name!r}]", setting[name])
            for name, effect in EFFECTS.items()
            if name in setting
        }
        self._surface = surface
        self.disturbance: Setting | None = None
        if DISTURBANCE in setting:
            self.disturbance = setting_from(setting[DISTURBANCE], parts)
        self._draws = {name: EFFECTS[name].draws(surface, len(parts)) for name in self.ranges}
        self.draws = sum(self._draws.values())

    def values(self, uniform: np.ndarray) -> dict[str, np.ndarray]:
        """Return values of n worlds, by name, from ``uniform`` (n, draws) in [0, 1)."""
        found, at = {}, 0
        for name, bounds in self.ranges.items():
            own = uniform[:, at : at + self._draws[name]]
            found[name] = EFFECTS[name].values(bounds, own, self._surface)
            at += self._draws[name]
        return found
