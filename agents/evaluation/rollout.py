"""One policy on one task over a list of seeds: all worlds in one batch, the first episode of each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from agents.evaluation.log import SERIES, Ends, Film, Log, Measures
from vibgym.policies.protocol import Policy

Kept = TypeVar("Kept", bound=Ends)

LEAST_WAY = 0.010
"""m: over shorter ways an efficiency says nothing."""


@dataclass(frozen=True)
class Timing:
    """Wall times of a rollout, s, as long as all worlds are at work. The first step is left out: it may compile kernels."""

    world_steps: int  # steps of all worlds together
    total: float
    policy: float  # in predict()
    environment: float  # in step()

    def rates(self) -> tuple[float, float, float]:
        """Steps of worlds per second: all in all, of the policy alone, of the environment alone; nan without a step."""
        times = (self.total, self.policy, self.environment)
        return tuple(self.world_steps / each if each > 0.0 else float("nan") for each in times)  # type: ignore[return-value]


@dataclass(frozen=True)
class Outcomes:
    """How one policy's episodes on one task ended. Arrays are (episodes,), in the order of the seeds."""

    task: str
    seeds: tuple[int, ...]
    step_time: float  # s that one step lasts in the simulated world
    steps: np.ndarray  # int64, until success, fall, divergence or the step limit
    success: np.ndarray  # bool
    fallen: np.ndarray  # bool
    diverged: np.ndarray  # bool
    returns: np.ndarray  # sum of rewards
    position_error: np.ndarray  # m, at the end
    heading_error: np.ndarray  # rad, at the end, magnitude; nan where the heading does not count
    path_error: np.ndarray  # m, rms distance from a goal that moves, of the part that was worst; nan where goals stay

    @property
    def time_to_goal(self) -> np.ndarray:
        """Simulated time until success was established, its hold included, s; nan without success."""
        return np.where(self.success, self.steps * self.step_time, np.nan)


@dataclass(frozen=True)
class Measured(Outcomes):
    """The same, with what each episode is measured by."""

    bound: np.ndarray  # s, least time to goal from this start, hold included; nan where none is known
    collisions: np.ndarray  # pairs newly in touch, see Touches; nan where the task does not count them

    @property
    def time_over_bound(self) -> np.ndarray:
        """Time to goal as a multiple of the least one; nan without success, and where no bound is known."""
        return self.time_to_goal / self.bound


@dataclass(frozen=True)
class Rollout(Measured):
    """Records of one policy on one task. Arrays are (episodes,) unless said otherwise, in the order of the seeds."""

    path_lengths: np.ndarray  # (episodes, parts) m, of the centres, sampled once a step; 0 of absent parts
    straight: np.ndarray  # m, shortest way of all parts together, see below
    poses: np.ndarray  # (episodes, most steps + 1, parts, 3) float32; nan after the end, and of absent parts
    goals: np.ndarray  # (episodes, parts, 3); zeros for tasks without goal poses
    series: (
        np.ndarray
    )  # (SERIES, episodes, most steps + 1) float32; nan after the end, and where a task does not say it
    timing: Timing
    film: Film

    @property
    def path_length(self) -> np.ndarray:
        """Path travelled, of all parts together, m."""
        return self.path_lengths.sum(axis=1)

    @property
    def path_efficiency(self) -> np.ndarray:
        """Shortest way over path travelled, of successes; nan where there was hardly any way to go.

        The shortest way is the straight line from the start to the goal, in Sort to the nearest point of the part's zone. In
        Singulate, where parts have no goals of their own, it is the one from the start to where the part ended.
        """
        path = self.path_length
        sensible = self.success & (self.straight > LEAST_WAY) & (path > 0.0)
        return np.where(sensible, self.straight / np.maximum(path, 1e-12), np.nan)

    def over_time(self, name: str) -> np.ndarray | None:
        """One of :data:`agents.evaluation.log.SERIES`, (episodes, most steps + 1); None where the task does not say it."""
        values = self.series[SERIES.index(name)]
        return values if np.isfinite(values).any() else None

    @property
    def parts_done(self) -> np.ndarray:
        """Parts done at the end; nan where they are not counted."""
        done = self.series[SERIES.index("parts_done")]
        return done[np.arange(len(self.steps)), self.steps].astype(np.float64)

    @property
    def throughput(self) -> np.ndarray:
        """Parts done at the end over the episode's simulated time, 1/s; nan where they are not counted."""
        return self.parts_done / (self.steps * self.step_time)

    @property
    def clearance(self) -> np.ndarray:
        """Smallest distance between parts on the whole way, start included, m; nan without a second part."""
        clearances = self.series[SERIES.index("clearance")]
        least = np.where(np.isnan(clearances), np.inf, clearances).min(axis=1)
        return np.where(np.isfinite(least), least, np.nan).astype(np.float64)


