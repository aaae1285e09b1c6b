"""Imitation of a classical policy: a network learns what an expert would do in the places that it gets itself into.

DAgger (Ross, Gordon & Bagnell 2011): the expert is asked at every step, whoever acts. In the first round that is the expert,
in later ones mostly the network, so that it learns to mend its own mistakes. Those who act are disturbed a little, which shows
the expert's way back to where it wants to be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import torch

from agents.learned.coding import Coding, Seen
from agents.learned.parts_policy import PartsPolicy
from agents.learned.settings import ImitationSettings
from agents.policy import Policy
from vibgym.envs import VibgymVectorEnv


class Demonstrations(NamedTuple):
    """What was seen, and what the expert would have done: (steps * worlds, parts, ...)."""

    rows: np.ndarray
    mask: np.ndarray
    action: np.ndarray


class Imitation:
    """Teaches a policy's actor what an expert does.

    Args:
        policy: its actor is taught.
        expert: speaks the environment's action, reads the flat state.
        env: in same-step autoreset mode, with observations by parts.
        settings: how long, and how.
        seed: of the episodes, the disturbances and the minibatches.
    """

    def __init__(
        self, policy: PartsPolicy, expert: Policy, env: VibgymVectorEnv, settings: ImitationSettings, seed: int
    ) -> None:
        self.policy, self.expert, self.env, self.settings = policy, expert, env, settings
        self.coding: Coding = policy.coding
        self.generator = np.random.default_rng(seed)
        self.steps = 0
        self._found: list[Demonstrations] = []
        self._observation, _ = env.reset(seed=seed)
        self._memory: Any = None
        self._new = np.ones(env.num_envs, dtype=bool)

    def rounds(self, tell: Callable[[str], None] = lambda text: None) -> Iterator[int]:
        """Collect and learn, round after round; yields the steps of all worlds made so far."""
        settings = self.settings
        optimizer = torch.optim.Adam(self.policy.actor.parameters(), lr=settings.learning_rate, fused=True)
        for number in range(settings.rounds):
            share = 0.0 if number == 0 else settings.own_share
            self._found.append(self._collect(share))
            last = number == settings.rounds - 1
            rate = settings.learning_rate * (1.0 if not last else 0.5)
            loss = self._learn(optimizer, rate, settings.epochs * (2 if last else 1))
            tell(f"imitation, round {number + 1}: loss {loss:.2e}")
            yield self.steps

    def _collect(self, share: float) -> Demonstrations:
        """Steps of all worlds, in a ``share`` of which the network itself acts."""
        worlds, steps, settings = self.env.num_envs, self.settings.steps, self.settings
        parts, shape = len(self.coding.parts), self.coding.shape
        rows = np.zeros((steps, worlds, parts, shape.columns), dtype=np.float32)
        mask = np.zeros((steps, worlds, parts), dtype=np.float32)
        wanted = np.zeros((steps, worlds, parts, shape.action), dtype=np.float32)
        own = self.generator.random(worlds) < share
        disturbed = settings.noise * self.generator.random((worlds, 1, 1))
        for step in range(steps):
            seen = self.coding.see(self._observation)
            action, self._memory = self.expert.predict(self.env.observed("state"), self._memory, self._new)
            rows[step], mask[step] = seen
            wanted[step] = action.reshape(worlds, parts, -1)
            acted = wanted[step].copy()
            if own.any():
                acted[own] = self._act(Seen(seen.rows[own], seen.mask[own]))
            noise = self.generator.standard_normal(acted.shape, dtype=np.float32)
            acted = np.clip(acted + disturbed * noise, -1.0, 1.0).astype(np.float32)
            self._observation, _, terminated, truncated, _ = self.env.step(self.coding.actions(seen, acted))
            self._new = terminated | truncated
            self.steps += worlds
        flat = (each.reshape(-1, *each.shape[2:]) for each in (rows, mask, wanted))
        return Demonstrations(*flat)

    def _act(self, seen: Seen) -> np.ndarray:
        with torch.no_grad():
            return self.policy.actor(torch.from_numpy(seen.rows))[0].clamp(-1.0, 1.0).numpy()

    def _learn(self, optimizer: torch.optim.Optimizer, rate: float, epochs: int) -> float:
        """Fit the actor's mean to all that has been found; returns the last epoch's mean squared error."""
        rows, mask, wanted = (torch.from_numpy(np.concatenate(each)) for each in zip(*self._found, strict=True))
        size = max(self.settings.batch_size // mask.shape[1], 1)
        total, all_in_all = 0.0, epochs * -(-len(rows) // size)
        done = 0
        for _ in range(epochs):
            order = torch.from_numpy(self.generator.permutation(len(rows)))
            total, count = 0.0, 0.0
            for chosen in order.split(size):
                for group in optimizer.param_groups:  # to a tenth, by a cosine
                    group["lr"] = rate * (0.55 + 0.45 * float(np.cos(np.pi * done / all_in_all)))
                here = mask[chosen]
                mean, _ = self.policy.actor(rows[chosen])
                error = (((mean - wanted[chosen]) ** 2).mean(dim=-1) * here).sum() / here.sum().clamp(min=1.0)
                optimizer.zero_grad()
                error.backward()
                optimizer.step()
                total, count, done = total + float(error.detach()), count + 1.0, done + 1
        return total / count
