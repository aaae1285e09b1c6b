"""Episodes of a policy, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from agents.policy import Policy
from agents.recording.settings import RecordSettings
from agents.registry import make_policy
from agents.task_info import TaskInfo
from vibgym import checks


class Episode(NamedTuple):
    """What happened in ``steps`` steps."""

    seed: int
    observations: Any  # (steps + 1, ...), or a dictionary of such
    actions: np.ndarray  # (steps, size), as they were done
    rewards: np.ndarray  # (steps,)
    terminated: bool
    truncated: bool
    success: bool
    drawn: dict[str, np.ndarray]  # what the episode's machine and parts were drawn to be, see ``info["drawn"]``


class Recorder:
    """Plays a policy on a batch of worlds.

    Args:
        settings: what to play.

    Attributes:
        policy: who plays.
        env: the batch.

    Raises:
        ValueError: an environment or a policy that cannot be made, or that do not fit.
    """

    def __init__(self, settings: RecordSettings) -> None:
        self.settings = settings
        for name in ("observation", "num_envs", "autoreset_mode"):
            if name in settings.environment:
                raise checks.refuse(f"environment.{name}", settings.environment[name], "nothing")
        given = dict(settings.environment)
        action = given.pop("action", None)
        first: Any = gym.make_vec(settings.environment_name, num_envs=1, **given)
        self.policy: Policy = make_policy(settings.policy, TaskInfo.of(first), settings.first_seed)
        first.close()
        checks.choice("environment.action", action or self.policy.action, (self.policy.action,))
        self.kwargs = {**given, "action": self.policy.action, "observation": settings.observation}
        self.env: Any = gym.make_vec(
            settings.environment_name,
            num_envs=min(settings.worlds, settings.episodes),
            autoreset_mode="Disabled",
            **self.kwargs,
        )
        self.policy = make_policy(settings.policy, TaskInfo.of(self.env), settings.first_seed)

    def episodes(self) -> Iterator[Episode]:
        """One after the other, in the order of their seeds."""
        done = 0
        while done < self.settings.episodes:
            found = self._batch(self.settings.first_seed + done)
            yield from found[: self.settings.episodes - done]
            done += len(found)

    def _batch(self, first_seed: int) -> list[Episode]:
        """An episode in every world, of which world k begins with ``first_seed + k``."""
        env, worlds, policy = self.env, self.env.num_envs, self.policy
        noises = [np.random.default_rng([first_seed + world, 1]) for world in range(worlds)]
        observation, info = env.reset(seed=first_seed)
        drawn = {name: np.array(value) for name, value in info.get("drawn", {}).items() if not name.startswith("_")}
        seen, acted, paid = [observation], [], []
        playing, start, state = np.ones(worlds, dtype=bool), np.ones(worlds, dtype=bool), None
        lengths = np.zeros(worlds, dtype=np.int64)
        flags = np.zeros((3, worlds), dtype=bool)
        low, high = env.single_action_space.low, env.single_action_space.high
        while playing.any():
            kept = policy.observation == self.settings.observation
            reads = observation if kept else env.unwrapped.observed(policy.observation)
            action, state = policy.predict(reads, state, start, deterministic=True)
            if self.settings.noise > 0.0:
                action = action + self.settings.noise * np.stack(
                    [each.standard_normal(action.shape[1]) for each in noises]
                )
            action = np.clip(action, low, high).astype(np.float32)
            observation, reward, terminated, truncated, info = env.step(action)
            seen.append(observation)
            acted.append(action)
            paid.append(reward)
            lengths += playing
            ended = playing & (terminated | truncated)
            flags[:, ended] = np.stack([terminated, truncated, info["is_success"]])[:, ended]
            playing &= ~ended
            start = terminated | truncated
            if start.any() and playing.any():  # worlds that have ended play on, and nobody looks
                observation, _ = env.reset(options={"reset_mask": start})
        rows = _stacked(seen)
        actions, rewards = np.stack(acted, axis=1), np.stack(paid, axis=1)
        return [
            Episode(
                first_seed + world,
                _cut(rows, world, length + 1),
                actions[world, :length].copy(),
                rewards[world, :length].copy(),
                bool(flags[0, world]),
                bool(flags[1, world]),
                bool(flags[2, world]),
                {name: value[world] for name, value in drawn.items()},
            )
            for world, length in enumerate(lengths.tolist())
        ]


def _stacked(seen: list[Any]) -> Any:
    """(worlds, steps, ...) of a list of batches."""
    if isinstance(seen[0], dict):
        return {name: np.stack([each[name] for each in seen], axis=1) for name in seen[0]}
    return np.stack(seen, axis=1)


def _cut(rows: Any, world: int, length: int) -> Any:
    if isinstance(rows, dict):
        return {name: each[world, :length].copy() for name, each in rows.items()}
    return rows[world, :length].copy()
