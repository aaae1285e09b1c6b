"""Episodes of a policy, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from agents import environments
from agents.recording.record_settings import RecordSettings
from agents.recording.tracks import Tracks
from vibgym import checks
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo


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
        first: Any = environments.make_batch(settings.task, num_envs=1, **given)
        self.policy: Policy = make_policy(settings.policy, TaskInfo.of(first), settings.first_seed)
        first.close()
        checks.choice("environment.action", action or self.policy.action, (self.policy.action,))
        self.kwargs = {**given, "action": self.policy.action, "observation": settings.observation}
        self.env: Any = environments.make_batch(
            settings.task,
            num_envs=min(settings.worlds, settings.episodes),
            autoreset_mode="Disabled",
            **self.kwargs,
        )
        self.policy = make_policy(settings.policy, TaskInfo.of(self.env), settings.first_seed)

    def episodes(self) -> Iterator[Episode]:
        """One after the other, in the order of their seeds.

        A world whose episode has ended begins the next one, until all have begun.
        """
        env, worlds, policy = self.env, self.env.num_envs, self.policy
        low, high = env.single_action_space.low, env.single_action_space.high
        total, first, deviation = self.settings.episodes, self.settings.first_seed, self.settings.noise
        number = np.arange(worlds)  # of the episode that a world plays; those past the last are played for nothing
        begun, given, waiting = worlds, 0, dict[int, Episode]()
        observation, info = env.reset(seed=first)
        noises = [np.random.default_rng([first + k, 1]) for k in range(worlds)]
        drawn = _drawn(info)
        tracks, age, everyone = Tracks(worlds), np.zeros(worlds, dtype=np.int64), np.arange(worlds)
        tracks.begin(everyone, observation)
        start, state = np.ones(worlds, dtype=bool), None
        kept = policy.observation == self.settings.observation
        while given < total:
            reads = observation if kept else env.unwrapped.observed(policy.observation)
            action, state = policy.predict(reads, state, start, deterministic=True)
            if deviation > 0.0:
                action = action + deviation * np.stack([each.standard_normal(action.shape[1]) for each in noises])
            action = np.clip(action, low, high).astype(np.float32)
            observation, reward, terminated, truncated, info = env.step(action)
            tracks.add(age, observation, action, reward)
            age += 1
            start = terminated | truncated
            ended = np.flatnonzero(start)
            for world in ended[number[ended] < total].tolist():
                rows, actions, rewards = tracks.cut(world, int(age[world]))
                waiting[int(number[world])] = Episode(
                    first + int(number[world]),
                    rows,
                    actions,
                    rewards,
                    bool(terminated[world]),
                    bool(truncated[world]),
                    bool(info["is_success"][world]),
                    {name: np.copy(value[world]) for name, value in drawn.items()},
                )
            while given in waiting:
                yield waiting.pop(given)
                given += 1
            if len(ended) and given < total:
                number[ended] = begun + np.arange(len(ended))
                begun += len(ended)
                seeds: list[int | None] = [None] * worlds
                for world in ended.tolist():
                    seed = seeds[world] = first + int(number[world])
                    noises[world] = np.random.default_rng([seed, 1])
                observation, info = env.reset(seed=seeds, options={"reset_mask": start})
                for name, value in _drawn(info).items():
                    drawn[name][ended] = value[ended]
                tracks.begin(ended, observation)
                age[ended] = 0


def _drawn(info: dict[str, Any]) -> dict[str, np.ndarray]:
    return {name: np.array(value) for name, value in info.get("drawn", {}).items() if not name.startswith("_")}
