"""Episodes of a policy: :func:`rollout` returns their outcomes, :class:`Episodes` iterates them step by step."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from vibgym import checks
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.vector import batch_of, environment_id
from vibgym.policies.by_parts import ByParts
from vibgym.policies.foreign import ModelPolicy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.tasks.episode import EVENTS

CUSTOM_INFO = (
    *(f"{event}_per_minute" for event in EVENTS[1:]), "transit", "on_table", "pattern_error", "coverage"
)  # fmt: skip
"""Entries of ``info`` at the end of episodes of some tasks only: parts a minute by event, s from arrival to leaving, parts on
the table (Feed); rms error, m (Pack); covered share of the goal's area (Push)."""


@dataclass
class Timing:
    """Wall times of a rollout, s, while all worlds are in use. The first step is excluded: it may compile kernels."""

    world_steps: int = 0  # steps of all worlds together
    policy: float = 0.0  # in predict()
    environment: float = 0.0  # in step()


@dataclass(frozen=True, eq=False)
class RolloutStep:
    """Result of one step of all worlds. Arrays are (worlds, ...)."""

    episode: np.ndarray  # int64, index of the episode's seed
    age: np.ndarray  # int64, steps of this episode, this one included
    playing: np.ndarray  # bool; False where no seeds are left: the world's data are ignored
    ended: np.ndarray  # bool, where an episode that counts has ended
    action: np.ndarray  # of this step
    observation: Any  # after the step, as are all below
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    info: dict[str, Any]


