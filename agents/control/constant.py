"""Policies that look at nothing: the floor of every comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.policy import Situation
from vibgym import checks
from vibgym.physics.core.drive import FIELD_STRENGTHS


def _lead(observation: Any, size: int) -> tuple[int, ...]:
    shape = np.shape(observation)
    if not shape or shape[-1] != size:
        raise checks.refuse("observation", f"array of shape {shape}", f"shape (..., {size})")
    return shape[:-1]


class ZeroPolicy:
    """All elements at rest: the parts slide in place."""

    action, observation = "field", "state"

    def __init__(self, situation: Situation) -> None:
        self.size = situation.state_size
        self.shape = (len(situation.parts), FIELD_STRENGTHS)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """No push, whatever is seen."""
        return np.zeros((*_lead(observation, self.size), *self.shape), dtype=np.float32), state


class RandomPolicy:
    """Every element with an amplitude and a phase of its own, drawn anew every step."""

    action, observation = "element", "state"

    def __init__(self, situation: Situation, seed: int = 0) -> None:
        self.size = situation.state_size
        self.shape = (situation.surface.rows, situation.surface.columns, 2)
        self.generator = np.random.default_rng(checks.count("seed", seed, least=0))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Uniform random amplitudes and phases."""
        values = self.generator.random((*_lead(observation, self.size), *self.shape), dtype=np.float32)
        return 2.0 * values - np.float32(1.0), state
