"""Rollouts of PPO: steps of all worlds, with values and advantages of every part (GAE; Schulman et al. 2016)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from agents.training_settings import check_bytes
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding, Inputs

if TYPE_CHECKING:
    from agents.ppo import PPO

CRITIC_BATCH = 300_000
"""Values of observations that the critic evaluates in one call, so that its intermediate results stay in the caches."""


class Rollout:
    """Steps of all worlds and their advantages; every part of a world is a sample, or the world with one row for all parts.

    A part's return ends with the episode of its world, or when the part leaves while the world continues: it is present at one
    step and absent at the next. It keeps the reward of the step in which it left.

    Args:
        settings: ``n_steps``, ``gamma``, ``gae_lambda`` and ``shared``.
        worlds: number of worlds.
        coding: of the network.
        info: which parts the action drives. Other parts are no samples, and their rewards go to every driven part. Where parts
            leave, shared rewards count relative to their mean, or parts would gain by staying.

    Raises:
        ValueError: too many bytes.
    """

    def __init__(self, settings: PPO.Settings, worlds: int, coding: Coding, info: TaskInfo) -> None:
        self.gamma, self.gae_lambda, steps = settings.gamma, settings.gae_lambda, settings.n_steps
        self.shared, self.continuous_feed, driven = settings.shared, info.continuous_feed, np.array(info.driven)
        self.together = coding.slots < len(coding.parts)
        if self.together:
            driven = np.ones(coding.slots, dtype=bool)
        parts, shape = coding.slots, coding.shape
        lead = (steps, worlds, parts)
        row = np.dtype(coding.dtype).itemsize * shape.columns
        check_bytes("ppo.n_steps", steps, worlds * parts * (row + 4 * (shape.action + 6)))
        self.rows = np.zeros((steps + 1, worlds, parts, shape.columns), dtype=coding.dtype)
        self.mask = np.zeros((steps + 1, worlds, parts), dtype=np.float32)
        self.actions = np.zeros((*lead, shape.action), dtype=np.float32)
        self.log_prob, self.reward = np.zeros(lead, dtype=np.float32), np.zeros(lead, dtype=np.float32)
        self.done = np.zeros((steps, worlds), dtype=np.float32)
        self.value, self.advantage = np.zeros(lead, dtype=np.float32), np.zeros(lead, dtype=np.float32)
        self.driven = driven
        self.reset()

    def reset(self) -> None:
        """Start at the first step."""
        self.position = 0
        self.truncated: list[tuple[int, int, np.ndarray, np.ndarray]] = []  # step, world, rows, mask

    def add(
        self, inputs: Inputs, action: np.ndarray, log_prob: np.ndarray, reward: np.ndarray, done: np.ndarray
    ) -> None:
        """Add a step of all worlds: inputs, action and its outcome, (worlds, parts, ...)."""
        step = self.position
        if self.together:
            reward = reward.mean(axis=-1, keepdims=True)
        self.rows[step], self.mask[step] = inputs.rows, inputs.mask * self.driven
        self.actions[step], self.log_prob[step], self.reward[step], self.done[step] = action, log_prob, reward, done
        self.position += 1

    def truncate(self, world: int, inputs: Inputs) -> None:
        """Mark the last step of ``world`` as cut off by the limit, with the final observation to bootstrap from."""
        self.truncated.append((self.position - 1, world, inputs.rows[0], inputs.mask[0] * self.driven))

    def finish(self, inputs: Inputs, critic: Any) -> None:
        """Compute values of all observations, and advantages by GAE.

        Args:
            inputs: after the last step.
            critic: (rows, mask) -> values (..., parts).
        """
        self.rows[-1], self.mask[-1] = inputs.rows, inputs.mask * self.driven
        steps, worlds, parts = self.reward.shape
        self._credit_others()
        with torch.no_grad():
            flat = torch.from_numpy(self.rows.reshape(-1, *self.rows.shape[2:]))
            mask = torch.from_numpy(self.mask.reshape(-1, parts))
            size = max(CRITIC_BATCH // flat[0].numel(), 1)
            value = torch.cat([critic(*chunk) for chunk in zip(flat.split(size), mask.split(size), strict=True)])
            value = value.numpy().reshape(steps + 1, worlds, parts)
            if self.truncated:
                where, world, rows, there = zip(*self.truncated, strict=True)
                last = critic(torch.from_numpy(np.stack(rows)), torch.from_numpy(np.stack(there))).numpy()
                self.reward[list(where), list(world)] += self.gamma * last * np.stack(there)
        self.value[:] = value[:-1]
        advantage = np.zeros((worlds, parts), dtype=np.float32)
        for step in reversed(range(steps)):
            continues = (1.0 - self.done[step])[:, None] * self.mask[step + 1]
            error = self.reward[step] + self.gamma * continues * value[step + 1] - value[step]
            advantage = error + self.gamma * self.gae_lambda * continues * advantage
            self.advantage[step] = advantage

    def _credit_others(self) -> None:
        """Add the rewards of the other parts to those of each part."""
        mask = self.mask[:-1]
        others = self.shared * ((self.reward * mask).sum(axis=-1, keepdims=True) - self.reward)
        if self.shared and self.continuous_feed:
            others -= (others * mask).sum() / max(mask.sum(), 1.0)
        self.reward += others + self.reward[..., ~self.driven].sum(axis=-1, keepdims=True)

    def samples(self) -> dict[str, torch.Tensor]:
        """Return all steps of all worlds, (steps * worlds, parts, ...)."""
        named = {
            "rows": self.rows[:-1],
            "mask": self.mask[:-1],
            "actions": self.actions,
            "log_prob": self.log_prob,
            "advantage": self.advantage,
            "target": self.advantage + self.value,
        }
        return {name: torch.from_numpy(array.reshape(-1, *array.shape[2:])) for name, array in named.items()}

    def minibatches(self, size: int, epochs: int) -> Iterator[dict[str, torch.Tensor]]:
        """Yield random minibatches of all epochs, without a small one at the end of an epoch.

        Advantages are normalised over all parts that are present.

        Args:
            size: parts of a minibatch.
            epochs: passes over all samples.
        """
        samples = self.samples()
        present = samples["advantage"][samples["mask"] > 0.5]
        samples["advantage"] = (samples["advantage"] - present.mean()) / (present.std() + 1e-8)
        count, parts = samples["mask"].shape
        size = max(size // parts, 1)
        for _ in range(epochs):
            for chosen in torch.randperm(count).split(size):
                if len(chosen) * 2 >= size or count < size:
                    yield {name: tensor.index_select(0, chosen) for name, tensor in samples.items()}
