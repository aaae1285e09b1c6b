"""What worlds have seen and done in episodes that begin and end apart."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

ACTION, REWARD = ("action",), ("reward",)  # no names of observations


class Tracks:
    """What the worlds have seen, done and been paid in their present episodes."""

    def __init__(self, worlds: int) -> None:
        self.worlds, self.steps = worlds, 64
        self._kept: dict[Any, np.ndarray] = {}

    def begin(self, worlds: np.ndarray, observation: Any) -> None:
        """Episodes of these worlds begin with what they show now."""
        for name, value in _named(observation):
            self._room(name, value)[worlds, 0] = value[worlds]

    def add(self, age: np.ndarray, observation: Any, action: np.ndarray, reward: np.ndarray) -> None:
        """A step of all worlds, each after so many of its own (``age``)."""
        if age.max() + 2 > self.steps:
            self.steps *= 2
            self._kept = {
                name: np.concatenate((each, np.empty_like(each)), axis=1) for name, each in self._kept.items()
            }
        everyone = np.arange(self.worlds)
        for name, value in _named(observation):
            self._room(name, value)[everyone, age + 1] = value
        for name, value in ((ACTION, action), (REWARD, reward)):
            self._room(name, value)[everyone, age] = value

    def cut(self, world: int, steps: int) -> tuple[Any, np.ndarray, np.ndarray]:
        """Observations (steps + 1), actions and rewards of a world's episode."""
        seen = {
            name: each[world, : steps + 1].copy() for name, each in self._kept.items() if name not in (ACTION, REWARD)
        }
        action, reward = (self._kept[name][world, :steps].copy() for name in (ACTION, REWARD))
        return seen[None] if None in seen else seen, action, reward

    def _room(self, name: Any, value: np.ndarray) -> np.ndarray:
        if name not in self._kept:
            self._kept[name] = np.empty((self.worlds, self.steps, *value.shape[1:]), dtype=value.dtype)
        return self._kept[name]


def _named(observation: Any) -> Iterable[tuple[Any, np.ndarray]]:
    return observation.items() if isinstance(observation, dict) else ((None, observation),)
