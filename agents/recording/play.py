"""Episodes of a policy, recorded step by step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from agents.recording.record_settings import RecordSettings
from vibgym import checks
from vibgym.envs.vector import batch_of
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes
from vibgym.policies.task_info import TaskInfo


class Episode(NamedTuple):
    """Record of an episode."""

    seed: int
    observations: Any  # (steps + 1, ...), or a dictionary of such
    actions: np.ndarray  # (steps, size), as they were done
    rewards: np.ndarray  # (steps,)
    terminated: bool
    truncated: bool
    success: bool
    drawn: dict[str, np.ndarray]  # randomized values of the episode, see ``info["drawn"]``


class Recorder:
    """A policy on a batch of worlds.

    Args:
        settings: of the recording.

    Attributes:
        policy: as made for the environment.
        env: the batch.

    Raises:
        ValueError: an invalid environment or policy, or a policy that does not serve the environment.
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
        """Yield the episodes in the order of their seeds. A world whose episode has ended begins the next one."""
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
    """The policy with its own observation, independent of the recorded one, and with noise on its actions.

    Args:
        policy, env: the policy and its environment.
        kept: name of the observation that the environment returns.
        noise: standard deviation of the noise on every entry of an action.
    """

    def __init__(self, policy: Policy, env: Any, kept: str, noise: float) -> None:
        self.policy, self.env, self.noise = policy, env, noise
        self.action, self.observation = policy.action, kept
        self._noises: list[np.random.Generator] = [np.random.default_rng(0)] * env.num_envs

    def begin(self, seeds: Mapping[int, int]) -> None:
        """Seed the noise of worlds whose episodes begin; ``seeds`` by world."""
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


ACTION, REWARD = ("action",), ("reward",)  # keys that no observation has


class Tracks:
    """Observations, actions and rewards of the current episode of every world."""

    def __init__(self, worlds: int) -> None:
        self.worlds, self.steps = worlds, 64
        self._kept: dict[Any, np.ndarray] = {}

    def begin(self, worlds: np.ndarray, observation: Any) -> None:
        """Begin episodes of these worlds with their current observation."""
        for name, value in _named(observation):
            self._room(name, value)[worlds, 0] = value[worlds]

    def add(self, age: np.ndarray, observation: Any, action: np.ndarray, reward: np.ndarray) -> None:
        """Add a step of all worlds; ``age`` (worlds,) is the number of steps before it."""
        if age.max() + 2 > self.steps:
            self.steps *= 2
            self._kept = {
                name: np.concatenate((each, np.empty_like(each)), axis=1) for name, each in self._kept.items()
            }
        everyone = np.arange(self.worlds)
        for name, value in _named(observation):
            self._room(name, value)[everyone, age + 1] = value
        for name, value in ((ACTION, action), (REWARD, reward)):
            self._room(name, value)[everyone, age] = value

    def cut(self, world: int, steps: int) -> tuple[Any, np.ndarray, np.ndarray]:
        """Return observations (steps + 1), actions and rewards of a world's episode."""
        seen = {
            name: each[world, : steps + 1].copy() for name, each in self._kept.items() if name not in (ACTION, REWARD)
        }
        action, reward = (self._kept[name][world, :steps].copy() for name in (ACTION, REWARD))
        return seen[None] if None in seen else seen, action, reward

    def _room(self, name: Any, value: np.ndarray) -> np.ndarray:
        if name not in self._kept:
            self._kept[name] = np.empty((self.worlds, self.steps, *value.shape[1:]), dtype=value.dtype)
        return self._kept[name]


def _named(observation: Any) -> Iterable[tuple[Any, np.ndarray]]:
    return observation.items() if isinstance(observation, dict) else ((None, observation),)
