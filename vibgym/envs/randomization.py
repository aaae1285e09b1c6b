"""``randomize=``: what is drawn anew for every episode, besides its start.

Each name stands in one table, :data:`EFFECTS`, with how many uniform numbers it takes and what becomes of them. Draws come from
the world's own generator at its reset. ``info["drawn"]`` says what was drawn; observations do not show it.
"""

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
"""rad, of a table's incline: the load, which is left as it is, would be 2 % smaller."""


@dataclass(frozen=True)
class Effect:
    """Something that may be drawn for every episode.

    Attributes:
        range: the lowest and highest value from a setting; raises ValueError. Takes the setting's name for errors, and it.
        draws: how many uniform numbers it takes, by surface and number of parts.
        values: what they become: from the range, ``uniform`` (n, draws), and the surface.
    """

    range: Callable[[str, Any], tuple[float, float]]
    draws: Callable[[Surface, int], int]
    values: Callable[[tuple[float, float], np.ndarray, Surface], np.ndarray]


def factor_range(name: str, value: Any) -> tuple[float, float]:
    """A range of factors."""
    return checks.interval(name, value, LEAST_FACTOR, MOST_FACTOR)


def angle_range(name: str, value: Any) -> tuple[float, float]:
    """A range of angles from the horizontal, rad; of a single number, from 0 on."""
    if checks.listed(value):
        return checks.interval(name, value, 0.0, STEEPEST)
    return 0.0, checks.number(name, value, least=0.0, most=STEEPEST)


def within(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """Numbers in the range, evenly."""
    return bounds[0] + (bounds[1] - bounds[0]) * uniform


def inclines(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """(n, 2) m/s^2, downhill on tables whose angle is evenly in the range, in any direction."""
    size = surface.gravity * np.sin(within(bounds, uniform[:, 0], surface))
    turn = 2.0 * math.pi * uniform[:, 1]
    return size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def patches(bounds: tuple[float, float], uniform: np.ndarray, surface: Surface) -> np.ndarray:
    """(n, rows, columns) numbers in the range, evenly, for every element its own."""
    return within(bounds, uniform, surface).reshape(-1, surface.rows, surface.columns)


def one_a_part(surface: Surface, parts: int) -> int:
    """Draws of what every part has of its own."""
    return parts


def one_an_element(surface: Surface, parts: int) -> int:
    """Draws of what every element has of its own."""
    return surface.rows * surface.columns


def two(surface: Surface, parts: int) -> int:
    """Draws of a vector that a world has."""
    return 2


EFFECTS: dict[str, Effect] = {
    "friction": Effect(factor_range, one_a_part, within),
    "mass": Effect(factor_range, one_a_part, within),
    "incline": Effect(angle_range, two, inclines),
    "patches": Effect(factor_range, one_an_element, patches),
}
"""By the name in ``randomize=``, which :meth:`vibgym.Simulator.set_conditions` has for them, too."""


DISTURBANCE = "disturbance"
"""The name of what strikes parts while an episode runs, see :mod:`vibgym.envs.disturbances`."""


class Randomization:
    """What an environment draws for every episode.

    Args:
        setting: the keyword argument: None, or a mapping from names to ranges.
        of_task, of_actuators: names that the task, and the actuators, draw for themselves.
        surface: the table.
        parts: of a world.

    Attributes:
        task, actuators: their shares of the mapping.
        disturbance: what strikes parts while an episode runs, or None.
        ranges: lowest and highest value of every effect, in the order of :data:`EFFECTS`.
        draws: uniform numbers that an episode takes.

    Raises:
        ValueError: an unknown name, or a bad range.
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
                raise checks.refuse("randomize", f"the key {name!r}", f"keys among {', '.join(known)}")
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
        """What is drawn for n worlds, by name, from ``uniform`` (n, draws) in [0, 1)."""
        found, at = {}, 0
        for name, bounds in self.ranges.items():
            own = uniform[:, at : at + self._draws[name]]
            found[name] = EFFECTS[name].values(bounds, own, self._surface)
            at += self._draws[name]
        return found
