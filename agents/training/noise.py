"""What is added to actions in training, so that more is tried."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from stable_baselines3.common.noise import VectorizedActionNoise

from vibgym.envs import generators


class Wandering(VectorizedActionNoise):
    """Gaussian noise that lasts for some steps, from none in the first world to all of it in the last.

    White noise gets parts nowhere, since it changes its mind at every step; noise that lasts takes them past goals, and never
    lets them hold one. With worlds from quiet to loud both are seen (as in Horgan et al., "Distributed Prioritized Experience
    Replay", 2018, https://arxiv.org/abs/1803.00933). One world alone gets all of it.

    Args:
        worlds: how many.
        size: numbers of an action.
        spread: standard deviation in the last world.
        steps: after which noise has fallen to 1/e, about; 1 for white noise.
        seed: of the draws.
    """

    def __init__(self, worlds: int, size: int, spread: float, steps: float, seed: int) -> None:
        self.keep = 1.0 - 1.0 / steps
        share = np.linspace(0.0, 1.0, worlds) if worlds > 1 else np.ones(1)
        self.spread = (spread * share[:, None]).astype(np.float32)
        self.generator = np.random.default_rng(seed)
        self.value = np.zeros((worlds, size), dtype=np.float32)

    def __call__(self) -> np.ndarray:
        """(worlds, size) float32."""
        fresh = self.generator.standard_normal(self.value.shape, dtype=np.float32)
        self.value = np.float32(self.keep) * self.value + np.float32(np.sqrt(1.0 - self.keep**2)) * self.spread * fresh
        return self.value

    def get_state(self) -> dict[str, Any]:
        """Where the noise is, and what it draws next."""
        return {"value": self.value.copy(), "generator": generators.state_of(self.generator)}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave."""
        self.value = np.array(state["value"])
        self.generator = generators.generator_from("noise", state["generator"])

    def reset(self, indices: Iterable[int] | None = None) -> None:
        """Begin again from nothing, in all worlds or in these."""
        self.value[slice(None) if indices is None else list(indices)] = 0.0