class Episodes:
    """Iterator over the steps (:class:`RolloutStep`) of an episode for every seed, until all have ended.

    A world whose episode has ended takes the next seed. Where none is left it begins another episode with its first part alone,
    which costs little. Actions are deterministic.

    Args:
        policy: acts in all worlds.
        env: vector environment of vibgym with ``autoreset_mode="Disabled"`` and the policy's action and observation, of at
            most as many worlds as there are seeds.
        seeds: of the episodes' resets.
        began: called with (worlds,) bool, observation and info where episodes that count have begun.
        options: of every reset of an episode that counts.

    Attributes:
        timing: wall times so far.
    """

    def __init__(
        self,
        policy: Policy,
        env: Any,
        seeds: Iterable[int],
        began: Callable[[np.ndarray, Any, dict[str, Any]], None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        self.policy, self.env, self.seeds = policy, env, list(seeds)
        self.timing = Timing()
        self._began, self._options = began, options or {}
        self._episode, self._age = np.zeros((2, env.num_envs), dtype=np.int64)
        self._taken, self._idle = 0, {"parts": [0]} if len(env.unwrapped.parts) > 1 else {}
        self._renew(np.ones(env.num_envs, dtype=bool))

    def __iter__(self) -> Iterator[RolloutStep]:
        env, state, start = self.env, None, np.ones(self.env.num_envs, dtype=bool)
        playing, first = self._episode < len(self.seeds), True
        while playing.any():
            before = time.perf_counter()
            action, state = self.policy.predict(self._observation, state, start, deterministic=True)
            between = time.perf_counter()
            observation, reward, terminated, truncated, info = env.step(action)
            if playing.all() and not first:
                self.timing.world_steps += len(playing)
                self.timing.policy += between - before
                self.timing.environment += time.perf_counter() - between
            first, start = False, terminated | truncated
            self._observation = observation
            self._age += 1
            yield RolloutStep(
                self._episode.copy(), self._age.copy(), playing, playing & start, action, observation, reward,
                terminated, truncated, info,
            )  # fmt: skip
            if start.any():
                self._renew(start)
            playing = self._episode < len(self.seeds)

    def _renew(self, over: np.ndarray) -> None:
        """Begin other episodes in the worlds ``over`` (worlds,) bool, unless all episodes have ended."""
        worlds = np.flatnonzero(over)
        self._age[worlds] = 0
        self._episode[worlds] = self._taken + np.arange(len(worlds))
        self._taken += len(worlds)
        playing = self._episode < len(self.seeds)
        fresh, idle = over & playing, over & ~playing
        if fresh.any():
            seeds = [self.seeds[k] if new else None for k, new in zip(self._episode.tolist(), fresh, strict=True)]
            self._observation, info = self.env.reset(seed=seeds, options={**self._options, "reset_mask": fresh})
            if self._began is not None:
                self._began(fresh, self._observation, info)
        if idle.any() and playing.any():
            self._observation, _ = self.env.reset(options={"reset_mask": idle, **self._idle})


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of a policy's episodes on one task. Arrays are (episodes,), in the order of the seeds."""

    task: str
    seeds: tuple[int, ...]
    step_time: float  # s, simulated time of a step
    timing: Timing
    steps: np.ndarray  # int64, until success, fall, divergence or the step limit
    success: np.ndarray  # bool
    fallen: np.ndarray  # bool
    diverged: np.ndarray  # bool
    returns: np.ndarray  # sum of rewards
    position_error: np.ndarray  # m, at the end; nan where a task does not report it
    heading_error: np.ndarray  # rad, at the end, magnitude; nan where the heading does not count
    cost: np.ndarray  # sum of info["cost"]; nan without ``costs``
    path_error: np.ndarray  # m, rms distance of the worst part from a goal that moves; nan where goals stay
    info: np.ndarray  # (episodes, CUSTOM_INFO) values of ``info`` at the end; nan where a task does not report them

    @property
    def time_to_goal(self) -> np.ndarray:
        """Simulated time until success was established, its hold included, s; nan without success."""
        return np.where(self.success, self.steps * self.step_time, np.nan)

    def reported(self, name: str) -> np.ndarray:
        """Return one of :data:`CUSTOM_INFO`, (episodes,)."""
        return self.info[..., CUSTOM_INFO.index(name)]


class Ends:
    """Collector of the outcomes of episodes.

    Args:
        env: a vector environment whose episodes have just begun.
        info: returned by its reset.
        seeds: of all episodes.

    Attributes:
        fields: arrays (episodes, ...), named as in :class:`Outcomes`.
    """

    def __init__(self, env: VibgymVectorEnv, info: dict[str, Any], seeds: Sequence[int]) -> None:
        self.env, self.seeds, count = env, tuple(seeds), len(seeds)
        self.fields: dict[str, np.ndarray] = {
            "steps": np.zeros(count, dtype=np.int64),
            **{key: np.zeros(count, dtype=bool) for key in ("success", "fallen", "diverged")},
            "returns": np.zeros(count),
            "cost": np.full(count, 0.0 if "cost" in info else np.nan),
            **{key: np.full(count, np.nan) for key in ("position_error", "heading_error", "path_error")},
            "info": np.full((count, len(CUSTOM_INFO)), np.nan),
        }

    def add(self, step: RolloutStep) -> None:
        """Add a step."""
        fields, info = self.fields, step.info
        fields["returns"][step.episode[step.playing]] += step.reward[step.playing]
        if "cost" in info:
            fields["cost"][step.episode[step.playing]] += info["cost"][step.playing]
        if step.ended.any():
            which = step.episode[step.ended]
            fields["steps"][which] = step.age[step.ended]
            fields["success"][which] = info["is_success"][step.ended]
            for key in ("fallen", "diverged", "position_error", "heading_error", "path_error"):
                if key in info:
                    fields[key][which] = info[key][step.ended]
            for column, key in enumerate(CUSTOM_INFO):
                if key in info:
                    fields["info"][which, column] = info[key][step.ended]

    def result(self, task: str, timing: Timing) -> Outcomes:
        """Return the result, when all episodes have ended."""
        return Outcomes(task, self.seeds, self.env.step_time, timing, **self.fields)


def rollout(
    policy: Any,
    task: str,
    /,
    *,
    seeds: Iterable[int],
    keep: Callable[..., Any] = Ends,
    progress: Callable[[int], Any] | None = None,
    **environment: Any,
) -> Any:
    """Run an episode for every seed, all of them in one batch of worlds, with deterministic actions.

    Args:
        policy: anything that :func:`vibgym.policies.make_policy` takes.
        task: id of a registered environment, such as ``"vibgym/Sort-v0"``, or short ``"Sort"``.
        seeds: of the episodes' resets, integers.
        keep: collector: ``keep(env, info, seeds)`` receives every :class:`RolloutStep` and returns a result, as :class:`Ends`;
            :class:`vibgym.policies.measures.Measures` also has time bounds and collisions.
        progress: called with the number of episodes that have ended since the last call.
        **environment: keyword arguments of the environment, as for ``gym.make``.

    Returns:
        :class:`Outcomes`, or the result of ``keep``; arrays in the order of the seeds.

    Raises:
        ValueError: an unknown environment, one that is not of vibgym or has no step limit, a policy that does not serve it, or
            a bad seed or setting.
    """
    name, numbers = environment_id(task), list(seeds)
    if not numbers:
        raise checks.refuse("seeds", numbers, "one seed at least")
    for seed in numbers:
        checks.count("seeds", seed, least=0, most=2**63 - 1)
    for key in ("num_envs", "autoreset_mode"):
        if key in environment:
            raise checks.conflict(f"{key} cannot be set: rollout runs one world per seed")
    acting, interface = _acting(policy, name, environment, numbers[0])
    env = worlds_of(name, len(numbers), **{**environment, **interface})
    try:
        if isinstance(acting, ByParts):
            acting.kinds = env.unwrapped.core.kinds  # type: ignore[attr-defined]
        if isinstance(acting, ModelPolicy):
            acting.check(env.single_observation_space)
        return run(acting, env, numbers, task, keep=keep, progress=progress)
    finally:
        env.close()


def run(
    policy: Policy,
    env: Any,
    seeds: Sequence[int],
    task: str,
    *,
    keep: Callable[..., Any] = Ends,
    progress: Callable[[int], Any] | None = None,
    options: dict[str, Any] | None = None,
) -> Any:
    """Run an episode for every seed in an environment; see :func:`rollout`.

    Args:
        policy, env, options: see :class:`Episodes`.
        seeds: one for every world.
        task: name of the environment in the result.
        keep, progress: see :func:`rollout`.
    """
    kept: list[Any] = []
    episodes = Episodes(policy, env, seeds, lambda _, __, info: kept.append(keep(env.unwrapped, info, seeds)), options)
    for step in episodes:
        kept[0].add(step)
        if progress is not None and step.ended.any():
            progress(int(step.ended.sum()))
    return kept[0].result(task, episodes.timing)


def _acting(policy: Any, name: str, environment: dict[str, Any], seed: int) -> tuple[Policy, dict[str, str]]:
    """Return the policy, and the action and observation of its environment."""
    wanted = {key: environment[key] for key in ("action", "observation") if key in environment}
    if not all(hasattr(policy, attribute) for attribute in ("predict", "action", "observation")):
        if hasattr(policy, "predict") and not hasattr(policy, "action") and "action" in wanted:
            policy = {"policy": policy, "action": wanted["action"]}
        env = batch_of(name, num_envs=1, **environment)
        policy = make_policy(policy, TaskInfo.of(env), seed)
        env.close()
    interface = {"action": policy.action, "observation": policy.observation}
    for key, value in wanted.items():
        checks.choice(key, value, (interface[key],))
    return policy, interface


def worlds_of(task: str, count: int, **arguments: Any) -> VectorEnv:
    """Return a vector environment for :class:`Episodes`.

    Args:
        task: see :func:`vibgym.envs.vector.environment_id`.
        count: number of worlds.
        **arguments: of the environment.

    Raises:
        ValueError: a bad setting, or an environment without a step limit.
    """
    env = batch_of(task, num_envs=count, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    if env.unwrapped.max_episode_steps is None:
        raise checks.refuse("task", task, "environments with a step limit: episodes must end")
    return env
