"""What SAC remembers of what it has done."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from vibgym.snapshots import generator_from, generator_state

STORED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def buffer_bytes(size: int, worlds: int, observation_space: spaces.Box, action_space: spaces.Box) -> int:
    """Memory of a :class:`Replay` of ``size`` transitions."""
    numbers = 2 * spaces.flatdim(observation_space) + spaces.flatdim(action_space) + 3
    return 4 * numbers * max(size // worlds, 1) * worlds


class Replay(ReplayBuffer):
    """Stable-Baselines3's replay buffer, with a generator of its own and a state from which it goes on exactly.

    Args:
        *arguments, **more: as Stable-Baselines3 hands them on.
        seed: of what is drawn.
    """

    def __init__(self, *arguments: Any, seed: int = 0, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.generator = np.random.default_rng(seed)

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """Uniformly drawn transitions; what the step limit has cut off does not count as an end."""
        at = self.generator.integers(0, self.size(), batch_size), self.generator.integers(0, self.n_envs, batch_size)
        done = self.dones[at] * (1.0 - self.timeouts[at])
        found = (
            self.observations[at],
            self.actions[at],
            self.next_observations[at],
            done[:, None],
            self.rewards[at][:, None],
        )
        return ReplayBufferSamples(*(torch.from_numpy(each) for each in found))

    def get_state(self) -> dict[str, Any]:
        """What has been stored, arrays (rows, worlds, ...) in the order of the memory, and what is drawn next."""
        stored = {name: getattr(self, name)[: self.size()] for name in STORED}
        return {
            "stored": stored,
            "position": self.pos,
            "full": self.full,
            "generator": generator_state(self.generator),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave on a buffer of the same size."""
        self.pos, self.full = state["position"], state["full"]
        for name in STORED:
            getattr(self, name)[: self.size()] = state["stored"][name]
        self.generator = generator_from("buffer", state["generator"])
