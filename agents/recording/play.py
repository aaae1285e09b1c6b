"""Episodes of a policy, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from agents.recording.record_settings import RecordSettings
from agents.recording.tracks import Tracks
from vibgym import checks
from vibgym.envs.vector import batch_of
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes
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
                raise checks.conflict(f"environment.{name} cannot be set for recordings")
        given = dict(settings.environment)
        action = given.pop("action", None)
        first: Any = batch_of(settings.task, num_envs=1, **given)
        self.policy: Policy = make_policy(settings.policy, TaskInfo.of(first), settings.first_seed)
        first.close()
        checks.choice("environment.action", action or self.policy.action, (self.policy.action,))
        self.kwargs = {**given, "action": self.policy.action, "observation": settings.observation}
        self.env: Any = batch_of(
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
        settings, env, given, waiting = self.settings, self.env, 0, dict[int, Episode]()
        seeds = range(settings.first_seed, settings.first_seed + settings.episodes)
        tracks, drawn = Tracks(env.num_envs), dict[str, np.ndarray]()
        actor, number = Actor(self.policy, env, settings.observation, settings.noise), np.full(env.num_envs, -1)

        def began(fresh: np.ndarray, observation: Any, info: dict[str, Any]) -> None:
            worlds = np.flatnonzero(fresh)
            number[worlds] = number.max() + 1 + np.arange(len(worlds))
            actor.begin({int(world): seeds[number[world]] for world in worlds})
            for name, value in _drawn(info).items():
                drawn.setdefault(name, value)[worlds] = value[worlds]
            tracks.begin(worlds, observation)

        for step in Episodes(actor, env, seeds, began):
            tracks.add(step.age - 1, step.observation, step.action, step.reward)
            for world in np.flatnonzero(step.ended).tolist():
                episode = int(step.episode[world])
                waiting[episode] = Episode(
                    seeds[episode],
                    *tracks.cut(world, int(step.age[world])),
                    bool(step.terminated[world]),
                    bool(step.truncated[world]),
                    bool(step.info["is_success"][world]),
                    {name: np.copy(value[world]) for name, value in drawn.items()},
                )
            while given in waiting:
                yield waiting.pop(given)
                given += 1


class Actor:
    """The policy as it is recorded: it reads its own observation, whichever is kept, and its actions get noise.

    Args:
        policy, env: who acts where.
        kept: name of the observation that the environment gives.
        noise: standard deviation of what is added to every number of an action.
    """

    def __init__(self, policy: Policy, env: Any, kept: str, noise: float) -> None:
        self.policy, self.env, self.noise = policy, env, noise
        self.action, self.observation = policy.action, kept
        self._noises: list[np.random.Generator] = [np.random.default_rng(0)] * env.num_envs

    def begin(self, seeds: Mapping[int, int]) -> None:
        """Episodes with these seeds begin, by world: the noise of each follows from its own."""
        for world, seed in seeds.items():
            self._noises[world] = np.random.default_rng([seed, 1])

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """See :class:`vibgym.policies.protocol.Policy`."""
        if self.policy.observation != self.observation:
            observation = self.env.unwrapped.observed(self.policy.observation)
        action, state = self.policy.predict(observation, state, episode_start, deterministic)
        if self.noise > 0.0:
            action = action + self.noise * np.stack([each.standard_normal(action.shape[1]) for each in self._noises])
        space = self.env.single_action_space
        return np.clip(action, space.low, space.high).astype(np.float32), state


def _drawn(info: dict[str, Any]) -> dict[str, np.ndarray]:
    return {name: np.array(value) for name, value in info.get("drawn", {}).items() if not name.startswith("_")}
