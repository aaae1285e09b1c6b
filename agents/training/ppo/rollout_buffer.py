"""What PPO keeps of its last steps, part by part, and what it makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.buffers import BaseBuffer

from vibgym.policies.trained.coding import Coding, Seen
from vibgym.policies.trained.pictures import PictureCoding

AT_ONCE = 300_000
"""Numbers of observations of which the critic tells the values in one go: what it makes of them stays in the caches."""


class PartsBuffer(BaseBuffer):
    """Steps of all worlds; every part of a world is a sample, with its own reward, value and advantage.

    A part's return ends where its world's episode does, or where it leaves, however the world goes on: it is there at a step
    and not at the next one. What it was rewarded with in the step in which it left is still its own.

    Args:
        buffer_size: steps.
        observation_space, action_space, device, n_envs: as SB3 hands them on.
        gae_lambda, gamma: of the generalised advantage estimate (Schulman et al. 2016).
        coding: of the environment.
        driven: of each part whether actions speak for it. The others are no samples, and every part that is driven is paid for
            what becomes of them, too. None: all are.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: gym.Space,
        action_space: gym.Space,
        device: Any = "cpu",
        gae_lambda: float = 1.0,
        gamma: float = 0.99,
        n_envs: int = 1,
        *,
        coding: Coding | PictureCoding,
        driven: Sequence[bool] | None = None,
    ) -> None:
        super().__init__(buffer_size, observation_space, action_space, device, n_envs)
        self.gae_lambda, self.gamma = gae_lambda, gamma
        parts, shape = len(coding.parts), coding.shape
        lead = (buffer_size, n_envs, parts)
        self.rows = np.zeros((buffer_size + 1, n_envs, parts, shape.columns), dtype=coding.dtype)
        self.mask = np.zeros((buffer_size + 1, n_envs, parts), dtype=np.float32)
        self.actions = np.zeros((*lead, shape.action), dtype=np.float32)
        self.log_prob = np.zeros(lead, dtype=np.float32)
        self.reward = np.zeros(lead, dtype=np.float32)
        self.done = np.zeros((buffer_size, n_envs), dtype=np.float32)
        self.value, self.advantage = np.zeros(lead, dtype=np.float32), np.zeros(lead, dtype=np.float32)
        self.driven = np.ones(parts, dtype=bool) if driven is None else np.array(driven)
        self.credit = np.eye(parts) + np.outer(
            ~self.driven, self.driven
        )  # of the parts' rewards, by whom they are due to
        self.cut: list[tuple[int, int, np.ndarray, np.ndarray]] = []

    def reset(self) -> None:
        """Begin anew."""
        super().reset()
        self.cut = []

    def write(self, seen: Seen, action: np.ndarray, log_prob: np.ndarray, reward: np.ndarray, done: np.ndarray) -> None:
        """Add a step: what was seen, what was done, and what came of it, (worlds, parts, ...)."""
        step = self.pos
        self.rows[step], self.mask[step] = seen.rows, seen.mask * self.driven
        reward = reward if self.driven.all() else reward @ self.credit
        self.actions[step], self.log_prob[step], self.reward[step], self.done[step] = action, log_prob, reward, done
        self.pos += 1

    def cut_off(self, world: int, seen: Seen) -> None:
        """The last step's episode in ``world`` was cut off by its limit: what was seen last counts by its value."""
        self.cut.append((self.pos - 1, world, seen.rows[0], seen.mask[0] * self.driven))

    def finish(self, seen: Seen, critic: Any) -> None:
        """Values of all that was seen, in one go, and the advantages that follow.

        Args:
            seen: after the last step.
            critic: see :class:`agents.training.networks.parts.PartsCritic`.
        """
        self.rows[-1], self.mask[-1] = seen.rows, seen.mask * self.driven
        steps, worlds, parts = self.reward.shape
        with torch.no_grad():
            flat = torch.from_numpy(self.rows.reshape(-1, *self.rows.shape[2:]))
            mask = torch.from_numpy(self.mask.reshape(-1, parts))
            some = max(AT_ONCE // flat[0].numel(), 1)
            value = torch.cat([critic(*each) for each in zip(flat.split(some), mask.split(some), strict=True)])
            value = value.numpy().reshape(steps + 1, worlds, parts)
            if self.cut:
                where, world, rows, there = zip(*self.cut, strict=True)
                last = critic(torch.from_numpy(np.stack(rows)), torch.from_numpy(np.stack(there))).numpy()
                self.reward[list(where), list(world)] += self.gamma * last * np.stack(there)
        self.value[:] = value[:-1]
        run = np.zeros((worlds, parts), dtype=np.float32)
        for step in reversed(range(steps)):
            goes_on = (1.0 - self.done[step])[:, None] * self.mask[step + 1]
            change = self.reward[step] + self.gamma * goes_on * value[step + 1] - value[step]
            run = change + self.gamma * self.gae_lambda * goes_on * run
            self.advantage[step] = run

    def samples(self) -> dict[str, torch.Tensor]:
        """All steps of all worlds, (steps * worlds, parts, ...)."""
        named = {
            "rows": self.rows[:-1],
            "mask": self.mask[:-1],
            "actions": self.actions,
            "log_prob": self.log_prob,
            "advantage": self.advantage,
            "target": self.advantage + self.value,
        }
        return {name: torch.from_numpy(each.reshape(-1, *each.shape[2:])) for name, each in named.items()}

    def _get_samples(self, batch_inds: np.ndarray, env: Any = None) -> Any:
        return {name: each[torch.from_numpy(batch_inds)] for name, each in self.samples().items()}
