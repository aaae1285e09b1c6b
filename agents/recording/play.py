"""Episodes of a policy, recorded step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.envs.vector import batch_of
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes
from vibgym.policies.task_info import TaskInfo

if TYPE_CHECKING:
    from agents.recording.record import RecordSettings


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
        actor, drawn = Actor(self.policy, env, settings.observation, settings.noise), dict[str, np.ndarray]()
        history: list[tuple[Any, np.ndarray, np.ndarray]] = []  # observation before, action and reward of each step
        first = np.zeros(env.num_envs, dtype=int)  # step of the history at which the world's episode began
        started, now = 0, None

        def began(fresh: np.ndarray, observation: Any, info: dict[str, Any]) -> None:
            nonlocal started, now
            now, worlds = observation, np.flatnonzero(fresh)
            first[worlds] = len(history)
            actor.begin({world: seeds[started + k] for k, world in enumerate(worlds.tolist())})
            started += len(worlds)
            for name, value in _drawn(info).items():
                drawn.setdefault(name, value)[worlds] = value[worlds]

        for step in Episodes(actor, env, seeds, began):
            history.append((now, step.action, step.reward))
            now = step.observation
            for world in np.flatnonzero(step.ended).tolist():
                observations, actions, rewards = zip(*history[first[world] :], strict=True)
                episode = int(step.episode[world])
                waiting[episode] = Episode(
                    seeds[episode],
                    _of_world((*observations, now), world),
                    _of_world(actions, world),
                    _of_world(rewards, world),
                    bool(step.terminated[world]),
                    bool(step.truncated[world]),
                    bool(step.info["is_success"][world]),
                    {name: np.copy(value[world]) for name, value in drawn.items()},
                )
            past = first[step.playing].min()
            del history[:past]  # no episode needs it
            first -= past
            while given in waiting:
                yield waiting.pop(given)
                given += 1


def _of_world(steps: Sequence[Any], world: int) -> Any:
    """Return the values of a world at all steps: an array (steps, ...), or a dictionary of such."""
    if isinstance(steps[0], dict):
        return {name: np.stack([each[name][world] for each in steps]) for name in steps[0]}
    return np.stack([each[world] for each in steps])


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
