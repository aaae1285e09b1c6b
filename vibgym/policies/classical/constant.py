"""Policies that look at nothing: the floor of every comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.actions import Element, Field
from vibgym.policies.classical.measured import check_state
from vibgym.policies.task_info import TaskInfo


class ZeroPolicy:
    """All elements at rest: the parts slide in place."""

    action, observation = "field", "state"

    def __init__(self, info: TaskInfo) -> None:
        self.layout = info.layout
        self.size = Field(info.surface, info.parts).size

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """No push, whatever is seen."""
        lead = check_state(observation, self.layout).shape[:-1]
        return np.zeros((*lead, self.size), dtype=np.float32), state


class RandomPolicy:
    """Every element with an amplitude and a phase of its own, drawn anew every step."""

    action, observation = "element", "state"

    def __init__(self, info: TaskInfo, *, seed: int = 0) -> None:
        self.layout = info.layout
        self.size = Element(info.surface, info.parts).size
        self.generator = np.random.default_rng(checks.count("seed", seed, least=0))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Uniform random amplitudes and phases."""
        lead = check_state(observation, self.layout).shape[:-1]
        return 2.0 * self.generator.random((*lead, self.size), dtype=np.float32) - np.float32(1.0), state
