"""One policy on one task over a list of seeds: all worlds in one batch, the first episode of each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from agents.policy import Policy
from vibgym.envs.core import Core

WATCHED_AMONG = 30
"""The world that is filmed is one of the first so many, which are also those of the trajectory plot."""

TURN_WEIGHT = 0.1  # m/rad: a turn of 1 rad counts as far as 100 mm when the farthest goal is chosen


@dataclass(frozen=True)
class Timing:
    """Wall times of a rollout, s. The first step is left out: it may compile kernels."""

    world_steps: int  # steps of all worlds together, finished worlds included
    total: float
    policy: float  # in predict()
    environment: float  # in step()

    def rates(self) -> tuple[float, float, float]:
        """Steps of worlds per second: all in all, of the policy alone, of the environment alone; nan without a step."""
        times = (self.total, self.policy, self.environment)
        return tuple(self.world_steps / each if each > 0.0 else float("nan") for each in times)  # type: ignore[return-value]


@dataclass(frozen=True)
class Film:
    """One world of a rollout, frame by frame; frame 0 is the start, with all elements at rest."""

    seed: int
    poses: np.ndarray  # (frames, 3) m, m, rad
    phasors: np.ndarray  # (frames, rows, columns, 2) float32, fractions of full scale, of the step that led to the pose
    goal: np.ndarray  # (3,)
    success: bool


@dataclass(frozen=True)
class Rollout:
    """Records of one policy on one task. Arrays are (episodes,) unless said otherwise, in the order of the seeds."""

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
    path_length: np.ndarray  # m, of the centre, sampled once a step
    poses: np.ndarray  # (episodes, most steps + 1, 3) float32; nan after the end
    goals: np.ndarray  # (episodes, 3)
    timing: Timing
    film: Film

    @property
    def time_to_goal(self) -> np.ndarray:
        """Simulated time until success was established, its hold of ten steps included, s; nan without success."""
        return np.where(self.success, self.steps * self.step_time, np.nan)

    @property
    def path_efficiency(self) -> np.ndarray:
        """Straight line from start to goal over the path travelled, of successes; nan where the goal is at the start."""
        straight = np.hypot(*(self.goals[:, :2] - self.poses[:, 0, :2]).T)
        sensible = self.success & (straight > 0.010) & (self.path_length > 0.0)
        return np.where(sensible, straight / np.maximum(self.path_length, 1e-12), np.nan)


def farthest_goal(core: Core) -> int:
    """World among the first ones whose goal is farthest: worth watching, and the same for every policy."""
    distance = core.score.distance + TURN_WEIGHT * np.abs(core.score.error[:, 2])
    return int(distance[:WATCHED_AMONG].argmax())


def run(
    policy: Policy, task: str, seeds: Sequence[int], environment: dict[str, Any], name: str = "", quiet: bool = False
) -> Rollout:
    """Run ``policy`` on ``task``, one world for each seed.

    The policy gets observations and nothing else. Every world counts with its first episode; all have ended on return.

    Args:
        policy: predicts actions for a batch.
        task: "Transport", "Align" or "Rotate".
        seeds: of the worlds' resets.
        environment: keyword arguments of the environment other than action and observation.
        name: of the policy, for the progress bar.
        quiet: no progress bar.
    """
    worlds = len(seeds)
    env = gym.make_vec(
        f"vibgym/{task}-v0", num_envs=worlds, action=policy.action, observation=policy.observation, **environment
    )
    core: Core = env.unwrapped.core  # type: ignore[attr-defined]
    limit: int = env.unwrapped.max_episode_steps  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=list(seeds))  # type: ignore[arg-type]
    pose = core.simulator.state.pose
    poses = np.full((worlds, limit + 1, 3), np.nan, dtype=np.float32)
    poses[:, 0] = pose[:, 0]
    goals, last = core.goal.copy(), pose[:, 0, :2].copy()
    record: dict[str, np.ndarray] = {
        "steps": np.zeros(worlds, dtype=np.int64),
        **{key: np.zeros(worlds, dtype=bool) for key in ("success", "fallen", "diverged")},
        **{key: np.zeros(worlds) for key in ("returns", "position_error", "path_length")},
        "heading_error": np.full(worlds, np.nan),
    }
    watched = farthest_goal(core)
    film_poses, film_phasors = [pose[watched, 0].copy()], [core.phasors(watched).astype(np.float32)]
    alive, resetting = np.ones(worlds, dtype=bool), np.zeros(worlds, dtype=bool)
    start, state, step = np.ones(worlds, dtype=bool), None, 0
    policy_time = environment_time = 0.0
    with tqdm(total=worlds, desc=f"{task:>9} {name:<12}", unit="ep", disable=quiet) as bar:
        while alive.any():
            before = time.perf_counter()
            action, state = policy.predict(observation, state, start, deterministic=True)
            between = time.perf_counter()
            observation, reward, terminated, truncated, info = env.step(action)
            after = time.perf_counter()
            step += 1
            if step > 1:
                policy_time += between - before
                environment_time += after - between
            here = pose[:, 0, :2].copy()
            record["returns"][alive] += reward[alive]
            record["path_length"][alive] += np.hypot(*(here - last).T)[alive]
            last = here
            poses[alive, step] = pose[alive, 0]
            if alive[watched]:
                film_poses.append(pose[watched, 0].copy())
                film_phasors.append(core.phasors(watched).astype(np.float32))
            ended = alive & (terminated | truncated)
            if ended.any():
                record["steps"][ended] = step
                record["success"][ended] = info["is_success"][ended]
                for key in ("fallen", "diverged", "position_error", "heading_error"):
                    if key in info:
                        record[key][ended] = info[key][ended]
                alive &= ~ended
                bar.update(int(ended.sum()))
            # A finished world is reset by the next step, so its first observation is seen by the prediction after that.
            start, resetting = resetting, terminated | truncated
    env.close()
    film = Film(
        seeds[watched], np.array(film_poses), np.array(film_phasors), goals[watched], bool(record["success"][watched])
    )
    return Rollout(
        task=task,
        seeds=tuple(seeds),
        step_time=core.surface.period * core.periods,
        poses=poses,
        goals=goals,
        timing=Timing(worlds * (step - 1), policy_time + environment_time, policy_time, environment_time),
        film=film,
        **record,
    )
