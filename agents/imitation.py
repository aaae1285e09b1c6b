"""Imitation of a classical policy by DAgger (Ross, Gordon & Bagnell 2011).

The expert labels every step. In the first round the expert acts, in later ones mostly the network, which so learns to correct
its own mistakes. Noise on the actions shows how the expert returns to its course.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from agents.networks import ActorCritic
from agents.training_settings import ImitationSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding, Seen
from vibgym.policies.trained.pictures import PictureCoding

MOST_FOUND = 4e9
"""Bytes of demonstrations."""


class Demonstrations(NamedTuple):
    """What was seen, and what the expert would have done: (samples, parts, ...)."""

    rows: np.ndarray
    mask: np.ndarray
    action: np.ndarray


def experts(lessons: ImitationSettings, action: str, seed: int, env: VecEnv) -> list[tuple[Policy, VibgymVectorEnv]]:
    """Whom a run imitates in each of its scenes.

    Args:
        lessons: who the expert is.
        action: what it has to speak, the run's.
        seed: of experts that draw random numbers.
        env: of the run.

    Raises:
        ValueError: an expert that does not serve the task, or does not speak its actions.
    """
    found = []
    for wrapped in env.envs:
        scene = wrapped.unwrapped  # its rewards do not count here
        expert = make_policy(lessons.expert, TaskInfo.of(scene), seed)
        if expert.action != action or expert.observation != "state":
            got = f"one that speaks {expert.action!r} and reads {expert.observation!r}"
            raise checks.refuse("imitation.expert", got, f"one that speaks {action!r} and reads 'state'")
        found.append((expert, scene))
    return found


class Demonstrator:
    """One scene in which an expert is queried for actions.

    An expert with ``acted`` (``Steering.acted``) takes the applied actions into account. Only a
    network whose rows contain them too can imitate that: another had three times the error, and 74 % success in Align. For
    other networks the expert assumes that its own actions were applied.

    Args:
        expert: speaks the environment's action, reads the flat state.
        env: in same-step autoreset mode, with observations by parts.
        coding: of the network that learns.
        generator: of the disturbances.
    """

    def __init__(
        self, expert: Policy, env: VibgymVectorEnv, coding: Coding | PictureCoding, generator: np.random.Generator
    ) -> None:
        self.expert, self.env, self.coding, self.generator = expert, env, coding, generator
        self._driven = np.array(TaskInfo.of(env).driven)
        self._memory: Any = None
        self._told = getattr(expert, "acted", None) if coding.remembers and expert.action == "wrench" else None
        self._new = np.ones(env.num_envs, dtype=bool)
        self._observation: Any = None
        self._seen: Seen | None = None

    def begin(self, seed: int) -> None:
        """Reset all worlds."""
        self._observation, _ = self.env.reset(seed=seed)

    def collect(self, policy: ActorCritic, steps: int, noise: float, share: float) -> Demonstrations:
        """Make so many steps in all worlds, in a ``share`` of which the network itself acts."""
        worlds, parts, shape = self.env.num_envs, len(self.coding.parts), self.coding.shape
        rows = np.zeros((steps, worlds, parts, shape.columns), dtype=self.coding.dtype)
        mask = np.zeros((steps, worlds, parts), dtype=np.float32)
        wanted = np.zeros((steps, worlds, parts, shape.action), dtype=np.float32)
        own = self.generator.random(worlds) < share
        disturbed = (noise * self.generator.random((worlds, 1, 1))).astype(np.float32)
        for step in range(steps):
            self._seen = seen = self.coding.see(self._observation, self._seen, self._new)
            action, self._memory = self.expert.predict(self.env.observed("state"), self._memory, self._new)
            rows[step], mask[step] = seen.rows, seen.mask * self._driven  # of others there is nothing to learn
            wanted[step] = self.coding.to_rows(seen, action.reshape(worlds, parts, -1))
            acted = wanted[step].copy()
            if own.any():
                acted[own] = _act(policy, seen.rows[own])
            acted += disturbed * self.generator.standard_normal(acted.shape, dtype=np.float32)
            done = self.coding.actions(seen, np.clip(acted, -1.0, 1.0))
            if self._told is not None:
                self._memory = self._told(self._memory, action, done)
            self._observation, _, terminated, truncated, _ = self.env.step(done)
            self._new = terminated | truncated
        flat = (each.reshape(-1, *each.shape[2:]) for each in (rows, mask, wanted))
        return Demonstrations(*flat)


def _act(policy: ActorCritic, rows: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return policy.actor(torch.from_numpy(rows))[0].clamp(-1.0, 1.0).numpy()


def check_memory(settings: ImitationSettings, coding: Coding | PictureCoding, worlds: int) -> None:
    """Refuse more demonstrations than there is room for.

    Args:
        settings: of the imitation.
        coding: of the network that learns.
        worlds: of all scenes.

    Raises:
        ValueError: they have more than :data:`MOST_FOUND` bytes.
    """
    numbers = np.dtype(coding.dtype).itemsize * coding.shape.columns + 4 * (1 + coding.shape.action)
    size = settings.rounds * settings.steps * worlds * len(coding.parts) * numbers
    if size > MOST_FOUND:
        allowed = f"demonstrations of at most {MOST_FOUND:.1e} bytes; these would have {size:.1e}"
        raise checks.refuse("imitation.steps", settings.steps, allowed)


def relative_error(mean: torch.Tensor, sought: torch.Tensor, weight: torch.Tensor, floor: float) -> torch.Tensor:
    """Mean squared error of actions, in part relative to what is sought: at the goal small pushes are all that counts.

    Args:
        mean, sought: (samples, parts, numbers).
        weight: (samples, parts), 0 where there is no part.
        floor: size of actions below which errors are not weighed by it any more.
    """
    scale = 1.0 / (floor**2 + (sought**2).mean(dim=-1))
    return (((mean - sought) ** 2).mean(dim=-1) * scale * weight).sum() / weight.sum().clamp(min=1.0)


class Imitation:
    """Teaches a policy's actor what an expert does.

    Args:
        policy: its actor is taught.
        scenes: an expert and an environment each; all have the same rows and actions.
        settings: how long, and how.
        seed: of the episodes, the disturbances and the minibatches.

    Attributes:
        steps: of all worlds, made so far.
    """

    def __init__(
        self,
        policy: ActorCritic,
        scenes: Sequence[tuple[Policy, VibgymVectorEnv]],
        settings: ImitationSettings,
        seed: int,
    ) -> None:
        self.policy, self.settings, self.seed, self.steps = policy, settings, seed, 0
        self.generator = np.random.default_rng(seed)
        self.scenes = [Demonstrator(expert, env, policy.coding, self.generator) for expert, env in scenes]
        parts, shape = len(policy.coding.parts), policy.coding.shape
        samples = settings.rounds * settings.steps * sum(env.num_envs for _, env in scenes)
        self._found = Demonstrations(
            np.empty((samples, parts, shape.columns), dtype=policy.coding.dtype),
            np.empty((samples, parts), dtype=np.float32),
            np.empty((samples, parts, shape.action), dtype=np.float32),
        )

    def rounds(self) -> Iterator[float]:
        """Collect and learn, round after round; yields the last epoch's mean squared error."""
        settings, first = self.settings, self.seed
        for scene in self.scenes:
            scene.begin(first)
            first += scene.env.num_envs
        optimizer = torch.optim.Adam(self.policy.actor.parameters(), lr=settings.learning_rate, fused=True)
        for number in range(settings.rounds):
            share = 0.0 if number == 0 else settings.own_share
            for scene in self.scenes:
                found = scene.collect(self.policy, settings.steps, settings.noise, share)
                for kept, new in zip(self._found, found, strict=True):
                    kept[self.steps : self.steps + len(new)] = new
                self.steps += len(found.mask)
            yield self._learn(optimizer, settings.epochs * (3 if number == settings.rounds - 1 else 1))

    def _learn(self, optimizer: torch.optim.Optimizer, epochs: int) -> float:
        """Fit the actor's mean to all that has been found; returns the last epoch's mean error, squared and relative."""
        rows, mask, wanted = (torch.from_numpy(each[: self.steps]) for each in self._found)
        size, rate = max(self.settings.batch_size // mask.shape[1], 1), self.settings.learning_rate
        updates, done, total = epochs * -(-len(rows) // size), 0, 0.0
        for _ in range(epochs):
            total = 0.0
            for chosen in torch.from_numpy(self.generator.permutation(len(rows))).split(size):
                for group in optimizer.param_groups:  # a cosine, to a tenth
                    group["lr"] = rate * (0.55 + 0.45 * float(np.cos(np.pi * done / updates)))
                mean, _ = self.policy.actor(rows[chosen])
                error = relative_error(mean, wanted[chosen], mask[chosen], self.settings.floor)
                optimizer.zero_grad()
                error.backward()
                optimizer.step()
                total, done = total + float(error.detach()) * len(chosen) / len(rows), done + 1
        return total
