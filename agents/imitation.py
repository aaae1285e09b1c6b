"""Imitation of another policy by DAgger (Ross, Gordon & Bagnell 2011).

The expert labels every step. It acts in the first round. In later rounds the network acts in most worlds, and learns to correct
its own errors. Noise on the actions shows how the expert recovers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from agents.actor_critic import ActorCritic
from agents.training_settings import ImitationSettings, check_bytes, for_seed
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.coding import Coding, Inputs
from vibgym.policies.trained.residual import CORRECTED
from vibgym.seeds import training_seed

STUDENT_SHARE = 0.8
"""Share of the worlds in which the network acts, after the first round."""


class Demonstrations(NamedTuple):
    """Network inputs and the expert's actions: (samples, parts, ...)."""

    rows: np.ndarray
    mask: np.ndarray
    action: np.ndarray


def experts(settings: ImitationSettings, action: str, seed: int, env: VecEnv) -> list[tuple[Policy, VibgymVectorEnv]]:
    """Return an expert, for ``action`` and the run's ``seed``, and the unwrapped environment for each scene of a run."""
    pairs = []
    for wrapped in env.envs:
        scene = wrapped.unwrapped  # rewards are not used
        expert = make_policy(for_seed(settings.expert, seed), TaskInfo.of(scene), seed)
        if expert.action != action:
            got = f"one with action {expert.action!r}"
            raise checks.refuse("imitation.expert", got, f"a policy with action {action!r}")
        pairs.append((expert, scene))
    return pairs


class Demonstrator:
    """One scene in which an expert is queried for actions.

    An expert with ``acted`` (``Steering.acted``) takes the applied actions into account, if the network's rows contain them
    too. For other networks the expert assumes that its own actions were applied: with unobserved causes the network had three
    times the error, and 74 % success in Align.

    Args:
        expert: policy with the environment's action.
        env: in same-step autoreset mode, with the network's observation.
        coding: of the network.
        generator: of the noise.
    """

    def __init__(self, expert: Policy, env: VibgymVectorEnv, coding: Coding, generator: np.random.Generator) -> None:
        self.expert, self.env, self.coding, self.generator = expert, env, coding, generator
        self._driven = np.array(TaskInfo.of(env).driven)
        self._memory: Any = None
        self._acted = getattr(expert, "acted", None) if coding.history and expert.action in CORRECTED else None
        self._new = np.ones(env.num_envs, dtype=bool)
        self._observation: Any = None
        self._inputs: Inputs | None = None

    def begin(self, seed: int) -> None:
        """Reset all worlds."""
        self._observation, _ = self.env.reset(seed=seed)

    def collect(self, policy: ActorCritic, into: Demonstrations, noise: float, share: float) -> None:
        """Make a step in all worlds for each of ``into``; the network acts in a random ``share`` of the worlds."""
        worlds, parts = self.env.num_envs, len(self.coding.parts)
        rows, mask, labels = (array.reshape(-1, worlds, *array.shape[1:]) for array in into)  # of all steps
        student = self.generator.random(worlds) < share
        deviation = (noise * self.generator.random((worlds, 1, 1))).astype(np.float32)
        for step in range(len(rows)):
            self._inputs = inputs = self.coding.encode(self._observation, self._inputs, self._new)
            action, self._memory = self.expert.predict(
                self.env.observed(self.expert.observation), self._memory, self._new
            )
            rows[step], mask[step] = inputs.rows, inputs.mask * self._driven
            labels[step] = self.coding.to_rows(inputs, action.reshape(worlds, parts, -1))
            acted = labels[step].copy()
            if student.any():
                with torch.no_grad():
                    mean, _ = policy.actor(torch.from_numpy(inputs.rows[student]))
                acted[student] = mean.clamp(-1.0, 1.0).numpy()
            acted += deviation * self.generator.standard_normal(acted.shape, dtype=np.float32)
            done = self.coding.decode(inputs, np.clip(acted, -1.0, 1.0))
            if self._acted is not None:
                self._memory = self._acted(self._memory, action, done)
            self._observation, _, terminated, truncated, _ = self.env.step(done)
            self._new = terminated | truncated


def check_memory(settings: ImitationSettings, coding: Coding, worlds: int) -> None:
    """Raise if the demonstrations of all worlds have more than :data:`agents.training_settings.MAX_BYTES`."""
    sample = np.dtype(coding.dtype).itemsize * coding.shape.columns + 4 * (1 + coding.shape.action)
    check_bytes("imitation.steps", settings.steps, settings.rounds * worlds * len(coding.parts) * sample)


def relative_error(mean: torch.Tensor, labels: torch.Tensor, weight: torch.Tensor, floor: float) -> torch.Tensor:
    """Return the mean squared error of actions, partly relative to the labels, since small actions matter at the goal.

    Args:
        mean, labels: (samples, parts, values).
        weight: (samples, parts), 0 where there is no part.
        floor: size of actions below which errors are absolute.
    """
    scale = 1.0 / (floor**2 + (labels**2).mean(dim=-1))
    return (((mean - labels) ** 2).mean(dim=-1) * scale * weight).sum() / weight.sum().clamp(min=1.0)


class Imitation:
    """Training of an actor on the actions of experts.

    Args:
        policy: its actor is trained.
        scenes: an expert and an environment each; all have the same rows and actions.
        settings: of the imitation.
        seed: of the run, for the episodes, the noise and the minibatches.

    Attributes:
        steps: of all worlds so far.
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
        self._demonstrations = Demonstrations(
            np.empty((samples, parts, shape.columns), dtype=policy.coding.dtype),
            np.empty((samples, parts), dtype=np.float32),
            np.empty((samples, parts, shape.action), dtype=np.float32),
        )

    def rounds(self) -> Iterator[float]:
        """Collect and train in rounds; yield the mean error of the last epoch after each."""
        settings, seed = self.settings, training_seed(self.seed, "imitation")
        for scene in self.scenes:
            scene.begin(seed)
            seed += scene.env.num_envs
        optimizer = torch.optim.Adam(self.policy.actor.parameters(), lr=settings.learning_rate, fused=True)
        for number in range(settings.rounds):
            share = 0.0 if number == 0 else STUDENT_SHARE
            for scene in self.scenes:
                first, self.steps = self.steps, self.steps + settings.steps * scene.env.num_envs
                into = Demonstrations(*(array[first : self.steps] for array in self._demonstrations))
                scene.collect(self.policy, into, settings.noise, share)
            yield self._learn(optimizer, settings.epochs * (3 if number == settings.rounds - 1 else 1))

    def _learn(self, optimizer: torch.optim.Optimizer, epochs: int) -> float:
        """Fit the actor's mean to all demonstrations; return the mean :func:`relative_error` of the last epoch."""
        rows, mask, labels = (torch.from_numpy(array[: self.steps]) for array in self._demonstrations)
        size, rate = max(self.settings.batch_size // mask.shape[1], 1), self.settings.learning_rate
        updates, done, total = epochs * -(-len(rows) // size), 0, 0.0
        for _ in range(epochs):
            total = 0.0
            for chosen in torch.from_numpy(self.generator.permutation(len(rows))).split(size):
                for group in optimizer.param_groups:  # cosine decay to a tenth
                    group["lr"] = rate * (0.55 + 0.45 * float(np.cos(np.pi * done / updates)))
                mean, _ = self.policy.actor(rows[chosen])
                error = relative_error(mean, labels[chosen], mask[chosen], self.settings.floor)
                optimizer.zero_grad()
                error.backward()
                optimizer.step()
                total, done = total + float(error.detach()) * len(chosen) / len(rows), done + 1
        return total