def run(
    policy: Policy, task: str, seeds: Sequence[int], environment: dict[str, Any], name: str = "", quiet: bool = False
) -> Rollout:
    """Run ``policy`` on ``task``, one world for each seed, and write down all that the report shows.

    The policy gets observations and nothing else. Every world counts with its first episode; all have ended on return. One
    that has ended begins another with its first part alone, which costs little, and nobody looks.

    Args:
        policy: predicts actions for a batch.
        task: name of the environment without ``vibgym/`` and version, such as "Transport".
        seeds: of the worlds' resets.
        environment: keyword arguments of the environment other than action and observation.
        name: of the policy, for the progress bar.
        quiet: no progress bar.
    """
    log, timing = _episodes(Log, policy, task, seeds, environment, name, quiet)
    film = log.film(seeds[log.watched])
    return Rollout(task, tuple(seeds), log.env.step_time, timing=timing, film=film, **log.fields)


def outcomes(
    policy: Policy, task: str, seeds: Sequence[int], environment: dict[str, Any], name: str = "", quiet: bool = False
) -> Outcomes:
    """The same episodes as of :func:`run`, of which only the ends are kept."""
    ends, _ = _episodes(Ends, policy, task, seeds, environment, name, quiet)
    return Outcomes(task, tuple(seeds), ends.env.step_time, **ends.fields)


def measured(
    policy: Policy, task: str, seeds: Sequence[int], environment: dict[str, Any], name: str = "", quiet: bool = False
) -> Measured:
    """The same episodes as of :func:`run`: their ends, their bounds and the collisions on the way."""
    found, _ = _episodes(Measures, policy, task, seeds, environment, name, quiet)
    return Measured(task, tuple(seeds), found.env.step_time, **found.fields)


def _episodes(
    kept: type[Kept],
    policy: Policy,
    task: str,
    seeds: Sequence[int],
    environment: dict[str, Any],
    name: str,
    quiet: bool,
) -> tuple[Kept, Timing]:
    """The first episode of every world, written down by a record of the class ``kept``."""
    worlds = len(seeds)
    env = gym.make_vec(
        f"vibgym/{task}-v0",
        num_envs=worlds,
        action=policy.action,
        observation=policy.observation,
        autoreset_mode=AutoresetMode.DISABLED,
        **environment,
    )
    base: Any = env.unwrapped
    observation, info = env.reset(seed=list(seeds))  # type: ignore[arg-type]
    log = kept(base, info, base.max_episode_steps)
    parked: dict[str, Any] = {"parts": [0]} if len(base.parts) > 1 else {}
    alive, start = np.ones(worlds, dtype=bool), np.ones(worlds, dtype=bool)
    state, step, timed, policy_time, environment_time = None, 0, 0, 0.0, 0.0
    with tqdm(total=worlds, desc=f"{task:>9} {name:<12}", unit="ep", disable=quiet) as bar:
        while alive.any():
            before = time.perf_counter()
            action, state = policy.predict(observation, state, start, deterministic=True)
            between = time.perf_counter()
            observation, reward, terminated, truncated, info = env.step(action)
            after = time.perf_counter()
            step += 1
            if step > 1 and alive.all():
                timed += worlds
                policy_time += between - before
                environment_time += after - between
            log.fields["returns"][alive] += reward[alive]
            log.write(step, alive, info)
            start = terminated | truncated
            ended = alive & start
            if ended.any():
                log.end(step, ended, info)
                alive &= ~ended
                bar.update(int(ended.sum()))
            if start.any() and alive.any():
                observation, _ = env.reset(options={"reset_mask": start, **parked})
    env.close()
    return log, Timing(timed, policy_time + environment_time, policy_time, environment_time)
